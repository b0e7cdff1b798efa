"""The shapes of one move: trapezoid, jerk-limited, and jerk-limited in the trapezoid's time.

A move goes from rest to rest, or, as a jog, from one speed over to another. All come from one
engine, ruckig: with an infinite jerk it gives the exact trapezoid. Its piecewise cubic is read
out once and evaluated here, for many times at a time.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.errors import InputError
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


def trapezoid(distance_m: float, limits: Limits) -> Shape:
    """Constant acceleration, constant speed, constant deceleration; the jerk limit is not used.

    Takes |d|/v + v/a, or 2·sqrt(|d|/a) when it never reaches the speed limit.
    """
    return _shortest(distance_m, limits.without_jerk_limit())


def ruckig(distance_m: float, limits: Limits) -> Shape:
    """The shortest move within speed, acceleration and jerk limits.

    Takes |d|/v + v/a + a/j when it reaches both the speed and the acceleration limit.
    """
    _need_jerk(limits, "ruckig")
    return _shortest(distance_m, limits)


def ruckig_equal_time(distance_m: float, limits: Limits) -> Shape:
    """The jerk-limited move with acceleration and jerk raised until it takes as long as the trapezoid.

    Speed ramps run s times faster when a → s·a and j → s²·j: the same change of speed,
    in 1/s of the time. The speed limit stays, so T(s) falls steadily from T(1), which is no less
    than the trapezoid's time, towards |d|/v, which is below it: one s fits. Where both moves
    reach full speed and the acceleration limit,

        |d|/v + (v/a + a/j)/s = |d|/v + v/a   →   s = 1 + a²/(v·j),

    whatever the distance. For the others s is found by bisection, which serves all of them.
    """
    _need_jerk(limits, "ruckig_equal_time")
    wanted_s = trapezoid(distance_m, limits).duration_s
    low, high = 1.0, 2.0
    while _shortest(distance_m, limits.ramps_faster(high)).duration_s > wanted_s:
        low, high = high, 2.0 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        if _shortest(distance_m, limits.ramps_faster(middle)).duration_s > wanted_s:
            low = middle
        else:
            high = middle
    return _shortest(distance_m, limits.ramps_faster(high))


KINDS: dict[str, Callable[[float, Limits], Shape]] = {
    "trapezoid": trapezoid,
    "ruckig": ruckig,
    "ruckig_equal_time": ruckig_equal_time,
}


def jog(kind: str, speed_m_s: float, next_speed_m_s: float, limits: Limits, for_s: float) -> Shape:
    """From one speed over to the next within acceleration and jerk limits, then on at it until `for_s` is over.

    The ramp is a trapezoid's (no jerk limit), the jerk-limited one, or that one s times as fast, with
    a → s·a and j → s²·j, so that it takes as long as the trapezoid's |Δv|/a. Over to rest, the
    shape ends with its ramp. InputError where the ramp takes longer than `for_s`.
    """
    change = abs(next_speed_m_s - speed_m_s)
    if kind == "trapezoid":
        limits = limits.without_jerk_limit()
    else:
        _need_jerk(limits, kind)
    if kind == "ruckig_equal_time" and change > 0.0:
        ramp_s = float(_velocity_ramp(speed_m_s, next_speed_m_s, limits).duration)
        limits = limits.ramps_faster(ramp_s * limits.acceleration_m_s2 / change)
    trajectory = _velocity_ramp(speed_m_s, next_speed_m_s, limits)
    ramp_s = float(trajectory.duration)
    if ramp_s > for_s * (1.0 + 1e-9):
        raise InputError(
            f"from {speed_m_s:g} m/s to {next_speed_m_s:g} m/s takes {ramp_s:.3g} s within the limits, "
            f"for_s gives {for_s:g} s"
        )
    profile = trajectory.profiles[0][0]
    starts = np.concatenate(([0.0], np.cumsum(np.asarray(profile.t))[:-1], [ramp_s]))
    end_m = float(profile.p[7])
    on_s = 0.0 if next_speed_m_s == 0.0 else max(for_s - ramp_s, 0.0)
    return Shape(
        distance_m=end_m + next_speed_m_s * on_s,
        duration_s=ramp_s + on_s,
        limits=limits,
        phase_start_s=starts,
        position_m=np.asarray([*profile.p[:7], end_m]),
        speed_m_s=np.asarray([*profile.v[:7], next_speed_m_s]),
        acceleration_m_s2=np.asarray([*profile.a[:7], 0.0]),
        jerk_m_s3=np.asarray([*profile.j, 0.0]),
        end_speed_m_s=next_speed_m_s,
    )


def duration_s(kind: str, distance_m: float, limits: Limits) -> float:
    """What a move takes, without its shape. InputError as for the shape."""
    if kind == "ruckig":
        _need_jerk(limits, kind)
        return float(_calculated(distance_m, limits).duration)
    d, v, a = abs(distance_m), limits.speed_m_s, limits.acceleration_m_s2
    return d / v + v / a if d >= v * v / a else 2.0 * math.sqrt(d / a)


def _velocity_ramp(speed_m_s: float, next_speed_m_s: float, limits: Limits) -> Any:
    """Ruckig's trajectory from one steady speed to another, by its velocity interface."""
    from ruckig import ControlInterface, InputParameter, Ruckig, RuckigError, Trajectory

    wanted = InputParameter(1)
    wanted.control_interface = ControlInterface.Velocity
    wanted.current_velocity, wanted.target_velocity = [speed_m_s], [next_speed_m_s]
    wanted.max_acceleration, wanted.max_jerk = [limits.acceleration_m_s2], [limits.jerk_m_s3]
    trajectory = Trajectory(1)
    try:
        Ruckig(1).calculate(wanted, trajectory)
    except RuckigError as error:
        raise InputError(
            f"no way from {speed_m_s:g} m/s to {next_speed_m_s:g} m/s within {limits.acceleration_m_s2:g} m/s² and "
            f"{limits.jerk_m_s3:g} m/s³ was found; expected limits of a like size"
        ) from error
    return trajectory


