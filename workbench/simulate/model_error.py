"""The error of a residual under a correct hypothesis: measurement noise and the model's own error.

    r_i = d_i x_i + s_i e_i,    x_i = rho_i x_(i-1) + sqrt(1 - rho_i^2) w_i,    e_i, w_i independent, N(0, 1)

s_i is the noise of a row, taken as independent. d_i is the model error: no lumped model of a large machine is exact,
and its error grows with the torque, with the accelerating torque, and near standstill. It is correlated over a time T:
rho_i = exp(-(t_i - t_(i-1)) / T), 0 at the beginning of a run (M. Kennedy, A. O'Hagan, Bayesian Calibration of
Computer Models, Journal of the Royal Statistical Society B 63, 2001; the process is Ornstein's and Uhlenbeck's). Its
innovations are independent, and the Kalman filter of the one state x gives them: `whiten` divides each by its standard
deviation, so that sums of squares of what it returns are generalised least squares.

The kind of machine has the default sizes: round numbers, set on simulated machines without a gap and larger than sensor
noise would hide. A campaign's own sizes are estimated beside them, as factors with log-normal priors (`SPREAD`): of
the whole, and of the part near standstill, where no law of friction is exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg.lapack import dtbtrs

from workbench.core.run import Array
from workbench.machines import kind_of
from workbench.simulate.driven import InverseSimulation

SPREAD = 0.7  # standard deviation of the logarithm of a campaign's own size over the default
STEP = 2.0  # of both sizes, from one tried to the next
BOUNDS = ((0.5, 1024.0), (1.0, 16.0))
LEAST_LEVEL = 0.02  # of the largest input: a friction level, for a machine.yaml may know of none

Sizes = tuple[float, float]
Bounds = tuple[Sizes, Sizes]  # of the one size and of the other
ANY: Bounds = ((0.0, math.inf), (0.0, math.inf))


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """white, moving, standstill: (n,) standard deviations, in the unit of the residual: of the noise, and of the two
    parts of the model error at their default sizes. carry: (n,) rho_i, 0 at the beginning of each run; rows are in the
    order of time within a run. sizes: of the model error as a whole, and of its part near standstill beside it."""

    white: Array
    moving: Array
    standstill: Array
    carry: Array
    sizes: Sizes = (1.0, 1.0)
    _gains: dict[Sizes, _Gains] = field(default_factory=dict, repr=False, init=False)

    @property
    def model_error(self) -> Array:
        """(n,) d_i."""
        return self.sizes[0] * np.hypot(self.moving, self.sizes[1] * self.standstill)

    @property
    def std(self) -> Array:
        """(n,) of a row, of noise and model error."""
        return np.hypot(self.white, self.model_error)

    @property
    def at_speed(self) -> Array:
        """(n,) Of each row's model error (its square), the share that is not that near standstill."""
        moving = self.moving**2
        return moving / np.maximum(moving + (self.sizes[1] * self.standstill) ** 2, 1e-300)

    def sized(self, sizes: Sizes) -> ErrorModel:
        """With other sizes of its model error."""
        other = replace(self, sizes=sizes)
        object.__setattr__(other, "_gains", self._gains)  # kept by size: what was computed once serves all
        return other

    def likeliest(self, residual: Array, step: float = STEP, bounds: Bounds = BOUNDS) -> tuple[float, Sizes]:
        """The score of a residual, |whitened|^2 + ln det + the priors of the sizes, and the sizes at which it is least,
        to a factor of `step`."""
        tried: dict[Sizes, float] = {}

        def value(sizes: Sizes) -> float:
            if sizes not in tried:
                errors = self.sized(sizes)
                white, unlikely = errors.whiten(residual), sum((math.log(size) / SPREAD) ** 2 for size in sizes)
                tried[sizes] = float(white @ white) + errors.log_det() + unlikely
            return tried[sizes]

        best = self.sizes
        while True:
            g, h = best
            around = [(g * step, h), (g / step, h), (g, h * step), (g, h / step)]
            (least_g, most_g), (least_h, most_h) = bounds
            inside = [(g, h) for g, h in around if least_g <= g <= most_g and least_h <= h <= most_h]
            better = min(inside, key=value, default=best)  # what a first search needed may lie beyond the bounds
            if value(better) >= value(best):
                return value(best), best
            best = better

    def whiten(self, rows: Array) -> Array:
        """(n,) or (n, k) -> the same shape: independent values of variance 1 where the error model holds."""
        if not np.size(rows):
            return np.zeros(np.shape(rows))  # LAPACK's solver writes beyond an array without columns
        gains = self._numbers()
        columns = np.asfortranarray(rows, dtype=float).reshape(len(self.white), -1, order="F")
        # The state before each row, m_i = along_i m_(i-1) + into_i r_(i-1): a matrix of two diagonals.
        state = np.empty_like(columns)
        state[0] = 0.0
        np.multiply(gains.into[1:, None], columns[:-1], out=state[1:])
        state, _ = dtbtrs(gains.diagonals, state, uplo="L", diag="U", overwrite_b=1)
        state *= gains.size[:, None]
        np.subtract(columns, state, out=state)
        state *= gains.weight[:, None]
        return np.ascontiguousarray(state).reshape(np.shape(rows))

    def log_det(self) -> float:
        """ln det of the covariance of all rows."""
        return self._numbers().log_det

    def _numbers(self) -> _Gains:
        if self.sizes not in self._gains:
            self._gains[self.sizes] = _gains_of(self.white, self.model_error, self.carry)
        return self._gains[self.sizes]


