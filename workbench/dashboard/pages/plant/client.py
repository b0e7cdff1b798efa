"""What commands the served plant: the reader's own controller, or the sampled PI of the studies."""

from __future__ import annotations

from typing import Any

import streamlit as st

from workbench.dashboard import controller
from workbench.dashboard.pages.plant.faults import asked
from workbench.dashboard.plant.process import PlantProcess
from workbench.figures.style import label
from workbench.machine import Hoist
from workbench.references import allowed_carriage_speed_m_s, planned_kinds
from workbench.reports.loop.case import usual_controller

NOBODY, HOLDS, MOVES = "none", "holds", "up and down"
SENT = "plant live client"  # what the plant was told last


def client(process: PlantProcess, machine: Hoist) -> None:
    """The built-in client is told anew whenever its controls, or the gains of Study and Loop, have changed."""
    what = st.segmented_control(
        "Built-in client", (NOBODY, HOLDS, MOVES), default=NOBODY, required=True, key="plant client", width="stretch",
        help="The sampled PI of Study and Loop with the gains that stand there, every 4 ms or slower. Without it the "
        "plant waits for a controller of yours.", persist_state="session",
    )  # fmt: skip
    wanted: dict[str, Any] | None = None
    if what != NOBODY:
        settings = controller.present() or usual_controller(machine)
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
