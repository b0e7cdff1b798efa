"""The page Loop: margins of the sampled speed loop over payloads and heights; gains by slider or by tuning."""

from __future__ import annotations

from collections.abc import Sequence

import streamlit as st

from workbench.analysis.family import Member, weakest
from workbench.analysis.usual import usual_settings
from workbench.control import Cascade
from workbench.dashboard.pages.loop.controls import Question, gains, question, rule_settings
from workbench.dashboard.pages.loop.family import loops
from workbench.dashboard.pages.loop.tuning import tuned_before, tuning, wanted
from workbench.dashboard.pages.study.controls import Desk
from workbench.dashboard.pages.study.form import DESK
from workbench.dashboard.widgets import Number, chart, guarded, numbers, plain, table
from workbench.figures.loop import HZ, RAD_S, bode, gang_of_four, nyquist, steps
from workbench.kinds import kind_of
from workbench.reports.loop import report
from workbench.reports.loop.case import LoopCaseFile


def show() -> None:
    """Draws the page."""
    with st.sidebar, guarded():
        asked = question()
        settings = gains(asked)
        goal = wanted(asked.machine, asked.ms_limit)
    case = LoopCaseFile(asked.machine, settings, "on this page", asked.payloads_kg, asked.heights_m, None)
    cascade = kind_of(case.machine).looped.position_loop
    st.markdown(f"#### {'Position and speed loop' if cascade else 'Speed loop'} · {plain(case.machine.name)}")
    top = st.container()
    tuning(case, asked, goal)
    with guarded():
        members = loops(case, asked.motion)
        before = loops(_by_rule(case), asked.motion)
    with top:
        _numbers(case, members, before)
    _bode_and_nyquist(members, asked)
    tuned_before(case)
    st.markdown(plain(" ".join(report.sentences(case, members))))
    if kind_of(case.machine).payload and _on_rigid_bodies():
        st.caption("Study runs on the multi-body machine; this loop is that of the lumped one, which is linearised.")
    _others(members, asked)
    _table(members)


def _on_rigid_bodies() -> bool:
    """Whether the session's study runs on the multi-body machine."""
    desk = st.session_state.get(DESK)
    return isinstance(desk, Desk) and desk.controls.plant == "multibody"


def _by_rule(case: LoopCaseFile) -> LoopCaseFile:
    """The same loop under the gains that a rule of thumb gives: the baseline of the numbers."""
    rule = rule_settings(case.machine)
    gains_ = {name: getattr(rule, name) for name in (*rule.GAINS, *(["kv_per_s"] if isinstance(rule, Cascade) else []))}
    settings = case.settings.model_copy(update=gains_)
    return LoopCaseFile(case.machine, settings, "by rule", case.payloads_kg, case.heights_m, None)


def _numbers(case: LoopCaseFile, members: Sequence[Member], before: Sequence[Member]) -> None:
    """The least of each margin over all loops, against that under the gains by rule."""
    now, then = weakest(members).margins, weakest(before).margins
    if not now.stable:
        st.error("Unstable with these gains: no margin means anything.", icon=":material/warning:")
        return

    same = case.settings == _by_rule(case).settings

    def delta(new: float, old: float) -> float | None:
        return new - old if then.stable and not same else None

    slow, slow_before = (min(m.margins.bandwidth_hz for m in family) for family in (members, before))
    up, up_before = (report.gain_text(m).partition("/")[0] for m in (now, then))
    gain = float(up) if up[:1].isdigit() else None
    said = [
        Number("Largest Ms", now.ms, "", delta(now.ms, then.ms), "lower"),
        Number("Phase margin", now.phase_deg, "°", delta(now.phase_deg, then.phase_deg), "higher"),
        Number(
            "Gain margin", gain, "dB", delta(gain, float(up_before)) if gain and up_before[:1].isdigit() else None,
            "higher",
        ),
        Number("Delay margin", 1e3 * now.delay_s, "ms", delta(1e3 * now.delay_s, 1e3 * then.delay_s), "higher"),
        Number("Slowest bandwidth", slow, "Hz", delta(slow, slow_before), "higher"),
    ]  # fmt: skip
    numbers(said)
    rule = "" if same else f"; below, the difference to gains {usual_settings(case.machine)[1].replace(': ', ', ')}"
    over = "Of the one loop" if len(members) == 1 else f"The least of each over the {len(members)} loops"
    st.caption(f"{over}{rule}.")


def _bode_and_nyquist(members: Sequence[Member], asked: Question) -> None:
    unit = RAD_S if asked.rad_s else HZ
    left, right = st.columns([1.25, 1.0])
    with left:
        # The colours are Nyquist's, whose legend stands for both.
        figure = bode(members, height=600, unit=unit).update_layout(showlegend=False, margin={"t": 50})
        chart(figure, "loop bode", "Bode diagram of the open loop")
    with right:
        figure = nyquist(members, asked.ms_limit, height=600)
        below = {"orientation": "h", "x": 0.0, "y": -0.14, "yanchor": "top", "yref": "paper", "font": {"size": 12}}
        figure.update_layout(legend=below, margin={"l": 60, "r": 10, "t": 50})
        chart(figure, "loop nyquist", "Nyquist diagram with the circle of Ms")


def _others(members: Sequence[Member], asked: Question) -> None:
    unit = RAD_S if asked.rad_s else HZ
    chart(steps(members, height=760), "loop steps", "Step responses of the closed loop")
    chart(gang_of_four(members, asked.ms_limit, height=640, unit=unit), "loop gang", "Gang of four")


def _table(members: Sequence[Member]) -> None:
    st.markdown("##### Margins")
    table(report.table(members))
