"""The page Study: what a jerk limit, another payload or another controller does to the move."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar, cast

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from workbench.dashboard import controller, session
from workbench.dashboard.machines import AXIS, choose_machine, keep_machine, session_machine
from workbench.dashboard.pages.compare.kept import head as study_head
from workbench.dashboard.pages.study.address import KEY, axis_address, from_address, in_address
from workbench.dashboard.pages.study.answer import decision, numbers_of, say, take_away, window
from workbench.dashboard.pages.study.axis.desk import AxisDesk, axis_scenario
from workbench.dashboard.pages.study.axis.form import DESK as AXIS_DESK
from workbench.dashboard.pages.study.axis.form import axis_controls
from workbench.dashboard.pages.study.axis.page import axis_answer, axis_files, axis_names
from workbench.dashboard.pages.study.controls import Desk, scenario_of
from workbench.dashboard.pages.study.forces import forces
from workbench.dashboard.pages.study.form import DESK, controls, file_fields, named
from workbench.dashboard.pages.study.runs import beside_payloads, beside_ramps, on_damping, results, told
from workbench.dashboard.widgets import chart, guarded, plain, problem
from workbench.errors import InputError
from workbench.figures.pareto import pareto
from workbench.figures.study import overview, peak_torque_over_payload
from workbench.figures.study_plane import torque_speed_plane
from workbench.kinds import studied
from workbench.machine import Axis, Hoist, default_hoist, shipped
from workbench.study.decide import verdict
from workbench.study.labels import swept_axes
from workbench.study.load import standalone_text
from workbench.study.pareto import fronts
from workbench.study.rows import Row, metrics_of
from workbench.study.run import StudyResult, motor_torque_limit_nm
from workbench.study.scenario import Scenario

PEAK = "peak_torque_motor_nm"
GOOD, AXIS_GOOD = "study good", "study axis good"
AnyMachine = TypeVar("AnyMachine", Hoist, Axis)


def show() -> None:
    """Draws the page."""
    _from_link()
    bad: list[InputError] = []
    with st.sidebar:
        chosen = session_machine("study machine")
        hoist = studied(chosen)
        if hoist is not None:
            desk = controls(hoist, bad)
        else:
            axis = cast(Axis, chosen)
            axis_desk = axis_controls(axis, bad, lambda name: file_fields(name, axis))
    head, top = st.container(), st.container()
    if hoist is None:
        _axis(axis_desk, axis, bad, head)
        return
    with top:
        scenario, machine, result = _run(desk, hoist, bad)
    with head:
        files = {"Save scenario": (f"{scenario.name}.yaml", standalone_text(scenario, machine))}
        study_head(scenario, machine, result, files)
    with top:
        sentence = st.empty()
        decision(result, sentence)
        with st.expander("One reference against the trapezoid", icon=":material/compare:"):
            numbers_of(result)
    _over_time(result)
    forces(result)
    take_away(result)
    _plane(result)
    with guarded():
        _over_payload(beside_payloads(scenario, machine))
        _ramps(scenario, machine, result, sentence)
        _damping(scenario, machine)


def run_first() -> None:
    """The runs of the study that the page begins with, ahead of a visitor."""
    machine = default_hoist()
    scenario = scenario_of(Desk(), machine)
    for run in (results, beside_payloads, beside_ramps, on_damping):
        run(scenario, machine)


def _axis(desk: AxisDesk, machine: Axis, bad: Sequence[InputError], head: DeltaGenerator) -> None:
    """The page below its head for an axis."""
    names = axis_names(machine)
    good, new = _ran(machine, lambda: axis_scenario(desk, machine), bad, lambda error: named(error, names), AXIS_GOOD)
    if new:
        scenario, _, _ = good
        controller.said("study", desk.controller, controller.owner(machine))
        _say_address(axis_address(scenario, machine))
    with head:
        study_head(*good, axis_files(good[0], machine))
    sentence = axis_answer(*good)
    with guarded():
        _ramps(*good, sentence)
        _damping(good[0], machine)


def _damping(scenario: Scenario, machine: Hoist | Axis) -> None:
    if (hangs := on_damping(scenario, machine)) is not None:
        st.caption(plain(hangs))


def _from_link() -> None:
    """A session that has set nothing yet begins as its address says."""
    text = st.query_params.get(KEY)
    if not text or DESK in st.session_state or AXIS_DESK in st.session_state:
        return
    try:
        desk, machine = from_address(text)
    except InputError as error:
        problem(error)
        return
    if isinstance(desk, Desk):
        session.put(DESK, desk)
    else:
        session.put(AXIS_DESK, desk)
        choose_machine(AXIS if machine == shipped("emps_axis") else keep_machine(machine.name, machine))


def _run(desk: Desk, machine: Hoist, bad: Sequence[InputError]) -> tuple[Scenario, Hoist, StudyResult]:
    """The study of a hoist, told to the other pages and to the address."""
    good, new = _ran(machine, lambda: scenario_of(desk, machine), bad, named, GOOD)
    if new:
        scenario, _, _ = good
        controller.said("study", scenario.controller)
        _say_address(in_address(scenario, machine))
    return good


def _ran(
    machine: AnyMachine,
    asked: Callable[[], Scenario],
    bad: Sequence[InputError],
    under_its_control: Callable[[InputError], InputError],
    key: str,
) -> tuple[tuple[Scenario, AnyMachine, StudyResult], bool]:
    """The study that is asked for, and True; where it cannot be run, the error under its control's name, the last one
    that was, kept in the session under `key`, and False."""
    try:
        if bad:
            raise bad[0]
        scenario = asked()
        with told():
            good = (scenario, machine, results(scenario, machine))
    except InputError as error:
        problem(under_its_control(error))
        last = session.get(key, tuple, ())
        if not last:
            st.stop()
        st.caption("Shown below: the last settings that could be run.")
        return last, False
    session.put(key, good)
    return good, True


def _say_address(text: str | None) -> None:
    """What the page's address holds of the study."""
    if text is None:
        st.query_params.pop(KEY, None)
    elif text != st.query_params.get(KEY):
        st.query_params[KEY] = text


