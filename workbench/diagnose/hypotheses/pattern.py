"""A pattern search over an effect's own values, where the objective has steps that derivatives do not see.

The teeth of a play meet between two samples: a small change of its law moves no sample at all, a larger one several.
R. Hooke, T. A. Jeeves, Direct search solution of numerical and statistical problems, J. ACM 8, 1961.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.knobs import bounds_of, setting_of
from workbench.diagnose.hypotheses.problem import Problem

SIZES = (0.2, 0.07, 0.025, 0.008)  # of a value, or of LEAST of its scale where that is more
LEAST = 0.1
AGAIN = 2  # steps of one size


def stepped(problem: Problem, fit: Fitted, base: int) -> Array:
    """z of the best point found around a fit, its first `base` values kept."""
    lowest, highest, std = bounds_of(fit.knobs)
    values = np.array([float(np.mean(fit.setting[k.symbol])) for k in fit.knobs if hasattr(k, "symbol")])
    scales = np.array([getattr(k, "scale", 1.0) for k in fit.knobs if hasattr(k, "symbol")])
    if len(values) != len(fit.z):
        return fit.z
    best, worth = fit.z, fit.objective
    moves = [np.array(move) for move in product((-1.0, 0.0, 1.0), repeat=len(fit.z) - base) if any(move)]
    for size in SIZES:
        for _ in range(AGAIN):
            reach = size * np.maximum(np.abs(values / scales), LEAST)[base:]
            tried = [np.clip(best + np.concatenate([np.zeros(base), move * reach]), lowest, highest) for move in moves]
            residuals = problem.residuals([setting_of(fit.knobs, z) for z in tried])
            white = problem.errors.whiten(residuals.T)
            objectives = np.sum(white**2, axis=0) + np.array([np.sum((z / std) ** 2) for z in tried])
            k = int(np.argmin(objectives))
            if objectives[k] >= worth:
                break
            best, worth = tried[k], float(objectives[k])
    return best
