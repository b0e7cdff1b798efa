"""The shortest windows of time that hold most of an energy."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.records import Window
from workbench.diagnose.location.variables import spacing, times

HELD = 0.75  # of the energy, in the windows
SHORTEST = 2.0  # periods of the band
APART = 1.0  # periods: windows nearer to one another are one


@dataclass(frozen=True)
class Windows:
    """inside: (inputs,) bool, the residuals in the windows. held: their share of the energy; time: their share of the
    time."""

    windows: tuple[Window, ...]
    inside: np.ndarray
    held: float
    time: float


def windows_of(problem: Problem, power: Array, held: float = HELD) -> Windows:
    """The windows above one level of the power, (inputs,), smoothed over a period of the band.

    The level is the highest one whose windows hold the wanted share of the energy.
    """
    step, at, period = spacing(problem), times(problem), 1.0 / problem.band_hz
    run_of = problem.run_of_row[: problem.inputs]
    smooth = np.maximum(_smoothed(power, at, run_of, period), 0.0)
    energy = step * np.maximum(power, 0.0)
    total = float(energy.sum())
    levels = np.unique(smooth)[::-1]
    inside, spans = np.ones(problem.inputs, dtype=bool), None
    low, high = 0, len(levels) - 1  # the share grows as the level falls
    while low <= high:
        middle = (low + high) // 2
        tried = _spans(smooth >= levels[middle], at, run_of, step, period)
        within = _within(tried, at, run_of)
        if float(energy[within].sum()) >= held * total:
            inside, spans, high = within, tried, middle - 1
        else:
            low = middle + 1
    if spans is None:
        spans = _spans(inside, at, run_of, step, period)
    digits = max(0, math.ceil(-math.log10(0.05 * period)))  # a twentieth of a period says no more
    named = tuple(Window(problem.runs[j].name, round(a, digits), round(b, digits)) for j, a, b in spans)
    share = float(energy[inside].sum()) / total if total > 0.0 else 0.0
    return Windows(named, inside, share, float(step[inside].sum() / step.sum()))


def _smoothed(power: Array, at: Array, run_of: np.ndarray, period: float) -> Array:
    """The mean over a period around each time, of the same run."""
    out = np.empty_like(power)
    for j in np.unique(run_of):
        mine = np.flatnonzero(run_of == j)
        t, total = at[mine], np.concatenate([[0.0], np.cumsum(power[mine])])
        first = np.searchsorted(t, t - 0.5 * period)
        last = np.searchsorted(t, t + 0.5 * period, side="right")
        out[mine] = (total[last] - total[first]) / (last - first)
    return out


def _spans(
    chosen: np.ndarray, at: Array, run_of: np.ndarray, step: Array, period: float
) -> list[tuple[int, float, float]]:
    """(run, from, to) s, merged and at least SHORTEST long, within what the run's residuals cover."""
    of_all_runs: list[tuple[int, float, float]] = []
    for j in np.unique(run_of):
        mine = run_of == j
        t, half = at[mine], 0.5 * float(step[mine][0])
        begin, end = float(t[0]) - half, float(t[-1]) + half
        spans: list[list[float]] = []
        for x in t[chosen[mine]]:
            middle_a, middle_b = float(x) - half, float(x) + half
            if spans and middle_a - spans[-1][1] < APART * period:
                spans[-1][1] = middle_b
            else:
                spans.append([middle_a, middle_b])
        widened: list[list[float]] = []
        for a, b in spans:
            more = max(0.5 * (SHORTEST * period - (b - a)), 0.0)
            a = max(a - more, begin)
            b = min(max(b + more, a + SHORTEST * period), end)
            a = max(min(a, b - SHORTEST * period), begin)
            if widened and a - widened[-1][1] < APART * period:
                widened[-1][1] = b
            else:
                widened.append([a, b])
        of_all_runs += [(int(j), a, b) for a, b in widened]
    return of_all_runs


def _within(spans: list[tuple[int, float, float]], at: Array, run_of: np.ndarray) -> np.ndarray:
    inside = np.zeros(len(at), dtype=bool)
    for j, a, b in spans:
        inside |= (run_of == j) & (at >= a) & (at <= b)
    return inside
