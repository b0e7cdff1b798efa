"""The torque's lag over a step of the plant: exact at its end and in what it gives, nothing where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.ideal import ideal_hoist
from workbench.analysis.linearise import OperatingPoint, linearise
from workbench.analysis.loop import sampled_plant
from workbench.control import PiSettings, lag_step, weight_before
from workbench.machines import Hoist, with_values
from workbench.simulate.loop import LoopCase, simulate_loop

POINT, SETTINGS = OperatingPoint(4500.0, 10.0), PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)
H = 0.001
IDEAL = ideal_hoist()


def lagging(time_constant_s: float) -> Hoist:
    return with_values(IDEAL, {"drive.torque_lag_s": time_constant_s})


@pytest.mark.parametrize("time_constant_s", [1e-6, 1e-4, 1e-3, 0.004, 0.0499, 0.0501, 10.0])
def test_the_straight_line_has_the_exponentials_integral_and_first_moment(time_constant_s: float):
    from scipy.integrate import quad

    step = lag_step(time_constant_s, H)
    exact = [
        quad(lambda t, n=n: t**n * np.exp(-t / time_constant_s), 0.0, min(H, 60.0 * time_constant_s))[0] for n in (0, 1)
    ]
    line = [step.start * H + step.slope_per_s * H**2 / 2.0, step.start * H**2 / 2.0 + step.slope_per_s * H**3 / 3.0]
    np.testing.assert_allclose(line, exact, rtol=1e-8)
    assert step.left == pytest.approx(np.exp(-H / time_constant_s))
    assert step.mean * H == pytest.approx(exact[0], rel=1e-8)


def test_the_delay_of_a_lag_is_its_time_constant():
    """At low frequency the phase that a lag costs is that of a delay of its time constant."""
    f = np.array([1.0])
    plant = linearise(IDEAL, POINT)
    with_lag, without = (sampled_plant(plant, H, lagging(lag).drive).response(f)[0, 0, 0] for lag in (0.004, 0.0))
    assert np.angle(with_lag / without) == pytest.approx(-np.arctan(2.0 * np.pi * 0.004), rel=1e-3)


def test_the_simulated_run_goes_over_into_that_without_lag():
    speed = 20.0 * np.clip(np.arange(1500) / 1000.0, 0.0, 1.0)
    none, hardly, real = simulate_loop(
        [LoopCase("", lagging(lag), 4500.0, 5.0, SETTINGS, speed) for lag in (0.0, 1e-6, 0.004)], record_every=10
    )
    w = [result.run["speed_motor_rad_s"] for result in (none, hardly, real)]
    assert np.abs(w[1] - w[0]).max() < 1e-4 < np.abs(w[2] - w[0]).max()
    assert hardly.metrics["energy_motoring_j"] == pytest.approx(none.metrics["energy_motoring_j"], rel=1e-4)


@pytest.mark.parametrize("time_constant_s", [1e-6, 1e-3, 0.02])
def test_the_mean_torque_between_two_samples_is_that_of_the_exponential(time_constant_s: float):
    held, before = 300.0, 100.0
    now = held + (before - held) * np.exp(-H / time_constant_s)
    mean = held + (before - held) * time_constant_s / H * (1.0 - np.exp(-H / time_constant_s))
    w = weight_before(time_constant_s, H)
    assert w * before + (1.0 - w) * now == pytest.approx(mean, rel=1e-9)
