"""The page Plant: a plant served in real time, seen live, with faults at a click."""

from __future__ import annotations

from collections import deque
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import streamlit as st

from workbench.analysis.usual import usual_controller
from workbench.core.errors import InputError
from workbench.core.names import unit_of, words_of
from workbench.core.run import Array
from workbench.dashboard import session
from workbench.dashboard.machines import controller, hoist_of_session
from workbench.dashboard.plant import EVERY_S, KEPT_S, PlantProcess
from workbench.dashboard.widgets import guarded, is_dark, plain, problem, text
from workbench.effects import find, ranges_of
from workbench.figures.served import last_seconds, late_starts
from workbench.machines import HOIST, Hoist
from workbench.machines.files import machine_text
from workbench.references import allowed_carriage_speed_m_s, planned_kinds
from workbench.serve.serve import HIGHEST_RATE_HZ, LOWEST_RATE_HZ, PORTS, ProtocolName, Wish, chosen_ready
from workbench.simulate.loop import torque_limits
from workbench.view.style import label

PLANT, STARTED, PROBLEM = "plant process", "plant started as", "plant live problem"
SENT = "plant live client"  # what the plant was told last
OWN, ATTACHED = "start one", "attach to one"
NOBODY, HOLDS, MOVES = "none", "holds", "up and down"
PROTOCOLS: dict[ProtocolName, str] = {"udp": "UDP", "modbus": "Modbus TCP", "opcua": "OPC UA"}
LOOKS_EVERY_S = 0.5  # between two looks at the plant
WAITS_S = 1.0  # between two looks at one that is not there yet
WINDOWS = (10, 20, 60)
ADDRESSES = {"udp": "udp://127.0.0.1:{port}", "modbus": "127.0.0.1:{port}, Modbus TCP",
             "opcua": "opc.tcp://127.0.0.1:{port}/"}  # fmt: skip
STATES = {
    "waiting": ("blue", "waits for the first command"),
    "watchdog": ("red", "watchdog: the client is silent, torque zero"),
    "brake_closed": ("orange", "brake holds"),
    "motor_lost": ("orange", "one motor lost"),
    "limited": ("orange", "torque at its limit"),
    "slack": ("red", "wire slack"),
    "off_rail": ("red", "left the rail: stands until reset"),
    "diverged": ("red", "grew without bound: stands until reset"),
}


def show() -> None:
    """Draws the page."""
    with st.sidebar, guarded():
        machine = side_bar()
        commands = st.container()
    process = present()
    if process is None:
        _nothing()
        return
    try:
        greeting = process.greeting()
    except InputError as error:
        put_away()
        problem(error)
        return
    if greeting is None:
        _compiles()
        return
    with commands, guarded():
        client(process, machine)
        faults(process, greeting["points"], machine)
    _served(process, greeting, machine)


def _nothing() -> None:
    st.markdown("#### A plant in real time")
    st.markdown(
        "Starts the machine's plant in a process of its own on this computer, for a controller or PLC at the other end "
        "of a line: torque in; speed, height and tensions out. It is shown here live, and faults are set at a click. "
        "A built-in client, the sampled PI of the studies, moves it where no controller is at hand."
    )


@st.fragment(run_every=WAITS_S)
def _compiles() -> None:
    """Until the plant has said that it is there."""
    process = present()
    st.info("The plant's step is compiled; the first time on a computer that takes a while.",
            icon=":material/hourglass_top:")  # fmt: skip
    if process is None or process.greeting() is not None:
        st.rerun()


def _served(process: PlantProcess, greeting: dict[str, Any], machine: Hoist) -> None:
    started = started_as()
    protocol: ProtocolName = "udp" if "attach" in started else started["wish"]["protocol"]
    address = ADDRESSES[protocol].format(port=greeting["port"])
    st.markdown(f"#### {plain(greeting['name'])} · `{address}`")
    if isinstance(error := st.session_state.get(PROBLEM), InputError):
        problem(error)
    _live(machine)
    with st.expander("For your client", icon=":material/lan:"):
        _how_to_connect(protocol, address, greeting["points"], started)


