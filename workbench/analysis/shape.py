"""Gains by loop shaping: exact discrete loops of a whole family, searched on a grid that zooms in.

The rule is that of K. J. Astrom, T. Hagglund, "Advanced PID Control", ISA 2006, chapter 6: the
largest integral gain, which is the smallest integrated error after a load step, with |S| nowhere
above a bound. Here the bound holds for every member of the family.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from workbench.analysis.obstacle import rounded_down
from workbench.analysis.search import Judged, Search
from workbench.errors import InputError
from workbench.run import Array

LOWEST_CROSSOVER_HZ = 0.05
NEAR = 0.999  # of the bound on Ms, for what lies between the grid's frequencies
Range = tuple[float, float]


@dataclass(frozen=True)
class Shaped:
    """Gains (kp N m s/rad, ki N m/rad) with the family's largest Ms and smallest bandwidth.

    attainable_hz: the widest bandwidth that the bound on Ms allows with any gains.
    """

    kp: float
    ki: float
    ms: float
    bandwidth_hz: float
    attainable_hz: float


def best_rejection(search: Search, ms_limit: float) -> Shaped:
    """The largest ki with Ms below the limit for every member."""
    kp, ki = _largest(search, ms_limit, lambda ki, judged: ki)
    shaped = _shaped(search, kp, ki, _bandwidth_of(search, _widest(search, ms_limit)))
    return replace(shaped, attainable_hz=max(shaped.attainable_hz, shaped.bandwidth_hz))


def for_bandwidth(search: Search, bandwidth_hz: float, ms_limit: float) -> Shaped:
    """The largest ki among the gains that give the family's slowest member the bandwidth, Ms and Mt below the limit.

    Ms alone would let the integral grow until the reference is overshot by half.

    InputError where sample time, filters and delays do not allow it; it says what they do allow.
    """
    widest = _widest(search, ms_limit)
    attainable = _bandwidth_of(search, widest)
    if bandwidth_hz > attainable:
        raise InputError(
            f"{bandwidth_hz:g} Hz is out of reach: this machine and drive allow at most {rounded_down(attainable)} Hz "
            f"at Ms {ms_limit:g}; {search.why_no_wider(*widest)}",
            place="bandwidth",
        )
    _, (low, high) = _ranges(search)
    best: tuple[float, float] | None = None
    for _ in range(3):
        ratio = np.geomspace(low, high, 40)
        kp = kp_for(search, np.full(len(ratio), bandwidth_hz), ratio)
        judged = search.judge(kp, kp * ratio)
        good = (
            _allowed(judged, ms_limit)
            & (judged.mt <= NEAR * ms_limit)
            & (np.abs(np.log(judged.bandwidth_hz / bandwidth_hz)) < 1e-3)
        )
        if not good.any():
            break
        k = int(np.argmax(np.where(good, kp * ratio, -1.0)))
        best = (float(kp[k]), float(kp[k] * ratio[k]))
        low, high = float(ratio[max(k - 1, 0)]), float(ratio[min(k + 1, len(ratio) - 1)])
    if best is None:
        raise InputError(
            f"{bandwidth_hz:g} Hz: no gains give just that with Ms and Mt {ms_limit:g} or less; "
            f"{_nearest(search, bandwidth_hz, ms_limit)}the widest is {rounded_down(attainable)} Hz",
            place="bandwidth",
        )
    return _shaped(search, *best, attainable)


def _nearest(search: Search, bandwidth_hz: float, ms_limit: float) -> str:
    """Words for the bandwidth nearest to that asked for, as a ratio, of those that a table of allowed gains gives."""
    kps, ratios = (np.geomspace(*span, 60) for span in _ranges(search))
    kp, ratio = (a.ravel() for a in np.meshgrid(kps, ratios, indexing="ij"))
    judged = search.judge(kp, kp * ratio)
    good = _allowed(judged, ms_limit) & (judged.mt <= NEAR * ms_limit) & np.isfinite(judged.bandwidth_hz)
    had = judged.bandwidth_hz[good & (judged.bandwidth_hz > 0.0)]
    if not len(had):
        return ""
    return f"the nearest that can be had is about {had[np.argmin(np.abs(np.log(had / bandwidth_hz)))]:.2g} Hz, "


def _widest(search: Search, ms_limit: float) -> tuple[float, float]:
    """The gains of the widest bandwidth."""
    return _largest(search, ms_limit, lambda ki, judged: _finite(judged.bandwidth_hz))


def _bandwidth_of(search: Search, gains: tuple[float, float]) -> float:
    return float(search.judge(np.array([gains[0]]), np.array([gains[1]])).bandwidth_hz[0])


def _ranges(search: Search) -> tuple[Range, Range]:
    """Of kp, and of ki/kp (1/s): from next to nothing to what no sampled loop can bear."""
    nyquist = math.pi / search.dt
    slowest = 2.0 * math.pi * LOWEST_CROSSOVER_HZ
    return (search.inertia_kg_m2 * slowest, search.inertia_kg_m2 * nyquist), (0.05 * slowest, 0.25 * nyquist)


def _largest(search: Search, ms_limit: float, score: Callable[[Array, Judged], Array]) -> tuple[float, float]:
    """The allowed gains of the largest score: a coarse table of all, then finer ones around the best."""
    (kp_low, kp_high), (r_low, r_high) = _ranges(search)
    kps, ratios = np.geomspace(kp_low, kp_high, 48), np.geomspace(r_low, r_high, 40)
    step = np.array([kps[1] / kps[0], ratios[1] / ratios[0]])
    best: tuple[float, float, float] | None = None
    for _ in range(10):
        kp, ratio = (a.ravel() for a in np.meshgrid(kps, ratios, indexing="ij"))
        judged = search.judge(kp, kp * ratio)
        scores = np.where(_allowed(judged, ms_limit), score(kp * ratio, judged), -np.inf)
        k = int(np.argmax(scores))
        if np.isfinite(scores[k]) and (best is None or scores[k] >= best[0]):
            best = (float(scores[k]), float(kp[k]), float(ratio[k]))
        if best is None:
            raise InputError(
                f"{ms_limit:g}: no gains reach it {search.everywhere}; expected a number further above 1", place="ms"
            )
        kps = best[1] * np.geomspace(1.0 / step[0], step[0], 11)
        ratios = best[2] * np.geomspace(1.0 / step[1], step[1], 11)
        step = step**0.5
    assert best is not None
    return best[1], best[1] * best[2]


def kp_for(search: Search, bandwidth_hz: Array, ratio: Array) -> Array:
    """For each bandwidth and ki/kp (n,) the smallest kp that gives it; where none does, one that does not."""
    table = np.geomspace(*_ranges(search)[0], 40)
    kp = np.repeat(table[:, None], len(ratio), axis=1)
    reached = search.judge(kp.ravel(), (kp * ratio).ravel()).bandwidth_hz.reshape(kp.shape) >= bandwidth_hz
    first = np.clip(np.argmax(reached, axis=0), 1, None)
    low, high = np.log(table[first - 1]), np.log(table[first])
    for _ in range(16):
        middle = 0.5 * (low + high)
        enough = search.judge(np.exp(middle), np.exp(middle) * ratio).bandwidth_hz >= bandwidth_hz
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    smallest_kp: Array = np.exp(high)
    return smallest_kp


def _allowed(judged: Judged, ms_limit: float) -> np.ndarray:
    return np.asarray(judged.stable & (judged.ms <= NEAR * ms_limit))


def _finite(values: Array) -> Array:
    return np.where(np.isfinite(values), values, 0.0)


def _shaped(search: Search, kp: float, ki: float, attainable_hz: float) -> Shaped:
    judged = search.judge(np.array([kp]), np.array([ki]))
    return Shaped(kp, ki, float(judged.ms[0]), float(judged.bandwidth_hz[0]), attainable_hz)
