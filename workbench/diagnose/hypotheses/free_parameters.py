"""The free parameters of a hypothesis: each sets one or more values of the model from numbers z of order one.

Every fit has the base parameters first: the values of machine.yaml that have a tolerance, which is their prior, and
the nuisance amounts of effects that every machine of the kind has. The parameters of the effects follow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.core import yaml_strict
from workbench.core.run import Array, Run
from workbench.effects import Effect, Ranged, find, ranges_of
from workbench.machines import get_value, kind_of

GAIN, OFFSET, TENSION_GAIN = "sensor gain", "sensor offset", "tension gain"  # of the log, beside the plant's symbols
LOG_TIMING = "log timing"  # of the log: its motion behind its force, s, beside what an effect delays
SHAPE_STD = math.log(3.0)  # of a nuisance shape, such as the speed at which Stribeck friction falls: a factor
LEAST_STATE = 4e-5  # of its deviation: a nuisance that keeps a state is never quite off, for it has no derivative there
TIMING_STD = 1.0 / math.sqrt(3.0)  # of a sampling step: two channels are sampled anywhere within one of each other
LOAD_CELL_STD = 0.005  # of a dead line's load cell: its gain

Names = tuple[str, ...]  # ids of the effects of one hypothesis; () is the machine within its tolerances
Setting = Mapping[str, "float | tuple[float, ...]"]  # symbol -> value, or one value for each run


def key_told(name: str) -> str:
    """The key of machine.yaml of a base parameter, the log's timing among them."""
    return "log.speed_late_s" if name == LOG_TIMING else name


class FreeParameter:
    """lowest, highest: bounds of each z. prior_std: one standard deviation of each z, inf where nothing holds it.
    logarithmic: a factor of what nobody knows, such as how friction turns over at standstill; no tolerance. amount: of
    an effect, which is absent at z = 0."""

    logarithmic: bool = False
    amount: bool = False

    @property
    def lowest(self) -> tuple[float, ...]:
        raise NotImplementedError

    @property
    def highest(self) -> tuple[float, ...]:
        return tuple(-low for low in self.lowest)

    @property
    def prior_std(self) -> tuple[float, ...]:
        return (math.inf,) * self.size

    @property
    def size(self) -> int:
        return len(self.lowest)

    def values(self, z: Sequence[float]) -> Setting:
        raise NotImplementedError


@dataclass(frozen=True)
class Scalar(FreeParameter):
    """One value: origin + scale z, or origin exp(scale z); where it is a share of others (`Parameter.per`), at their
    nominal values."""

    symbol: str
    origin: float
    scale: float
    least: float = -math.inf
    most: float = math.inf
    std: float = math.inf
    logarithmic: bool = False
    furthest: float = math.inf  # |z|
    amount: bool = False
    per: Callable[[Any], float] | None = None
    nominal: tuple[tuple[str, float], ...] = ()
    size = 1

    def z_of(self, value: float) -> float:
        if self.logarithmic:
            if value <= 0.0:
                return -math.inf
            return math.log(value / self.origin) / self.scale if math.isfinite(value) else math.inf
        return (value - self.origin) / self.scale

    @property
    def lowest(self) -> tuple[float, ...]:
        return (max(self.z_of(self.least), -self.furthest),)

    @property
    def highest(self) -> tuple[float, ...]:
        return (min(self.z_of(self.most), self.furthest),)

    @property
    def prior_std(self) -> tuple[float, ...]:
        return (self.std,)

    def values(self, z: Sequence[float]) -> Setting:
        x = self.scale * z[0]
        value = self.origin * math.exp(x) if self.logarithmic else self.origin + x
        return {self.symbol: min(max(value, self.least), self.most)}

    def as_share(self, setting: Setting) -> Setting:
        """The value beside those that it is a share of."""
        if self.per is None:
            return {}
        own = dict(self.nominal)
        moved = {symbol: setting.get(symbol, value) for symbol, value in own.items()}
        before, now = (self.per(SimpleNamespace(**values)) for values in (own, moved))
        (value,) = np.atleast_1d(setting[self.symbol])
        return {self.symbol: min(max(float(value) * before / now, self.least), self.most)} if now > 0.0 else {}