@st.fragment(run_every=LOOKS_EVERY_S)
def _live(machine: Hoist) -> None:
    """The part that is drawn anew while the plant runs."""
    process = present()
    if process is None:
        st.error("The plant has ended; start it again.", icon=":material/error:")
        return
    try:
        seen = latest(process)
    except InputError as error:
        problem(error)
        return
    if not seen.now:
        return
    left, right = st.columns([3.0, 1.0], vertical_alignment="center")
    with left:
        _state(seen)
    window = right.segmented_control(
        "Shown", WINDOWS, default=20, key="plant window", required=True, format_func=lambda s: f"{s} s",
        label_visibility="collapsed",
    )  # fmt: skip
    _cards(seen)
    limit = torque_limits(machine)["u_one" if seen.told("motor_lost") else "u_all"]
    events = [(float(at), str(words)) for at, words in seen.answer["events"]]
    # A picture rather than a chart: streamlit would draw a chart anew from nothing each time.
    st.image(last_seconds(seen.columns, float(window or 20), limit, events, is_dark()), width="stretch")
    _pace(seen)


def _state(seen: Latest) -> None:
    told = [f":{colour}-badge[{words}]" for flag, (colour, words) in STATES.items() if seen.told(flag)]
    st.markdown(" ".join(told) or ":green-badge[under command]")
    ended = seen.answer["client"]["ended"]
    if ended:
        st.caption(plain(f"Built-in client: {ended}."))
    if seen.answer["problem"]:
        st.error(plain(seen.answer["problem"]), icon=":material/error:")


def _cards(seen: Latest) -> None:
    """Values of now, with as many decimals at rest as at speed."""
    now, pace = seen.now, seen.answer["status"]["pace"]
    shown = (
        ("Height (m)", f"{now['position_carriage_m']:.2f}", ""),
        ("Speed (rad/s)", f"{now['speed_motor_rad_s']:.1f}", ""),
        ("Torque (N m)", f"{now['torque_at_work_nm']:.0f}", "of all motors, behind the drive's limits and lag"),
        ("Drum tension (kN)", f"{1e-3 * now['tension_drum_n']:.1f}", ""),
        ("Payload (kg)", f"{now['payload_now_kg']:.0f}", ""),
        ("On time (%)", f"{pace['on_time_percent']:.2f}", f"{pace['steps']} steps at {pace['rate_hz']:g} Hz"),
    )
    with st.container(horizontal=True, key="cards plant"):
        for name, value, tip in shown:
            st.metric(name, value.replace("-", "\N{MINUS SIGN}"), help=tip or None, border=True, height="stretch")


def _pace(seen: Latest) -> None:
    pace, counts = seen.answer["status"]["pace"], seen.answer["status"]["counts"]
    left, right = st.columns([1.0, 1.6], vertical_alignment="center")
    refused = sum(count for name, count in counts.items() if name.startswith("refused"))
    rows = (
        ("Steps", f"{pace['steps']} at {pace['rate_hz']:g} Hz"),
        ("Overruns", f"{pace['overruns']}"),
        ("Latest start", f"{text(pace['latest_start_ms'], 3)} ms after it was due"),
        ("Commands", f"{counts.get('commands', 0)}, refused {refused}"),
        ("Watchdog", f"tripped {counts.get('watchdog', 0)} times"),
    )
    lines = [f"| {name} | {value} |" for name, value in rows]
    left.markdown("\n".join([lines[0], "|---|---|", *lines[1:]]))
    with right:
        st.image(late_starts(pace["jitter"], is_dark()), width="stretch")
    if seen.answer["said"]:
        with st.expander(f"What the plant says ({len(seen.answer['said'])})"):
            st.markdown("\n".join(f"- {plain(line)}" for line in seen.answer["said"]))


