"""The gap over frequency: how its energy is spread, and what one steady wave takes away."""

from __future__ import annotations

import math

import numpy as np

from workbench.diagnose.problem import Problem
from workbench.diagnose.profiles import Explained, blocks, run_of, share_of
from workbench.diagnose.records import Profile
from workbench.diagnose.variables import Variable, times
from workbench.run import Array

PER_RESOLUTION = 2.0  # frequencies tried within 1/(length of a run)
BINS = 16
FEWEST_WAVES = 2.0  # of a wave in the longest run: a slower one is a trend
MOST_TRIED = 4000


def wave_of(problem: Problem, gap: Array, seed: int) -> tuple[Explained, Profile]:
    """The one frequency whose wave, with an amplitude and phase of each run, explains most of the gap.

    Fitted to every other piece of time, judged on the rest: a wave goes on, a burst does not.
    """
    tried = _tried(problem)
    power = np.zeros(len(tried))
    pairs = _sums(problem, gap, tried)
    for run_power in pairs:
        power += run_power
    best = float(tried[int(np.argmax(power))])
    part = _held_out(problem, gap, best)
    share, interval = share_of(problem, gap, gap - part, seed)
    at = np.full(problem.inputs, best)
    edges = np.geomspace(tried[0], tried[-1], BINS + 1)
    v = Variable("frequency", "frequency", "Hz", "time", at, edges, of_each_run=True)
    found = Explained(v, part, share, interval)
    bins = np.clip(np.searchsorted(edges, tried, side="right") - 1, 0, BINS - 1)
    spread = np.bincount(bins, power, BINS)
    nothing = np.full(BINS, np.nan)
    profile = Profile(
        "frequency", f"frequency (one wave of {best:.3g} Hz)", "Hz", "time", edges, nothing, nothing,
        spread / max(float(spread.sum()), 1e-300), share, interval,
    )  # fmt: skip
    return found, profile


def _tried(problem: Problem) -> Array:
    longest = max(run.duration_s for run in problem.runs)
    lowest = FEWEST_WAVES / longest
    highest = max(problem.band_hz, 2.0 * lowest)
    count = min(MOST_TRIED, math.ceil((highest - lowest) * longest * PER_RESOLUTION) + 2)
    return np.linspace(lowest, highest, count)


def _sums(problem: Problem, gap: Array, tried: Array) -> list[Array]:
    """Of each run, what a wave of every frequency takes away, least squares with two amounts."""
    out, at = [], times(problem)
    for j in range(len(problem.runs)):
        mine = run_of(problem) == j
        angle = 2.0 * math.pi * np.outer(tried, at[mine])
        c, s, g = np.cos(angle), np.sin(angle), gap[mine]
        cc, ss, cs = np.sum(c * c, 1), np.sum(s * s, 1), np.sum(c * s, 1)
        a, b = c @ g, s @ g
        det = np.maximum(cc * ss - cs * cs, 1e-12)
        out.append((ss * a * a - 2.0 * cs * a * b + cc * b * b) / det)
    return out


def _held_out(problem: Problem, gap: Array, frequency: float) -> Array:
    out, at, halves = np.zeros_like(gap), times(problem), blocks(problem)
    for j in range(len(problem.runs)):
        mine = run_of(problem) == j
        angle = 2.0 * math.pi * frequency * at
        waves = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        for half in (0, 1):
            test, train = mine & (halves == half), mine & (halves != half)
            out[test] = waves[test] @ np.linalg.lstsq(waves[train], gap[train], rcond=1e-9)[0]
    return out
