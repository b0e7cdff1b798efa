"""The parameters of a fitted hypothesis in their own units, with standard errors."""

from __future__ import annotations

import math

import numpy as np

from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.knobs import Setting, bounds_of, setting_of
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.records import Estimate
from workbench.effects import Ranged, find, ranges_of
from workbench.plants import plant_of
from workbench.run import Array

STEP = 1e-4  # of z, for the values' slopes


def covariance(problem: Problem, fit: Fitted, interval: float) -> Array:
    """The covariance of z, (m, m). It grows in proportion to a residual above the noise. Standard errors are widened by
    `interval`, the factor that gives them the right coverage on simulated campaigns."""
    _, _, std = bounds_of(fit.knobs)
    white = problem.errors.whiten(fit.jacobian)
    information = white.T @ white + np.diag(1.0 / std**2)
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-12) / np.outer(scale, scale)
    excess = max(1.0, fit.chi2 / max(problem.share * problem.samples, 1.0))
    return np.asarray(inverse * excess * interval**2)


def estimates(problem: Problem, fit: Fitted, interval: float) -> dict[str, tuple[Estimate, ...]]:
    """Effect -> its parameters: value and standard error, of each run where they are each run's own."""
    spread = covariance(problem, fit, interval)
    slopes = _slopes(fit)
    kind = plant_of(problem.machine).kind
    setting = fit.setting
    return {
        name: tuple(
            _estimate(r, setting, slopes[r.symbol], spread)
            for r in ranges_of(find(name, kind), problem.machine, problem.runs)
            if r.symbol in setting
        )
        for name in fit.effects
    }


def _estimate(r: Ranged, setting: Setting, slopes: Array, spread: Array) -> Estimate:
    errors = tuple(float(np.sqrt(max(row @ spread @ row, 0.0))) for row in slopes)
    value = setting[r.symbol]
    return Estimate(r.name, value, errors if isinstance(value, tuple) else errors[0])


def _slopes(fit: Fitted) -> dict[str, Array]:
    """symbol -> (values, m): the derivative of each value by z; angles by their shorter way round."""
    base = {name: np.atleast_1d(np.array(value)) for name, value in fit.setting.items()}
    slopes = {name: np.zeros((len(value), len(fit.z))) for name, value in base.items()}
    for k, row in enumerate(STEP * np.eye(len(fit.z))):
        moved = setting_of(fit.knobs, fit.z + row)
        for name, value in moved.items():
            change = np.atleast_1d(np.array(value)) - base[name]
            if name.endswith("phase_rad"):
                change = (change + math.pi) % (2.0 * math.pi) - math.pi
            slopes[name][:, k] = change / STEP
    return slopes
