"""Limits of a motion, and the steps it is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

from workbench.errors import InputError


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


@dataclass(frozen=True)
class Step:
    """One step of a move list: go `by_m`, go `to_m`, or stay for `dwell_s`; exactly one is given.

    by_m: metres up (positive) or down. to_m: a carriage height. dwell_s: time at rest, zero or more.
    """

    by_m: float | None = None
    to_m: float | None = None
    dwell_s: float | None = None

    def __post_init__(self) -> None:
        given = {n: v for n in ("by_m", "to_m", "dwell_s") if (v := getattr(self, n)) is not None}
        if len(given) != 1:
            said = " and ".join(given) or "nothing"
            raise InputError(f"{said} given, expected exactly one of by_m, to_m, dwell_s")
        ((name, value),) = given.items()
        if not math.isfinite(value):
            raise InputError(f"{value:g} is not a number to go by", place=name)
        if name == "dwell_s" and value < 0.0:
            raise InputError(f"{value:g} s is negative, expected zero or more", place=name)
