"""Sweeps and samples: how many runs, which values; laws over the whole gallery."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.scenario_text import GOOD, write
from workbench.core.errors import InputError
from workbench.core.yaml_strict import load, loads
from workbench.logs import read_campaign
from workbench.machines import default_hoist, machine_text
from workbench.references import Step, motor_speed_rad_s, plan_motion
from workbench.references.shape import Limits
from workbench.study.front import fronts
from workbench.study.grid import RunSpec, plan_runs
from workbench.study.load import Study, load_study
from workbench.study.rows import Row
from workbench.study.run import run_specs
from workbench.study.scenario import Distribution, RangeBlock, SampleBlock, Scenario, distributions, draws, json_schema

SAFE = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+-]{0,199}")
BASE: dict[str, Any] = {
    "name": "x",
    "payloads_kg": [0.0, 9000.0],
    "start_position_m": 4.0,
    "moves": [{"by_m": 4.0}],
    "limits": {"speed_m_s": 0.7, "acceleration_m_s2": 0.6, "jerk_m_s3": 0.8},
    "references": ["trapezoid", "ruckig"],
    "controller": {"kp_nm_s_per_rad": 31.0, "ki_nm_per_rad": 122.0},
}


def specs_of(**changes: Any) -> Any:
    scenario = Scenario.model_validate({**BASE, **changes})
    return plan_runs(scenario, default_hoist())


values = st.lists(st.floats(0.05, 50.0), min_size=1, max_size=5, unique=True)


@given(values, values, st.integers(1, 4), st.data())
def test_a_grid_holds_every_combination_once(kp: list[float], jerk: list[float], together: int, data: Any) -> None:
    unlike = st.lists(st.floats(0.0, 3.0), min_size=together, max_size=together, unique=True)
    first, second = data.draw(unlike), data.draw(unlike)
    specs = specs_of(
        sweep={"controller.kp_nm_s_per_rad": kp, "limits.jerk_m_s3": jerk, "zip": {"lead_s": first, "settle_s": second}}
    )
    assert len(specs) == len(kp) * len(jerk) * together * 4
    runs: list[RunSpec] = specs[:]
    assert {
        (s.controller.kp_nm_s_per_rad, s.limits and s.limits.hoisting.jerk_m_s3, s.lead_s, s.settle_s) for s in runs
    } == {(k, j, a, b) for k in kp for j in jerk for a, b in zip(first, second, strict=True)}
    assert len({s.run_id for s in runs}) == len(runs)
    assert all(SAFE.fullmatch(s.run_id) for s in runs)
    assert all(s.assigned["sweep.limits.jerk_m_s3"] == s.limits.lowering.jerk_m_s3 for s in runs if s.limits)


@settings(max_examples=40, deadline=None)
@given(st.integers(-60, 60), st.integers(-60, 60), st.sampled_from([1, 2, -1, -3, None]))
def test_a_slice_is_the_same_runs_as_one_by_one(start: int, stop: int, step: int | None) -> None:
    specs = specs_of(sweep={"lead_s": {"from": 0, "to": 9, "steps": 10}})
    assert [s.run_id for s in specs[start:stop:step]] == [s.run_id for s in list(specs)[start:stop:step]]
    assert specs[-1] == specs[len(specs) - 1]


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e3), st.integers(2, 200))
def test_a_linear_range_has_its_ends_and_even_steps(low: float, width: float, steps: int) -> None:
    values = RangeBlock.model_validate({"from": low, "to": low + width, "steps": steps}).values()
    assert len(values) == steps and values[0] == low and values[-1] == low + width
    np.testing.assert_allclose(values, np.linspace(low, low + width, steps), rtol=1e-10, atol=1e-9)


def test_values_that_do_not_fit_together_are_a_row_with_the_reason() -> None:
    specs = specs_of(
        references=["ruckig"], payloads_kg=[0.0],
        sweep={"start_position_m": [4.0, 20.0], "moves[0].by_m": [2.0, 18.0]},
    )  # fmt: skip
    rows = [row for row, _ in run_specs(specs[:])]
    assert [row.ok for row in rows] == [True, True, True, False]
    assert "goes from 20 m to 38 m and leaves the rail" in rows[3].reason
    assert rows[3].assigned == {"sweep.start_position_m": 20.0, "sweep.moves[0].by_m": 18.0}
    assert set(rows[3].metrics) == set(rows[0].metrics)
    specs = specs_of(
        payloads_kg=[0.0],
        references=["ruckig"],
        sweep={"machine.winch.pin_diameter_m": [0.1, 0.59], "machine.winch.drum_diameter_m": [0.6, 0.58]},
    )
    rows = [row for row, _ in run_specs(specs[:])]
    assert [row.ok for row in rows] == [True, True, True, False]
    assert "pin_diameter_m 0.59, expected less than drum_diameter_m 0.58" in rows[3].reason


def test_runs_do_not_depend_on_the_chunk_they_are_simulated_in() -> None:
    specs = specs_of(sweep={"limits.jerk_m_s3": [0.5, 2.0]}, sample={"count": 3, "tolerances": True})
    whole = [row for row, _ in run_specs(specs[:])]
    parts = [row for a in range(0, len(specs), 5) for row, _ in run_specs(specs[a : a + 5])]
    assert whole == parts


DISTRIBUTIONS = {
    "uniform": {"low": 2.0, "high": 5.0},
    "normal": {"mean": 3.0, "std": 0.5},
    "lognormal": {"median": 2.0, "sigma": 0.3},
    "triangular": {"low": 1.0, "mode": 2.0, "high": 4.0},
}


@pytest.mark.parametrize("method", ["latin_hypercube", "sobol"])
@pytest.mark.parametrize("name", sorted(DISTRIBUTIONS))
def test_draws_follow_their_distribution(name: str, method: Any) -> None:
    """Against scipy's own distributions; evenly spread points lie closer than random ones would."""
    from scipy import stats

    p = DISTRIBUTIONS[name]
    block = SampleBlock(count=1024, method=method, values={"lead_s": Distribution(distribution=name, **p)})
    drawn = draws(block, block.values, 7)[:, 0]
    theirs = {
        "uniform": lambda: stats.uniform(2.0, 3.0),
        "normal": lambda: stats.norm(3.0, 0.5),
        "lognormal": lambda: stats.lognorm(0.3, scale=2.0),
        "triangular": lambda: stats.triang(1 / 3, 1.0, 3.0),
    }[name]()
    assert stats.kstest(drawn, theirs.cdf).statistic < 3.0 / 1024