def _how_to_connect(protocol: ProtocolName, address: str, points: list[str], started: dict[str, Any]) -> None:
    st.markdown(
        f"{PROTOCOLS[protocol]} at `{address}`, reached from this computer only. The plant hangs still until the first "
        "torque; a second client is not heard until the first is silent. Packets, registers and nodes are in "
        "docs/serve.md."
    )
    if "wish" in started:
        st.caption(f"Watchdog {started['wish']['watchdog_s']:g} s. Points, in the order of their addresses:")
    st.code("\n".join(points), language=None, height=260)


def present() -> PlantProcess | None:
    """This session's plant, as long as its process lives."""
    process = st.session_state.get(PLANT)
    return process if isinstance(process, PlantProcess) and process.alive else None


def started_as() -> dict[str, Any]:
    """What the plant was started with: machine, protocol, wish."""
    return session.get(STARTED, dict, {})


def put_away() -> None:
    """Ends the plant, and what the page knows of it."""
    process = st.session_state.pop(PLANT, None)
    if isinstance(process, PlantProcess):
        process.end()
    for key in [str(key) for key in st.session_state if str(key).startswith("plant live")]:
        del st.session_state[key]


def side_bar() -> Hoist:
    """The side bar: what to serve, the button. Returns the machine that is served, or would be."""
    runs = present()
    if runs is not None:
        st.button(
            "Stop the plant", icon=":material/stop:", width="stretch", on_click=put_away, key="plant stop",
            help="It goes on while other pages are looked at, and ends with this session.",
        )  # fmt: skip
        served: Hoist = started_as()["machine"]
        return served
    machine = hoist_of_session("plant machine")
    way = st.segmented_control(
        "Plant", (OWN, ATTACHED), default=OWN, key="plant way", required=True, width="stretch",
        label_visibility="collapsed",
    )  # fmt: skip
    spec = _attach() if way == ATTACHED else _own(machine)
    if st.button("Attach" if way == ATTACHED else "Start the plant", type="primary", width="stretch",
                 icon=":material/play_arrow:", key="plant start"):  # fmt: skip
        _begin(spec, machine)
    return machine


def _begin(spec: dict[str, Any], machine: Hoist) -> None:
    put_away()
    try:
        process = PlantProcess({"machine": machine_text(machine), **spec})
    except InputError as error:
        problem(error)
        return
    session.put(PLANT, process)
    session.put(STARTED, {"machine": machine, **spec})
    st.rerun()


def _attach() -> dict[str, Any]:
    port = st.number_input("UDP port", 1024, 65535, PORTS["udp"], key="plant port")
    st.caption(
        "A plant that `workbench serve` runs on this computer, over UDP. The machine above is the one that the "
        "built-in client is set for."
    )
    return {"attach": int(port)}


def _own(machine: Hoist) -> dict[str, Any]:
    protocol = st.selectbox("Protocol", list(PROTOCOLS), format_func=PROTOCOLS.__getitem__, key="plant protocol")
    left, right = st.columns(2)
    rate = left.number_input("Steps a second", LOWEST_RATE_HZ, HIGHEST_RATE_HZ, 1000.0, 100.0, key="plant rate",
                             format="%g")  # fmt: skip
    watchdog = right.number_input("Watchdog (s)", 0.01, 10.0, 0.2, 0.05, key="plant watchdog", format="%g",
                                  help="A client that is silent for so long loses its torque.")  # fmt: skip
    low, high = machine.rail.lowest_position_m, machine.highest_position_m
    payload = left.number_input("Payload (kg)", 0.0, 50_000.0, 4500.0, 500.0, key="plant payload", format="%g")
    start = right.number_input("Height (m)", low, high, round(0.5 * (low + high), 1), 0.5, key="plant height",
                               format="%g")  # fmt: skip
    brake = st.toggle("Brake closes when the watchdog trips", True, key="plant watchdog brake")
    first = st.toggle(
        "Before other programs", True, key="plant priority",
        help="Asks the system to run the plant first; where that is not allowed, it runs as any program does.",
    )  # fmt: skip
    wish = Wish(
        protocol, float(rate), "127.0.0.1", 0, float(payload), float(start), float(watchdog), brake,
        tuple(chosen_ready("all", machine)), priority=first,
    )  # fmt: skip
    return {"wish": asdict(wish)}


