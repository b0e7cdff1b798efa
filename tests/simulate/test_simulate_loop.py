"""The closed loop of a hoist, of an axis and of the multi-body machine: start, limits, lanes, outcomes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support import by_hand
from tests.support.axes import CASCADE, emps, followed, ideal_axis, there_and_back, two_inertia
from tests.support.ideal import ideal_hoist
from workbench.control import Events, LinearCascade, PiSettings
from workbench.control.settings import AxisFeedForward, RotaryCascade
from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.machines import KINDS, PLANTS, Hoist, with_values
from workbench.machines.multibody import motion
from workbench.machines.multibody.assemble import hang
from workbench.metrics import set_of
from workbench.references import Limits, Step, plan_motion
from workbench.simulate.loop import LoopCase, LoopResult, Outcome, simulate_loop, torque_limits
from workbench.simulate.models import check_multibody, compare_models, simulate_multibody_loop
from workbench.study.consequences import looped, small_study
from workbench.study.load import Study, load_study
from workbench.study.run import run_specs

MACHINE = ideal_hoist()
SETTINGS = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)
NOMINAL_SPEED = MACHINE.motor.nominal_speed_rad_s


def case(
    reference: Array,
    payload_kg: float = 4500.0,
    machine: Hoist = MACHINE,
    settings: PiSettings = SETTINGS,
    height_m: float = 10.0,
    **more: Any,
) -> LoopCase:
    return LoopCase("run", machine, payload_kg, height_m, settings, reference, **more)


def one(reference: Array, record_every: int = 1, **more: Any) -> LoopResult:
    return simulate_loop([case(reference, **more)], record_every=record_every)[0]


def ramp(to: float, samples: int = 1500) -> Array:
    """Rest, a ramp over a second, and on at its end."""
    return np.interp(np.arange(samples) * 0.001, [0.1, 1.1], [0.0, to])


@pytest.fixture(scope="module")
def lift() -> LoopResult:
    """A short lift and a lowering after it, every sample recorded."""
    return one(np.interp(np.arange(3000) * 0.001, [0.1, 0.6, 1.2, 2.2, 2.6], [0.0, 40.0, 40.0, -40.0, 0.0]))


@pytest.mark.parametrize("payload", [0.0, 4500.0, 9000.0])
def test_a_hanging_load_is_taken_over_without_a_bump(payload):
    result = one(np.zeros(2000), payload_kg=payload)
    assert result.run["torque_motor_nm"] == pytest.approx(result.hold_torque_nm, rel=1e-9)
    assert result.run["position_carriage_m"] == pytest.approx(10.0, abs=1e-9)
    assert np.max(np.abs(result.run["speed_motor_rad_s"])) < 1e-8
    assert result.outcome is Outcome.COMPLETED


def test_the_torque_is_that_of_the_sampled_law_from_the_measured_speed(lift):
    error = lift.run["speed_reference_rad_s"] - lift.run["speed_motor_rad_s"]
    integral = lift.hold_torque_nm + 122.0 * 0.001 * np.concatenate([[0.0], np.cumsum(error)[:-1]])
    assert lift.run["torque_motor_nm"] == pytest.approx(31.0 * error + integral, abs=1e-8)


def test_the_torque_is_held_between_samples_and_the_plant_moves_as_in_the_reference(lift):
    """Sample by sample, the reference integrates the plant under a constant torque."""
    p = PLANTS["hoist"].values(MACHINE, 4500.0)
    q, _ = PLANTS["hoist"].equilibrium(10.0, p)
    state = np.array([*q, 0.0, 0.0, 0.0])
    torque, speed = lift.run["torque_motor_nm"], lift.run["speed_motor_rad_s"]
    for k in range(len(torque) - 1):
        assert state[3] == pytest.approx(speed[k], abs=2e-6 * NOMINAL_SPEED)
        state = by_hand.reference(p, state, np.array([0.0, 0.001]), np.full(2, torque[k]), step=2e-5)[-1]
    assert state[2] == pytest.approx(lift.end_position_m, abs=1e-6)


def test_the_torque_stops_at_the_limit_of_the_drive():
    result = one(np.full(300, 140.0))
    limit = torque_limits(MACHINE)["u_all"]
    assert limit == pytest.approx(2 * 480.0 * 1.6)
    assert np.max(result.run["torque_motor_nm"]) == limit
    assert result.metrics["peak_torque_motor_nm"] == pytest.approx(limit / 2.0)
    assert result.metrics["peak_torque_percent"] == pytest.approx(160.0)
    assert np.min(one(np.full(300, -140.0)).run["torque_motor_nm"]) == -limit


def many(n: int) -> list[LoopCase]:
    """Cases of different payloads, heights and speeds; some at rest, one at its limit."""
    return [
        case(ramp(0.0 if j % 5 == 0 else 15.0 * (j % 9 - 4), 600), 270.0 * j, height_m=5.0 + 0.3 * j) for j in range(n)
    ]


@pytest.fixture(scope="module")
def alone() -> list[LoopResult]:
    return [simulate_loop([one_case])[0] for one_case in many(33)]


def assert_same(a: LoopResult, b: LoopResult) -> None:
    assert a.metrics == b.metrics
    assert a.end_position_m == b.end_position_m
    for name, values in a.run.signals.items():
        assert np.array_equal(values, b.run[name]), name


@pytest.mark.parametrize("n", [2, 7, 16, 17, 33])
def test_a_case_among_others_is_bit_for_bit_the_case_alone(n, alone):
    for together, single in zip(simulate_loop(many(n)), alone, strict=False):
        assert_same(together, single)


def test_cases_of_unequal_length_and_sample_time_come_back_in_order_each_as_it_is_alone():
    slow = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0, sample_time_s=0.002)
    mixed = [case(ramp(30.0, 600)), case(ramp(20.0, 400), settings=slow), case(ramp(10.0, 900)), case(ramp(-30.0, 600))]
    for together, one_case in zip(simulate_loop(mixed), mixed, strict=True):
        assert_same(together, simulate_loop([one_case])[0])
        assert len(together.run.time_s) == len(one_case.speed_reference_rad_s) // 10


def test_what_is_recorded_is_every_so_manyth_sample_and_metrics_do_not_hang_on_it(lift):
    reference = lift.run["speed_reference_rad_s"]
    thinned, silent = one(reference, record_every=7), one(reference, record_every=0)
    assert thinned.run.time_s == pytest.approx(np.arange(0, 3000, 7) * 0.001)
    assert np.array_equal(thinned.run["torque_motor_nm"], lift.run["torque_motor_nm"][::7])
    assert dict(silent.run.signals) == {}
    assert len(silent.run.time_s) == 0
    for name, value in lift.metrics.items():
        assert thinned.metrics[name] == value
        assert silent.metrics[name] == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize(("height", "speed"), [(0.05, -40.0), (24.95, 40.0)], ids=["below", "above"])
@pytest.mark.parametrize("record_every", [0, 1])
def test_a_carriage_that_leaves_the_rail_is_an_outcome_with_its_moment(height, speed, record_every):
    result = one(ramp(speed, 2500), height_m=height, record_every=record_every)
    assert result.outcome is Outcome.LEFT_THE_RAIL
    if record_every:
        heights = result.run["position_carriage_m"]
        first = int(np.argmax((heights < -0.01) | (heights > 25.01)))
        assert f"at {first * 0.001:.2f} s" in result.at


@pytest.mark.parametrize("record_every", [0, 10])
def test_a_carriage_that_left_the_rail_and_came_back_has_left_it(record_every):
    reference = np.interp(np.arange(3000) * 0.001, [0.0, 0.5, 1.0, 1.5], [0.0, -40.0, 40.0, 0.0])
    result = one(reference, height_m=0.05, record_every=record_every)
    assert result.end_position_m > 0.0
    assert result.outcome is Outcome.LEFT_THE_RAIL


@pytest.mark.parametrize("record_every", [0, 10])
def test_a_state_without_bound_is_an_outcome_with_its_moment(record_every):
    # No file may ask for such an overload; the outcome is there for what else may run away.
    drive = MACHINE.drive.model_copy(update={"overload": 1e150, "field_weakening": False})
    unheld = MACHINE.model_copy(update={"drive": drive})
    wild = PiSettings(kp_nm_s_per_rad=1.0, ki_nm_per_rad=0.0).model_copy(update={"kp_nm_s_per_rad": 1e300})
    result = one(ramp(50.0), machine=unheld, settings=wild, record_every=record_every)
    assert result.outcome is Outcome.DIVERGED
    assert result.at == ("by 0.01 s" if record_every else "")


@pytest.mark.parametrize(("share", "lag_s"), [(0.5, 0.002), (0.6, 0.02), (0.5, 0.0)])
def test_a_motor_that_fails_takes_its_torque_at_once_and_the_other_s_rises_behind_its_lag(share, lag_s):
    machine = with_values(MACHINE, {"drive.torque_lag_s": lag_s, "drive.torque_share": share})
    result = one(np.zeros(700), machine=machine, events=Events(motor_fails_s=0.5))
    works, fails = (result.run[f"torque_motor{k}_nm"] for k in (1, 2))
    failed, held = result.run.time_s >= 0.5 - 1e-9, result.hold_torque_nm
    assert np.all(fails[failed] == 0.0)
    at_first = works[failed][:2]  # the loop has hardly noticed: the lag alone brings back what is held
    rise = 1.0 - (1.0 - share) * (np.exp(-np.array([0.0, 0.001]) / lag_s) if lag_s else np.zeros(2))
    assert at_first / held == pytest.approx(rise, rel=0.02)


# An axis under its cascade: closed forms, a balance of energy, a loop written out by hand.


FULL = AxisFeedForward(inertia=1.0, load=1.0, friction=1.0)


def jog(speed: float, seconds: float):
    """From rest to a speed that is held, then to rest."""
    steps = [Step(speed_m_s=speed, for_s=seconds), Step(speed_m_s=0.0, for_s=1.0)]
    return plan_motion("trapezoid", steps, 0.0, Limits(0.25, 2.0), (-np.inf, np.inf), 0.1, 0.5)


def test_without_speed_feed_forward_the_axis_is_behind_by_speed_over_kv():
    settings = CASCADE.model_copy(update={"feed_forward": AxisFeedForward(speed=0.0)})
    run = followed(ideal_axis(), settings, jog(0.1, 4.0)).run
    at = int(np.searchsorted(run.time_s, 3.5))
    behind = run["position_reference_m"][at] - run["position_m"][at]
    assert behind == pytest.approx(0.1 / settings.kv_per_s, rel=1e-6)


def test_friction_and_a_load_leave_no_error_at_even_speed():
    """The integral takes the Coulomb level of the way, the viscous part and the constant load."""
    run = followed(with_values(emps(), {"gravity.constant_n": 50.0}), CASCADE, jog(0.1, 4.0)).run
    at = int(np.searchsorted(run.time_s, 3.5))
    assert abs(run["velocity_m_s"][at] - 0.1) < 1e-4  # the encoder's counts
    assert run["force_n"][at] == pytest.approx(20.3935 + 0.1 * 203.5034 + 50.0, rel=0.01)


def test_the_compiled_loop_is_the_one_written_out_by_hand():
    """One mass, held force: exact between samples, x += v T + F/M T²/2, v += F/M T."""
    settings, plan = CASCADE.model_copy(update={"set_point_weight": 0.7}), there_and_back()
    axis, dt = ideal_axis(), settings.sample_time_s
    run, M = followed(axis, settings, plan).run, axis.mass_kg
    profile = plan.sample(dt)
    x = v = integral = 0.0
    force = []
    for r, place in zip(profile.speed_m_s, profile.position_m, strict=True):
        error = r + settings.kv_per_s * (place - x) - v
        F = settings.kp * (error - 0.3 * r) + integral
        integral += dt * settings.ki * error
        x, v = x + dt * v + 0.5 * dt * dt * F / M, v + dt * F / M
        force.append(F)
    np.testing.assert_allclose(run["force_n"], force, atol=1e-6)


def test_full_feed_forward_of_an_exact_model_leaves_next_to_no_error():
    exact = ideal_axis(friction__viscous_n_s_per_m=200.0, gravity__constant_n=30.0)
    plain, ahead = (
        followed(exact, CASCADE.model_copy(update={"feed_forward": ff}), there_and_back()).metrics
        for ff in (AxisFeedForward(), FULL)
    )
    assert ahead["tracking_error_max_m"] < 0.05 * plain["tracking_error_max_m"]
    late = followed(emps(), CASCADE.model_copy(update={"feed_forward": FULL}), there_and_back()).metrics
    assert late["tracking_error_max_m"] > ahead["tracking_error_max_m"]  # a filter and a delay are not in the model


def test_work_of_a_move_is_what_friction_takes():
    """From rest to rest at one place: work given minus work taken back is the integral of friction times speed."""
    result = followed(emps(), CASCADE, there_and_back(settle_s=1.5))
    run, axis = result.run, emps()
    v = run["velocity_m_s"]
    level = axis.friction.coulomb_forward_n * np.clip(v / axis.friction.standstill_speed_m_s, -1.0, 1.0)
    lost = float(np.trapezoid((level + axis.friction.viscous_n_s_per_m * v) * v, run.time_s))
    given = result.metrics["energy_motoring_j"] - result.metrics["energy_regenerated_j"]
    assert given == pytest.approx(lost, rel=2e-3)


def test_the_drive_keeps_to_its_limit_and_the_integral_does_not_run_away():
    machine = with_values(emps(), {"drive.force_limit_n": 150.0})
    result = followed(machine, CASCADE, there_and_back("trapezoid", settle_s=1.5))
    assert np.max(np.abs(result.run["force_n"])) == pytest.approx(150.0, rel=1e-3)
    assert result.metrics["peak_force_percent"] == pytest.approx(100.0)
    assert abs(result.run["position_m"][-1]) < 2e-4


def test_metrics_of_the_compiled_loop_are_those_of_its_recorded_signals():
    result = followed(ideal_axis(friction__viscous_n_s_per_m=200.0), CASCADE, there_and_back())
    run = result.run
    lag, slow = run["position_reference_m"] - run["position_m"], run["velocity_reference_m_s"] - run["velocity_m_s"]
    found = result.metrics
    assert found["peak_force_n"] == np.max(np.abs(run["force_n"]))
    assert found["rms_force_n"] == pytest.approx(np.sqrt(np.mean(run["force_n"] ** 2)), rel=1e-9)
    assert found["tracking_error_max_m"] == pytest.approx(np.max(np.abs(lag)), rel=1e-12)
    assert found["tracking_error_rms_m"] == pytest.approx(np.sqrt(np.mean(lag**2)), rel=1e-9)
    assert found["velocity_error_max_m_s"] == pytest.approx(np.max(np.abs(slow)), rel=1e-12)
    assert found["overshoot_m"] == pytest.approx(max(np.max(run["position_m"]) - 0.2, -np.min(run["position_m"]), 0.0))
    off = np.flatnonzero(np.abs(lag) > 2e-4)[-1]
    moved = np.flatnonzero(np.abs(run["velocity_reference_m_s"]) > 1e-6 * 0.5)[-1]
    assert found["settling_time_s"] == pytest.approx(max(off - moved, 0) * 0.001, abs=1e-9)
    assert found["settling_window_m"] == pytest.approx(2e-4)


def test_a_loop_that_is_not_stable_ends_as_a_sentence_not_as_numbers():
    wild = LinearCascade(kp_n_s_per_m=5e5, ki_n_per_m=1e6, kv_per_s=100.0)
    free = emps().model_copy(update={"drive": emps().drive.model_copy(update={"force_limit_n": None})})
    assert followed(free, wild, there_and_back(settle_s=20.0)).outcome is Outcome.DIVERGED


def test_a_load_on_its_coupling_swings_at_its_own_frequency_after_the_motor_has_stopped():
    settings = RotaryCascade(kp_nm_s_per_rad=0.3, ki_nm_per_rad=3.0, kv_per_s=8.0)
    plan = there_and_back("trapezoid", by=2.0, limits=Limits(6.0, 60.0), settle_s=2.0)
    run = followed(two_inertia(), settings, plan).run
    twist = run["torque_coupling_nm"]
    at_rest = run.time_s > plan.move_windows[-1][1] + 0.1
    turns = np.flatnonzero(np.diff(np.sign(twist[at_rest])))
    measured = 0.5 / (np.mean(np.diff(turns)) * 0.001)
    free = np.sqrt(20.0 * (1 / 0.002 + 1 / 0.003)) / (2.0 * np.pi)
    held = np.sqrt(20.0 / 0.003) / (2.0 * np.pi)
    assert 0.95 * held < measured < free


@pytest.mark.parametrize("distance", [1e-9, 1e-8, 1e-7, 1e-6])
def test_friction_that_builds_up_over_next_to_no_distance_is_friction_that_jumps(distance):
    """Below what a step of a millisecond resolves too: there the bristles' own equation has no stable step."""
    light = with_values(emps(), {"mass_kg": 5.0})
    settings = CASCADE.model_copy(update={"kp": CASCADE.kp / 19.0, "ki": CASCADE.ki / 19.0})
    bristles = light.model_copy(update={"allowances": {"presliding": {"distance_m": distance}}})
    jumps, builds_up = (followed(axis, settings, there_and_back()).metrics for axis in (light, bristles))
    assert builds_up["peak_force_n"] == pytest.approx(jumps["peak_force_n"], rel=0.05)
    assert builds_up["tracking_error_max_m"] == pytest.approx(jumps["tracking_error_max_m"], rel=0.5)


