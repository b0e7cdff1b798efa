"""How well a fit explains the data: its likelihood, with the sizes of the discrepancy at their best, less its cost.

    score = |whitened residual|^2 + ln det C(g, h) + (ln g / SPREAD)^2 + (ln h / SPREAD)^2
            + |base parameters in tolerances|^2

g is the campaign's own size of the discrepancy (see `discrepancy`) over the default, h that of its part near standstill
beside it, at their best within bounds. Each parameter costs ln(n) (G. Schwarz, Annals of Statistics 6, 1978), n
independent samples, MOST at most.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.discrepancy import SPREAD
from workbench.diagnose.hypotheses.error_model import ErrorModel, Sizes
from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.problem import Problem, rms

STEP = 2.0  # of both sizes, from one tried to the next
BOUNDS = ((0.5, 1024.0), (1.0, 16.0))
MOST = 500.0  # independent samples that a parameter pays for


@dataclass(frozen=True)
class Score:
    """value: minus twice the logarithm of the likelihood, up to a constant, with priors. sizes: g and h. excess: the
    discrepancy over the default one, rms."""

    value: float
    sizes: Sizes
    excess: float


def score_of(problem: Problem, fit: Fitted) -> Score:
    """A fit's score at the best sizes of the discrepancy, to a factor of STEP."""
    errors = problem.errors
    tried: dict[Sizes, float] = {}

    def value(sizes: Sizes) -> float:
        if sizes not in tried:
            tried[sizes] = _value(errors.sized(sizes), fit.residual)
        return tried[sizes]

    best = errors.sizes
    while True:
        g, h = best
        around = [(g * STEP, h), (g / STEP, h), (g, h * STEP), (g, h / STEP)]
        inside = [sizes for sizes in around if _within(sizes)]
        better = min(inside, key=value)
        if value(better) >= value(best):
            break
        best = better
    excess = rms(errors.sized(best).discrepancy) / max(rms(errors.sized((1.0, 1.0)).discrepancy), 1e-300)
    return Score(value(best) + fit.prior, best, excess)


def explained(problem: Problem, before: Fitted, after: Fitted, score: Score) -> float:
    """The fall of the whitened sum of squares from one fit to another, whitened with the discrepancy of `score`."""
    white = problem.errors.sized(score.sizes).whiten(np.column_stack([before.residual, after.residual]))
    return max(float(white[:, 0] @ white[:, 0] - white[:, 1] @ white[:, 1]), 0.0)


def _value(errors: ErrorModel, residual: Array) -> float:
    white = errors.whiten(residual)
    unlikely = sum((math.log(size) / SPREAD) ** 2 for size in errors.sizes)
    return float(white @ white) + errors.log_det() + unlikely


def _within(sizes: Sizes) -> bool:
    return all(low <= size <= high for size, (low, high) in zip(sizes, BOUNDS, strict=True))


def independent(problem: Problem) -> float:
    """Independent samples of the input."""
    return problem.share * problem.inputs


def cost(problem: Problem, parameters: int) -> float:
    """The cost of so many effect parameters, in the score's unit."""
    return parameters * math.log(min(max(independent(problem), 2.0), MOST))
