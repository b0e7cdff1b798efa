"""Held-out residuals: what a hypothesis, fitted to the other runs, leaves in the run it has not seen."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import PhaseOfEachRun, Setting, bounds_of, setting_of
from workbench.diagnose.hypotheses.problem import Problem

BLOCKS = 4  # that a single run is cut into
STRETCHES = 8  # of a run: so long a residual may hang together
PARTS = (1.0, 0.3, 0.1)  # of a step
MOST_STEPS = 20
SETTLED = 0.005  # of the objective: a step that gains less ends the refit
ROUNDING = 1e-6  # of a signature: what another run's own value adds to this one's rows


@dataclass(frozen=True)
class HeldOut:
    """residual: (samples,) each row as predicted without its fold. settings: the fit without each fold."""

    residual: Array
    fold_of_row: np.ndarray
    settings: tuple[Setting, ...]

    def rms(self, inputs: int, fold: int | None = None) -> float:
        """Of the input's rows, all or of one fold."""
        rows = self.residual[:inputs]
        if fold is not None:
            rows = rows[self.fold_of_row[:inputs] == fold]
        return float(np.sqrt(np.mean(rows**2))) if len(rows) else math.nan


def folds_by_run(problem: Problem) -> np.ndarray:
    """Each run is a fold; one run alone is cut into four blocks of time."""
    if len(problem.runs) > 1:
        return np.asarray(problem.run_of_row)
    blocks = np.minimum(np.arange(problem.inputs) * BLOCKS // max(problem.inputs, 1), BLOCKS - 1)
    return np.tile(blocks, problem.samples // max(problem.inputs, 1))


def held_out(problem: Problem, fitted: Fitted, fold_of_row: np.ndarray) -> HeldOut:
    """A refit to the other rows for each fold, started at the joint fit and followed to convergence.

    Gauss-Newton steps with a Jacobian that each step corrects (C. G. Broyden, Mathematics of Computation 19, 1965); all
    folds are simulated together. A step is taken as far as it serves the runs that are left: all of it, or a part.
    What is each run's own (a phase) is taken from that run itself: another run cannot know it. What was computed once
    is kept.
    """
    asked = (fitted, fold_of_row.tobytes(), problem.errors.sizes)
    if asked not in problem.kept:
        problem.kept[asked] = _held_out(problem, fitted, fold_of_row)
    found: HeldOut = problem.kept[asked]
    return found


def _held_out(problem: Problem, fitted: Fitted, fold_of_row: np.ndarray) -> HeldOut:
    lowest, highest, std = bounds_of(fitted.free)
    prior = np.diag(1.0 / std**2)
    white = problem.errors.whiten(np.column_stack([fitted.jacobian, fitted.residual]))
    folds = int(np.max(fold_of_row)) + 1 if len(fold_of_row) else 0
    inside = [fold_of_row == fold for fold in range(folds)]
    z = [fitted.z.copy() for _ in range(folds)]
    slopes = [white[~mine, :-1].copy() for mine in inside]
    rows = [white[~mine, -1].copy() for mine in inside]
    sizes = np.abs(fitted.jacobian)
    shown = [np.max(sizes[~mine], axis=0) > ROUNDING * np.max(sizes, axis=0) for mine in inside]  # by the other rows
    worth = [float(r @ r) + _pull(fitted.z, std) for r in rows]
    open_folds = set(range(folds))
    for _ in range(MOST_STEPS):
        tried: list[tuple[int, Array]] = []
        for fold in sorted(open_folds):
            j, r, at = slopes[fold], rows[fold], z[fold]
            gradient = j.T @ r + at / std**2
            free = (
                shown[fold] & ((at > lowest) | (gradient < 0.0)),
                shown[fold] & ((at < highest) | (gradient > 0.0)),
            )
            step = _step(j.T @ j + prior, gradient, *free)
            tried += [(fold, np.clip(at + part * step, lowest, highest)) for part in PARTS]
        if not tried:
            break
        whitened = problem.errors.whiten(problem.residuals([setting_of(fitted.free, at) for _, at in tried]).T).T
        better: dict[int, tuple[float, Array, Array]] = {}
        for (fold, at), row in zip(tried, whitened, strict=True):
            left = row[~inside[fold]]
            moved = at - z[fold]
            if float(moved @ moved) > 0.0:  # what the simulation has shown of the slope along this step
                fresh = left - rows[fold] - slopes[fold] @ moved
                slopes[fold] += np.outer(fresh, moved / float(moved @ moved))
            size = float(left @ left) + _pull(at, std)
            if size < (better[fold][0] if fold in better else worth[fold] - SETTLED):
                better[fold] = (size, at, left)
        open_folds &= set(better)
        for fold, (size, at, left) in better.items():
            worth[fold], z[fold], rows[fold] = size, at, left
    points = [at + _own(fitted, mine, at - fitted.z) for at, mine in zip(z, inside, strict=True)]
    points = [np.clip(at, lowest, highest) for at in points]
    settings = tuple(setting_of(fitted.free, at) for at in points)
    residual = np.empty(problem.samples)
    for row, mine in zip(problem.residuals(settings), inside, strict=True):
        residual[mine] = row[mine]
    return HeldOut(residual, fold_of_row, settings)


def _pull(z: Array, std: Array) -> float:
    return float(np.sum((z / std) ** 2))


def _step(hessian: Array, gradient: Array, down: np.ndarray, up: np.ndarray) -> Array:
    """The Newton step of what is not held at a bound that it wants to cross.

    What these rows do not show stays: rounding over a curvature of zero would throw it anywhere.
    """
    free = np.flatnonzero(down & up & (np.diag(hessian) > 0.0))
    h = hessian[np.ix_(free, free)]
    scale = np.sqrt(np.maximum(np.diag(h), 1e-300))
    step = np.zeros(len(gradient))
    step[free] = np.linalg.lstsq(h / np.outer(scale, scale), -gradient[free] / scale, rcond=1e-10)[0] / scale
    return step


def _own(fitted: Fitted, fold: np.ndarray, step: Array) -> Array:
    """The least-squares step of the values that belong to this fold's own runs, after `step` of all the others."""
    own = np.array(
        [isinstance(parameter, PhaseOfEachRun) for parameter in fitted.free for _ in parameter.lowest], dtype=bool
    )
    sizes = np.abs(fitted.jacobian)
    elsewhere, anywhere = np.max(sizes[~fold], axis=0, initial=0.0), np.max(sizes, axis=0, initial=0.0)
    mine = np.flatnonzero(own & (elsewhere <= ROUNDING * anywhere))
    moved = np.zeros(len(step))
    if len(mine) and np.any(fold):
        left = fitted.residual[fold] + fitted.jacobian[fold] @ step
        moved[mine] = -np.linalg.lstsq(fitted.jacobian[fold][:, mine], left, rcond=1e-8)[0]
    return moved


def significance(problem: Problem, without: Fitted, fit: Fitted) -> float:
    """By how much a fit predicts left-out folds better than another one, in standard deviations of that.

        gain = sum_i (u_i^2 - w_i^2) + P_0 - P,    variance = 4 sum_b (sum_(i in b) (u_i - w_i) w_i)^2 + 4 (P_0 - P)

    u and w are the whitened held-out residuals of both, P_0 and P the squared distances of their base parameters from
    nominal in tolerances, which are data like the others. Were w independent of what the further effects predict,
    u - w, the gain would be the energy of u - w; it is off that by their product alone. The products are summed over
    stretches b as long as the residual hangs together, so a remainder with structure is no proof (a sandwich variance;
    W. K. Newey, K. D. West, Econometrica 55, 1987).
    """
    folds = folds_by_run(problem)
    u, w = problem.errors.whiten(np.stack([held_out(problem, one, folds).residual for one in (without, fit)], axis=1)).T
    product = np.bincount(stretches(problem), (u - w) * w)
    prior = without.prior - fit.prior
    variance = 4.0 * float(product @ product) + 4.0 * max(prior, 0.0)
    return (float(u @ u - w @ w) + prior) / math.sqrt(max(variance, 1e-300))


def stretches(problem: Problem) -> np.ndarray:
    """(samples,) which of STRETCHES parts of which run, by time."""
    which = np.zeros(problem.samples, dtype=int)
    for j in range(len(problem.runs)):
        mine = np.flatnonzero(problem.run_of_row == j)
        which[mine] = j * STRETCHES + np.arange(len(mine)) * STRETCHES // max(len(mine), 1)
    return which