@pytest.mark.parametrize("kind", [kind for kind in KINDS.values() if kind.closed_loop], ids=lambda kind: kind.name)
def test_shorter_steps_tell_nothing_else(kind):
    """Of every kind, by a move forth and back: friction turns over within microseconds where little mass is behind."""
    machine = looped(kind.example())
    assert machine is not None
    study, judged = small_study(machine, []), set_of(kind.name)
    usual, finer = (
        [row for row, _ in run_specs([replace(spec, step_s=step) for spec in study.specs(machine)])]
        for step in (1e-3, 2e-5)
    )
    for a, b in zip(usual, finer, strict=True):
        for name in (judged.peak, judged.error, judged.rms_error):
            assert a[name] == pytest.approx(b[name], rel=0.005), (a.reference, name)


# The multi-body machine beside the lumped plant: under one torque, and in the same closed loop.


ROOT = Path(__file__).resolve().parents[2]

SLOW = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0, sample_time_s=0.004)
REFERENCE = np.interp(np.arange(1250) * 0.004, [0.2, 1.2, 2.0, 3.2, 4.4], [0.0, 60.0, 60.0, -60.0, 0.0])


def case_of(settings: PiSettings = SLOW, **drive: Any) -> LoopCase:
    machine = with_values(MACHINE, {f"drive.{name}": value for name, value in drive.items()})
    return LoopCase("run", machine, 4500.0, 9.0, settings, REFERENCE)