def _need_jerk(limits: Limits, kind: str) -> None:
    if math.isinf(limits.jerk_m_s3):
        raise InputError(f"'{kind}' needs a finite jerk limit; without one use 'trapezoid'", place="jerk_m_s3")


def _shortest(distance_m: float, limits: Limits) -> Shape:
    """The time-optimal move from rest to rest, by ruckig."""
    if not math.isfinite(distance_m) or distance_m == 0.0:
        raise InputError(f"a move of {distance_m:g} m is no move, expected another distance than 0")
    trajectory = _calculated(distance_m, limits)
    profile = trajectory.profiles[0][0]
    lengths = np.asarray(profile.t)
    return Shape(
        distance_m=distance_m,
        duration_s=float(trajectory.duration),
        limits=limits,
        phase_start_s=np.concatenate(([0.0], np.cumsum(lengths)[:-1])),
        position_m=np.asarray(profile.p[:7]),
        speed_m_s=np.asarray(profile.v[:7]),
        acceleration_m_s2=np.asarray(profile.a[:7]),
        jerk_m_s3=np.asarray(profile.j),
    )


def _calculated(distance_m: float, limits: Limits) -> Any:
    """Ruckig's trajectory; it has no types of its own.

    Where a move just reaches two limits at once, ruckig can fall between its own cases and raise.
    A speed or acceleration limit smaller by 1e-12 and more takes it off that point.
    """
    from ruckig import InputParameter, Ruckig, RuckigError, Trajectory

    for less_speed, less_acceleration in ((0.0, 0.0), (1e-12, 0.0), (0.0, 1e-12), (1e-11, 1e-12), (1e-10, 1e-11)):
        wanted = InputParameter(1)
        wanted.current_position, wanted.target_position = [0.0], [distance_m]
        # Ruckig's default max_velocity is 0, so every limit is set.
        wanted.max_velocity = [limits.speed_m_s * (1.0 - less_speed)]
        wanted.max_acceleration = [limits.acceleration_m_s2 * (1.0 - less_acceleration)]
        wanted.max_jerk = [limits.jerk_m_s3]
        trajectory = Trajectory(1)
        try:
            Ruckig(1).calculate(wanted, trajectory)
        except RuckigError:
            continue
        return trajectory
    raise InputError(
        f"no move of {distance_m:g} m within {limits.speed_m_s:g} m/s, {limits.acceleration_m_s2:g} m/s², "
        f"{limits.jerk_m_s3:g} m/s³ was found; expected limits of a like size"
    )
