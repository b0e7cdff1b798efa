"""Laws over the whole gallery, and what each of its scenarios shows."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.scenario_text import GOOD
from workbench.core.yaml_strict import load, loads
from workbench.machines.files import machine_text
from workbench.study.front import fronts
from workbench.study.load import Study, load_study
from workbench.study.rows import Row
from workbench.study.run import run_specs
from workbench.study.scenario import json_schema

ROOT = Path(__file__).resolve().parents[2]
GALLERY = sorted((ROOT / "scenarios").glob("*.yaml"))


@cache
def study_of(name: str) -> Study:
    return load_study(ROOT / "scenarios" / f"{name}.yaml")


@cache
def rows_of(name: str) -> list[Row]:
    return [row for row, _ in run_specs(study_of(name).specs)]


def column(rows: Sequence[Row], metric: str) -> list[float]:
    return [row[metric] for row in rows]


def where(rows: Sequence[Row], **wanted: Any) -> list[Row]:
    """Rows with these attributes; a dotted name (with __ for .) is what sweep or sample has set."""
    return [
        row
        for row in rows
        if all(
            getattr(row, k) == v if hasattr(row, k) else row.assigned[k.replace("__", ".")] == v
            for k, v in wanted.items()
        )
    ]


def validator(kind: str) -> Any:
    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")
    jsonschema.Draft202012Validator.check_schema(json_schema(kind))
    return jsonschema.Draft202012Validator(json_schema(kind))


@pytest.fixture(params=GALLERY, ids=lambda path: path.stem)
def shipped(request: pytest.FixtureRequest) -> Path:
    assert isinstance(request.param, Path)
    return request.param


def test_a_shipped_scenario_expands_into_runs_that_are_all_ok(shipped: Path) -> None:
    study, rows = study_of(shipped.stem), rows_of(shipped.stem)
    assert study.scenario.name == shipped.stem
    assert study.scenario.description
    assert len({row.run_id for row in rows}) == len(rows) == len(study.specs)
    assert [row.reason for row in rows if not row.ok] == []
    assert all(np.isfinite(value) for row in rows for value in row.metrics.values() if value is not None)


def test_a_shipped_scenario_is_valid_by_the_schema(shipped: Path) -> None:
    assert [error.message for error in validator("scenario").iter_errors(load(shipped).data)] == []


@pytest.mark.parametrize(
    "more",
    ["speling: 1\n", "sweep: {limits.jerk_m_s3: {from: 1, too: 2, steps: 3}}\n", "outputs: {signals: some}\n",
     "sample: {count: 0}\n", "drive: {overload: -1}\n", "sweep: {limits.jerk_m_s3: []}\n"],
)  # fmt: skip
def test_the_schema_refuses_what_the_reader_refuses(more: str) -> None:
    assert not list(validator("scenario").iter_errors(loads(GOOD, "x").data))
    assert list(validator("scenario").iter_errors(loads(GOOD + more, "x").data))


def test_machines_and_run_lists_are_valid_by_their_schemas() -> None:
    from workbench.machines import default_hoist

    machine, runs = validator("machine"), validator("runs")
    assert not list(machine.iter_errors(loads(machine_text(default_hoist()), "m").data))
    friction = "{coulomb_forward_n: 2.0, coulomb_backward_n: 2.0, viscous_n_s_per_m: 1.0}"
    axis = f"kind: axis\nmotion: linear\nmass_kg: 95.0\nfriction: {friction}\n"
    assert not list(machine.iter_errors(loads(axis, "m").data))
    assert list(machine.iter_errors({"motor": {}}))
    listed = {
        "columns": {"time_s": "t", "torque_motor_nm": {"column": "T", "scale": 2.0}},
        "runs": [{"name": "a", "file": "a.csv"}],
    }
    assert not list(runs.iter_errors(listed))
    assert list(runs.iter_errors({"runs": []}))


def test_jerk_and_acceleration_trade_time_for_torque_and_the_knee_is_inside() -> None:
    (front,) = fronts(rows_of("jerk_pareto"))
    assert len(front.rows) >= 10
    assert front.knee is not None and front.knee not in (front.rows[0], front.rows[-1])
    for sooner, later in pairwise(front.rows):
        assert sooner["move_time_s"] < later["move_time_s"]
        assert sooner["peak_torque_motor_nm"] > later["peak_torque_motor_nm"]


def test_a_harder_emergency_stop_unloads_the_wire_going_up_and_loads_the_motors_going_down() -> None:
    rows = rows_of("emergency_stop")
    for payload in (0.0, 9000.0):
        up = where(rows, payload_kg=payload, **{"sweep__moves[0]__by_m": 11.0})
        down = where(rows, payload_kg=payload, **{"sweep__moves[0]__by_m": -11.0})
        assert all(a > b for a, b in pairwise(column(up, "min_wire_tension_n")))
        assert all(a < b for a, b in pairwise(column(down, "peak_torque_motor_nm")))
        # v²/2a is soon done: the stop ends where it should, whatever the deceleration.
        assert all(abs(value) < 0.05 for value in column([*up, *down], "position_error_end_m"))


def test_one_motor_carries_what_its_overload_allows_and_no_more() -> None:
    for row in rows_of("motor_failure"):
        # Hoisting at constant speed: weight and friction, in (8000 kg + payload)·g/2 falls·0.3 m/31 and guide.
        wanted = ((8000.0 + row.payload_kg) * 9.81 + 6000.0) / 2.0 * 0.3 / 31.0
        assert (abs(row["position_error_end_m"]) < 0.01) == (wanted < 480.0 * 1.6)


def test_a_brake_that_is_open_in_time_changes_nothing_and_a_late_one_costs_torque() -> None:
    for payload in (0.0, 9000.0):
        rows = where(rows_of("brake_late"), payload_kg=payload, sweep__controller__anti_windup="back_calculation")
        peaks, errors = column(rows, "peak_torque_motor_nm"), column(rows, "speed_error_max_rad_s")
        assert peaks[0] == pytest.approx(peaks[1], rel=1e-9)
        assert errors[1] < errors[2] < errors[3] < errors[4]
        assert peaks[4] == pytest.approx(768.0)


def test_torque_peaks_scatter_within_the_tolerances_about_the_nominal_one() -> None:
    nominal = where(rows_of("payloads"), payload_kg=9000.0, reference="ruckig")[0]["peak_torque_motor_nm"]
    peaks = np.array(column(where(rows_of("tolerances"), reference="ruckig"), "peak_torque_motor_nm"))
    assert len(peaks) == 256
    # A friction level of 6 kN ± 15 % is 4.4 N m of a motor, 17 t ± 0.4 % and the rest are less.
    assert abs(peaks.mean() - nominal) < 1.0
    assert 2.0 < peaks.std() < 6.0
