"""The shape of one move: position, speed and acceleration as functions of time; the shortest moves, by ruckig.

Ruckig gives the time-optimal motion within limits of speed, acceleration and jerk as a piecewise cubic, which is read
out once. With an infinite jerk it is the exact trapezoid. (L. Berscheid and T. Kröger, "Jerk-limited real-time
trajectory generation with arbitrary target states", Robotics: Science and Systems, 2021.)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array


@dataclass(frozen=True)
class Limits:
    """The largest speed, acceleration and jerk of the carriage.

    speed_m_s, acceleration_m_s2, jerk_m_s3: positive; the jerk may be infinite, which
    makes a trapezoid of speed. Anything else raises InputError.
    """

    speed_m_s: float
    acceleration_m_s2: float
    jerk_m_s3: float = math.inf

    def __post_init__(self) -> None:
        for name in ("speed_m_s", "acceleration_m_s2", "jerk_m_s3"):
            value = getattr(self, name)
            may_be_infinite = name == "jerk_m_s3"
            if math.isnan(value) or value <= 0.0 or (math.isinf(value) and not may_be_infinite):
                hint = "; for a reference without a jerk limit choose 'trapezoid'" if may_be_infinite else ""
                raise InputError(f"{value:g} is no limit, expected a positive number{hint}", place=name)

    def without_jerk_limit(self) -> Limits:
        return Limits(self.speed_m_s, self.acceleration_m_s2, math.inf)

    def ramps_faster(self, factor: float) -> Limits:
        """The limits under which every change of speed takes 1/factor of its time; the speed limit stays."""
        return Limits(self.speed_m_s, self.acceleration_m_s2 * factor, self.jerk_m_s3 * factor**2)


def raised(limits: Limits, used: Limits, unit: str = "m") -> str:
    """speed from 0.7 to 0.735 m/s: what a motion has used of more than its limits; "" where it kept them."""
    names = (("speed", "speed_m_s", "/s"), ("acceleration", "acceleration_m_s2", "/s²"), ("jerk", "jerk_m_s3", "/s³"))
    pairs = [(name, getattr(limits, key), getattr(used, key), power) for name, key, power in names]
    return ", ".join(
        f"{name} from {own:.3g} to {more:.3g} {unit}{power}" for name, own, more, power in pairs if more > own * 1.0005
    )


@dataclass(frozen=True)
class LimitPair:
    """Limits of a machine that may be asked for other motion going up than going down."""

    hoisting: Limits
    lowering: Limits

    @staticmethod
    def of(limits: Limits | LimitPair) -> LimitPair:
        """The pair itself, or the same limits both ways."""
        return limits if isinstance(limits, LimitPair) else LimitPair(limits, limits)

    def towards(self, distance_m: float) -> Limits:
        """Those of a move up (positive) or down."""
        return self.hoisting if distance_m > 0.0 else self.lowering

    def between(self, speed_m_s: float, next_speed_m_s: float) -> Limits:
        """Those of a change of speed; where it turns round, the stricter of the two."""
        low, high = sorted((speed_m_s, next_speed_m_s))
        if low >= 0.0:
            return self.hoisting
        if high <= 0.0:
            return self.lowering
        up, down = self.hoisting, self.lowering
        return Limits(
            min(up.speed_m_s, down.speed_m_s),
            min(up.acceleration_m_s2, down.acceleration_m_s2),
            min(up.jerk_m_s3, down.jerk_m_s3),
        )


@dataclass(frozen=True)
class Step:
    """One step of a move list: go `by_m`, go `to_m`, stay for `dwell_s`, or jog at `speed_m_s` for `for_s`.

    by_m: metres up (positive) or down. to_m: a carriage height. dwell_s: time at rest, zero or more.
    speed_m_s: the speed to go over to, up positive; for_s: how long until the next step, ramp included.
    """

    by_m: float | None = None
    to_m: float | None = None
    dwell_s: float | None = None
    speed_m_s: float | None = None
    for_s: float | None = None

    def __post_init__(self) -> None:
        given = {n: v for n in ("by_m", "to_m", "dwell_s", "speed_m_s") if (v := getattr(self, n)) is not None}
        if len(given) != 1:
            keys = " and ".join(given) or "nothing"
            raise InputError(f"{keys} given, expected exactly one of by_m, to_m, dwell_s, speed_m_s")
        ((name, value),) = given.items()
        if not math.isfinite(value):
            raise InputError(f"{value:g} is not a number to go by", place=name)
        if name == "dwell_s" and value < 0.0:
            raise InputError(f"{value:g} s is negative, expected zero or more", place=name)
        if (name == "speed_m_s") != (self.for_s is not None):
            raise InputError("speed_m_s and for_s belong together: a speed, and how long until the next step")
        if self.for_s is not None and not (math.isfinite(self.for_s) and self.for_s > 0.0):
            raise InputError(f"{self.for_s:g} s, expected a time greater than 0", place="for_s")


# The carriage hangs on a sheave, in the bight between drum and dead anchor.
FALLS = 2.0


def motor_speed_rad_s(carriage_speed_m_s: Array, ratio: float, drum_diameter_m: float) -> Array:
    """Motor speed on a wire that does not stretch: ω = 2·v·ratio / (D/2).

    The wire is reeled in twice as fast as the carriage rises; `ratio` is motor speed over drum speed.
    """
    return np.asarray(carriage_speed_m_s) * (FALLS * ratio / (drum_diameter_m / 2.0))


def allowed_carriage_speed_m_s(motor_speed_limit_rad_s: float, ratio: float, drum_diameter_m: float) -> float:
    """The carriage speed at which the motor reaches `motor_speed_limit_rad_s`."""
    return motor_speed_limit_rad_s * (drum_diameter_m / 2.0) / (FALLS * ratio)


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

    def add_alone(self, order: int, since_s: Array, values: Array) -> None:
        """The speed (order 1) or the acceleration (2) alone of `add_to`: a third of the work."""
        first, last = np.searchsorted(since_s, (0.0, self.duration_s))
        if first < last:
            t, motion = since_s[first:last], self.motion
            values[first:last] += motion.derivative(t, order) if isinstance(motion, Pieces) else motion(t)[order]

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
        return Pieces(start_s, np.array([p0, v0, a0 / 2, third / (2 * h**3), fourth / (2 * h**4), fifth / (2 * h**5)]))

    def __call__(self, time_s: Array) -> tuple[Array, Array, Array]:
        return self.derivative(time_s, 0), self.derivative(time_s, 1), self.derivative(time_s, 2)

    def derivative(self, time_s: Array, order: int) -> Array:
        """Phase by phase, six times as fast as looking up each time's phase."""
        values, coefficients = np.empty(len(time_s)), self.coefficients
        for _ in range(order):
            coefficients = coefficients[1:] * np.arange(1.0, len(coefficients))[:, None]
        edges = [0, *np.searchsorted(time_s, self.start_s[1:]), len(time_s)]
        for k, (first, last) in enumerate(pairwise(edges)):
            if first < last:
                values[first:last] = np.polyval(coefficients[::-1, k], time_s[first:last] - self.start_s[k])
        return values