@dataclass(frozen=True)
class Wave(FreeParameter):
    """An amplitude and its phase from two quadratures, so that nothing is singular where the amplitude is zero."""

    amplitude: str
    phase: str
    origin: float  # of the angle of (z0, z1)
    scale: float
    most: float
    std: float = math.inf
    furthest: float = math.inf  # |z|
    amount = True

    @property
    def lowest(self) -> tuple[float, ...]:
        return (max(-self.most / self.scale, -self.furthest),) * 2

    @property
    def prior_std(self) -> tuple[float, ...]:
        return (self.std,) * 2

    def values(self, z: Sequence[float]) -> Setting:
        angle = (self.origin + math.atan2(z[1], z[0])) % (2.0 * math.pi)
        return {self.amplitude: self.scale * math.hypot(z[0], z[1]), self.phase: angle}


@dataclass(frozen=True)
class PhaseOfEachRun(FreeParameter):
    """A phase that is each run's own: start + z, rad."""

    symbol: str
    start: tuple[float, ...]

    @property
    def lowest(self) -> tuple[float, ...]:
        return (-math.inf,) * len(self.start)

    def values(self, z: Sequence[float]) -> Setting:
        return {self.symbol: tuple((a + b) % (2.0 * math.pi) for a, b in zip(self.start, z, strict=True))}


@dataclass(frozen=True)
class Estimate:
    """One parameter of an effect, in the unit of its name. value: of each run where it is each run's own."""

    name: str
    value: float | tuple[float, ...]
    std_error: float | tuple[float, ...]


def within(parameter: FreeParameter, limit: float) -> FreeParameter:
    """The parameter with every |z| at most `limit`."""
    assert isinstance(parameter, Scalar | Wave)
    return replace(parameter, furthest=limit)


def setting_of(free: Sequence[FreeParameter], z: Array) -> dict[str, float | tuple[float, ...]]:
    """All values at z: (sum of the parameters' sizes,)."""
    setting: dict[str, float | tuple[float, ...]] = {}
    numbers, at = [float(x) for x in z], 0
    for parameter in free:
        size = parameter.size
        setting |= parameter.values(numbers[at : at + size])
        at += size
    for parameter in free:
        if isinstance(parameter, Scalar):
            setting |= parameter.as_share(setting)
    return setting


def bounds_of(free: Sequence[FreeParameter]) -> tuple[Array, Array, Array]:
    """lowest, highest and prior_std of all z, one after the other."""
    return (
        np.array([x for parameter in free for x in parameter.lowest]),
        np.array([x for parameter in free for x in parameter.highest]),
        np.array([x for parameter in free for x in parameter.prior_std]),
    )


def inward(free: Sequence[FreeParameter], z: Array, steps: Array) -> Array:
    """Steps of z for derivatives, turned round where they lead over an upper bound: beyond it no value changes."""
    return np.where(z + steps > bounds_of(free)[1], -steps, steps)


def logarithmic_of(free: Sequence[FreeParameter]) -> np.ndarray:
    """(len(z),) bool."""
    return np.array([parameter.logarithmic for parameter in free for _ in range(parameter.size)], dtype=bool)


def effect_parameters(
    effect: Effect, ranges: Sequence[Ranged], at: Mapping[str, float | tuple[float, ...]]
) -> tuple[list[FreeParameter], list[float]]:
    """The free of an effect around a point `at` (symbol -> value), and z there.

    Amounts are linear on their declared scale. Positive shape parameters are logarithmic. An amplitude with a phase is
    a wave.
    """
    free: list[FreeParameter] = []
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
            free.append(PhaseOfEachRun(r.symbol, of_runs))
            start += [0.0] * len(of_runs)
            continue
        assert not isinstance(value, tuple)
        if r.vanishes_at is not None and wave is not None:
            angle = at[wave.symbol]
            assert not isinstance(angle, tuple)
            free.append(Wave(r.symbol, wave.symbol, angle, r.scale, r.highest))
            start += [value / r.scale, 0.0]
        elif r.vanishes_at is None and declared[r.symbol].domain == "positive":
            if r.lowest < r.highest and len(r.tries) != 1:
                free.append(Scalar(r.symbol, value, 1.0, r.lowest, r.highest, logarithmic=True))
                start.append(0.0)
        elif len(r.tries) != 1 or r.vanishes_at is not None:
            origin = r.vanishes_at if r.vanishes_at is not None else value
            amount = r.vanishes_at is not None
            free.append(
                Scalar(r.symbol, origin, r.scale, r.lowest, r.highest, amount=amount, per=r.per, nominal=r.nominal)
            )
            start.append((value - origin) / r.scale)
    return free, start


