"""References that were recorded: a campaign's set-point as it was, or smoothed to an S-curve."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.references.limits import Limits
from workbench.references.plan import Sampling

# Below this part of its largest speed a set-point is at rest.
AT_REST = 0.01
# A run that begins or ends faster than this part of its largest speed was cut out of a motion.
CUT = 0.05
# A shorter average (s) is the difference of two almost equal numbers, and smooths nothing.
SHORTEST = 0.001


@dataclass(frozen=True, eq=False)
class RecordedPlan(Sampling):
    """A recorded speed of the carriage, followed again.

    time_s, speed_recorded_m_s: (n,), up positive, any sampling; linear in between, at rest before and
    after. start_position_m: the height it starts from. lead_s, settle_s: at rest before and after.

    smoothing_s: 0 follows the set-point as it is. Above 0 it is a moving average over that
    time T, of the samples up to now:

        v(t) = 1/T · ∫ v_recorded(τ) dτ   over t − T … t

    A ramp of acceleration a becomes an S-curve of jerk a/T; nothing overshoots, the distance is the
    recorded one to the last millimetre, and the motion is T longer and on average T/2 late.

    Raises InputError for a record that is cut out of a motion, stands still throughout or leaves the rail.
    """

    kind: str
    time_s: Array
    speed_recorded_m_s: Array
    start_position_m: float
    rail_m: tuple[float, float]
    lead_s: float = 0.0
    settle_s: float = 0.0
    smoothing_s: float = 0.0
    move_limits: tuple[Limits, ...] = ()

    def __post_init__(self) -> None:
        speed, low, high = self.speed_recorded_m_s, *self.rail_m
        if not (self.smoothing_s == 0.0 or SHORTEST <= self.smoothing_s < math.inf):
            raise InputError(f"{self.smoothing_s:g} s, expected 0 or at least {SHORTEST:g} s", place="smoothing_s")
        top = float(np.abs(speed).max())
        if not (math.isfinite(top) and top > 0.0):
            raise InputError("the recorded reference stands still throughout or holds no numbers", place="references")
        for end, value in (("begins", float(speed[0])), ("ends", float(speed[-1]))):
            if abs(value) > CUT * top:
                raise InputError(
                    f"the recorded reference {end} at {value:.3g} m/s; expected a run that begins and ends at rest",
                    place="references",
                )
        path = self.start_position_m + self._distance_m
        if path.min() < low - 1e-6 or path.max() > high + 1e-6:
            raise InputError(
                f"the recorded reference goes from {self.start_position_m:g} m to between {path.min():.4g} and "
                f"{path.max():.4g} m and leaves the rail, which reaches from {low:g} m to {high:g} m",
                place="references",
            )

    @cached_property
    def _distance_m(self) -> Array:
        """Travel since the start at each recorded time: the trapezoidal rule is exact for linear pieces."""
        steps = 0.5 * (self.speed_recorded_m_s[1:] + self.speed_recorded_m_s[:-1]) * np.diff(self.time_s)
        return np.concatenate(([0.0], np.cumsum(steps)))

    def _travel(self, t: Array) -> Array:
        """Travel at times t since the record's start: parabolas between the recorded times."""
        time, v = self.time_s - self.time_s[0], self.speed_recorded_m_s
        inside = np.clip(t, 0.0, time[-1])
        k = np.clip(np.searchsorted(time, inside, side="right") - 1, 0, len(time) - 2)
        rest = inside - time[k]
        slope = (v[k + 1] - v[k]) / (time[k + 1] - time[k])
        return self._distance_m[k] + rest * (v[k] + 0.5 * slope * rest)

    def _travel_twice(self, t: Array) -> Array:
        """∫ travel dt, by Simpson's rule between the recorded times: exact for parabolas."""
        time = self.time_s - self.time_s[0]
        ends = self._travel(time)
        middle = self._travel(0.5 * (time[1:] + time[:-1]))
        sums = np.concatenate(([0.0], np.cumsum(np.diff(time) * (ends[:-1] + 4.0 * middle + ends[1:]) / 6.0)))
        inside = np.clip(t, 0.0, time[-1])
        k = np.clip(np.searchsorted(time, inside, side="right") - 1, 0, len(time) - 2)
        rest = inside - time[k]
        part = rest * (ends[k] + 4.0 * self._travel(time[k] + 0.5 * rest) + self._travel(inside)) / 6.0
        return sums[k] + part + np.maximum(t - time[-1], 0.0) * ends[-1]

    @property
    def end_position_m(self) -> float:
        return self.start_position_m + float(self._distance_m[-1])

    @property
    def duration_s(self) -> float:
        return self.lead_s + float(self.time_s[-1] - self.time_s[0]) + self.smoothing_s + self.settle_s

    @cached_property
    def move_windows(self) -> tuple[tuple[float, float], ...]:
        """Stretches in motion: from where the set-point leaves 1 % of its largest speed to where it is back."""
        time = self.lead_s + self.time_s - self.time_s[0]
        going = np.abs(self.speed_recorded_m_s) > AT_REST * float(np.abs(self.speed_recorded_m_s).max())
        edges = np.flatnonzero(np.diff(np.concatenate(([False], going, [False])).astype(np.int8)))
        last = len(time) - 1
        return tuple(
            (float(time[max(a - 1, 0)]), float(time[min(b, last)]) + self.smoothing_s) for a, b in edges.reshape(-1, 2)
        )

    @cached_property
    def acceleration_m_s2(self) -> float:
        """The steepest slope of the set-point, as smoothed."""
        step = float(np.median(np.diff(self.time_s)))
        return float(np.abs(self.sample(step).acceleration_m_s2).max())

    def at(self, time_s: Array) -> tuple[Array, Array, Array]:
        """Height (m), speed (m/s) and acceleration (m/s², by differences of the times) at rising times (s)."""
        t = time_s - self.lead_s
        recorded = self.time_s - self.time_s[0]
        if self.smoothing_s > 0.0:
            width = self.smoothing_s
            travel = (self._travel_twice(t) - self._travel_twice(t - width)) / width
            speed = (self._travel(t) - self._travel(t - width)) / width
        else:
            travel = self._travel(t)
            speed = np.interp(t, recorded, self.speed_recorded_m_s, left=0.0, right=0.0)
        acceleration = np.gradient(speed, time_s) if len(time_s) > 1 else np.zeros_like(speed)
        return self.start_position_m + travel, speed, acceleration