def client(process: PlantProcess, machine: Hoist) -> None:
    """The built-in client is told anew whenever its controls, or the gains of Study and Loop, have changed."""
    what = st.segmented_control(
        "Built-in client", (NOBODY, HOLDS, MOVES), default=NOBODY, required=True, key="plant client", width="stretch",
        help="The sampled PI of Study and Loop with the gains that stand there, every 4 ms or slower. Without it the "
        "plant waits for a controller of yours.", persist_state="session",
    )  # fmt: skip
    wanted: dict[str, Any] | None = None
    if what != NOBODY:
        settings = controller(machine) or usual_controller(machine)
        wanted = {"settings": settings.model_dump(), "heights_m": None}
    if wanted is not None and what == MOVES:
        wanted |= _moves(machine)
    if wanted != st.session_state.get(SENT):
        asked(process, {"client": wanted})
        st.session_state[SENT] = wanted


def _moves(machine: Hoist) -> dict[str, Any]:
    """Heights, reference and limits of the way up and down."""
    low, high = machine.rail.lowest_position_m, machine.highest_position_m
    middle, way = 0.5 * (low + high), 0.25 * (high - low)
    between = st.slider(
        "Between (m)", low, high, (round(middle - way, 1), round(middle + way, 1)), step=0.5, key="plant way",
        persist_state="session",
    )  # fmt: skip
    fastest = 0.95 * allowed_carriage_speed_m_s(
        machine.motor.nominal_speed_rad_s, machine.gearbox.ratio, machine.winch.drum_diameter_m
    )
    limits = [
        column.number_input(
            words, 0.05, most, min(usual, most), 0.05, key=f"plant {words[0]}", format="%.3g", persist_state="session"
        )
        for column, (words, usual, most) in zip(
            st.columns(3), (("v (m/s)", 0.5, fastest), ("a (m/s²)", 0.6, 5.0), ("j (m/s³)", 0.8, 100.0)), strict=True
        )
    ]
    reference = st.selectbox(
        "Reference", list(planned_kinds()), 1, format_func=label, key="plant reference", persist_state="session"
    )
    return {"heights_m": list(between), "reference": reference, "limits": limits}


def _order(process: PlantProcess, values: dict[str, float], words: str) -> None:
    """A callback: it runs before the page, which then shows what became of it."""
    asked(process, {"order": {"set": values}, "note": words})


def asked(process: PlantProcess, question: dict[str, Any]) -> None:
    """What is refused stands on the page until something is taken."""
    try:
        process.ask(question)
        session.put(PROBLEM, None)
    except InputError as error:
        session.put(PROBLEM, error)


def faults(process: PlantProcess, points: list[str], machine: Hoist) -> None:
    """Buttons and fields, each of which acts at once."""
    st.markdown("**Faults**")

    def number(words: str, point: str, value: float, least: float, most: float, step: float, button: str) -> None:
        left, right = st.columns([1.0, 1.0], vertical_alignment="bottom")
        given = left.number_input(words, least, most, value, step, key=f"plant fault {point}", format="%g")
        said = f"{words.partition(' (')[0].lower()} {given:g} {unit_of(point)}"
        right.button(
            button, on_click=_order, args=(process, {point: given}, said), key=f"plant do {point}", width="stretch"
        )

    number("Payload (kg)", "payload_kg", 9000.0, 0.0, 50_000.0, 500.0, "Pick up")
    number("Slack (m)", "slack_m", 0.05, 0.0, 2.0, 0.05, "Let out")
    number("Brake late (s)", "brake_late_s", 0.5, 0.0, 5.0, 0.1, "Set")
    left, right = st.columns(2)
    _switch(left, process, "motor_lost", "Motor lost")
    _switch(right, process, "brake_closed", "Brake")
    _effects(process, points, machine)
    st.button(
        "Reset", icon=":material/restart_alt:", on_click=_reset, args=(process,), key="plant reset", width="stretch",
        help="Hanging still at the start, without faults; effects vanish.",
    )  # fmt: skip


