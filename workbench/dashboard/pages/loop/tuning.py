"""Tuning on the page Loop: a goal, a button, the trade-off, and the gains that fill the sliders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import streamlit as st

from workbench.analysis.family import operating_points
from workbench.analysis.tune import STEPS, Goal, Tuned, TuneProgress, Weights, tune
from workbench.dashboard import session
from workbench.dashboard.pages.loop.controls import Question, put_gains
from workbench.dashboard.widgets import plain, problem, table
from workbench.errors import InputError
from workbench.kinds import kind_of
from workbench.machine import Axis, Hoist
from workbench.machine.files import machine_text
from workbench.reports.loop import tuning as report
from workbench.reports.loop.case import LoopCaseFile

_TUNED = "loop tuned"
BANDWIDTH, REJECTION = "bandwidth", "best rejection of load steps"


@dataclass(frozen=True, eq=False)
class TunedCase:
    """A tuning, with the case that it was asked for and the machine's text."""

    case: LoopCaseFile
    tuned: Tuned
    machine: str


def wanted(machine: Hoist | Axis, ms_limit: float) -> Goal | None:
    """The side bar's goal, once its button is pressed."""
    kind = kind_of(machine)
    # A position loop under its kv needs a speed loop that is wider than it: an axis begins with a wider one.
    usual, own = (8.0, f" {kind.name}") if kind.looped.position_loop else (4.0, "")
    goal = st.radio("Tune for", [BANDWIDTH, REJECTION], key="loop goal")
    hertz = st.number_input(
        "Bandwidth (Hz)", 0.2, 500.0, usual, 0.5, key=f"loop hertz{own}", disabled=goal != BANDWIDTH
    )
    pressed = st.button("Tune", type="primary", width="stretch", icon=":material/tune:", key="loop tune")
    return Goal(hertz if goal == BANDWIDTH else None, ms_limit) if pressed else None


def tuning(case: LoopCaseFile, asked: Question, goal: Goal | None) -> None:
    """Tunes for a goal, which fills the sliders and draws the page anew."""
    if goal is None:
        return
    try:
        bar = st.empty()
        stop = st.empty()
        stop.button("Cancel", icon=":material/cancel:", key="loop cancel")
        # A press of any widget ends the run of the page at the next word to the bar, and the tuning with it.
        tuned = _tune(case, asked, goal, lambda p: bar.progress(p.step / STEPS, text=f"Tuning: {p.doing}"))
        bar.empty()
        stop.empty()
    except InputError as error:  # the loop under the present gains is still worth seeing
        problem(error)
        return
    session.put(_TUNED, TunedCase(case, tuned, machine_text(case.machine)))
    put_gains(tuned.winner.settings)
    st.rerun()


def tuned_before(case: LoopCaseFile) -> None:
    """What the last tuning found."""
    last = st.session_state.get(_TUNED)
    if isinstance(last, TunedCase):
        with st.expander("What the tuning found", expanded=True, icon=":material/tune:"):
            _result(last, last.machine == machine_text(case.machine))


def _tune(case: LoopCaseFile, asked: Question, goal: Goal, tell: Callable[[TuneProgress], object]) -> Tuned:
    points = operating_points(case.machine, case.payloads_kg, case.heights_m)
    return tune(case.machine, case.settings, points, case.trial(), goal, Weights(), tell=tell)


def _result(last: TunedCase, same_machine: bool) -> None:
    if not same_machine:
        st.caption("Found for another machine or drive:")
    st.markdown(plain(" ".join(report.sentences(last.case, last.tuned, Weights()))))
    table(report.table(last.tuned))
    st.download_button(
        "Controller block for scenarios", report.controller_text(last.tuned.winner.settings),
        file_name="controller.yaml", mime="application/yaml", icon=":material/download:", on_click="ignore",
    )  # fmt: skip
