"""Structure in the residual that points to a cause: repeated, sudden or lasting parts.

Every real machine leaves a residual that no lumped model has: resonances, a controller's cycle, slow wear. A cause
shows as a residual that repeats in the same state of the machine, as an impact within a few moments, or as friction
that changes its level at one moment of a run and keeps it.
"""

from __future__ import annotations

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.held_out import folds_by_run
from workbench.diagnose.hypotheses.problem import Problem
from workbench.machines import kind_of

BINS = 24  # of each variable, each way
MOMENTS = 0.02  # of the rows
AT_SPEED = 0.1  # of the largest of the run: slower is near standstill
SHORTEST = 0.05  # of a run's rows, before and behind a change that lasts
LASTING = 0.2  # of the energy: machines without such a change show up to 0.17
BY_CHANCE = 0.3  # of the energy, in so many rows: 0.13 of normal noise, some more of what is loud now and then


def repeated_share(problem: Problem, residual: Array) -> float:
    """Of the energy of the input's residual (samples,), 0 to 1: the most that the mean over other runs at the same
    position, or at the same speed, takes off it. Each way has means of its own."""
    kind = kind_of(problem.machine)
    place = [
        kind.place_of(problem.machine, run.start_position_m, motion.position)[at]
        for run, motion, at in zip(problem.runs, problem.bench.motions, problem.rows, strict=True)
    ]
    return _most_foretold(problem, residual, np.concatenate(place), _speed(problem))


def loaded_share(problem: Problem, residual: Array) -> float:
    """As `repeated_share`, with the same input or the same acceleration: a gain that differs between the ways."""
    measured = [u[at] for u, at in zip(problem.bench.measured, problem.rows, strict=True)]
    acceleration = [
        np.gradient(motion.speed, run.time_s)[at]
        for run, motion, at in zip(problem.runs, problem.bench.motions, problem.rows, strict=True)
    ]
    return _most_foretold(problem, residual, np.concatenate(measured), np.concatenate(acceleration))


def _speed(problem: Problem) -> Array:
    return np.concatenate([motion.speed[at] for motion, at in zip(problem.bench.motions, problem.rows, strict=True)])


def _most_foretold(problem: Problem, residual: Array, *variables: Array) -> float:
    folds = folds_by_run(problem)[: problem.inputs]
    forward = _speed(problem) > 0.0
    return max(_foretold(residual[: problem.inputs], folds, variable, forward) for variable in variables)


def _foretold(rows: Array, folds: np.ndarray, variable: Array, forward: np.ndarray) -> float:
    edges = np.quantile(variable, np.linspace(0.0, 1.0, BINS + 1)[1:-1])
    cell = np.searchsorted(edges, variable) + BINS * forward
    left = 0.0
    for fold in np.unique(folds):
        mine = folds == fold
        count = np.bincount(cell[~mine], minlength=2 * BINS)
        total = np.bincount(cell[~mine], rows[~mine], minlength=2 * BINS)
        mean = total / np.maximum(count, 1)
        left += float(np.sum((rows[mine] - mean[cell[mine]]) ** 2))
    energy = float(rows @ rows)
    return min(max(1.0 - left / energy, 0.0), 1.0) if energy > 0.0 else 0.0


def sudden_share(problem: Problem, residual: Array) -> float:
    """Of the energy of the input's residual (samples,), 0 to 1: what the loudest MOMENTS of its rows hold beyond
    BY_CHANCE, of those at speed. Near standstill a machine is loud for a moment at each reversal, by its friction."""
    at_speed = [
        np.abs(motion.speed[at]) > AT_SPEED * np.max(np.abs(motion.speed[at]), initial=0.0)
        for motion, at in zip(problem.bench.motions, problem.rows, strict=True)
    ]
    rows = residual[: problem.inputs]
    energy = np.sort(rows[np.concatenate(at_speed)] ** 2)
    loudest = energy[-max(int(MOMENTS * len(energy)), 1) :]
    share = float(np.sum(loudest)) / max(float(np.sum(energy)), 1e-300)
    of_all = float(np.sum(energy)) / max(float(rows @ rows), 1e-300)
    return max((share - BY_CHANCE) / (1.0 - BY_CHANCE), 0.0) * of_all


def lasting_share(problem: Problem, residual: Array) -> float:
    """Of the energy of the input's residual (samples,), 0 to 1: what friction takes off it whose level changes once in
    each run, at its best moment, beyond LASTING, as much as a slow discrepancy looks like that by chance."""
    start, taken = 0, 0.0
    for motion, at in zip(problem.bench.motions, problem.rows, strict=True):
        along = residual[start : start + len(at)] * np.sign(motion.speed[at])
        start += len(at)
        least = max(int(SHORTEST * len(at)), 1)
        if len(at) <= 2 * least:
            continue
        before, total, count = np.cumsum(along)[least - 1 : -least], float(np.sum(along)), len(at)
        rows = np.arange(least, count - least + 1)
        changed = before**2 / rows + (total - before) ** 2 / (count - rows) - total**2 / count
        taken += float(np.max(changed))
    energy = float(residual[: problem.inputs] @ residual[: problem.inputs])
    share = taken / energy if energy > 0.0 else 0.0
    return max((share - LASTING) / (1.0 - LASTING), 0.0)