def base_parameters(machine: Any, runs: Sequence[Run]) -> dict[str, Scalar]:
    """Key of machine.yaml -> parameter. Values without a tolerance stay at nominal."""
    kind = kind_of(machine)
    largest = kind.largest_input(runs)
    sensor = dict(zip(kind.sensor, (GAIN, OFFSET), strict=True))
    free: dict[str, Scalar] = {}
    for value in kind.base:
        std = value.std(machine, largest)
        if std <= 0.0 or (value.with_payload and all(run.payload_kg == 0.0 for run in runs)):
            continue
        nominal = float(get_value(machine, value.key))
        symbol = sensor.get(value.key) or kind.symbols[value.key]
        if value.spread == "factor":  # nothing else holds it, so the file's own bounds do
            bounds = yaml_strict.bounds_of(yaml_strict.field_at(type(machine), tuple(value.key.split("."))))
            low, high = (bounds.lowest, bounds.highest) if bounds else (0.0, math.inf)
            free[value.key] = Scalar(symbol, nominal, 1.0, low, high, std, logarithmic=True)
            continue
        least = -math.inf if value.signed else 0.0 if "coulomb" in value.key else 1e-3 * abs(nominal)
        free[value.key] = Scalar(symbol, nominal, std, least, std=1.0)
    # The channels of one log are rarely sampled at one instant: one sampling step is no gap.
    step = float(np.median([run.sample_time_s for run in runs]))
    free[LOG_TIMING] = Scalar(LOG_TIMING, 0.0, step, -machine.log.speed_late_s, std=TIMING_STD)
    if kind.dead_line is not None and any(kind.dead_line.signal in run for run in runs):
        free[TENSION_GAIN] = Scalar(TENSION_GAIN, 1.0, LOAD_CELL_STD, std=1.0)
    return free


def nuisance_parameters(machine: Any, runs: Sequence[Run]) -> dict[str, FreeParameter]:
    """Name -> parameter of the small amounts of effects that every machine of the kind has (`Kind.nuisances`).

    An effect counts as a cause only beyond that amount. A hypothesis with the effect replaces its nuisance.
    """
    kind = kind_of(machine)
    sizes = kind.sizes(machine, runs)
    free: dict[str, FreeParameter] = {}
    for trace in kind.nuisances:
        std = trace.std(machine, sizes)
        if not trace.fitted or std <= 0.0:
            continue
        ranges = ranges_of(find(trace.effect, kind.name), machine, runs)
        phase = next((r for r in ranges if r.scan == "phase"), None)
        for r in ranges:
            name = f"{trace.effect}.{r.name}"
            if r is phase:
                continue
            if r.vanishes_at is None:
                free[name] = Scalar(r.symbol, r.start, 1.0, r.lowest, r.highest, std=SHAPE_STD, logarithmic=True)
            elif phase is None:
                least = LEAST_STATE * std if find(trace.effect, kind.name).memory else 0.0
                free[name] = Scalar(r.symbol, 0.0, std, least, r.highest, std=1.0)
            else:  # of an amplitude of unknown phase, either quadrature
                free[name] = Wave(r.symbol, phase.symbol, 0.0, std, r.highest, 1.0)
    return free


def nuisance_std(machine: Any, runs: Sequence[Run], name: str) -> dict[str, float]:
    """Symbol -> standard deviation of each nuisance amount of an effect that is not fitted. Empty for other effects."""
    kind = kind_of(machine)
    sizes = kind.sizes(machine, runs)
    std = next((t.std(machine, sizes) for t in kind.nuisances if t.effect == name and not t.fitted), 0.0)
    if std <= 0.0:
        return {}
    ranges = ranges_of(find(name, kind.name), machine, runs)
    return {r.symbol: std for r in ranges if r.vanishes_at is not None}
