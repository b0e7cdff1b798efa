"""The zero-phase low-pass, its ends, the moving samples, and the noise of a channel."""

from __future__ import annotations

import math

import numpy as np
import pytest

from workbench.simulate.lowpass import LowpassAt, lowpass, noise_rms
from workbench.simulate.motion import moving

TIME = np.arange(0.0, 40.0, 0.01)


def gain_at(frequency_hz: float, band_hz: float, time: np.ndarray = TIME) -> complex:
    """What the filter makes of a tone, as amplitude and phase."""
    wave = np.sin(2.0 * math.pi * frequency_hz * time)
    smooth = lowpass(time, wave, band_hz)
    keep = (time > 5.0) & (time < 35.0)
    basis = np.exp(2j * math.pi * frequency_hz * time[keep])
    model = np.column_stack([basis.imag, basis.real])
    (in_phase, quadrature), *_ = np.linalg.lstsq(model, smooth[keep], rcond=None)
    return complex(in_phase, quadrature)


@pytest.mark.parametrize("band", [0.5, 1.7, 8.0])
def test_the_gain_at_the_band_is_minus_3_db(band):
    assert abs(gain_at(band, band)) == pytest.approx(1.0 / math.sqrt(2.0), rel=1e-3)


@pytest.mark.parametrize("ratio", [0.2, 0.5, 1.5, 2.0, 4.0])
def test_the_gain_is_that_of_a_fourth_order_butterworth_run_both_ways(ratio):
    f0 = 1.7 / (math.sqrt(2.0) - 1.0) ** 0.125
    assert abs(gain_at(1.7 * ratio, 1.7)) == pytest.approx(1.0 / (1.0 + (1.7 * ratio / f0) ** 8), abs=1e-4)


@pytest.mark.parametrize("frequency", [0.3, 1.0, 1.7, 2.5])
def test_no_phase_is_turned(frequency):
    response = gain_at(frequency, 1.7)
    assert abs(response.imag) < 1e-4 * abs(response) + 1e-6


@pytest.mark.parametrize("band", [0.1, 1.7, 20.0])
@pytest.mark.parametrize(("level", "slope"), [(50.0, 0.0), (-3.0, 20.0)])
def test_a_constant_and_a_line_pass_unchanged_to_their_very_ends(level, slope, band):
    line = level + slope * TIME
    assert lowpass(TIME, line, band) == pytest.approx(line, abs=1e-9 * (1.0 + abs(level) + 40.0 * abs(slope)))


@pytest.mark.parametrize(("band", "summed"), [(0.1, False), (1.7, True), (8.0, False), (60.0, False)])
def test_the_low_pass_at_some_samples_is_the_low_pass_there(band, summed):
    """Next to the ends, evenly apart and across a gap; by sums where they are quicker than a transform."""
    rows = np.concatenate([[0, 1, 5], np.arange(40, 1500, 12), np.arange(1777, 3990, 12), [3998, 3999]])
    series = np.array([5.0, -40.0, 0.0]) + np.cumsum(np.random.default_rng(3).normal(size=(len(TIME), 3)), axis=0)
    at = LowpassAt(TIME, band, rows)
    assert at.summed == summed
    assert at(series) == pytest.approx(lowpass(TIME, series, band)[rows], abs=1e-9 * np.max(np.abs(series)))


def test_irregular_samples_are_filtered_at_their_own_times():
    rng = np.random.default_rng(2)
    time = np.sort(rng.uniform(0.0, 40.0, 8000))
    slow = np.sin(2.0 * math.pi * 0.3 * time)
    fast = np.sin(2.0 * math.pi * 9.0 * time)
    smooth = lowpass(time, slow + fast, 1.7)
    keep = (time > 5.0) & (time < 35.0)
    assert np.sqrt(np.mean((smooth - slow)[keep] ** 2)) < 0.02


@pytest.mark.parametrize("band", [0.5, 2.0, 10.0])
def test_the_noise_below_the_band_is_recovered_under_a_slow_signal(band):
    time = np.arange(0.0, 400.0, 0.01)
    white = np.random.default_rng(4).normal(0.0, 3.0, len(time))
    under = 500.0 + 200.0 * np.sin(0.5 * time) + np.where(time > 200.0, 80.0, 0.0)
    said = noise_rms(time, under + white, band)
    assert said == pytest.approx(3.0 * math.sqrt(band / 50.0), rel=0.03)
    assert said == pytest.approx(np.std(lowpass(time, white, band)), rel=0.1)  # what the filter really leaves


def speed_profile(*spans: tuple[float, float]) -> np.ndarray:
    """10 of some speed, and rest in the given spans."""
    speed = np.full(len(TIME), 10.0)
    for begin, end in spans:
        speed[(begin <= TIME) & (end > TIME)] = 0.0
    return speed


def test_a_rest_is_left_out_with_half_a_period_around():
    keep = moving(TIME, speed_profile((10.0, 20.0)), 100.0, 2.0)
    left_out = TIME[~keep]
    assert 9.7 < left_out[0] < 10.15
    assert 19.85 < left_out[-1] < 20.3
    assert np.array_equal(left_out, TIME[(left_out[0] <= TIME) & (left_out[-1] >= TIME)])


def test_a_quick_reversal_is_no_rest():
    speed = 10.0 * np.sign(20.0 - TIME)
    assert np.all(moving(TIME, speed, 100.0, 2.0))


def test_noise_at_rest_is_no_motion():
    noise = np.random.default_rng(5).normal(0.0, 0.5, len(TIME))
    keep = moving(TIME, speed_profile((10.0, 20.0)) + noise, 100.0, 2.0)
    assert not np.any(keep[(TIME > 10.5) & (TIME < 19.5)])
    assert np.all(keep[(TIME < 9.0) | (TIME > 21.0)])