def test_the_seed_decides_the_draws() -> None:
    def values_of(**changes: Any) -> list[Any]:
        specs = specs_of(sample={"count": 8, "tolerances": True, **changes.pop("sample", {})}, **changes)
        return [dict(s.assigned) for s in specs]

    assert values_of(seed=3) == values_of(seed=3) == values_of(sample={"seed": 3}, seed=9)
    assert values_of(seed=3) != values_of(seed=4)


def test_tolerances_are_drawn_about_the_nominal_machine_with_their_own_spread() -> None:
    machine = default_hoist()
    chosen = distributions(SampleBlock(count=1, tolerances=True), machine)
    assert {name: d.std for name, d in chosen.items()} == {
        "machine.motor.rotor_inertia_kg_m2": 0.01,
        "machine.carriage.mass_kg": 0.004,
        "machine.sensors.payload_scale": 0.005,
        "machine.guide.coulomb_hoisting_n": 0.15,
        "machine.guide.coulomb_lowering_n": 0.15,
        "machine.bearing.pin_friction_coefficient": 0.1,
        "machine.wire.youngs_modulus_pa": 0.05,
    }
    specs = specs_of(sample={"count": 512, "tolerances": True}, references=["ruckig"], payloads_kg=[9000.0])
    up = np.array([s.machine.guide.coulomb_hoisting_n for s in specs])
    down = np.array([s.machine.guide.coulomb_lowering_n for s in specs])
    assert up.mean() == pytest.approx(6000.0, rel=2e-3) and up.std() == pytest.approx(900.0, rel=2e-2)
    assert abs(np.corrcoef(up, down)[0, 1]) < 0.15
    # The payload as stated stays what the index is sorted by.
    assert {s.payload_kg for s in specs} == {9000.0}


