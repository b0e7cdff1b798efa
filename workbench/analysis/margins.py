"""Margins of a sampled loop: found on a grid, then refined on the exact frequency response.

K. J. Astrom, R. M. Murray, "Feedback Systems", 2nd ed., chapter 10, for gain, phase and delay margin and
the sensitivities' peaks; P. Seiler, A. Packard, P. Gahinet, "An introduction to disk margins", IEEE Control
Systems 40 (2020), for the disk margin, there with skew 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workbench.analysis.linearise import Motion, OperatingPoint
from workbench.analysis.loop import LinearLoop, linear_loop
from workbench.control import Settings
from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.machines import NO_EFFECTS, Effects, Machine, kind_of, of_kind

HALF_POWER = math.sqrt(0.5)


@dataclass(frozen=True)
class Margins:
    """What a stable loop bears. Of an unstable loop no margin means anything; `stable` says so.

    gain_up, gain_down: the factors (more, less than 1) on the loop gain at which it becomes unstable; inf
    and 0 where none does. phase_deg: smallest phase lag or lead at a gain crossover; crossover_hz: that
    crossover. delay_s: smallest added delay, phase over angular frequency. disk: largest alpha so that
    every factor (1 + d/2)/(1 - d/2), |d| < alpha, gain and phase at once, is borne: 2/max|S - T|.
    ms, mt: largest |S|, |T|. bandwidth_hz: where |T| first falls below -3 dB, inf where it never does.
    rejection_hz: the disturbance-rejection bandwidth, up to which every disturbance of the speed is held below
    -3 dB: where |S| first rises above that, 0 where it is above it from the start (M. B. Tischler, R. K. Remple,
    "Aircraft and Rotorcraft System Identification", 2nd ed., AIAA 2012).
    """

    stable: bool
    gain_up: float
    gain_up_hz: float
    gain_down: float
    gain_down_hz: float
    phase_deg: float
    crossover_hz: float
    delay_s: float
    disk: float
    ms: float
    ms_hz: float
    mt: float
    mt_hz: float
    bandwidth_hz: float
    rejection_hz: float


def margins(loop: LinearLoop) -> Margins:
    """All margins of a loop, each to about nine digits."""
    f = loop.grid()
    L = loop.open_response(f)
    S = 1.0 / (1.0 + L)

    def at(x: float) -> complex:
        return complex(loop.open_response(np.array([x]))[0])

    crossings = _roots(lambda x: math.log(abs(at(x))), f, np.log(np.abs(L)))
    lags = [(math.degrees(np.angle(at(x))) + 180.0) % 360.0 for x in crossings]
    phases = [(min(lag, 360.0 - lag), x) for lag, x in zip(lags, crossings, strict=True)]
    phase, crossover = min(phases, default=(math.inf, math.nan))
    delay = min((lag / 360.0 / x for lag, x in zip(lags, crossings, strict=True)), default=math.inf)

    real = [(x, at(x).real) for x in _roots(lambda x: at(x).imag, f[:-1], L.imag[:-1])]
    real.append((float(f[-1]), float(L[-1].real)))  # at half the sample rate L is always real
    factors = [(-1.0 / value, x) for x, value in real if value < 0.0]
    up = min((pair for pair in factors if pair[0] >= 1.0), default=(math.inf, math.nan))
    down = max((pair for pair in factors if pair[0] < 1.0), default=(0.0, math.nan))

    def sensitivity(x: float) -> float:
        return 1.0 / abs(1.0 + at(x))

    def complementary(x: float) -> float:
        return abs(1.0 - 1.0 / (1.0 + at(x)))

    ms, ms_hz = _peak(sensitivity, f, np.abs(S))
    mt, mt_hz = _peak(complementary, f, np.abs(L * S))
    worst, _ = _peak(lambda x: abs(2.0 / (1.0 + at(x)) - 1.0), f, np.abs(S - L * S))
    return Margins(
        loop.stable, up[0], up[1], down[0], down[1], phase, crossover, delay, 2.0 / worst,
        ms, ms_hz, mt, mt_hz, _first(np.abs(L * S) < HALF_POWER, complementary, f, float(f[0])),
        _first(np.abs(S) >= HALF_POWER, sensitivity, f, 0.0),
    )  # fmt: skip


def _first(beyond: np.ndarray, size: Callable[[float], float], f: Array, at_start: float) -> float:
    """Where a size passes -3 dB, before the first frequency of the grid that is beyond; inf where none is."""
    if not beyond.any():
        return math.inf
    k = int(np.argmax(beyond))
    if k == 0:
        return at_start
    ends = f[k - 1 : k + 1]
    roots = _roots(lambda x: size(x) - HALF_POWER, ends, np.array([size(x) - HALF_POWER for x in ends]))
    return roots[0] if roots else float(f[k])


def _roots(function: Callable[[float], float], f: Array, values: Array) -> list[float]:
    """Where a function of frequency changes its sign, from its values on the grid."""
    from scipy.optimize import brentq

    turns = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0.0)
    return [float(brentq(function, f[k], f[k + 1], xtol=1e-13 * f[k], rtol=1e-12)) for k in turns]


def _peak(function: Callable[[float], float], f: Array, values: Array) -> tuple[float, float]:
    """(value, frequency) of the largest, between the neighbours of the grid's largest."""
    from scipy.optimize import minimize_scalar

    k = int(np.argmax(values))
    low, high = f[max(k - 1, 0)], f[min(k + 1, len(f) - 1)]
    optimum = minimize_scalar(
        lambda x: -function(x), bounds=(low, high), method="bounded", options={"xatol": 1e-8 * high}
    )
    best = (float(-optimum.fun), float(optimum.x))
    return max(best, (float(values[k]), float(f[k])))