def _good(result: StudyResult) -> list[tuple[str, Row]]:
    return [(row.reference, row) for row in result.rows if row.ok]


def _over_time(result: StudyResult) -> None:
    machine = result.study.machine
    runs = [(kind, result.runs[row.run_id]) for kind, row in _good(result)]
    if runs:
        limit = motor_torque_limit_nm(machine)
        stretch = window(result, max(float(run.time_s[-1]) for _, run in runs))
        figure = overview(runs, machine.motor.nominal_torque_nm, limit, "", stretch, height=740)
        chart(figure, "study over time", "Speed, tracking error, torque and wire tension over time")


def _plane(result: StudyResult) -> None:
    machine = result.study.machine
    runs = [(kind, result.runs[row.run_id]) for kind, row in _good(result)]
    if runs:
        motor, limit = machine.motor, motor_torque_limit_nm(machine)
        figure = torque_speed_plane(
            runs, motor.nominal_torque_nm, limit, motor.nominal_speed_rad_s, machine.drive.field_weakening, height=460
        )
        chart(figure, "study plane", "Torque over speed of one motor with continuous and peak envelope")


def _over_payload(result: StudyResult) -> None:
    machine = result.study.machine
    good = [row for row in result.rows if row.ok]
    payloads = np.array(sorted({row.payload_kg for row in good}))
    if len(payloads) < 2:
        return
    peak = {(row.reference, row.payload_kg): row[PEAK] for row in good}
    held = {row.payload_kg: row["hold_torque_nm"] / machine.motor.count for row in good}
    peaks = {
        kind: np.array([peak.get((kind, payload), np.nan) for payload in payloads])
        for kind in result.study.scenario.kinds
    }
    figure = peak_torque_over_payload(
        payloads, peaks, machine.motor.nominal_torque_nm, motor_torque_limit_nm(machine),
        np.array([held[payload] for payload in payloads]), height=400,
    )  # fmt: skip
    chart(figure, "study payload", "Torque peak over payload for each reference")


def _ramps(scenario: Scenario, machine: Hoist | Axis, result: StudyResult, sentence: DeltaGenerator) -> None:
    """The front of move time and peak over other limits, and the verdict anew where one of its runs does better."""
    rows = [row for row in beside_ramps(scenario, machine) if row.ok]
    if not rows:
        return
    judged = metrics_of(rows)
    heaviest = max(row.payload_kg for row in result.rows)
    axes, limits = swept_axes(rows), scenario.limits.model_dump()
    own = {name: limits[name.rpartition(".")[2]] for axis in axes for name in axis.columns}
    chosen = [replace(r, assigned=own) for r in result.rows if r.ok and r.payload_kg == heaviest]
    # The ramps' runs are the lumped model's: front and verdict would else lay two models side by side.
    lumped = scenario.plant == "lumped"
    front = fronts([*rows, *chosen] if lumped else rows)
    figure = pareto(rows, front, axes, judged.peak, height=480, chosen=chosen)
    what = f"Move time against {judged.input_words} peak"
    figure.update_layout(title_text=f"{what}, {heaviest:g} kg" if judged.payload else what)
    chart(figure, "study pareto", f"{what} over accelerations and jerks")
    if lumped and (better := verdict(result.rows, rows, machine=result.study.machine)) is not None:
        say(sentence, better)
