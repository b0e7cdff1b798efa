"""Levenberg-Marquardt within bounds, for models that give residual and Jacobian in one call.

The kernels run the changed parameters of a Jacobian as extra lanes beside the plain
ones, so a residual without its Jacobian saves next to nothing; solvers that ask for
them one after the other ask for too much.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array

ENOUGH = 0.01  # of chi^2: less than this left to gain is a tenth of a standard error
ROUND_OFF = 1e-11  # of chi^2, relative: less than this is noise of the arithmetic
MOST = 40  # evaluations
DAMPING = 1e-4  # to begin with, of the diagonal of J'J


@dataclass(frozen=True)
class Minimum:
    """z: (m,); residual: (n,), jacobian: (n, m) at z. settled: the last step would have gained next to nothing."""

    z: Array
    residual: Array
    jacobian: Array
    evaluations: int
    settled: bool


def minimise(
    evaluate: Callable[[Array], tuple[Array, Array]],
    begin: tuple[Array, Array, Array],
    lowest: Array,
    reach: Array,
    weight: float,
    prior: Array,
    highest: Array | None = None,
    most: int = MOST,
) -> Minimum:
    """Minimise |weight residual(z)|^2 + |prior z|^2 for lowest <= z <= highest, in steps of at most `reach`.

    evaluate(z): residual (n,) and its Jacobian (n, m). begin: z with its residual and
    Jacobian. K. Madsen, H. B. Nielsen, O. Tingleff, "Methods for Non-Linear Least Squares
    Problems", 2004, section 3.2; each step is the best one within bounds and reach.
    """
    z, residual, jacobian = begin
    damping, growth, evaluations = DAMPING, 2.0, 0
    top = np.full(len(z), np.inf) if highest is None else highest
    chi2 = _chi2(z, residual, weight, prior)
    while evaluations < most:
        gradient = weight**2 * (jacobian.T @ residual) + prior.T @ (prior @ z)
        hessian = weight**2 * (jacobian.T @ jacobian) + prior.T @ prior
        box = np.maximum(lowest - z, -reach), np.minimum(top - z, reach)
        step = _step(hessian, gradient, box, damping)
        trial = np.clip(z + step, lowest, top)
        step = trial - z
        promised = float(-(2.0 * gradient @ step + step @ hessian @ step))
        if promised <= max(ENOUGH, ROUND_OFF * chi2):
            return Minimum(z, residual, jacobian, evaluations, True)
        r, j = evaluate(trial)
        evaluations += 1
        trial_chi2 = _chi2(trial, r, weight, prior)
        if trial_chi2 < chi2:
            gain = min((chi2 - trial_chi2) / promised, 1.0)
            z, residual, jacobian, chi2 = trial, r, j, trial_chi2
            damping = max(damping * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3) * 0.3, 1e-12)
            growth = 2.0
        else:
            damping, growth = max(damping, 1e-9) * growth * 4.0, growth * 2.0
            if damping > 1e12:
                break
    return Minimum(z, residual, jacobian, evaluations, False)


def _chi2(z: Array, residual: Array, weight: float, prior: Array) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        value = float(weight**2 * (residual @ residual) + np.sum((prior @ z) ** 2))
    return value if np.isfinite(value) else np.inf


def _step(hessian: Array, gradient: Array, box: tuple[Array, Array], damping: float) -> Array:
    """The damped Newton step, the best one within the box."""
    scale = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    unit = hessian / np.outer(scale, scale)  # variables on their own scale, else the damping is of the largest
    unit[np.diag_indices_from(unit)] *= 1.0 + damping
    pull = gradient / scale
    if not (np.all(np.isfinite(unit)) and np.all(np.isfinite(pull))):  # LAPACK would complain on the terminal
        raise np.linalg.LinAlgError("the slopes of the residual are not finite")
    step = -np.linalg.lstsq(unit, pull, rcond=1e-14)[0] / scale
    if np.all((step >= box[0]) & (step <= box[1])):
        return step
    from scipy.optimize import lsq_linear

    unit[np.diag_indices_from(unit)] += 1e-12
    values, vectors = np.linalg.eigh(unit)
    root = np.sqrt(np.maximum(values, 1e-14))
    bounds = np.minimum(box[0], 0.0) * scale, np.maximum(box[1], 1e-300) * scale
    solution = lsq_linear(root[:, None] * vectors.T, -(vectors.T @ pull) / root, bounds, method="bvls")
    return np.asarray(solution.x / scale)
