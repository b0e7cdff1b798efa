"""Limits of a motion, and the steps it is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

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
