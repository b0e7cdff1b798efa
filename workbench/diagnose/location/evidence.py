"""How well a force of unknown shape at one port accounts for what is unexplained: its marginal likelihood.

    y = B z + s Φ w + e,   z, w ~ N(0, 1),   e ~ N(0, κ² σ²)

y is the residual at the nominal machine, B what the base parameters add (each by its tolerance), Φ the port's
columns, scaled so that s is the rms of what they add. z and w are integrated out; s and κ, for no model is exact, are
averaged over, evenly on a logarithmic scale. C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine
Learning, 2006, sections 2.1 and 5.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import log_ndtr, logsumexp

from workbench.diagnose.location.survey import Survey
from workbench.run import Array

SIZES = 8  # of s
MISFITS = 7  # of κ
SMALLEST = 0.3  # s, of the noise
LARGEST = 2.0  # s, of the residual at the nominal machine
MOST_MISFIT = 1.5  # κ σ, of what the base parameters leave


@dataclass(frozen=True)
class Evidence:
    """log: of the marginal likelihood. size, misfit: s, N m (N), and κ where it is largest."""

    log: float
    size: float
    misfit: float


class Weigher:
    """Marginal likelihoods on one survey."""

    def __init__(self, survey: Survey) -> None:
        self.survey = survey
        root = math.sqrt(survey.share) / survey.noise
        self.y, self.base, self.root = root * survey.residual, root * survey.base, root
        self.count = survey.share * len(self.y)
        gap, nominal = survey.gap_rms, float(np.sqrt(np.mean(survey.residual[: survey.inputs] ** 2)))
        self.sizes = np.geomspace(SMALLEST * survey.noise, max(LARGEST * max(nominal, gap), survey.noise), SIZES)
        self.misfits = np.geomspace(1.0, max(MOST_MISFIT * gap / survey.noise, 1.5), MISFITS)
        gram, pull = self.base.T @ self.base, self.base.T @ self.y
        self.of_base = []
        for k2 in self.misfits**2:
            factor = cho_factor(np.eye(len(pull)) + gram / k2)
            alone = -self.count * 0.5 * math.log(k2) - float(np.sum(np.log(np.diag(factor[0]))))
            alone -= 0.5 * (float(self.y @ self.y) / k2 - float(pull @ cho_solve(factor, pull)) / k2**2)
            self.of_base.append((k2, factor, cho_solve(factor, pull), alone))

    def nothing(self) -> float:
        """Of the base parameters alone."""
        return float(logsumexp([alone for *_, alone in self.of_base]) - math.log(MISFITS))

    def evidence(self, columns: Array, positive: bool = False) -> Evidence:
        """columns: (samples, k) of a port. positive: whether the amounts cannot be negative, all in all."""
        phi = self.root * columns
        gram, cross, pull = phi.T @ phi, phi.T @ self.base, phi.T @ self.y
        table = np.empty((MISFITS, SIZES))
        for i, (k2, factor, z, alone) in enumerate(self.of_base):
            inner = gram / k2 - cross @ cho_solve(factor, cross.T) / k2**2
            q = pull / k2 - cross @ z / k2**2
            value, vector = np.linalg.eigh(inner)
            value, along = np.maximum(value, 0.0), vector.T @ q
            s2 = self.sizes[:, None] ** 2
            table[i] = alone + np.sum(0.5 * s2 * along**2 / (1.0 + s2 * value) - 0.5 * np.log1p(s2 * value), axis=1)
            if positive:
                c, share = np.sum(vector, axis=0), 1.0 / (1.0 + s2 * value)
                mean, spread = self.sizes * np.sum(share * c * along, axis=1), np.sqrt(np.sum(share * c**2, axis=1))
                table[i] += math.log(2.0) + log_ndtr(mean / spread)
        i, j = (int(k) for k in np.unravel_index(int(np.argmax(table)), table.shape))
        log = float(logsumexp(table) - math.log(table.size))
        return Evidence(log, float(self.sizes[j]), float(self.misfits[i]))

    def part(self, columns: Array, at: Evidence) -> Array:
        """(samples,) the posterior mean of what the port adds."""
        phi = at.size * self.root * columns
        a = np.vstack([np.hstack([self.base, phi]) / at.misfit, np.eye(self.base.shape[1] + phi.shape[1])])
        y = np.concatenate([self.y / at.misfit, np.zeros(len(a) - len(self.y))])
        w = np.linalg.lstsq(a, y, rcond=None)[0][self.base.shape[1] :]
        return np.asarray(at.size * (columns @ w), dtype=float)
