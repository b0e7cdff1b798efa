"""A first-order lag behind a held value, over one step: exact at its end, exact in what it gives the plant."""

from __future__ import annotations

import math
from dataclasses import dataclass

_SERIES = 0.02  # below this step over time constant the closed forms lose digits


@dataclass(frozen=True)
class LagStep:
    """A torque that nears a held one, u(t) = held + (u0 - held) exp(-t/T), over a step h.

    left: of the difference at the step's end. start, slope_per_s: the straight line start + slope t, of the
    difference, that has the exponential's integral and first moment over the step, so that an inertia ends the step
    with the very speed and angle that the lag gives it, however short the lag. mean: of the difference over the step.
    Without a lag all are 0: the torque is the held one.
    """

    left: float
    start: float
    slope_per_s: float
    mean: float


def lag_step(time_constant_s: float, step_s: float) -> LagStep:
    """With x = h/T: integral m0 = (1 - exp(-x))/x, first moment m1 = (1 - (1 + x) exp(-x))/x², both over h."""
    if time_constant_s == 0.0:
        return LagStep(0.0, 0.0, 0.0, 0.0)
    x = step_s / time_constant_s
    left = math.exp(-x)
    if x < _SERIES:
        m0 = 1.0 - x / 2.0 + x**2 / 6.0 - x**3 / 24.0 + x**4 / 120.0
        m1 = 1.0 / 2.0 - x / 3.0 + x**2 / 8.0 - x**3 / 30.0 + x**4 / 144.0
    else:
        m0, m1 = (1.0 - left) / x, (1.0 - (1.0 + x) * left) / (x * x)
    return LagStep(left, 4.0 * m0 - 6.0 * m1, (12.0 * m1 - 6.0 * m0) / step_s, m0)


def weight_before(time_constant_s: float, sample_time_s: float) -> float:
    """The mean torque between two samples is w (torque then) + (1 - w) (torque now); this is w.

    Without a lag the torque seen at a sample is the one that is held from then on: w = 1. Behind a lag the torque is
    continuous, u1 = held + (u0 - held) L, and its mean held + (u0 - held) m0 holds both.
    """
    if time_constant_s == 0.0:
        return 1.0
    step = lag_step(time_constant_s, sample_time_s)
    if sample_time_s / time_constant_s < 1e-4:  # a straight line
        return 0.5
    return step.mean - step.left * (1.0 - step.mean) / (1.0 - step.left)
