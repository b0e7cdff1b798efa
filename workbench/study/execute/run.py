"""A study run in one go: all its rows and signals, held in memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from workbench.kinds import kind_of
from workbench.machine import Axis, Hoist
from workbench.run import Run
from workbench.shown import Shown
from workbench.study.execute.chunk import run_specs
from workbench.study.results.row import Row
from workbench.study.scenario.load import Study


@dataclass(frozen=True, repr=False)
class StudyResult(Shown):
    """All rows in the order of the scenario, and the signals of the runs by run_id."""

    study: Study
    rows: Sequence[Row]
    runs: Mapping[str, Run] = field(default_factory=dict)


def run_study(study: Study) -> StudyResult:
    """Simulate all runs of a study. A run that fails is a row with its reason."""
    done = run_specs(study.specs)
    runs = {row.run_id: run for row, run in done if run is not None}
    return StudyResult(study, [row for row, _ in done], runs)


def peak_limit(machine: Hoist | Axis) -> float:
    """What the largest input of a run is held against: one motor's largest torque, an axis' largest force or torque.

    inf where none is stated.
    """
    return kind_of(machine).looped.peak_limit(machine)


def motor_torque_limit_nm(machine: Hoist) -> float:
    """The largest torque of one motor."""
    return machine.motor.nominal_torque_nm * machine.drive.overload
