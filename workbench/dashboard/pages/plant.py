"""The page Plant: a plant served in real time, seen live, with faults at a click."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import streamlit as st

from workbench.core.errors import InputError
from workbench.core.names import unit_of, words_of
from workbench.dashboard import desk, session, widgets
from workbench.dashboard.chosen import hoist_of_session
from workbench.dashboard.plant import PlantProcess, Wanted
from workbench.dashboard.widgets import Number, guarded, held, plain, problem
from workbench.effects import find, ranges_of
from workbench.machines import HOIST, Hoist
from workbench.references import Limits, planned_kinds
from workbench.serve.serve import PORTS, Wish, chosen_ready
from workbench.simulate.loop import torque_limits
from workbench.view.served import last_seconds, late_starts
from workbench.view.style import label

PLANT, PROBLEM = "plant process", "plant live problem"
SENT = "plant live client"  # what the plant was told last
OWN, ATTACHED = "start one", "attach to one"
NOBODY, HOLDS, MOVES = "none", "holds", "up and down"
LOOKS_EVERY_S = 0.5  # between two looks at the plant
WINDOWS = (10, 20, 60)
ADDRESSES = {"udp": "udp://127.0.0.1:{port}", "modbus": "127.0.0.1:{port}, Modbus TCP",
             "opcua": "opc.tcp://127.0.0.1:{port}/"}  # fmt: skip
WISHES = {
    "protocol": "Protocol", "rate_hz": "Steps a second", "watchdog_s": "Watchdog (s)", "payload_kg": "Payload (kg)",
    "start_position_m": "Height (m)", "watchdog_brake": "Brake closes when the watchdog trips",
    "priority": "Before other programs",
}  # fmt: skip
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
SWITCHES = {"motor_lost": "Motor lost", "brake_closed": "Brake"}
# words, point, value, largest, step, what the button says
AMOUNTS = (
    ("Payload (kg)", "payload_kg", 9000.0, 50_000.0, 500.0, "Pick up"),
    ("Slack (m)", "slack_m", 0.05, 2.0, 0.05, "Let out"),
    ("Brake late (s)", "brake_late_s", 0.5, 5.0, 0.1, "Set"),
)


def show() -> None:
    """Draws the page."""
    with st.sidebar, guarded():
        machine = _side_bar()
        commands = st.container()
    if (plant := present()) is None:
        st.markdown("#### A plant in real time")
        st.markdown(
            "Starts the machine's plant in a process of its own on this computer, for a controller or PLC at the other "
            "end of a line: torque in; speed, height and tensions out. It is shown here live, and faults are set at a "
            "click. A built-in client, the sampled PI of the studies, moves it where no controller is at hand."
        )
        return
    try:
        waits = st.empty()
        while (greeting := plant.greeting(LOOKS_EVERY_S)) is None:  # at the next word a press of Stop is heard
            waits.info("The plant's step is compiled; the first time on a computer that takes a while.",
                       icon=":material/hourglass_top:")  # fmt: skip
        waits.empty()
    except InputError as error:
        put_away()
        problem(error)
        return
    with commands, guarded():
        _client(plant, machine)
        _faults(plant, greeting["points"], machine)
    address = ADDRESSES[plant.what.protocol if isinstance(plant.what, Wish) else "udp"].format(port=greeting["port"])
    st.markdown(f"#### {plain(greeting['name'])} · `{address}`")
    if isinstance(refused := st.session_state.get(PROBLEM), InputError):
        problem(refused)
    _live()
    with st.expander("For your client", icon=":material/lan:"):
        st.markdown(
            f"`{address}` is reached from this computer only. The plant hangs still until the first torque; a second "
            "client is not heard until the first is silent. Packets, registers and nodes are in docs/serve.md."
        )
        if isinstance(plant.what, Wish):
            st.caption(f"Watchdog {plant.what.watchdog_s:g} s. Points, in the order of their addresses:")
        st.code("\n".join(greeting["points"]), language=None, height=260)


def present() -> PlantProcess | None:
    """This session's plant; one whose process has ended says why it did."""
    plant = st.session_state.get(PLANT)
    return plant if isinstance(plant, PlantProcess) else None


def put_away() -> None:
    """Ends the plant, and what the page knows of it."""
    if (plant := st.session_state.pop(PLANT, None)) is not None:
        plant.end()
    for key in [str(key) for key in st.session_state if str(key).startswith("plant live")]:
        del st.session_state[key]


# ---- the side bar -------------------------------------------------------------------------------------------------


