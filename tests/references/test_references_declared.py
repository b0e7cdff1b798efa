"""A kind of reference that is declared is known everywhere: one is added here, and looked for in every place."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from tests.support.scenario_text import study_of
from workbench.cli import cli
from workbench.references import (
    Limits,
    Move,
    PlannedKind,
    Shape,
    add,
    forget_added,
    motion_time_s,
    move_shape,
    move_time_s,
    plan_motion,
    planned,
    planned_kind,
)
from workbench.references.shape import Step, shortest_move, shortest_ramp
from workbench.study.store import read_finished
from workbench.view.study import conclusions

LIMITS = Limits(0.7, 0.5, 1.0)
RAIL = (0.0, 25.0)


@planned(
    label="half acceleration",
    words="the trapezoid at half its acceleration",
    definition="a trapezoid under half of the acceleration limit",
    ramp=lambda ramp: shortest_ramp(ramp.speed_m_s, ramp.next_speed_m_s, _halved(ramp.limits)),
    needs_jerk=False,
    colour="#CC79A7",
    dash="4px,2px",
)
def half_acceleration(move: Move) -> Shape:
    return shortest_move(move.distance_m, _halved(move.limits))


def _halved(limits: Limits) -> Limits:
    return Limits(limits.speed_m_s, 0.5 * limits.acceleration_m_s2)


@pytest.fixture
def declared() -> Iterator[PlannedKind]:
    add(half_acceleration)
    yield half_acceleration
    forget_added()


@pytest.mark.usefixtures("declared")
def test_its_own_duration_counts_and_not_the_trapezoids() -> None:
    slower = 12.0 / 0.7 + 0.7 / 0.25
    assert move_time_s(planned_kind("half_acceleration"), 12.0, LIMITS) == pytest.approx(slower)
    steps = [Step(by_m=12.0), Step(dwell_s=1.0), Step(by_m=-12.0)]
    assert motion_time_s(["trapezoid", "half_acceleration"], steps, 4.0, LIMITS, RAIL) == pytest.approx(1 + 2 * slower)
    plan = plan_motion("half_acceleration", steps, 4.0, LIMITS, RAIL)
    assert plan.duration_s == pytest.approx(1.0 + 2.0 * slower)
    assert np.abs(plan.sample(0.01).acceleration_m_s2).max() == pytest.approx(0.25)


@pytest.mark.usefixtures("declared")
def test_a_scenario_runs_it_and_all_that_shows_a_study_shows_it(tmp_path: Path) -> None:
    study = study_of(tmp_path, "", "references: [trapezoid, ruckig]", "references: [trapezoid, half_acceleration]")
    assert study.plans["half_acceleration"].duration_s > study.plans["trapezoid"].duration_s
    assert study.duration_s == study.plans["half_acceleration"].duration_s
    out, report = tmp_path / "out", tmp_path / "report.html"
    done = CliRunner().invoke(
        cli, ["study", str(tmp_path / "scenario.yaml"), "--out", str(out)], catch_exceptions=False
    )
    assert done.exit_code == 0, done.output
    result = read_finished(out)
    rows = {(row.payload_kg, row.reference): row for row in result.rows}
    longer = (rows[9000.0, "half_acceleration"]["move_time_s"] - rows[9000.0, "trapezoid"]["move_time_s"]) / 2.0
    assert longer == pytest.approx(0.7 / 0.3 - 0.7 / 0.6)
    assert "the trapezoid at half its acceleration" in " ".join(done.output.split())
    assert "the trapezoid at half its acceleration" in " ".join(conclusions(result))
    CliRunner().invoke(cli, ["report", str(out), "--out", str(report)], catch_exceptions=False)
    for file in (out / "study.html", report):
        text = file.read_text(encoding="utf-8")
        assert "half acceleration" in text and "#CC79A7" in text, file.name


def test_a_kind_may_take_the_time_of_any_other(declared: PlannedKind) -> None:
    quick = Limits(LIMITS.speed_m_s, 1.5 * LIMITS.acceleration_m_s2)
    add(replace(declared, name="quick", move=lambda move: shortest_move(move.distance_m, quick)))
    as_long = replace(planned_kind("ruckig_equal_time"), name="as_long_as_quick", same_time_as="quick")
    wanted = 12.0 / 0.7 + 0.7 / 0.75
    assert move_shape(as_long, 12.0, LIMITS).duration_s == pytest.approx(wanted, abs=1e-9)
    assert move_time_s(as_long, 12.0, LIMITS) == pytest.approx(wanted, abs=1e-9)
