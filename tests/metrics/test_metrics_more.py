"""Torque over time, tracking, tension, power and jerk: each metric against a closed form or a trace made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.metrics.test_metrics import DT, P, metric, trace, with_peak
from workbench.control import PiSettings
from workbench.core.run import Run
from workbench.machines import default_hoist, with_values
from workbench.metrics import measure, observer
from workbench.simulate.loop import LoopCase, simulate_loop

LIFT = 0.6 / (4 * 31)  # m of carriage per rad of motor


def test_i2t_of_nominal_torque_is_the_time_it_lasts():
    run = trace(torque_motor_nm=np.full(100, 960.0))  # 480 N m each, for 1 s
    assert metric("i2t_s", run) == pytest.approx(1.0)
    assert metric("thermal_load_percent", run) == pytest.approx(100.0)


def test_i2t_of_a_sine_is_half_of_its_peak_squared_times_the_time():
    time = np.arange(1000) * DT  # ten whole periods
    run = trace(1000, torque_motor_nm=1920.0 * np.sin(2.0 * math.pi * time))
    assert metric("i2t_s", run) == pytest.approx(0.5 * 2.0**2 * 10.0)
    assert metric("thermal_load_percent", run) == pytest.approx(200.0)


def test_thermal_load_is_the_square_of_the_rms_torque_over_nominal():
    run = trace(torque_motor_nm=np.linspace(-900.0, 1400.0, 100))
    ratio = metric("rms_torque_motor_nm", run) / 480.0
    assert metric("thermal_load_percent", run) == pytest.approx(100.0 * ratio**2)


def test_overload_counts_the_time_above_nominal_either_way_and_not_at_it():
    torque = np.full(100, 960.0)
    torque[10:17], torque[50:53] = 960.1, -1000.0
    assert metric("overload_time_s", trace(torque_motor_nm=torque)) == pytest.approx(10 * DT)


def test_with_one_motor_left_the_same_torque_is_overload():
    run = trace(torque_motor_nm=np.full(100, 600.0))
    assert metric("overload_time_s", run) == 0.0
    assert metric("overload_time_s", run, t_fail=0.395) == pytest.approx(60 * DT)


def test_the_torque_rate_of_a_ramp_is_its_slope_for_one_motor():
    time = np.arange(100) * DT
    assert metric("torque_rate_max_nm_per_s", trace(torque_motor_nm=list(600.0 - 50.0 * time))) == pytest.approx(25.0)


def test_the_torque_rate_takes_the_largest_change_and_not_that_from_nothing_to_the_first_sample():
    run = trace(torque_motor_nm=with_peak(660.0))
    assert metric("torque_rate_max_nm_per_s", run) == pytest.approx(30.0 / DT)
    assert metric("torque_rate_max_nm_per_s", trace()) == 0.0


def test_a_change_over_a_longer_pause_is_a_smaller_rate():
    base = trace(4, torque_motor_nm=[600.0, 600.0, 700.0, 700.0], acceleration_carriage_m_s2=[0.0, 0.0, 0.6, 0.6])
    run = Run("by hand", np.array([0.0, 0.1, 0.3, 0.4]), base.signals)
    assert metric("torque_rate_max_nm_per_s", run) == pytest.approx(50.0 / 0.2)
    assert metric("peak_carriage_jerk_m_s3", run) == pytest.approx(3.0)


def test_the_jerk_of_a_growing_acceleration_is_its_slope():
    run = trace(acceleration_carriage_m_s2=list(5.0 - 0.8 * np.arange(100) * DT))
    assert metric("peak_carriage_jerk_m_s3", run) == pytest.approx(0.8)


def test_the_integral_of_the_absolute_error_of_a_sine_is_its_closed_form():
    time = np.arange(1000) * DT
    run = trace(1000, speed_reference_rad_s=10.0 + 3.0 * np.sin(2.0 * math.pi * time))
    assert metric("speed_error_iae_rad", run) == pytest.approx(3.0 * 2.0 / math.pi * 10.0, rel=1e-3)


def test_overshoot_is_beyond_the_extremes_of_the_whole_reference_either_way():
    reference = np.concatenate([np.full(50, 100.0), np.full(50, -80.0)])
    up = reference + np.where(np.arange(100) == 20, 4.0, 0.0)
    down = up - np.where(np.arange(100) == 70, 5.0, 0.0)
    for speed, wanted in ((reference, 0.0), (up, 4.0), (down, 5.0), (0.5 * reference, 0.0)):
        run = trace(speed_reference_rad_s=reference, speed_motor_rad_s=speed)
        assert metric("speed_overshoot_rad_s", run) == wanted


def decaying(amplitude: float, time_constant_s: float) -> Run:
    """A reference that stops after 2 s, and a speed error that dies away from there."""
    time = np.arange(1000) * DT
    reference = np.where(time < 2.0, 50.0, 0.0)
    error = np.where(time < 2.0, 0.0, amplitude * np.exp(-(time - 2.0) / time_constant_s))
    return trace(1000, speed_reference_rad_s=reference, speed_motor_rad_s=reference + error)


@pytest.mark.parametrize("amplitude", [15.71, -15.71])
def test_an_exponential_settles_to_a_tenth_after_its_time_constant_times_ln_10(amplitude):
    # 1 % of 157.1 rad/s is 1.571 rad/s.
    assert metric("settling_time_s", decaying(amplitude, 1.0)) == pytest.approx(math.log(10.0), abs=DT)


def test_what_is_within_its_band_at_the_stop_has_settled_and_what_never_settles_says_so():
    assert metric("settling_time_s", decaying(1.5, 1.0)) == 0.0
    assert metric("settling_time_s", decaying(20.0, 1e6)) == pytest.approx(8.0)


def test_the_position_error_is_the_speed_error_summed_up_in_carriage_travel():
    time = np.arange(300) * DT
    reference = np.where(time < 2.0, 10.0, 0.0)
    # 1 s behind by 2 rad/s, then caught up by half before the stop and wholly after it.
    speed = reference - np.select([time < 1.0, time < 2.0, time >= 2.0], [2.0, -1.0, -1.0])
    run = trace(300, speed_reference_rad_s=reference, speed_motor_rad_s=speed)
    assert metric("position_error_max_m", run) == pytest.approx(2.0 * LIFT)
    assert metric("position_error_stop_m", run) == pytest.approx(-1.0 * LIFT)  # below its reference
    ahead = trace(300, speed_reference_rad_s=-reference, speed_motor_rad_s=-speed)
    assert metric("position_error_stop_m", ahead) == pytest.approx(1.0 * LIFT)


def test_the_swing_is_of_the_fall_that_swings_more():
    run = trace(tension_drum_n=with_peak(7e4, calm=6e4), tension_dead_line_n=with_peak(4.5e4, at=3, calm=6e4))
    assert metric("wire_tension_swing_n", run) == 1.5e4
    assert metric("wire_tension_swing_n", trace()) == 0.0


def test_the_safety_factor_is_breaking_load_over_largest_tension():
    run = trace(tension_dead_line_n=with_peak(1.2e5, calm=6e4))
    assert metric("wire_safety_factor", run, W_break=6e5) == pytest.approx(5.0)


def test_without_a_breaking_load_there_is_no_safety_factor():
    assert "wire_safety_factor" not in measure(trace(), P)
    assert {m.name for m in observer().metrics if m.optional} == {"wire_safety_factor"}


def test_peak_power_is_torque_times_speed_by_sign():
    speed = np.full(100, 10.0)
    speed[40], speed[60] = 150.0, -120.0
    run = trace(speed_motor_rad_s=speed)
    assert metric("peak_power_motoring_kw", run) == pytest.approx(600.0 * 150.0 / 1000.0)
    assert metric("peak_power_regenerating_kw", run) == pytest.approx(600.0 * 120.0 / 1000.0)
    assert metric("peak_power_regenerating_kw", trace()) == 0.0


def test_sums_that_several_metrics_read_are_kept_once():
    starts = {id(m.accumulators): len(m.accumulators.start) for m in observer().metrics}
    assert observer().size == sum(starts.values()) < sum(len(m.accumulators.start) for m in observer().metrics)


def lifted(**values: float) -> dict[str, float]:
    machine = with_values(default_hoist(), {"drive.overload": 3.0, **values})
    reference = np.interp(np.arange(4000) * 0.001, [0.1, 0.6, 1.6, 2.1], [0.0, 60.0, 60.0, 0.0])
    case = LoopCase("lift", machine, 4500.0, 8.0, PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0), reference)
    (done,) = simulate_loop([case], record_every=1)
    r, w = done.run["speed_reference_rad_s"], done.run["speed_motor_rad_s"]
    behind = np.cumsum(r - w) * 0.001 * machine.lift_m_per_rad
    assert done.metrics["position_error_max_m"] == pytest.approx(np.abs(behind).max(), rel=1e-9)
    assert done.metrics["torque_rate_max_nm_per_s"] == pytest.approx(
        np.abs(np.diff(done.run["torque_motor1_nm"])).max() / 0.001, rel=1e-9
    )
    return done.metrics


def test_in_the_compiled_loop_the_breaking_load_gives_its_factor():
    factor = lifted(**{"wire.breaking_load_n": 5e5})
    assert factor["wire_safety_factor"] == pytest.approx(5e5 / factor["max_wire_tension_n"])
    assert lifted()["wire_safety_factor"] == pytest.approx(547e3 / factor["max_wire_tension_n"])


def test_peak_power_of_a_lift_is_near_hold_torque_times_speed():
    metrics = lifted()
    assert metrics["peak_power_motoring_kw"] > 1.2 * 60.0 * (12500 * 9.81 * LIFT) / 1000.0
    # The speed swings below rest at the stop: the weight drives the motors back for a moment.
    assert 0.0 < metrics["peak_power_regenerating_kw"] < 0.3 * metrics["peak_power_motoring_kw"]
    assert 0.0 < metrics["settling_time_s"] < 1.9
    assert metrics["speed_overshoot_rad_s"] > 0.0


@pytest.mark.parametrize(("amplitude", "swings"), [(0.51, 19), (3.0, 20), (0.49, 0)])
def test_torque_that_goes_to_and_fro_by_more_than_nominal_swings_twice_a_period(amplitude, swings):
    time = np.arange(1000) * DT  # ten periods; the last way back, to zero, counts where it is long enough
    run = trace(1000, torque_motor_nm=300.0 + 960.0 * amplitude * np.sin(2.0 * math.pi * time))
    assert metric("torque_swings", run) == swings


def test_small_steps_on_the_way_are_no_swings_of_their_own():
    steps = np.cumsum(np.where(np.arange(200) % 5 == 4, -150.0, 100.0))  # up to and down again, in saw teeth
    assert metric("torque_swings", trace(400, torque_motor_nm=[*steps, *steps[::-1]])) == 1
