"""Faults of the served plant at a click."""

from __future__ import annotations

from typing import Any

import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.plant.process import PlantProcess
from workbench.effects import find, ranges_of
from workbench.errors import InputError
from workbench.machine import Hoist
from workbench.names import unit_of, words_of
from workbench.plants import HOIST

PROBLEM = "plant live problem"


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
    effect = find(name, HOIST.kind)
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
