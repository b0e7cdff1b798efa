"""The spectrum of the gap, over time and along the travel, and the share of it that one steady wave explains."""

from __future__ import annotations

import math

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.profiles import Explained, blocks, run_of, share_of
from workbench.diagnose.location.records import Profile
from workbench.diagnose.location.variables import Variable, forward, times, way
from workbench.machines import kind_of

PER_RESOLUTION = 3.0  # frequencies tried within 1/(length of a run)
BINS = 16
FEWEST_WAVES = 2.0  # in the longest run: a slower wave is a trend
MOST_WAVES = 600.0  # over the way of the longest run
FINE = 16.0  # cells of the grid to a wave
FEWEST_ROWS = 8  # of a run and way: fewer say nothing of a wave


def wave_in_time(problem: Problem, gap: Array, seed: int) -> tuple[Explained, Profile]:
    """The one frequency, Hz, whose wave in time explains most of the gap."""
    longest = max(run.duration_s for run in problem.runs)
    tried = _tried(longest, problem.band_hz)
    return _wave(problem, gap, seed, times(problem), tried, ("frequency", "frequency", "Hz", "time"), False)


def wave_along_the_way(problem: Problem, gap: Array, seed: int) -> tuple[Explained, Profile] | None:
    """The wave over the carriage's height (the axis' position) that explains most of the gap, one for each direction.

    Rotating parts repeat so: motor, drum, a roller. Every run has its own phase, because a motor turns many times
    within the uncertainty of the height.
    """
    at, runs = way(problem), run_of(problem)
    longest = max(float(np.ptp(at[runs == j])) for j in np.unique(runs))
    if longest <= 0.0:
        return None
    tried = _tried(longest, MOST_WAVES / longest)
    unit = f"1/{kind_of(problem.machine).moved.unit}"
    return _wave(problem, gap, seed, at, tried, ("wave", "frequency over the way", unit, "periodic"), True)


def _wave(
    problem: Problem, gap: Array, seed: int, at: Array, tried: Array, said: tuple[str, str, str, str], each_way: bool
) -> tuple[Explained, Profile]:
    """One frequency for all runs; amplitude and phase for each run (and direction).

    Fitted to every other piece of time and judged on the rest: a wave continues, a burst does not.
    """
    groups = [run_of(problem) == j for j in range(len(problem.runs))]
    if each_way:
        ahead = forward(problem)
        groups = [mine & side for mine in groups for side in (ahead, ~ahead)]
    groups = [mine for mine in groups if np.sum(mine) >= FEWEST_ROWS]
    power = sum((_taken(gap[mine], at[mine], tried) for mine in groups), np.zeros(len(tried)))
    best = float(tried[int(np.argmax(power))])
    part = _held_out(problem, gap, best * at, groups)
    share, interval = share_of(problem, gap, gap - part, seed)
    edges = np.geomspace(tried[0], tried[-1], BINS + 1)
    name, label, unit, regime = said
    explained = Explained(
        Variable(name, label, unit, regime, np.full(problem.inputs, best), edges), part, share, interval
    )
    bins = np.clip(np.searchsorted(edges, tried, side="right") - 1, 0, BINS - 1)
    # Of each bin its best wave: a sum would count the noise of ever more frequencies, the higher they are.
    taken = np.zeros(BINS)
    np.maximum.at(taken, bins, power)
    nothing = np.full(BINS, np.nan)
    profile = Profile(
        name, f"{label}, best at {best:.3g} {unit}", unit, regime, edges, nothing, nothing,
        taken / max(float(gap @ gap), 1e-300), share, interval,
    )  # fmt: skip
    return explained, profile


def _tried(longest: float, highest: float) -> Array:
    """Even frequencies, whole multiples of their distance, from FEWEST_WAVES on."""
    distance = 1.0 / (PER_RESOLUTION * longest)
    first = math.ceil(FEWEST_WAVES * PER_RESOLUTION)
    last = max(math.ceil(highest / distance), 2 * first)
    return np.asarray(distance * np.arange(first, last + 1), dtype=float)


def _taken(gap: Array, at: Array, tried: Array) -> Array:
    """The energy that a wave of each frequency explains: least squares with two amounts, at times of any spacing.

    The sums over all samples are Fourier transforms, of the samples put on a fine grid.
    """
    distance, highest = float(tried[1] - tried[0]), float(tried[-1])
    n = math.ceil(FINE * highest / distance)
    step = 1.0 / (n * distance)
    cell = np.round((at - at.min()) / step).astype(int)
    cell %= n  # what lies a whole period of all frequencies further on is in phase
    order = np.round(tried / distance).astype(int)
    sums = np.conj(np.fft.fft(np.bincount(cell, gap, n)))
    twice = np.conj(np.fft.fft(np.bincount(cell, minlength=n)))[2 * order]
    a, b = sums[order].real, sums[order].imag
    cc, ss, cs = 0.5 * (len(gap) + twice.real), 0.5 * (len(gap) - twice.real), 0.5 * twice.imag
    det = np.maximum(cc * ss - cs * cs, 1e-6 * (cc + ss) ** 2)
    return np.asarray((ss * a * a - 2.0 * cs * a * b + cc * b * b) / det, dtype=float)


def _held_out(problem: Problem, gap: Array, turns: Array, groups: list[np.ndarray]) -> Array:
    out, halves = np.zeros_like(gap), blocks(problem)
    waves = np.stack([np.cos(2.0 * math.pi * turns), np.sin(2.0 * math.pi * turns)], axis=1)
    for mine in groups:
        for half in (0, 1):
            test, train = mine & (halves == half), mine & (halves != half)
            if np.sum(train) >= FEWEST_ROWS // 2:
                out[test] = waves[test] @ np.linalg.lstsq(waves[train], gap[train], rcond=1e-9)[0]
    return out
