"""A motion that an emergency stop cuts short."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from workbench.references.plan import Plan, Profile, sample_times
from workbench.run import Array


@dataclass(frozen=True, eq=False)
class StoppedPlan:
    """A plan up to `stop_s`; from then on its speed falls by `deceleration_m_s2` (positive) to rest, and stays there.

    The jerk of a stop is not limited. After `stop_s` the plan's own motion does not count.
    """

    plan: Plan
    stop_s: float
    deceleration_m_s2: float

    @property
    def kind(self) -> str:
        return self.plan.kind

    @property
    def start_position_m(self) -> float:
        return self.plan.start_position_m

    @cached_property
    def _at_stop(self) -> tuple[float, float]:
        """Height (m) and speed (m/s) at which the stop begins."""
        position, speed, _ = self.plan.at(np.array([self.stop_s]))
        return float(position[0]), float(speed[0])

    @property
    def rest_s(self) -> float:
        """When the carriage is asked to be at rest."""
        return self.stop_s + abs(self._at_stop[1]) / self.deceleration_m_s2

    @property
    def end_position_m(self) -> float:
        position, speed = self._at_stop
        return position + speed * abs(speed) / (2.0 * self.deceleration_m_s2)

    @property
    def duration_s(self) -> float:
        return max(self.plan.duration_s, self.rest_s)

    @property
    def move_windows(self) -> tuple[tuple[float, float], ...]:
        """Those of the plan, as far as the stop lets them go."""
        begun = [(start, end) for start, end in self.plan.move_windows if start < self.stop_s]
        return tuple((start, end if end <= self.stop_s else self.rest_s) for start, end in begun)

    @property
    def acceleration_m_s2(self) -> float:
        return max(self.plan.acceleration_m_s2, self.deceleration_m_s2)

    def at(self, time_s: Array) -> tuple[Array, Array, Array]:
        """Height (m), speed (m/s) and acceleration (m/s²) at rising times (s)."""
        before = self.plan.at(time_s)
        position, speed = self._at_stop
        since = np.clip(time_s - self.stop_s, 0.0, self.rest_s - self.stop_s)
        braking = -np.sign(speed) * self.deceleration_m_s2
        stopping = (
            position + since * (speed + 0.5 * braking * since),
            np.where(time_s < self.rest_s, speed + braking * since, 0.0),
            np.where(time_s < self.rest_s, braking, 0.0),
        )
        late = time_s >= self.stop_s
        p, v, a = (np.where(late, after, old) for after, old in zip(stopping, before, strict=True))
        return p, v, a

    def sample(self, sample_time_s: float, duration_s: float | None = None) -> Profile:
        """The profile at 0, T, 2T, … up to the end of the plan, or held at rest up to a longer `duration_s`."""
        time_s = sample_times(sample_time_s, max(self.duration_s, duration_s or 0.0))
        position, speed, acceleration = self.at(time_s)
        return replace(
            self.plan.sample(sample_time_s, time_s[-1]),
            time_s=time_s,
            position_m=position,
            speed_m_s=speed,
            acceleration_m_s2=acceleration,
            move_windows=self.move_windows,
        )
