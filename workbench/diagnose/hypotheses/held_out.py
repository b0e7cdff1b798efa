"""Held-out residuals: what a hypothesis, fitted to the other runs, leaves in the run it has not seen."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.knobs import PhaseOfEachRun, Setting, bounds_of, setting_of
from workbench.diagnose.hypotheses.problem import Problem
from workbench.run import Array

BLOCKS = 4  # that a single run is cut into
PARTS = (1.0, 0.3, 0.0)  # of the step that takes a fold out
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


def folds_by_payload(problem: Problem) -> np.ndarray | None:
    """Runs of one payload are a fold; None where all runs have the same."""
    payloads = sorted({run.payload_kg for run in problem.runs})
    if len(payloads) < 2:
        return None
    of_run = np.array([payloads.index(run.payload_kg) for run in problem.runs])
    return np.asarray(of_run[problem.run_of_row])


def held_out(problem: Problem, fitted: Fitted, fold_of_row: np.ndarray) -> HeldOut:
    """One Gauss-Newton step from the joint fit takes a fold out; the model is then run anew at that point.

    The step is taken as far as it serves the runs that are left: all of it, a part, or not at all.

    What is each run's own (a phase) is taken from that run itself: another run cannot know it.
    """
    lowest, highest, std = bounds_of(fitted.knobs)
    prior = np.diag(1.0 / std**2)
    white = problem.errors.whiten(np.column_stack([fitted.jacobian, fitted.residual]))
    folds = int(np.max(fold_of_row)) + 1 if len(fold_of_row) else 0
    points: list[Array] = []
    for fold in range(folds):
        rest = fold_of_row != fold
        j, r = white[rest, :-1], white[rest, -1]
        hessian = j.T @ j + prior
        gradient = j.T @ r + fitted.z / std**2
        step = _step(hessian, gradient, (fitted.z > lowest) | (gradient < 0.0), (fitted.z < highest) | (gradient > 0.0))
        for part in PARTS:
            points.append(np.clip(fitted.z + part * step + _own(fitted, ~rest, part * step), lowest, highest))
    out = problem.residuals([setting_of(fitted.knobs, z) for z in points])
    whitened = problem.errors.whiten(out.T).T
    residual, settings = np.empty(problem.samples), []
    for fold in range(folds):
        mine = fold_of_row == fold
        tried = range(fold * len(PARTS), (fold + 1) * len(PARTS))
        best = min(tried, key=lambda k: float(whitened[k][~mine] @ whitened[k][~mine]) + _pull(points[k], std))
        residual[mine] = out[best][mine]
        settings.append(setting_of(fitted.knobs, points[best]))
    return HeldOut(residual, fold_of_row, tuple(settings))


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
    own = np.array([isinstance(knob, PhaseOfEachRun) for knob in fitted.knobs for _ in knob.lowest], dtype=bool)
    sizes = np.abs(fitted.jacobian)
    elsewhere, anywhere = np.max(sizes[~fold], axis=0, initial=0.0), np.max(sizes, axis=0, initial=0.0)
    mine = np.flatnonzero(own & (elsewhere <= ROUNDING * anywhere))
    moved = np.zeros(len(step))
    if len(mine) and np.any(fold):
        left = fitted.residual[fold] + fitted.jacobian[fold] @ step
        moved[mine] = -np.linalg.lstsq(fitted.jacobian[fold][:, mine], left, rcond=1e-8)[0]
    return moved
