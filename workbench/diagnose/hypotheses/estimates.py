"""The parameters of a fitted hypothesis in their own units, with standard errors.

    std_error² = interval² (g Σ gᵀ + s²)

Σ is the covariance of the fit, of noise, discrepancy and tolerances; g the parameter's derivative. s is by how much the
value may be off because the effect's law simplifies (`Parameter.simplified`): where the law fits every run alike, the
residual does not show it, neither as a whole nor from run to run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.knobs import Setting, bounds_of, setting_of
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.records import Estimate
from workbench.effects import Effect, Ranged, find, ranges_of
from workbench.machines import plant_of

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


def estimates(problem: Problem, fit: Fitted, interval: float, exact: bool = False) -> dict[str, tuple[Estimate, ...]]:
    """Effect -> its parameters: value and standard error, of each run where they are each run's own.

    exact: of laws taken as exact, s = 0, as where two fits of one law are compared.
    """
    spread = covariance(problem, fit, interval)
    slopes = _slopes(fit)
    kind = plant_of(problem.machine).kind
    rows = {}
    for name in fit.effects:
        effect = find(name, kind)
        ranges = ranges_of(effect, problem.machine, problem.runs)
        simplified = {} if exact else _simplified(effect, ranges, fit.setting)
        rows[name] = tuple(
            _estimate(r, fit.setting, slopes[r.symbol], spread, interval * simplified.get(r.symbol, 0.0))
            for r in ranges
            if r.symbol in fit.setting
        )
    return rows


def _estimate(r: Ranged, setting: Setting, slopes: Array, spread: Array, simplified: float) -> Estimate:
    errors = tuple(float(np.sqrt(max(row @ spread @ row, 0.0) + simplified**2)) for row in slopes)
    value = setting[r.symbol]
    return Estimate(r.name, value, errors if isinstance(value, tuple) else errors[0])


def _simplified(effect: Effect, ranges: Sequence[Ranged], setting: Setting) -> dict[str, float]:
    """symbol -> s, in the parameter's unit; held values are as they start."""
    declared = list(zip(effect.parameters, ranges, strict=True))
    e = SimpleNamespace(**{p.symbol: setting.get(r.symbol, r.start) for p, r in declared})
    return {r.symbol: abs(float(p.simplified(e))) for p, r in declared if p.simplified is not None}


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
