"""The runs behind the Study page, kept by value so that a slider that comes back costs nothing."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import streamlit as st

from workbench.machine import Axis, Hoist
from workbench.machine.files import machine_text
from workbench.metrics import columns
from workbench.study.load import Study, changed, plan_study
from workbench.study.rows import Row
from workbench.study.run import StudyResult, run_study
from workbench.study.scenario import Scenario
from workbench.study.side import damping_sentence, over_payload, over_ramps

log = logging.getLogger(__name__)

RAMPS = (0.4, 0.55, 0.7, 0.85, 1.0, 1.25, 1.6)  # of the acceleration that is set
JERKS = (0.25, 0.4, 0.63, 1.0, 1.6, 2.5, 4.0)  # of the jerk that is set
POINTS = 5
KEPT = 20  # studies whose signals are kept, of all sessions together
STEP_S = 1.5e-4  # of compute, for a step of the multi-body model
LUMPED = {"plant": "lumped"}  # of the curves beside a study: dozens of runs


def results(scenario: Scenario, machine: Hoist | Axis) -> StudyResult:
    """The scenario's runs. InputError for what cannot be run."""
    study = plan_study(scenario, machine)
    if scenario.plant == "multibody":
        steps = sum(spec.duration_s / min(spec.step_s, spec.controller.sample_time_s) for spec in study.specs)
        log.info("%d runs on the multi-body machine, some %.0f s", len(study.specs), max(1.0, STEP_S * steps))
    return _with_signals(*_values(study), study)


def beside_payloads(scenario: Scenario, machine: Hoist) -> StudyResult:
    """The same at payloads from none to the heaviest."""
    most = max(9000.0, *(scenario.payloads_kg or (0.0,)))
    study = over_payload(changed(scenario, LUMPED), machine, [most * k / (POINTS - 1) for k in range(POINTS)])
    return _run(*_values(study), study)


def beside_ramps(scenario: Scenario, machine: Hoist | Axis) -> Sequence[Row]:
    """Other accelerations and jerks at the heaviest payload; the trapezoid has accelerations only."""
    limits = scenario.limits.given()
    acceleration, jerk = (limits.get(name, 0.0) for name in ("acceleration_m_s2", "jerk_m_s3"))
    accelerations = [_short(acceleration * k) for k in RAMPS if acceleration]
    jerks = [_short(jerk * k) for k in JERKS if jerk]
    rows: list[Row] = []
    for kinds, other in ((("trapezoid",), jerks[3:4]), (("ruckig",), jerks)):
        study = over_ramps(changed(scenario, {"references": kinds} | LUMPED), machine, accelerations, other)
        rows += _run(*_values(study), study).rows
    return rows


def _short(value: float) -> float:
    """As a sentence can say it."""
    return float(f"{value:.3g}")


def on_damping(scenario: Scenario, machine: Hoist | Axis) -> str | None:
    """How far the answer hangs on the damping assumed for wire or coupling; None where its runs fail."""
    return _on_damping(scenario.model_dump_json(), machine_text(machine), scenario, machine)


@st.cache_resource(max_entries=200, show_spinner=False)
def _on_damping(said: str, machine: str, _scenario: Scenario, _machine: Hoist | Axis) -> str | None:
    return damping_sentence(_scenario, _machine)


def _values(study: Study) -> tuple[str, str]:
    """What the runs depend on: scenario with metrics, and machine."""
    return f"{study.scenario_hash} {' '.join(columns())}", study.machine_hash


# Resources rather than data: the records are frozen, so that nobody need have a copy. The runs of a study hold some
# 5 MB of signals, those beside it none.
@st.cache_resource(max_entries=KEPT, show_spinner=False)
def _with_signals(scenario: str, machine: str, _study: Study) -> StudyResult:
    return run_study(_study)


@st.cache_resource(max_entries=200, show_spinner=False)
def _run(scenario: str, machine: str, _study: Study) -> StudyResult:
    return run_study(_study)


@contextmanager
def told() -> Iterator[None]:
    """While the block runs, what the library says (that it compiles, the first time) stands on the page."""
    place, thread = st.empty(), threading.get_ident()

    class Told(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if threading.get_ident() == thread:  # other sessions compile in their own threads
                place.info(record.getMessage(), icon=":material/hourglass_top:")

    log, teller = logging.getLogger("workbench"), Told(logging.INFO)
    if log.getEffectiveLevel() > logging.INFO:
        log.setLevel(logging.INFO)
    log.addHandler(teller)
    try:
        yield
    finally:
        log.removeHandler(teller)
        place.empty()
