"""Whether what a fit leaves comes again: the share of it that the place or the speed of another run foretells.

A machine of its own leaves something that no lumped model has: a resonance, a controller's cycle, wear that shifts. A
cause comes again where the machine is in the same state.
"""

from __future__ import annotations

import numpy as np

from workbench.diagnose.hypotheses.held_out import folds_by_run
from workbench.diagnose.hypotheses.problem import Problem
from workbench.kinds import kind_of
from workbench.run import Array

BINS = 24  # of each variable, each way


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
