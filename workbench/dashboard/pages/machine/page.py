"""The page Machine: the machine as a drawing that moves with a run."""

from __future__ import annotations

import streamlit as st

from workbench.dashboard.pages.machine.runs import Shown, chosen_run
from workbench.dashboard.pages.machine.scene import scene_of
from workbench.dashboard.widgets import guarded, is_dark, plain
from workbench.figures.arm import HEIGHT, moving_arm


def show() -> None:
    """Draws the page."""
    with st.sidebar, guarded():
        shown = chosen_run()
        height = 880 if st.toggle("Large", key="machine large", help="For a large screen or a projector.") else HEIGHT
    with guarded():
        _draw(shown, height)


def _draw(shown: Shown, height: int) -> None:
    machine, run = shown.machine, shown.run
    scene = scene_of(machine, run)
    st.markdown(f"#### {plain(machine.name)} · {plain(shown.name)}")
    figure = moving_arm(machine, scene, is_dark(), height=height)
    # Not by `chart`: that one knows no frames, and a drawing has nothing to zoom.
    st.plotly_chart(
        figure, width="stretch", theme=None, key="machine drawing",
        config={"displayModeBar": False, "responsive": True, "scrollZoom": False},
        alt="Gripper arm, winch and wire, moving with the run",
    )  # fmt: skip
    st.caption(
        "Heights are to scale; drum, sheave, arm and pipe are drawn larger and turn as the drawn wire runs. "
        f"Wire coloured by tension at the top of each fall, dashed while slack. Tension: {scene.tension_of}; "
        f"height: {scene.height_of}. Up and hoisting are positive; torque of each motor at its shaft."
    )
