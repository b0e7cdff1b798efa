"""How well a fit explains the data: its likelihood, with the size of the discrepancy at its best, less its cost.

    score = |whitened residual|^2 + ln det C(g) + (ln g / SPREAD)^2 + |base parameters in tolerances|^2

g is the campaign's own size of the discrepancy (see `discrepancy`), at its best between a half and a thousand times the
default. Each parameter costs ln(n) (G. Schwarz, Annals of Statistics 6, 1978), n independent samples, MOST at most.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.diagnose.hypotheses.discrepancy import SPREAD
from workbench.diagnose.hypotheses.error_model import ErrorModel
from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.problem import Problem
from workbench.run import Array

STEP = 2.0  # of the discrepancy's size, from one tried to the next
SMALLEST, LARGEST = 0.5, 1024.0
MOST = 500.0  # independent samples that a parameter pays for


@dataclass(frozen=True)
class Score:
    """value: minus twice the logarithm of the likelihood, up to a constant, with priors. size: g."""

    value: float
    size: float


def score_of(problem: Problem, fit: Fitted) -> Score:
    """A fit's score at the best size of the discrepancy, to a factor of STEP."""
    start = problem.errors.size
    best = _at(problem.errors, fit.residual)
    for factor in (STEP, 1.0 / STEP):
        size = start * factor
        while SMALLEST <= size <= LARGEST:
            there = _at(problem.errors.sized(size), fit.residual)
            if there.value >= best.value:
                break
            best, size = there, size * factor
        if best.size != start:
            break
    return Score(best.value + fit.prior, best.size)


def explained(problem: Problem, before: Fitted, after: Fitted, score: Score) -> float:
    """By how much the whitened sum of squares falls from one fit to another, with the discrepancy of that score."""
    white = problem.errors.sized(score.size).whiten(np.column_stack([before.residual, after.residual]))
    return max(float(white[:, 0] @ white[:, 0] - white[:, 1] @ white[:, 1]), 0.0)


def _at(errors: ErrorModel, residual: Array) -> Score:
    white = errors.whiten(residual)
    value = float(white @ white) + errors.log_det() + (math.log(errors.size) / SPREAD) ** 2
    return Score(value, errors.size)


def independent(problem: Problem) -> float:
    """Independent samples of the input."""
    return problem.share * problem.inputs


def cost(problem: Problem, parameters: int) -> float:
    """What parameters of effects cost, in the score's unit."""
    return parameters * math.log(min(max(independent(problem), 2.0), MOST))