def test_a_relative_draw_multiplies_the_swept_value_and_the_listed_payload() -> None:
    about_one = {"distribution": "uniform", "low": 0.9, "high": 1.1, "relative": True}
    specs = specs_of(
        sweep={"controller.kp_nm_s_per_rad": [10.0, 40.0]},
        sample={"count": 16, "values": {"controller.kp_nm_s_per_rad": about_one, "payload_kg": about_one}},
    )
    assert len(specs) == 2 * 16 * 2 * 2
    for spec in specs:
        base = spec.assigned["sweep.controller.kp_nm_s_per_rad"]
        assert 0.9 * base <= spec.controller.kp_nm_s_per_rad <= 1.1 * base
        assert spec.assigned["sample.controller.kp_nm_s_per_rad"] == spec.controller.kp_nm_s_per_rad
        assert spec.payload_kg == 0.0 or 8100.0 <= spec.payload_kg <= 9900.0
    # Every point of the sweep gets the same draws, so that points compare.
    factors: dict[float, set[float]] = {10.0: set(), 40.0: set()}
    for spec in specs:
        base = spec.assigned["sweep.controller.kp_nm_s_per_rad"]
        factors[base].add(round(spec.controller.kp_nm_s_per_rad / base, 9))
    assert factors[10.0] == factors[40.0] and len(factors[10.0]) == 16


# References out of a campaign: the same motion again, as it was or smoothed.


SCENARIO = """\
name: again
payloads_kg: [4500]
references:
  - {kind: recorded, campaign: logs, run: up}
  - {kind: s_curve, campaign: logs, run: up, smoothing_s: 0.5}
controller: {kp_nm_s_per_rad: 31.0, ki_nm_per_rad: 122.0}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A scenario beside a campaign of one run: 4 m up by trapezoid, from 6 m, its set-point logged at 50 Hz."""
    machine = default_hoist()
    profile = plan_motion("trapezoid", (Step(by_m=4.0),), 6.0, Limits(0.6, 0.5), (0.0, 25.0), 1.0, 2.0).sample(0.02)
    speed = motor_speed_rad_s(profile.speed_m_s, machine.gearbox.ratio, machine.winch.drum_diameter_m)
    logs = tmp_path / "logs"
    logs.mkdir()
    rows = [f"{t},{300.0 + 0.1 * k},{w},{w}" for k, (t, w) in enumerate(zip(profile.time_s, speed, strict=True))]
    write(logs, "time_s,torque_motor_nm,speed_motor_rad_s,speed_reference_rad_s\n" + "\n".join(rows) + "\n", "up.csv")
    write(logs, machine_text(machine), "machine.yaml")
    write(logs, "runs: [{name: up, file: up.csv, payload_kg: 4500.0, start_position_m: 6.0}]\n", "runs.yaml")
    write(tmp_path, SCENARIO)
    return tmp_path


def study_in(folder: Path) -> Study:
    return load_study(folder / "scenario.yaml")


def test_a_recorded_set_point_is_run_again_from_its_own_height(folder: Path) -> None:
    study = study_in(folder)
    spec = study.specs[0]
    assert (spec.run_id, spec.start_position_m) == ("4500kg_recorded", 6.0)
    ((row, run),) = run_specs([spec])
    recorded = read_campaign(folder / "logs").run("up")
    assert run is not None and row.ok
    reference = np.interp(run.time_s - spec.lead_s, recorded.time_s, recorded["speed_reference_rad_s"])
    np.testing.assert_allclose(run["speed_reference_rad_s"], reference, atol=1e-6)
    assert run["position_carriage_m"][-1] == pytest.approx(10.0, abs=0.02)
    assert row["moves"] == 1.0


def test_the_smoothed_set_point_asks_for_a_lower_torque_peak(folder: Path) -> None:
    hard, smooth = (row for row, _ in run_specs(study_in(folder).specs))
    assert smooth["peak_torque_above_static_nm"] < 0.97 * hard["peak_torque_above_static_nm"]
    assert smooth["speed_error_max_rad_s"] < 0.7 * hard["speed_error_max_rad_s"]
    assert smooth["move_time_s"] == pytest.approx(hard["move_time_s"] + 0.5)


def test_another_recording_under_the_same_name_is_another_study(folder: Path) -> None:
    before = study_in(folder).fingerprint
    log = folder / "logs" / "up.csv"
    lines = log.read_text(encoding="utf-8").splitlines()
    lines[200] = ",".join([*lines[200].split(",")[:3], str(float(lines[200].split(",")[3]) + 0.5)])
    log.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert study_in(folder).fingerprint != before


def test_a_recording_where_the_rail_ends_is_refused(folder: Path) -> None:
    write(folder, SCENARIO + "machine_overrides: {rail.highest_position_m: 8.0}\n")
    with pytest.raises(
        InputError, match=r"scenario\.yaml:3: references: .*leaves the rail, which reaches from 0 m to 8 m"
    ):
        study_in(folder)


# Laws over the whole gallery, and what each of its scenarios shows.


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
