"""The free parameters of a hypothesis: each knob sets one or more values of the model from numbers z of order one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from workbench.core.run import Array
from workbench.effects import Effect, Ranged

GAIN, OFFSET, TENSION_GAIN = "sensor gain", "sensor offset", "tension gain"  # of the log, beside the plant's symbols
LOG_TIMING = "log timing"  # of the log: its motion behind its force, s, beside what an effect delays
Setting = Mapping[str, "float | tuple[float, ...]"]  # symbol -> value, or one value for each run


class Knob(Protocol):
    """lowest, highest: bounds of each z. prior_std: one standard deviation of each z, inf where nothing holds it."""

    @property
    def lowest(self) -> tuple[float, ...]: ...
    @property
    def highest(self) -> tuple[float, ...]: ...
    @property
    def prior_std(self) -> tuple[float, ...]: ...

    def values(self, z: Sequence[float]) -> Setting: ...


@dataclass(frozen=True)
class Value:
    """One value: origin + scale z, or origin exp(scale z)."""

    symbol: str
    origin: float
    scale: float
    least: float = -math.inf
    most: float = math.inf
    std: float = math.inf
    logarithmic: bool = False
    furthest: float = math.inf  # |z|

    def _z(self, value: float) -> float:
        if self.logarithmic:
            if value <= 0.0:
                return -math.inf
            return math.log(value / self.origin) / self.scale if math.isfinite(value) else math.inf
        return (value - self.origin) / self.scale

    @property
    def lowest(self) -> tuple[float, ...]:
        return (max(self._z(self.least), -self.furthest),)

    @property
    def highest(self) -> tuple[float, ...]:
        return (min(self._z(self.most), self.furthest),)

    @property
    def prior_std(self) -> tuple[float, ...]:
        return (self.std,)

    def values(self, z: Sequence[float]) -> Setting:
        x = self.scale * z[0]
        value = self.origin * math.exp(x) if self.logarithmic else self.origin + x
        return {self.symbol: min(max(value, self.least), self.most)}


@dataclass(frozen=True)
class Wave:
    """An amplitude and its phase from two quadratures, so that nothing is singular where the amplitude is zero."""

    amplitude: str
    phase: str
    origin: float  # of the angle of (z0, z1)
    scale: float
    most: float
    prior_std: tuple[float, ...] = (math.inf, math.inf)
    furthest: float = math.inf  # |z|

    @property
    def lowest(self) -> tuple[float, ...]:
        return (max(-self.most / self.scale, -self.furthest),) * 2

    @property
    def highest(self) -> tuple[float, ...]:
        return (min(self.most / self.scale, self.furthest),) * 2

    def values(self, z: Sequence[float]) -> Setting:
        angle = (self.origin + math.atan2(z[1], z[0])) % (2.0 * math.pi)
        return {self.amplitude: self.scale * math.hypot(z[0], z[1]), self.phase: angle}


@dataclass(frozen=True)
class PhaseOfEachRun:
    """A phase that is each run's own: start + z, rad."""

    symbol: str
    start: tuple[float, ...]

    @property
    def lowest(self) -> tuple[float, ...]:
        return (-math.inf,) * len(self.start)

    @property
    def highest(self) -> tuple[float, ...]:
        return (math.inf,) * len(self.start)

    @property
    def prior_std(self) -> tuple[float, ...]:
        return (math.inf,) * len(self.start)

    def values(self, z: Sequence[float]) -> Setting:
        return {self.symbol: tuple((a + b) % (2.0 * math.pi) for a, b in zip(self.start, z, strict=True))}


def within(knob: Knob, limit: float) -> Knob:
    """The knob with every |z| at most `limit`."""
    assert isinstance(knob, Value | Wave)
    return replace(knob, furthest=limit)


def setting_of(knobs: Sequence[Knob], z: Array) -> dict[str, float | tuple[float, ...]]:
    """All values at z: (sum of the knobs' sizes,)."""
    setting: dict[str, float | tuple[float, ...]] = {}
    at = 0
    for knob in knobs:
        size = len(knob.lowest)
        setting |= knob.values([float(x) for x in z[at : at + size]])
        at += size
    return setting


def bounds_of(knobs: Sequence[Knob]) -> tuple[Array, Array, Array]:
    """lowest, highest and prior_std of all z, one after the other."""
    return (
        np.array([x for knob in knobs for x in knob.lowest]),
        np.array([x for knob in knobs for x in knob.highest]),
        np.array([x for knob in knobs for x in knob.prior_std]),
    )


def effect_knobs(
    effect: Effect, ranges: Sequence[Ranged], at: Mapping[str, float | tuple[float, ...]]
) -> tuple[list[Knob], list[float]]:
    """The knobs of an effect around a point `at` (symbol -> value), and z there.

    Amounts are linear on their declared scale. Positive shape parameters are logarithmic. An amplitude with a phase is
    a wave.
    """
    knobs: list[Knob] = []
    start: list[float] = []
    declared = dict(zip([r.symbol for r in ranges], effect.parameters, strict=True))
    phases = [r for r in ranges if r.scan == "phase" and not r.per_run]
    amounts = [r for r in ranges if r.vanishes_at is not None]
    wave = phases[0] if phases and len(amounts) == 1 else None
    for r in ranges:
        value = at[r.symbol]
        if r is wave:
            continue
        if r.per_run:
            of_runs = value if isinstance(value, tuple) else (float(value),)
            knobs.append(PhaseOfEachRun(r.symbol, of_runs))
            start += [0.0] * len(of_runs)
            continue
        assert not isinstance(value, tuple)
        if r.vanishes_at is not None and wave is not None:
            angle = at[wave.symbol]
            assert not isinstance(angle, tuple)
            knobs.append(Wave(r.symbol, wave.symbol, angle, r.scale, r.highest))
            start += [value / r.scale, 0.0]
        elif r.vanishes_at is None and declared[r.symbol].domain == "positive":
            if r.lowest < r.highest and len(r.tries) != 1:
                knobs.append(Value(r.symbol, value, 1.0, r.lowest, r.highest, logarithmic=True))
                start.append(0.0)
        elif len(r.tries) != 1 or r.vanishes_at is not None:
            origin = r.vanishes_at if r.vanishes_at is not None else value
            knobs.append(Value(r.symbol, origin, r.scale, r.lowest, r.highest))
            start.append((value - origin) / r.scale)
    return knobs, start
