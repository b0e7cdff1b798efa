"""Which plant the page shows: one that this session starts, or one that runs on this computer already."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.machines import hoist_of_session
from workbench.dashboard.plant.process import PlantProcess
from workbench.dashboard.widgets import problem
from workbench.errors import InputError
from workbench.machine import Hoist
from workbench.machine.files import machine_text
from workbench.serve.serve import HIGHEST_RATE_HZ, LOWEST_RATE_HZ, PORTS, ProtocolName, Wish, chosen_ready

PLANT, STARTED = "plant process", "plant started as"
OWN, ATTACHED = "start one", "attach to one"
PROTOCOLS: dict[ProtocolName, str] = {"udp": "UDP", "modbus": "Modbus TCP", "opcua": "OPC UA"}


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
