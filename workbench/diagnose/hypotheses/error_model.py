"""What a residual may hold although its hypothesis is right: measurement noise, and the model's own discrepancy.

    r_i = d_i x_i + s_i e_i,    x_i = rho_i x_(i-1) + sqrt(1 - rho_i^2) w_i,    e_i, w_i independent, N(0, 1)

s_i is the noise of a row, taken as independent. d_i is the discrepancy: no lumped model of a large machine is exact,
and what it misses grows with the torque, with the torque that accelerates, and near standstill; it hangs together over
a correlation time T: rho_i = exp(-(t_i - t_(i-1)) / T), 0 at the beginning of a run (M. Kennedy, A. O'Hagan, Bayesian
Calibration of Computer Models, Journal of the Royal Statistical Society B 63, 2001; the process is Ornstein's and
Uhlenbeck's). Its innovations are independent, and the Kalman filter of the one state x gives them: `whiten` divides
each by its standard deviation, so that sums of squares of what it returns are generalised least squares.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from workbench.run import Array


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """white, discrepancy: (n,) standard deviations, in the unit of the residual. carry: (n,) rho_i, 0 at the
    beginning of each run; rows are in the order of time within a run."""

    white: Array
    discrepancy: Array
    carry: Array
    _gains: dict[float, _Gains] = field(default_factory=dict, repr=False, init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_gains", {})

    def beside(self, more: Array) -> ErrorModel:
        """With further discrepancy, (n,), independent of the one that is there."""
        return replace(self, discrepancy=np.hypot(self.discrepancy, more))

    def whiten(self, rows: Array, scale: float = 1.0) -> Array:
        """(n,) or (n, k) -> the same shape: independent values of variance 1 where the error model holds.

        scale: of the discrepancy.
        """
        gains = self._at(scale)
        columns = np.asarray(rows, dtype=float).reshape(len(self.white), -1)
        lanes, steps = gains.lanes, gains.rows.shape[0]
        padded = np.concatenate([columns, np.zeros((1, columns.shape[1]))])
        out = np.zeros_like(padded)
        state = np.zeros((lanes, columns.shape[1]))
        for i in range(steps):
            at = gains.rows[i]
            state *= gains.carry[i]
            innovation = padded[at]
            innovation -= gains.discrepancy[i] * state
            out[at] = innovation * gains.weight[i]
            innovation *= gains.gain[i]
            state += innovation
        return out[:-1].reshape(np.shape(rows))

    def log_det(self, scale: float = 1.0) -> float:
        """ln det of the covariance of all rows."""
        return self._at(scale).log_det

    def _at(self, scale: float) -> _Gains:
        if scale not in self._gains:
            self._gains[scale] = _gains_of(self.white, scale * self.discrepancy, self.carry)
        return self._gains[scale]


@dataclass(frozen=True, eq=False)
class _Gains:
    """The filter's numbers for all runs side by side, (steps, lanes, 1); rows: (steps, lanes), the last row is none."""

    rows: np.ndarray
    carry: Array
    discrepancy: Array
    gain: Array
    weight: Array
    log_det: float

    @property
    def lanes(self) -> int:
        return int(self.rows.shape[1])


def _gains_of(white: Array, discrepancy: Array, carry: Array) -> _Gains:
    rows = _lanes_of(carry.tobytes())
    none = len(carry)
    s2 = np.append(white**2, 1.0)[rows]
    d = np.append(discrepancy, 0.0)[rows]
    rho = np.append(carry, 0.0)[rows]
    gain, weight = np.zeros_like(d), np.zeros_like(d)
    variance = np.zeros(rows.shape[1])
    total = 0.0
    for i in range(len(rows)):
        ahead = rho[i] ** 2 * variance + 1.0 - rho[i] ** 2
        innovation = d[i] ** 2 * ahead + s2[i]
        gain[i] = d[i] * ahead / innovation
        weight[i] = 1.0 / np.sqrt(innovation)
        variance = (1.0 - gain[i] * d[i]) * ahead
        total += float(np.sum(np.log(innovation[rows[i] != none])))
    return _Gains(rows, rho[..., None], d[..., None], gain[..., None], weight[..., None], total)


@lru_cache(maxsize=8)
def _lanes_of(carry: bytes) -> np.ndarray:
    """(longest run, runs): the row of each run's step; n where a run is over."""
    rho = np.frombuffer(carry)
    begins = np.flatnonzero(rho == 0.0)
    ends = np.append(begins[1:], len(rho))
    longest = int(np.max(ends - begins, initial=1))
    rows = np.full((longest, max(len(begins), 1)), len(rho))
    for lane, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        rows[: end - begin, lane] = np.arange(begin, end)
    return rows