# A loop over payloads and heights, and the least of its margins.


@dataclass(frozen=True, eq=False)
class Member:
    """One loop of a family with its margins."""

    loop: LinearLoop
    margins: Margins

    @property
    def point(self) -> OperatingPoint:
        return self.loop.point


def operating_points(
    machine: Machine, payloads_kg: Sequence[float], heights_m: Sequence[float], motion: Motion = "hoisting"
) -> list[OperatingPoint]:
    """Every payload at every height. InputError for a height off the rail or where no free wire is left."""
    kind = kind_of(machine)
    (low, high), top = kind.looped.rail(machine), kind.looped.top(machine)
    for height in heights_m:
        if not (low <= height <= high and height < top):
            said = f"{height:g} m is off the rail, which reaches from {low:g} m to {high:g} m"
            raise InputError(said, place="heights")
    if not kind.payload and any(payloads_kg):
        raise InputError(f"{of_kind(machine)} carries no payload", place="payloads")
    for payload in payloads_kg:
        if not 0.0 <= payload <= 1e6:
            raise InputError(f"{payload:g} kg, expected 0 to 1000000 kg", place="payloads")
    return [OperatingPoint(payload, height, motion) for payload in payloads_kg for height in heights_m]


def family(
    machine: Machine, settings: Settings, points: Sequence[OperatingPoint], *, effects: Effects = NO_EFFECTS
) -> list[Member]:
    """The loop at each point, with its margins; `effects` beside the machine's own."""
    loops = [linear_loop(machine, settings, point, effects=effects) for point in points]
    return [Member(loop, margins(loop)) for loop in loops]


@dataclass(frozen=True, eq=False)
class Weakest:
    """The least of each margin over a family. member: name of a margin -> the member it is of.

    An unstable member leaves no margin: all is then that member's.
    """

    margins: Margins
    member: Mapping[str, Member]

    @property
    def point(self) -> OperatingPoint:
        """Of the member with the largest Ms."""
        return self.member["ms"].point


# Margin -> (whether the larger is the worse, what goes with it).
_MARGINS: dict[str, tuple[bool, tuple[str, ...]]] = {
    "gain_up": (False, ("gain_up_hz",)),
    "gain_down": (True, ("gain_down_hz",)),
    "phase_deg": (False, ("crossover_hz",)),
    "delay_s": (False, ()),
    "disk": (False, ()),
    "ms": (True, ("ms_hz",)),
    "mt": (True, ("mt_hz",)),
    "bandwidth_hz": (False, ()),
    "rejection_hz": (False, ()),
}


def weakest(members: Sequence[Member]) -> Weakest:
    """The least of each margin, each with its own member: least gain and largest Ms may stand at different payloads."""
    unstable = next((m for m in members if not m.margins.stable), None)
    if unstable is not None:
        return Weakest(unstable.margins, dict.fromkeys(_MARGINS, unstable))
    least: dict[str, Any] = {}
    of: dict[str, Member] = {}
    for name, (larger_is_worse, beside) in _MARGINS.items():
        values = [getattr(m.margins, name) for m in members]
        of[name] = members[values.index(max(values) if larger_is_worse else min(values))]
        least |= {key: getattr(of[name].margins, key) for key in (name, *beside)}
    return Weakest(replace(members[0].margins, **least), of)
