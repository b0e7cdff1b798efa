"""The page Plant: a plant served in real time, seen live, with faults at a click."""

from __future__ import annotations

from typing import Any

import streamlit as st

from workbench.dashboard.pages.plant.choose import PROTOCOLS, present, put_away, side_bar, started_as
from workbench.dashboard.pages.plant.client import client
from workbench.dashboard.pages.plant.faults import PROBLEM, faults
from workbench.dashboard.pages.plant.live import Latest, latest
from workbench.dashboard.plant.process import PlantProcess
from workbench.dashboard.widgets import guarded, is_dark, plain, problem, text
from workbench.errors import InputError
from workbench.figures.served import last_seconds, late_starts
from workbench.machine import Hoist
from workbench.serve.serve import ProtocolName
from workbench.simulate.loop import torque_limits

EVERY_S = 0.5  # between two looks at the plant
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


@st.fragment(run_every=EVERY_S)
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
    for column, (name, value, tip) in zip(st.columns(len(shown)), shown, strict=True):
        column.metric(name, value.replace("-", "\N{MINUS SIGN}"), help=tip or None, border=True, height="stretch")


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
