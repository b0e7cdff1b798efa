"""The multi-body machine beside the lumped plant: under one torque, and in the same closed loop."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.ideal import ideal_hoist
from workbench.control import Events, PiSettings
from workbench.core.errors import InputError
from workbench.machines import with_values
from workbench.machines.multibody import motion
from workbench.machines.multibody.assemble import hang
from workbench.simulate.loop import LoopCase, LoopResult, Outcome, simulate_loop
from workbench.simulate.models import check_multibody, compare_models, simulate_multibody_loop
from workbench.study.load import Study, load_study

ROOT = Path(__file__).resolve().parents[2]

MACHINE = ideal_hoist()
SETTINGS = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0, sample_time_s=0.004)
REFERENCE = np.interp(np.arange(1250) * 0.004, [0.2, 1.2, 2.0, 3.2, 4.4], [0.0, 60.0, 60.0, -60.0, 0.0])


def case(settings: PiSettings = SETTINGS, **drive: Any) -> LoopCase:
    machine = with_values(MACHINE, {f"drive.{name}": value for name, value in drive.items()})
    return LoopCase("run", machine, 4500.0, 9.0, settings, REFERENCE)


@pytest.fixture(scope="module")
def pair() -> tuple[LoopResult, LoopResult]:
    (lumped,) = simulate_loop([case()], record_every=1)
    return lumped, simulate_multibody_loop(case(), record_every=1, step_s=0.004)


def test_in_one_closed_loop_both_models_tell_the_same_story(pair):
    lumped, multibody = pair
    assert multibody.outcome is Outcome.COMPLETED
    off = multibody.run["speed_motor_rad_s"] - lumped.run["speed_motor_rad_s"]
    assert np.sqrt(np.mean(off**2)) < 1e-3 * MACHINE.motor.nominal_speed_rad_s
    for name in ("peak_torque_motor_nm", "rms_torque_motor_nm", "energy_motoring_j", "max_wire_tension_n"):
        assert multibody.metrics[name] == pytest.approx(lumped.metrics[name], rel=2e-3)
    assert multibody.metrics.keys() == lumped.metrics.keys()


def test_under_one_torque_the_motor_speeds_agree_within_half_a_per_cent(pair):
    """Where the lumped assumptions hold: measured 0.02 % of nominal, rms."""
    run = pair[0].run
    compared = compare_models(MACHINE, [run])
    assert compared.runs[0].apart_percent < 0.05
    # Both replays take the held torque as linear between samples, and are off the record by that alike.
    assert abs(compared.runs[0].multibody_rmse_percent - compared.runs[0].lumped_rmse_percent) < 0.05
    assert compared.runs[0].multibody_cpu_s > 0.0 and compared.ratio > 1.0


def test_an_arm_that_moves_during_a_run_ends_with_the_forces_of_one_that_hangs_there():
    """Statics at the new reach, from another start: rollers, cylinders and wire; from YAML, with the carriage held."""
    events = Events(arm_moves_s=0.5, arm_reach_m=1.5, arm_takes_s=2.0)
    reach = events.reach_m(2.5)
    assert reach is not None and [reach(t) for t in (0.0, 1.5, 9.0)] == pytest.approx([2.5, 2.0, 1.5])
    still = replace(case(), speed_reference_rad_s=np.zeros(2250), events=events)
    run = simulate_multibody_loop(still, record_every=10, step_s=0.004).run
    there = hang(with_values(MACHINE, {"arm.reach_m": 1.5}), 4500.0, 9.0)
    late = run.time_s > 8.0
    for name, force in there.normal_n.items():
        assert np.mean(run[f"force_roller_{name}_n"][late]) == pytest.approx(force, rel=0.02)
    assert np.mean(run["force_cylinder_n"][late]) == pytest.approx(there.cylinder_n, rel=0.02)


def test_a_scenario_moves_the_arm_of_the_multi_body_machine_only_and_within_its_reach(tmp_path: Path):
    file = tmp_path / "arm.yaml"

    def scenario(plant: str, reach: float) -> Study:
        lines = f"plant: {plant}\nevents: {{arm_moves_s: 2.5, arm_reach_m: {reach}, arm_takes_s: 4.0}}"
        file.write_text(f"extends: {ROOT / 'scenarios' / 'payloads.yaml'}\nname: arm\n{lines}\n", encoding="utf-8")
        return load_study(file)

    (spec, *_) = scenario("multibody", 3.1).specs
    assert spec.events.arm_reach_m == 3.1 and "events.arm_reach_m" in scenario("multibody", 3.1).specs.fields.names()
    with pytest.raises(InputError, match=r"arm.yaml:4: events.arm_reach_m: 3.5 m, expected 0.8 to 3.3 m"):
        scenario("multibody", 3.5)
    with pytest.raises(InputError, match=r"arm.yaml:4: events: moves the arm, .* expected plant: multibody"):
        scenario("lumped", 3.1)


def test_a_lagging_drive_with_a_counted_late_speed_is_the_same_drive_here():
    drive: dict[str, Any] = {
        "torque_lag_s": 0.012,
        "speed_delay_s": 0.004,
        "speed_filter_s": 0.003,
        "encoder_counts_per_turn": 8192,
    }
    (lumped,) = simulate_loop([case(**drive)])
    multibody = simulate_multibody_loop(case(**drive), step_s=0.004)
    for name in ("peak_torque_motor_nm", "speed_error_rms_rad_s"):
        assert multibody.metrics[name] == pytest.approx(lumped.metrics[name], rel=0.02)


def test_a_machine_that_cannot_hang_is_an_outcome_with_its_place_and_not_an_unstable_loop():
    soft = replace(case(), machine=with_values(MACHINE, {"arm.cylinder_stiffness_n_per_m": 1.0}))
    result = simulate_multibody_loop(soft)
    assert result.outcome is Outcome.NOT_SOLVED
    assert "does not hang still" in result.at and "at height 9.000 m with 4500 kg" in result.at


def test_an_engine_that_gives_up_says_when_and_in_what_state(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(motion, "TOLERANCE", 1e-300)  # which no iteration reaches once anything moves
    result = simulate_multibody_loop(case(), step_s=0.004)
    assert result.outcome is Outcome.NOT_SOLVED
    assert "did not converge, at 0." in result.at
    assert "height 9.000 m" in result.at and "torque 597" in result.at


def test_an_effect_that_it_does_not_know_is_said_before_anything_runs():
    with pytest.raises(InputError, match="has no effect 'backlash'"):
        check_multibody(MACHINE.model_copy(update={"effects": {"backlash": {"play_rad": 0.01}}}))
