"""The shape of one move: position, speed and acceleration as functions of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from workbench.core.run import Array
from workbench.references.limits import Limits

Motion = Callable[[Array], tuple[Array, Array, Array]]


@dataclass(frozen=True, eq=False)
class Shape:
    """A move of `distance_m` that takes `duration_s`.

    motion: rising times (s) from 0 to `duration_s` -> position (m), speed (m/s), acceleration (m/s²), each (n,); the
    position counts from the start of the move. `Pieces` is one; any function will do. end_speed_m_s: 0, except where a
    jog goes on into the next.
    """

    distance_m: float
    duration_s: float
    limits: Limits
    motion: Motion
    end_speed_m_s: float = 0.0

    def at(self, time_s: Array) -> tuple[Array, Array, Array]:
        """Position (m), speed (m/s), acceleration (m/s²) at rising times since the start; speed 0 outside."""
        position, speed, acceleration = np.zeros((3, len(time_s)))
        self.add_to(time_s, position, speed, acceleration)
        return position, speed, acceleration

    def add_to(self, since_s: Array, position: Array, speed: Array, acceleration: Array) -> None:
        """Add what `at` gives to arrays of a whole plan."""
        first, last = np.searchsorted(since_s, (0.0, self.duration_s))
        if first < last:
            p, v, a = self.motion(since_s[first:last])
            position[first:last] += p
            speed[first:last] += v
            acceleration[first:last] += a
        position[last:] += self.distance_m

    def going_on(self, time_s: Array) -> tuple[Array, Array, Array]:
        """The same, with the end speed kept after the end."""
        position, speed, acceleration = self.at(time_s)
        late = time_s >= self.duration_s
        position[late] += self.end_speed_m_s * (time_s[late] - self.duration_s)
        speed[late] = self.end_speed_m_s
        return position, speed, acceleration

    def held(self, duration_s: float) -> Shape:
        """The shape with its end speed kept until `duration_s` is over; a shape that ends at rest ends as it is."""
        if self.end_speed_m_s == 0.0 or duration_s <= self.duration_s:
            return self
        further = self.end_speed_m_s * (duration_s - self.duration_s)
        return replace(self, distance_m=self.distance_m + further, duration_s=duration_s, motion=self.going_on)


@dataclass(frozen=True, eq=False)
class Pieces:
    """A motion of polynomials, one a phase.

    start_s: (phases,), the first one 0. coefficients: (order + 1, phases) of the position in powers of the time since
    the phase's start, lowest first.
    """

    start_s: Array
    coefficients: Array

    @staticmethod
    def of_even_jerk(start_s: Array, position: Array, speed: Array, acceleration: Array, jerk: Array) -> Pieces:
        """Cubics, from what each phase begins with, (phases,) each."""
        return Pieces(start_s, np.array([position, speed, acceleration / 2.0, jerk / 6.0]))

    @staticmethod
    def through(steps_s: Array, start: Array, end: Array) -> Pieces:
        """Polynomials of fifth order from (position, speed, acceleration) to the same, (phases, 3) each (Hermite)."""
        (p0, v0, a0), (p1, v1, a1), h = start.T, end.T, steps_s
        d = p1 - p0
        third = 20.0 * d - (8.0 * v1 + 12.0 * v0) * h - (3.0 * a0 - a1) * h**2
        fourth = -30.0 * d + (14.0 * v1 + 16.0 * v0) * h + (3.0 * a0 - 2.0 * a1) * h**2
        fifth = 12.0 * d - 6.0 * (v1 + v0) * h - (a0 - a1) * h**2
        start_s = np.concatenate([[0.0], np.cumsum(h)[:-1]])
        return Pieces(
            start_s, np.array([p0, v0, a0 / 2.0, third / (2 * h**3), fourth / (2 * h**4), fifth / (2 * h**5)])
        )

    def __call__(self, time_s: Array) -> tuple[Array, Array, Array]:
        position, speed, acceleration = np.empty((3, len(time_s)))
        power = np.arange(1.0, len(self.coefficients))[:, None]
        of_speed = self.coefficients[1:] * power
        of_acceleration = of_speed[1:] * power[:-1]
        # Phase by phase: six times as fast as looking up each time's phase.
        edges = [0, *np.searchsorted(time_s, self.start_s[1:]), len(time_s)]
        for k, (first, last) in enumerate(pairwise(edges)):
            if first < last:
                t = time_s[first:last] - self.start_s[k]
                position[first:last] = _polynomial(self.coefficients[:, k], t)
                speed[first:last] = _polynomial(of_speed[:, k], t)
                acceleration[first:last] = _polynomial(of_acceleration[:, k], t)
        return position, speed, acceleration


def _polynomial(coefficients: Array, t: Array) -> Array:
    """By Horner's rule, lowest first."""
    value = coefficients[-1] + 0.0 * t
    for c in coefficients[-2::-1]:
        value = c + t * value
    return value
