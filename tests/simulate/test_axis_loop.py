"""An axis under its cascade: closed forms, a balance of energy, a loop written out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.axes import CASCADE, emps, followed, ideal_axis, there_and_back, two_inertia
from workbench.control import AxisFeedForward, LinearCascade, RotaryCascade
from workbench.machines import KINDS, with_values
from workbench.metrics import set_of
from workbench.references import Limits, Step, plan_motion
from workbench.simulate.loop import Outcome
from workbench.study.consequences import looped, small_study
from workbench.study.run import run_specs

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
