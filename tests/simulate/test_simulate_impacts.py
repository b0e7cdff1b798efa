"""Impacts of a play in a log: found where momentum is lost without the input, and only where they come again."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.core.run import Array, Run
from workbench.simulate.motion import bridged, repeated_impacts

MASS, TIMES = 20.0, (0.73, 1.61, 2.48, 3.37)
NAMES = ("position_m", "velocity_m_s", "force_n")


def moved(impacts: tuple[float, ...] = (), loss: float = 0.3, seed: int = 1, ramp_s: float = 0.2) -> Run:
    """A carriage goes to and fro in ramps; at each impact it loses that share of 1 m/s and gets it back in 30 ms."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 4.0, 0.001)
    corners = np.arange(0.0, 4.5, 0.5)
    ends = [0.0, *(1.0 if k % 2 else -1.0 for k in range(1, len(corners)))]
    v = np.interp(t, np.sort([*corners[:-1], *(corners[1:] - 0.5 + ramp_s)]), [*np.repeat(ends[:-1], 2)[1:], ends[-1]])
    force = MASS * np.gradient(v, t) + 5.0 * np.sign(v)
    for at in impacts:
        lost = np.where((t >= at) & (t < at + 0.03), loss * (1.0 - (t - at) / 0.03), 0.0)
        force = force + np.where((t >= at) & (t < at + 0.03), MASS * loss / 0.03, 0.0)  # the drive brings it back
        v = v - lost
    signals = {"velocity_m_s": v + rng.normal(0.0, 1e-3, len(t)), "force_n": force + rng.normal(0.0, 0.5, len(t))}
    return Run("there and back", t, signals)


def found(*runs: Run) -> tuple[Array, ...]:
    return repeated_impacts(runs, MASS, *NAMES)


def test_impacts_that_come_again_are_found_at_their_times():
    first, second = found(moved(TIMES), moved(TIMES[1:], seed=2))
    assert first == pytest.approx(TIMES, abs=0.006)
    assert second == pytest.approx(TIMES[1:], abs=0.006)


@pytest.mark.parametrize("ramp_s", [0.02, 0.1, 0.4])
def test_what_the_input_moves_is_no_impact_however_steep(ramp_s: float):
    assert all(len(impacts) == 0 for impacts in found(moved(ramp_s=ramp_s), moved(ramp_s=ramp_s, seed=2)))


def test_impacts_of_one_run_alone_are_an_event_and_none_of_a_play():
    assert all(len(impacts) == 0 for impacts in found(moved(TIMES), moved(seed=2)))


def test_a_loss_of_a_hundredth_of_the_speed_is_no_plain_impact():
    assert all(len(impacts) == 0 for impacts in found(moved(TIMES, 0.01), moved(TIMES, 0.01, seed=2)))


def test_the_acceleration_runs_straight_across_an_impact_and_is_kept_beside_it():
    t = np.arange(0.0, 1.0, 0.001)
    a = 2.0 * t + np.where(np.abs(t - 0.5) < 0.005, 100.0, 0.0)
    assert bridged(t, a, np.array([0.5])) == pytest.approx(2.0 * t, abs=1e-12)
    assert bridged(t, a, np.zeros(0)) is a
