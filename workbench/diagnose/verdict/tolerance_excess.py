"""The distance of the base parameters from nominal, beyond what correct tolerances give by chance.

A wrong hypothesis may leave no residual at all, because the base parameters absorb the rest. Then only their distance
from nominal counts against it.
"""

from __future__ import annotations

import math

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.knobs import bounds_of
from workbench.diagnose.hypotheses.problem import Problem

HEAVIEST = 12.0  # logarithm of the tolerances' weight: nothing is left of any deviation
HALVED = 40  # times


def tolerance_excess(problem: Problem, fit: Fitted, allowed: float = 0.0) -> float:
    """The base parameters' distance from nominal, all together, in standard deviations beyond chance.

    allowed: by how much chi^2 of the data may rise for parameters nearer to nominal: an effect is no exact image of
    what the machine has, and what it misses bends the base parameters.

    A parameter that the data do not determine stays at its nominal value, whatever the true one. So true values drawn
    from the tolerances come back, in tolerances, with the covariance I - P, P the one that the data leave. The sum of
    their squares is then like chi^2 of fewer degrees than there are parameters: of as many as the data determine. How
    steeply friction turns over at standstill has no tolerance and does not count.
    """
    _, _, std = bounds_of(fit.knobs)
    hold = np.where(np.isfinite(std), 1.0 / std, 0.0)
    which = np.flatnonzero(_held_by_tolerance(fit))
    if not len(which):
        return 0.0
    white = problem.errors.whiten(np.column_stack([fit.jacobian, fit.residual]))
    data = white[:, :-1].T @ white[:, :-1]
    information = data + np.diag(hold**2)
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    left = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)
    determined = np.eye(len(which)) - (left * np.outer(hold, hold))[np.ix_(which, which)]
    shares = np.clip(np.linalg.eigvalsh(determined), 1e-9, 1.0)
    # A sum of squares of unequal variances, as chi^2 of the same mean and variance (F. E. Satterthwaite, Biometrics
    # Bulletin 2, 1946), in standard deviations (R. A. Fisher's sqrt(2 chi^2) - sqrt(2 k - 1)).
    unit = float(np.sum(shares**2) / np.sum(shares))
    pull = white[:, :-1].T @ white[:, -1]
    off = ((fit.z + _nearer(data, pull, fit.z, hold, scale, allowed)) * hold)[which]
    return math.sqrt(2.0 * float(off @ off) / unit) - math.sqrt(max(2.0 * float(np.sum(shares)) / unit - 1.0, 0.0))


def _nearer(data: Array, pull: Array, z: Array, hold: Array, scale: Array, allowed: float) -> Array:
    """The step from z to the parameters nearest to nominal at which chi^2 of the data, 2 pull step + step' data step
    above that at z, has risen by `allowed`."""

    def step(log_weight: float) -> Array:
        weight = math.exp(log_weight) * hold**2
        matrix = (data + np.diag(weight)) / np.outer(scale, scale)
        return np.asarray(np.linalg.lstsq(matrix, -(pull + weight * z) / scale, rcond=1e-12)[0] / scale)

    low, high = 0.0, HEAVIEST
    if allowed <= 0.0:
        return np.zeros(len(z))
    for _ in range(HALVED):
        middle = 0.5 * (low + high)
        there = step(middle)
        if 2.0 * float(pull @ there) + float(there @ data @ there) > allowed:
            high = middle
        else:
            low = middle
    return step(low)


def _held_by_tolerance(fit: Fitted) -> np.ndarray:
    """(len(z),) bool: a base parameter with a tolerance of machine.yaml."""
    return np.array(
        [math.isfinite(std) and not getattr(k, "logarithmic", False) for k in fit.knobs for std in k.prior_std],
        dtype=bool,
    )