@dataclass(frozen=True, eq=False)
class _Gains:
    """The filter's numbers. diagonals: (2, n) of LAPACK's band storage, 1 and -along of the next row; into: (n,) what
    of the row before enters the state; size, weight: (n,)."""

    diagonals: Array
    into: Array
    size: Array
    weight: Array
    log_det: float


def _gains_of(white: Array, size: Array, carry: Array) -> _Gains:
    s2, d, rho = white**2, size, carry
    if not np.any(rho):
        none = np.zeros_like(d)
        return _Gains(
            np.vstack([none + 1.0, none]), none, d, 1.0 / np.hypot(white, d), float(np.sum(np.log(s2 + d**2)))
        )
    gain, innovation = np.zeros_like(d), np.zeros_like(d)
    variance = 0.0
    for i, (noise, own, kept) in enumerate(zip(s2.tolist(), d.tolist(), rho.tolist(), strict=True)):
        ahead = kept * kept * variance + 1.0 - kept * kept
        innovation[i] = own * own * ahead + noise
        gain[i] = own * ahead / innovation[i]
        variance = (1.0 - gain[i] * own) * ahead
    into = np.zeros_like(d)
    into[1:] = rho[1:] * gain[:-1]
    along = np.zeros_like(d)
    along[1:] = rho[1:] * (1.0 - gain[:-1] * d[:-1])
    diagonals = np.vstack([np.ones_like(d), np.append(-along[1:], 0.0)])
    return _Gains(diagonals, into, d, 1.0 / np.sqrt(innovation), float(np.sum(np.log(innovation))))


def model_error_of(bench: InverseSimulation, rows: list[np.ndarray]) -> tuple[Array, Array]:
    """(all rows,) each, of the input, in its unit: at any speed, and near standstill."""
    kind = kind_of(bench.machine)
    share = kind.model_error
    friction = friction_level(bench)
    largest = max(float(np.max(np.abs(u))) for u in bench.measured)
    moving, standstill = [], []
    for run, speed, measured, at in zip(bench.runs, bench.speeds, bench.measured, rows, strict=True):
        inertia = kind.rigid(bench.machine, run.payload_kg).inertia
        load = share.load * (np.full(len(speed), largest) if share.of_largest else np.abs(measured))
        accelerating = share.inertia * inertia * np.gradient(speed, run.time_s)
        moving.append(np.hypot(load, accelerating)[at])
        standstill.append((share.standstill * friction * np.exp(-np.abs(speed) / (share.slow * bench.scale)))[at])
    return np.concatenate(moving), np.concatenate(standstill)


def friction_level(bench: InverseSimulation) -> float:
    """Coulomb friction at the driven coordinate, both ways on average, in the input's unit."""
    kind = kind_of(bench.machine)
    levels = [float(getattr(bench.base[0], symbol)) for symbol in kind.friction.levels]
    level = float(np.mean(levels)) * kind.transmission_of(bench.machine)
    return max(level, LEAST_LEVEL * max(float(np.max(np.abs(u))) for u in bench.measured))


def carries(bench: InverseSimulation, rows: list[np.ndarray]) -> Array:
    """(all rows,): the correlation of each row's model error with that of the row before it in its run."""
    parts = []
    for run, at in zip(bench.runs, rows, strict=True):
        apart = np.diff(run.time_s[at], prepend=-math.inf)
        parts.append(np.exp(-apart / kind_of(bench.machine).model_error.time_s) if len(at) else apart)
    return np.concatenate(parts)


def error_model(
    bench: InverseSimulation,
    rows: list[np.ndarray],
    row_noise: Array,
    share: float,
    noise: float,
    pulled: np.ndarray,
    tension: float | None,
) -> ErrorModel:
    """row_noise: (rows of the input,), rms in the band. share: how many independent values one row stands for.

    tension: None, or the model error of the dead line's tension in the unit of its rows, which follow the input's;
    pulled: of each one, the input's row beside it; noise: that of these rows.
    """
    white = row_noise
    moving, standstill = model_error_of(bench, rows)
    rho = carries(bench, rows)
    if tension is not None:
        moving = np.append(moving, np.full(len(pulled), tension))
        standstill = np.append(standstill, np.zeros(len(pulled)))
        white = np.append(white, np.full(len(pulled), noise))
        rho = np.append(rho, rho[pulled])
    return ErrorModel(white / math.sqrt(share), moving, standstill, rho)