def _switch(place: Any, process: PlantProcess, point: str, words: str) -> None:
    key = f"plant fault {point}"

    def change() -> None:
        on = bool(st.session_state[key])
        _order(process, {point: float(on)}, words.lower() if on else f"{words.lower()}: no more")

    place.toggle(words, key=key, on_change=change, persist_state="session")


def _reset(process: PlantProcess) -> None:
    for point in ("motor_lost", "brake_closed"):
        st.session_state[f"plant fault {point}"] = False
    _order(process, {"reset": 1}, "reset")


def _effects(process: PlantProcess, points: list[str], machine: Hoist) -> None:
    """The effects that the plant has, with their parameters."""
    by_effect: dict[str, list[str]] = {}
    for point in points:
        if point.startswith("effects."):
            by_effect.setdefault(point.split(".")[1], []).append(point)
    if not by_effect:
        return
    name = st.selectbox("Effect", list(by_effect), key="plant effect", format_func=lambda id_: id_.replace("_", " "))
    effect = find(name, HOIST.plant.kind)
    st.caption(effect.meaning)
    ranges = {ranged.name: ranged for ranged in ranges_of(effect, machine)}
    values, gone = {}, {}
    for point in by_effect[name]:
        parameter = point.split(".")[2]
        ranged = ranges[parameter]
        unit = unit_of(parameter)
        words = f"{words_of(parameter)} ({unit})" if unit else words_of(parameter)
        values[point] = st.number_input(
            words[0].upper() + words[1:], value=ranged.start, step=abs(ranged.scale) or None, key=f"plant {point}",
            format="%.4g",
        )  # fmt: skip
        if ranged.vanishes_at is not None:
            gone[point] = ranged.vanishes_at
    said = name.replace("_", " ")
    left, right = st.columns(2)
    left.button("Apply", on_click=_order, args=(process, values, said), key="plant effect do", width="stretch")
    if gone:
        right.button(
            "Take away", on_click=_order, args=(process, gone, f"{said}: no more"), key="plant effect off",
            width="stretch",
        )  # fmt: skip


@dataclass
class Latest:
    """Rows of numbers by column, and the rest of the worker's last answer."""

    rows: deque[list[float]] = field(default_factory=lambda: deque(maxlen=round(KEPT_S / EVERY_S)))
    generation: int = -1
    next: int = 0
    answer: dict[str, Any] = field(default_factory=dict)

    @property
    def columns(self) -> dict[str, Array]:
        """Name -> (n,)."""
        names = self.answer["columns"]
        table = np.array(self.rows, dtype=float).reshape(len(self.rows), len(names))
        return {name: table[:, i] for i, name in enumerate(names)}

    @property
    def now(self) -> dict[str, float]:
        now: dict[str, float] = self.answer["now"]
        return now

    def told(self, flag: str) -> bool:
        return self.now.get(f"is_{flag}", 0.0) > 0.0


def latest(process: PlantProcess) -> Latest:
    """Asks for what is new. InputError where the plant has gone."""
    kept = session.get("plant live rows", Latest, Latest())
    answer = process.ask({"rows": [kept.generation, kept.next]})
    if answer["generation"] != kept.generation:
        kept.rows.clear()
    kept.rows.extend(answer.pop("rows"))
    kept.generation, kept.next, kept.answer = answer["generation"], answer["next"], answer
    st.session_state["plant live rows"] = kept
    return kept
