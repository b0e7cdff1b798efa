"""The page Machine: the machine as a drawing that moves with a run, or with two beside each other."""

from __future__ import annotations

import streamlit as st

from workbench.dashboard.pages.machine.runs import Shown, chosen_runs
from workbench.dashboard.pages.machine.scene import scene_of
from workbench.dashboard.widgets import guarded, is_dark, plain
from workbench.figures.film import HEIGHT, film

LARGE = 900


def show() -> None:
    """Draws the page."""
    with st.sidebar, guarded():
        shown = chosen_runs()
        height = LARGE if st.toggle("Large", key="machine large", help="For a large screen or a projector.") else HEIGHT
    with guarded():
        _draw(shown, height)


def _draw(shown: list[Shown], height: int) -> None:
    machine = shown[0].machine
    scenes = [scene_of(drawn.machine, drawn.run) for drawn in shown]
    named = [type(scene)(**{**vars(scene), "name": drawn.name}) for scene, drawn in zip(scenes, shown, strict=True)]
    st.markdown(f"#### {plain(machine.name)} · {plain(' beside '.join(drawn.name for drawn in shown))}")
    st.iframe(film(machine, named, is_dark(), height), height=height + 8)
    st.caption(
        "Heights are to scale; drum, sheave, arm and pipe are drawn larger and turn as the drawn wire runs. "
        f"Wire coloured by tension at the top of each fall, dashed while slack. Tension: {scenes[0].tension_of}; "
        f"height: {scenes[0].height_of}. Up and hoisting are positive; torque of the harder-worked motor at its shaft."
    )