def _side_bar() -> Hoist:
    """What to serve, the button. Returns the machine that is served, or would be."""
    if (plant := present()) is not None:
        st.button(
            "Stop the plant", icon=":material/stop:", width="stretch", on_click=put_away, key="plant stop",
            help="It goes on while other pages are looked at, and ends with this session.",
        )  # fmt: skip
        return plant.machine
    machine = hoist_of_session("plant machine")
    way = st.segmented_control(
        "Plant", (OWN, ATTACHED), default=OWN, key="plant way", required=True, width="stretch",
        label_visibility="collapsed",
    )  # fmt: skip
    what: Wish | int
    if way == ATTACHED:
        what = int(st.number_input("UDP port", 1024, 65535, PORTS["udp"], key="plant port"))
        st.caption("A plant that `workbench serve` runs on this computer, over UDP. The machine above is the one that "
                   "the built-in client is set for.")  # fmt: skip
    else:
        middle = round(0.5 * (machine.rail.lowest_position_m + machine.highest_position_m), 1)
        usual = Wish(payload_kg=4500.0, watchdog_s=0.2, priority=True, port=0, start_position_m=middle,
                     ready=tuple(chosen_ready("all", machine)))  # fmt: skip
        what = Wish(**widgets.form(Wish, asdict(usual), "plant", WISHES))
    if st.button("Attach" if way == ATTACHED else "Start the plant", type="primary", width="stretch",
                 icon=":material/play_arrow:", key="plant start"):  # fmt: skip
        session.put(PLANT, PlantProcess(machine, what))
        st.rerun()
    return machine


def _client(plant: PlantProcess, machine: Hoist) -> None:
    """The built-in client is told anew whenever its controls, or the gains of Study and Loop, have changed."""
    what = st.segmented_control(
        "Built-in client", (NOBODY, HOLDS, MOVES), required=True, key=held("plant client", NOBODY), width="stretch",
        help="The sampled PI of Study and Loop with the gains and limits that stand there, every 4 ms or slower. "
        "Without it the plant waits for a controller of yours.",
    )  # fmt: skip
    wanted = None
    if what == HOLDS:
        wanted = Wanted(desk.controller(machine))
    elif what == MOVES:
        low, high = machine.rail.lowest_position_m, machine.highest_position_m
        middle, way = 0.5 * (low + high), 0.25 * (high - low)
        usual = (round(middle - way, 1), round(middle + way, 1))
        between: Any = st.slider("Between (m)", low, high, step=0.5, key=held("plant between", usual))
        kinds = list(planned_kinds())
        reference = st.selectbox("Reference", kinds, format_func=label, key=held("plant reference", kinds[1]))
        given = desk.current(machine).scenario.limits.given()
        limits = Limits(*(given[key] for key in desk.LIMITS.values()))
        st.caption(plain(f"Under the limits of Study: {limits.speed_m_s:g} m/s, {limits.acceleration_m_s2:g} m/s², "
                         f"{limits.jerk_m_s3:g} m/s³."))  # fmt: skip
        wanted = Wanted(desk.controller(machine), tuple(between), reference, limits)
    if wanted != st.session_state.get(SENT):
        _ask(plant, "use", wanted)
        st.session_state[SENT] = wanted


def _ask(plant: PlantProcess, method: str, *arguments: Any) -> None:
    """Also a callback, which runs before the page. What is refused stands on the page until something is taken."""
    session.put(PROBLEM, None)
    try:
        plant.ask(method, *arguments)
    except InputError as error:
        session.put(PROBLEM, error)


def _faults(plant: PlantProcess, points: list[str], machine: Hoist) -> None:
    """Buttons and fields, each of which acts at once."""
    st.markdown("**Faults**")
    for words, point, value, most, step, button in AMOUNTS:
        left, right = st.columns([1.0, 1.0], vertical_alignment="bottom")
        given = left.number_input(words, 0.0, most, step=step, key=held(f"plant fault {point}", value), format="%g")
        said = f"{words.partition(' (')[0].lower()} {given:g} {unit_of(point)}"
        right.button(button, on_click=_ask, args=(plant, "order", {"set": {point: given}}, said),
                     key=f"plant do {point}", width="stretch")  # fmt: skip

    def switch(point: str, words: str) -> None:
        on = bool(st.session_state[f"plant fault {point}"])
        _ask(plant, "order", {"set": {point: float(on)}}, words.lower() if on else f"{words.lower()}: no more")

    for column, (point, words) in zip(st.columns(2), SWITCHES.items(), strict=True):
        column.toggle(words, key=held(f"plant fault {point}", False), on_change=switch, args=(point, words))
    _effects(plant, points, machine)

    def reset() -> None:
        st.session_state.update({f"plant fault {point}": False for point in SWITCHES})
        _ask(plant, "order", {"set": {"reset": 1}}, "reset")

    st.button("Reset", icon=":material/restart_alt:", on_click=reset, key="plant reset", width="stretch",
              help="Hanging still at the start, without faults; effects vanish.")  # fmt: skip


