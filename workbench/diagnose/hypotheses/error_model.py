"""The error model of a residual under a correct hypothesis: measurement noise and the model's discrepancy.

    r_i = d_i x_i + s_i e_i,    x_i = rho_i x_(i-1) + sqrt(1 - rho_i^2) w_i,    e_i, w_i independent, N(0, 1)

s_i is the noise of a row, taken as independent. d_i is the discrepancy: no lumped model of a large machine is exact,
and its error grows with the torque, with the accelerating torque, and near standstill. It is correlated over a time T:
rho_i = exp(-(t_i - t_(i-1)) / T), 0 at the beginning of a run (M. Kennedy, A. O'Hagan, Bayesian Calibration of
Computer Models, Journal of the Royal Statistical Society B 63, 2001; the process is Ornstein's and Uhlenbeck's). Its
innovations are independent, and the Kalman filter of the one state x gives them: `whiten` divides each by its standard
deviation, so that sums of squares of what it returns are generalised least squares.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg.lapack import dtbtrs

from workbench.core.run import Array

Sizes = tuple[float, float]


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """white, moving, standstill: (n,) standard deviations, in the unit of the residual: of the noise, and of the two
    parts of the discrepancy at their default sizes. carry: (n,) rho_i, 0 at the beginning of each run; rows are in the
    order of time within a run. sizes: of the discrepancy as a whole, and of its part near standstill beside it."""

    white: Array
    moving: Array
    standstill: Array
    carry: Array
    sizes: Sizes = (1.0, 1.0)
    _gains: dict[Sizes, _Gains] = field(default_factory=dict, repr=False, init=False)

    @property
    def discrepancy(self) -> Array:
        """(n,) d_i."""
        return self.sizes[0] * np.hypot(self.moving, self.sizes[1] * self.standstill)

    @property
    def at_speed(self) -> Array:
        """(n,) Of each row's discrepancy (its square), the share that is not that near standstill."""
        moving = self.moving**2
        return moving / np.maximum(moving + (self.sizes[1] * self.standstill) ** 2, 1e-300)

    def sized(self, sizes: Sizes) -> ErrorModel:
        """With other sizes of its discrepancy."""
        other = replace(self, sizes=sizes)
        object.__setattr__(other, "_gains", self._gains)  # kept by size: what was computed once serves all
        return other

    def whiten(self, rows: Array) -> Array:
        """(n,) or (n, k) -> the same shape: independent values of variance 1 where the error model holds."""
        gains = self._numbers()
        columns = np.array(rows, dtype=float, order="F").reshape(len(self.white), -1, order="F")
        # The state before each row, m_i = along_i m_(i-1) + into_i r_(i-1): a matrix of two diagonals.
        driving = np.zeros_like(columns)
        np.multiply(gains.into[1:, None], columns[:-1], out=driving[1:])
        state, _ = dtbtrs(gains.diagonals, driving, uplo="L", diag="U", overwrite_b=1)
        return np.ascontiguousarray((columns - gains.discrepancy[:, None] * state) * gains.weight[:, None]).reshape(
            np.shape(rows)
        )

    def log_det(self) -> float:
        """ln det of the covariance of all rows."""
        return self._numbers().log_det

    def _numbers(self) -> _Gains:
        if self.sizes not in self._gains:
            self._gains[self.sizes] = _gains_of(self.white, self.discrepancy, self.carry)
        return self._gains[self.sizes]


@dataclass(frozen=True, eq=False)
class _Gains:
    """The filter's numbers. diagonals: (2, n) of LAPACK's band storage, 1 and -along of the next row; into: (n,) what
    of the row before enters the state; discrepancy, weight: (n,)."""

    diagonals: Array
    into: Array
    discrepancy: Array
    weight: Array
    log_det: float


def _gains_of(white: Array, discrepancy: Array, carry: Array) -> _Gains:
    s2, d, rho = white**2, discrepancy, carry
    gain, innovation = np.zeros_like(d), np.zeros_like(d)
    variance = 0.0
    for i, (noise, size, kept) in enumerate(zip(s2.tolist(), d.tolist(), rho.tolist(), strict=True)):
        ahead = kept * kept * variance + 1.0 - kept * kept
        innovation[i] = size * size * ahead + noise
        gain[i] = size * ahead / innovation[i]
        variance = (1.0 - gain[i] * size) * ahead
    into = np.zeros_like(d)
    into[1:] = rho[1:] * gain[:-1]
    along = np.zeros_like(d)
    along[1:] = rho[1:] * (1.0 - gain[:-1] * d[:-1])
    diagonals = np.vstack([np.ones_like(d), np.append(-along[1:], 0.0)])
    return _Gains(diagonals, into, d, 1.0 / np.sqrt(innovation), float(np.sum(np.log(innovation))))
