"""The marginal likelihood of the unexplained residual, for a force of unknown shape at one port.

    y = B z + s Φ w + e,   z, w ~ N(0, 1),   e ~ N(0, C(g))

y is the residual at the nominal machine, B what the base parameters and traces add (each by its tolerance), Φ the
port's columns, scaled so that s is the rms of what they add. C(g) is noise and discrepancy as every fit weighs them
(`ErrorModel`), g the campaign's own size of the discrepancy with its log-normal prior. z and w are integrated out; g
and s, evenly on a logarithmic scale, are averaged over. C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for
Machine Learning, 2006, sections 2.1 and 5.2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import log_ndtr, logsumexp

from workbench.core.run import Array
from workbench.diagnose.hypotheses.model_error import SPREAD, ErrorModel
from workbench.diagnose.location.survey import Survey

SIZES = 8  # of s
SMALLEST = 0.3  # s, of the noise
LARGEST = 2.0  # s, of the residual at the nominal machine
DISCREPANCIES = tuple(2.0**k for k in range(11))  # g
FEWER = 30.0  # of the logarithm: where a step of g is worse by so much, no further one that way is tried


@dataclass(frozen=True)
class Evidence:
    """log: of the marginal likelihood. size, discrepancy: s, N m (N), and g where it is largest."""

    log: float
    size: float
    discrepancy: float


@dataclass(frozen=True, eq=False)
class _Whitened:
    """At one size g of the discrepancy: data and base whitened, and the likelihood of the base alone."""

    size: float
    y: Array
    base: Array
    factor: tuple[Array, bool]
    z: Array
    alone: float


def _with(errors: ErrorModel, size: float) -> ErrorModel:
    """Near standstill the discrepancy is as large beside the rest as the search has left it."""
    return errors.sized((size, errors.sizes[1]))


class Weigher:
    """Marginal likelihoods on one survey."""

    def __init__(self, survey: Survey) -> None:
        self.survey = survey
        gap, nominal = survey.gap_rms, float(np.sqrt(np.mean(survey.residual[: survey.inputs] ** 2)))
        self.sizes = np.geomspace(SMALLEST * survey.noise, max(LARGEST * max(nominal, gap), survey.noise), SIZES)
        self.whitened: list[_Whitened] = []
        for g in DISCREPANCIES:
            self.whitened.append(self._at(g))
            # A port takes something away: it never needs more discrepancy than nothing does.
            if self.whitened[-1].alone < max(w.alone for w in self.whitened) - FEWER:
                break

    def _at(self, g: float) -> _Whitened:
        s = self.survey
        errors = _with(s.errors, g)
        white = errors.whiten(np.column_stack([s.base, s.residual]))
        base, y = white[:, :-1], white[:, -1]
        pull = base.T @ y
        factor = cho_factor(np.eye(len(pull)) + base.T @ base)
        z = cho_solve(factor, pull)
        log = -0.5 * (float(y @ y) - float(pull @ z)) - float(np.sum(np.log(np.diag(factor[0]))))
        log -= 0.5 * errors.log_det() + 0.5 * (math.log(g) / SPREAD) ** 2
        return _Whitened(g, y, base, factor, z, log)

    def nothing(self) -> float:
        """The logarithm of the marginal likelihood of the base parameters alone."""
        return float(logsumexp([w.alone for w in self.whitened]) - math.log(len(self.whitened)))

    def evidence(self, columns: Array, positive: bool = False) -> Evidence:
        """columns: (samples, k) of a port. positive: whether the amounts cannot be negative, all in all."""
        return self.evidences([columns], [positive])[0]

    def evidences(self, columns: Sequence[Array], positive: Sequence[bool]) -> list[Evidence]:
        """As `evidence`, for several ports, which are whitened together.

        From the largest discrepancy down: what a port explains shows as less discrepancy, step by step, so that one
        for which a step is for the worse is followed no further."""
        tables = np.full((len(columns), len(self.whitened), SIZES), -np.inf)
        active = list(range(len(columns)))
        for i in reversed(range(len(self.whitened))):
            w = self.whitened[i]
            ends = np.cumsum([columns[k].shape[1] for k in active])[:-1]
            together = np.hstack([columns[k] for k in active])
            parts = np.split(_with(self.survey.errors, w.size).whiten(together), ends, axis=1)
            for k, phi in zip(active, parts, strict=True):
                tables[k, i] = w.alone + self._gain(w, phi, positive[k])
            active = [k for k in active if np.max(tables[k, i]) > np.max(tables[k]) - FEWER]
            if not active:
                break
        return [self._summed(table) for table in tables]

    def _gain(self, w: _Whitened, phi: Array, positive: bool) -> Array:
        """(SIZES,) what whitened columns add to the logarithm of the likelihood."""
        cross = phi.T @ w.base
        inner = phi.T @ phi - cross @ cho_solve(w.factor, cross.T)
        q = phi.T @ w.y - cross @ w.z
        value, vector = np.linalg.eigh(inner)
        value, along = np.maximum(value, 0.0), vector.T @ q
        s2 = self.sizes[:, None] ** 2
        gain = np.sum(0.5 * s2 * along**2 / (1.0 + s2 * value) - 0.5 * np.log1p(s2 * value), axis=1)
        if positive:
            c, share = np.sum(vector, axis=0), 1.0 / (1.0 + s2 * value)
            mean, spread = self.sizes * np.sum(share * c * along, axis=1), np.sqrt(np.sum(share * c**2, axis=1))
            gain += math.log(2.0) + log_ndtr(mean / spread)
        return np.asarray(gain, dtype=float)

    def _summed(self, table: Array) -> Evidence:
        i, j = (int(k) for k in np.unravel_index(int(np.argmax(table)), table.shape))
        log = float(logsumexp(table) - math.log(table.size))
        return Evidence(log, float(self.sizes[j]), self.whitened[i].size)

    def part(self, columns: Array, at: Evidence) -> Array:
        """(samples,) the posterior mean of the port's contribution."""
        w = next(w for w in self.whitened if w.size == at.discrepancy)
        phi = at.size * _with(self.survey.errors, at.discrepancy).whiten(columns)
        a = np.hstack([w.base, phi])
        amounts = np.linalg.solve(a.T @ a + np.eye(a.shape[1]), a.T @ w.y)[w.base.shape[1] :]
        return np.asarray(at.size * (columns @ amounts), dtype=float)
