"""What speaks for a cause in what a fit leaves: the share that comes again, and the share that comes all at once.

A machine of its own leaves something that no lumped model has: a resonance, a controller's cycle, wear that shifts. A
cause comes again where the machine is in the same state; or it is a blow, in a few moments of the runs.
"""

from __future__ import annotations

import numpy as np

from workbench.diagnose.hypotheses.held_out import folds_by_run
from workbench.diagnose.hypotheses.problem import Problem
from workbench.kinds import kind_of
from workbench.run import Array

BINS = 24  # of each variable, each way
MOMENTS = 0.02  # of the rows
BY_CHANCE = 0.3  # of the energy, in so many rows: 0.13 of normal noise, some more of what is loud now and then


def repeated_share(problem: Problem, residual: Array) -> float:
    """Of the energy of the input's residual (samples,), 0 to 1: the most that the mean over other runs at the same
    position, or at the same speed, takes off it. Each way has means of its own."""
    rows = residual[: problem.inputs]
    folds = folds_by_run(problem)[: problem.inputs]
    kind = kind_of(problem.machine)
    motions = list(zip(problem.runs, problem.bench.motions, problem.rows, strict=True))
    speed = np.concatenate([motion.speed[at] for _, motion, at in motions])
    place = np.concatenate(
        [kind.place_of(problem.machine, run.start_position_m, motion.position)[at] for run, motion, at in motions]
    )
    return max(_foretold(rows, folds, variable, speed > 0.0) for variable in (place, speed))


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
    BY_CHANCE."""
    energy = np.sort(residual[: problem.inputs] ** 2)
    loudest = energy[-max(int(MOMENTS * len(energy)), 1) :]
    share = float(np.sum(loudest)) / max(float(np.sum(energy)), 1e-300)
    return max((share - BY_CHANCE) / (1.0 - BY_CHANCE), 0.0)
