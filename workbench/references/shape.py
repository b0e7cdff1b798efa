"""The shape of one move: a cubic of time on each of its phases."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from workbench.references.limits import Limits
from workbench.run import Array


@dataclass(frozen=True, eq=False)
class Shape:
    """A move of `distance_m`: a cubic in time on each of its phases.

    phase_start_s, position_m, speed_m_s, acceleration_m_s2, jerk_m_s3: (phases,), the last four at
    the start of each phase, the position counted from the start of the move. end_speed_m_s: 0,
    except where a jog goes on into the next.
    """

    distance_m: float
    duration_s: float
    limits: Limits
    phase_start_s: Array
    position_m: Array
    speed_m_s: Array
    acceleration_m_s2: Array
    jerk_m_s3: Array
    end_speed_m_s: float = 0.0

    def at(self, time_s: Array) -> tuple[Array, Array, Array]:
        """Position (m), speed (m/s) and acceleration (m/s²) at times since the start; speed 0 outside the move."""
        inside = np.clip(time_s, 0.0, self.duration_s)
        phase = np.clip(np.searchsorted(self.phase_start_s, inside, side="right") - 1, 0, None)
        t = inside - self.phase_start_s[phase]
        p, v = self.position_m[phase], self.speed_m_s[phase]
        a, j = self.acceleration_m_s2[phase], self.jerk_m_s3[phase]
        moving = (time_s >= 0.0) & (time_s < self.duration_s)
        position = p + t * (v + t * (a / 2.0 + t * j / 6.0))
        return (
            np.where(time_s >= self.duration_s, self.distance_m, np.where(moving, position, 0.0)),
            np.where(moving, v + t * (a + t * j / 2.0), 0.0),
            np.where(moving, a + t * j, 0.0),
        )

    def add_to(self, since_s: Array, position: Array, speed: Array, acceleration: Array) -> None:
        """Add what `at` gives at rising times, phase by phase: six times as fast, the same to the last bit."""
        edges = np.searchsorted(since_s, [*self.phase_start_s, self.duration_s])
        edges = np.minimum(edges, edges[-1])
        for k, (first, last) in enumerate(itertools.pairwise(edges)):
            if first == last:
                continue
            t = since_s[first:last] - self.phase_start_s[k]
            p, v, a, j = self.position_m[k], self.speed_m_s[k], self.acceleration_m_s2[k], self.jerk_m_s3[k]
            position[first:last] += p + t * (v + t * (a / 2.0 + t * j / 6.0))
            speed[first:last] += v + t * (a + t * j / 2.0)
            acceleration[first:last] += a + t * j
        position[edges[-1] :] += self.distance_m

    def held(self, duration_s: float) -> Shape:
        """The shape with its end speed held until `duration_s` is over; a shape that ends at rest ends as it is."""
        rest_s = 0.0 if self.end_speed_m_s == 0.0 else max(duration_s - self.duration_s, 0.0)
        return replace(
            self,
            distance_m=self.distance_m + self.end_speed_m_s * rest_s,
            duration_s=self.duration_s + rest_s,
        )