@pytest.fixture(scope="module")
def pair() -> tuple[LoopResult, LoopResult]:
    (lumped,) = simulate_loop([case_of()], record_every=1)
    return lumped, simulate_multibody_loop(case_of(), record_every=1, step_s=0.004)


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
    still = replace(case_of(), speed_reference_rad_s=np.zeros(2250), events=events)
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
    (lumped,) = simulate_loop([case_of(**drive)])
    multibody = simulate_multibody_loop(case_of(**drive), step_s=0.004)
    for name in ("peak_torque_motor_nm", "speed_error_rms_rad_s"):
        assert multibody.metrics[name] == pytest.approx(lumped.metrics[name], rel=0.02)


def test_a_machine_that_cannot_hang_is_an_outcome_with_its_place_and_not_an_unstable_loop():
    soft = replace(case_of(), machine=with_values(MACHINE, {"arm.cylinder_stiffness_n_per_m": 1.0}))
    result = simulate_multibody_loop(soft)
    assert result.outcome is Outcome.NOT_SOLVED
    assert "does not hang still" in result.at and "at height 9.000 m with 4500 kg" in result.at


def test_an_engine_that_gives_up_says_when_and_in_what_state(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(motion, "TOLERANCE", 1e-300)  # which no iteration reaches once anything moves
    result = simulate_multibody_loop(case_of(), step_s=0.004)
    assert result.outcome is Outcome.NOT_SOLVED
    assert "did not converge, at 0." in result.at
    assert "height 9.000 m" in result.at and "torque 597" in result.at


def test_an_effect_that_it_does_not_know_is_said_before_anything_runs():
    with pytest.raises(InputError, match="has no effect 'backlash'"):
        check_multibody(MACHINE.model_copy(update={"effects": {"backlash": {"play_rad": 0.01}}}))