def shortest_move(distance_m: float, limits: Limits) -> Shape:
    """The shortest move from rest to rest. InputError for a move of 0 m and for limits of very unlike sizes."""
    if not math.isfinite(distance_m) or distance_m == 0.0:
        raise InputError(f"a move of {distance_m:g} m is no move, expected another distance than 0")
    trajectory = _move(distance_m, limits)
    return Shape(distance_m, float(trajectory.duration), limits, _pieces(trajectory.profiles[0][0]))


def shortest_move_s(distance_m: float, limits: Limits) -> float:
    """What `shortest_move` takes (s), without its shape."""
    return float(_move(distance_m, limits).duration)


def shortest_ramp(speed_m_s: float, next_speed_m_s: float, limits: Limits) -> Shape:
    """The shortest change from one steady speed to another, at any distance; it ends at the second speed."""
    trajectory = _ramp(speed_m_s, next_speed_m_s, limits)
    profile = trajectory.profiles[0][0]
    return Shape(float(profile.p[7]), float(trajectory.duration), limits, _pieces(profile), next_speed_m_s)


def _pieces(profile: Any) -> Pieces:
    """Ruckig's seven phases."""
    start_s = np.concatenate(([0.0], np.cumsum(np.asarray(profile.t))[:-1]))
    return Pieces.of_even_jerk(start_s, *(np.asarray(x[:7]) for x in (profile.p, profile.v, profile.a, profile.j)))


def shortest_ramp_s(speed_m_s: float, next_speed_m_s: float, limits: Limits) -> float:
    """What `shortest_ramp` takes (s), without its shape."""
    return float(_ramp(speed_m_s, next_speed_m_s, limits).duration)


def _ramp(speed_m_s: float, next_speed_m_s: float, limits: Limits) -> Any:
    """Ruckig's trajectory from one steady speed to another, by its velocity interface; it has no types of its own."""
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


def _move(distance_m: float, limits: Limits) -> Any:
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