def _effects(plant: PlantProcess, points: list[str], machine: Hoist) -> None:
    """The effects that the plant has, with their parameters."""
    names = list(dict.fromkeys(point.split(".")[1] for point in points if point.startswith("effects.")))
    if not names:
        return
    name = st.selectbox("Effect", names, key="plant effect", format_func=lambda id_: id_.replace("_", " "))
    effect = find(name, HOIST.plant.kind)
    st.caption(effect.meaning)
    values, gone = {}, {}
    for ranged in ranges_of(effect, machine):
        point, unit = f"effects.{name}.{ranged.name}", unit_of(ranged.name)
        words = f"{words_of(ranged.name).capitalize()} ({unit})".removesuffix(" ()")
        step = abs(ranged.scale) or None
        values[point] = st.number_input(words, value=ranged.start, step=step, key=f"plant {point}", format="%.4g")
        if ranged.vanishes_at is not None:
            gone[point] = ranged.vanishes_at
    said, (left, right) = name.replace("_", " "), st.columns(2)
    left.button("Apply", on_click=_ask, args=(plant, "order", {"set": values}, said), key="plant effect do",
                width="stretch")  # fmt: skip
    if gone:
        right.button("Take away", on_click=_ask, args=(plant, "order", {"set": gone}, f"{said}: no more"),
                     key="plant effect off", width="stretch")  # fmt: skip


# ---- what it shows ------------------------------------------------------------------------------------------------


@st.fragment(run_every=LOOKS_EVERY_S)
def _live() -> None:
    """The part that is drawn anew while the plant runs."""
    plant, seen = present(), dict[str, Any]()
    with guarded(stop=False):
        seen = plant.ask("seen") if plant is not None else {}
    if plant is None or not seen.get("now"):
        return
    now, pace = seen["now"], seen["status"]["pace"]
    with st.container(horizontal=True, horizontal_alignment="distribute"):  # one under the other where it is narrow
        left, right = st.container(width="content"), st.container(width="content")
    told = [f":{colour}-badge[{words}]" for flag, (colour, words) in STATES.items() if now[f"is_{flag}"]]
    left.markdown(" ".join(told) or ":green-badge[under command]")
    if seen["client_ended"]:
        left.caption(plain(f"Built-in client: {seen['client_ended']}."))
    if seen["problem"]:
        left.error(plain(seen["problem"]), icon=":material/error:")
    window = right.segmented_control(
        "Shown", WINDOWS, key=held("plant window", 20), required=True, format_func=lambda s: f"{s} s",
        label_visibility="collapsed",
    )  # fmt: skip
    widgets.numbers([
        Number("Height", now["position_carriage_m"], "m"),
        Number("Speed", round(now["speed_motor_rad_s"], 1), "rad/s"),
        Number("Torque", round(now["torque_at_work_nm"]), "N m",
               help="of all motors, behind the drive's limits and lag"),
        Number("Drum tension", 1e-3 * now["tension_drum_n"], "kN"),
        Number("Payload", now["payload_now_kg"], "kg", digits=4),
    ])  # fmt: skip
    limit = torque_limits(plant.machine)["u_one" if now["is_motor_lost"] else "u_all"]
    figure = last_seconds(seen["columns"], float(window or 20), limit, seen["events"])
    widgets.chart(figure, "plant live", "Height, speed, torque and wire tension of the last seconds")
    counts = seen["status"]["counts"]
    refused = sum(count for name, count in counts.items() if name.startswith("refused"))
    left, right = widgets.beside("pace")
    left.markdown(
        f"| Steps | {pace['steps']} at {pace['rate_hz']:g} Hz |\n|---|---|\n"
        f"| On time | {widgets.text(pace['on_time_percent'], 4)} % |\n| Overruns | {pace['overruns']} |\n"
        f"| Latest start | {widgets.text(pace['latest_start_ms'], 3)} ms after it was due |\n"
        f"| Commands | {counts.get('commands', 0)}, refused {refused} |\n"
        f"| Watchdog | tripped {counts.get('watchdog', 0)} times |"
    )
    with right:
        widgets.chart(late_starts(pace["jitter"]), "plant late", "How late the steps began")
    if seen["said"]:
        with st.expander(f"What the plant says ({len(seen['said'])})"):
            st.markdown("\n".join(f"- {plain(line)}" for line in seen["said"]))
