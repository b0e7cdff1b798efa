"""How well a fit explains the data: its likelihood, with the discrepancy at its best, less its cost.

    score = |whitened residual|^2 + ln det C(g, h) + (ln g / SPREAD)^2 + (ln h / SPREAD)^2
            + |base parameters in tolerances|^2

g and h are the campaign's own size and correlation time of the discrepancy over the defaults (see `discrepancy`), at
their best within bounds. Each parameter costs ln(n) (G. Schwarz, Annals of Statistics 6, 1978), n independent samples,
MOST at most.
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

STEP = 2.0  # of both factors, from one tried to the next
SIZES = (0.5, 1024.0)
SLOWNESS = (1.0, 16.0)
MOST = 500.0  # independent samples that a parameter pays for


@dataclass(frozen=True)
class Score:
    """value: minus twice the logarithm of the likelihood, up to a constant, with priors. size, slowness: g and h."""

    value: float
    size: float
    slowness: float


def score_of(problem: Problem, fit: Fitted) -> Score:
    """A fit's score at the best size and correlation time of the discrepancy, to a factor of STEP."""
    errors = problem.errors
    tried: dict[tuple[float, float], float] = {}

    def value(at: tuple[float, float]) -> float:
        if at not in tried:
            tried[at] = _value(errors.sized(*at), fit.residual)
        return tried[at]

    best = (errors.size, errors.slowness)
    while True:
        around = [(best[0] * a, best[1] * b) for a, b in ((STEP, 1.0), (1.0 / STEP, 1.0), (1.0, STEP), (1.0, 1.0 / STEP))]
        inside = [at for at in around if _within(at[0], SIZES) and _within(at[1], SLOWNESS)]
        better = min(inside, key=value)
        if value(better) >= value(best):
            return Score(value(best) + fit.prior, *best)
        best = better


def explained(problem: Problem, before: Fitted, after: Fitted, score: Score) -> float:
    """By how much the whitened sum of squares falls from one fit to another, with the discrepancy of that score."""
    errors = problem.errors.sized(score.size, score.slowness)
    white = errors.whiten(np.column_stack([before.residual, after.residual]))
    return max(float(white[:, 0] @ white[:, 0] - white[:, 1] @ white[:, 1]), 0.0)


def _value(errors: ErrorModel, residual: Array) -> float:
    white = errors.whiten(residual)
    far = math.log(errors.size) ** 2 + math.log(errors.slowness) ** 2
    return float(white @ white) + errors.log_det() + far / SPREAD**2


def _within(x: float, bounds: tuple[float, float]) -> bool:
    return bounds[0] <= x <= bounds[1]


def independent(problem: Problem) -> float:
    """Independent samples of the input."""
    return problem.share * problem.inputs


def cost(problem: Problem, parameters: int) -> float:
    """What parameters of effects cost, in the score's unit."""
    return parameters * math.log(min(max(independent(problem), 2.0), MOST))
