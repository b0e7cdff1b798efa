"""A cycle's parameters with standard errors, from its torque balance; and when a series of them leaves its baseline.

The test is a window-limited generalised likelihood ratio.

Estimates x (m,) of healthy cycles are taken as independent normal; their mean, a straight line over the stated payload,
and their covariance are learned from the first N of them, and anew from 2 N and 4 N while nothing has alarmed. A
payload is never quite what is stated, and the more so the heavier it is: along the direction of a load the deviation is
taken relative to sqrt(v + c payload²), with v and c from the same cycles. With the deviations z whitened by the learned
covariance, the statistic after cycle k is

    g = max over n of  n / (1 + n/N) |mean of the last n z|² / 2,      n = 1, 2, 4, ... WINDOW

the logarithm of the likelihood ratio of a shift of unknown size and direction n cycles ago; n/N is the mean's own
error. It alarms where g exceeds h, and begins anew behind the alarm. M. Basseville, I. V. Nikiforov, Detection of
Abrupt Changes, Prentice Hall 1993, sections 2.4 and 7.2; the window: T. L. Lai, J. R. Statist. Soc. B 57 (1995).

h is found by simulating the whole procedure, learning included, for a stated number of cycles between false alarms: a
baseline of few cycles alarms more often than one that is known (W. A. Jensen et al., J. Quality Technology 38, 2006).
By the affine invariance of z, h depends on m, N and the rate only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Annotated

import numpy as np
from pydantic import Field, PlainSerializer, PlainValidator

from workbench.core.run import Array, Run
from workbench.identify.fit import STEP, fit
from workbench.identify.model import BalanceModel, Free, free_parameters
from workbench.machines import Machine, kind_of
from workbench.simulate.driven import InverseSimulation


def _numbers(value: object) -> Array:
    made: Array = np.asarray(value, dtype=float)
    if not np.all(np.abs(made) < LARGEST):
        raise ValueError("holds what is no number")
    return made


LARGEST = 1e100  # of what a state holds; no product of two overflows
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST, strict=True, allow_inf_nan=False)]
Numbers = Annotated[Array, PlainValidator(_numbers), PlainSerializer(lambda values: values.tolist())]


@dataclass(frozen=True)
class Estimate:
    """keys: of machine.yaml; values, errors: (m,), each in its key's unit, held by the machine's tolerances.

    resolution: (m, m); column j is what a true change of parameter j by one does to the estimates, in their units. A
    parameter that the cycle hardly shows moves others with it, or nothing. residual_rms, noise_rms: of the balance of
    the machine as identified, and of the sensor.
    """

    keys: tuple[str, ...]
    values: Numbers
    errors: Numbers
    resolution: Numbers
    residual_rms: Number
    noise_rms: Number


def watched_keys(machine: Machine) -> tuple[str, ...]:
    """What is estimated of each cycle: of three values that a cycle shows as two sums (`Kind.ties`), two."""
    kind = kind_of(machine)
    thirds = {third for _, third in kind.ties}
    return kind.watched or tuple(key for key in kind.free if key not in thirds)


def estimate(machine: Machine, run: Run) -> Estimate:
    """Least squares of one run's torque balance over its noise, and over the tolerances; see `identify.fit`.

    InputError where the machine hardly moves in the run.
    """
    keys = watched_keys(machine)
    model = BalanceModel(InverseSimulation(machine, [run]))
    free = free_parameters(machine, [run], keys)
    result = fit(model, free)
    sigma = max(result.noise_rms, result.residual_rms)
    _, out = _around_nominal(model, free)
    jacobian = (out[1:] - out[0]).T / STEP
    in_z = _inverse(jacobian, free, sigma) @ (jacobian.T @ jacobian / sigma**2)
    unit = _units(free)
    value, std_error, covariance = np.array(result.value), np.array(result.std_error), unit[:, None] * in_z / unit
    return Estimate(keys, value, std_error, covariance, result.residual_rms_before, result.noise_rms)


def shift(machine: Machine, run: Run, other: Machine, keys: Sequence[str]) -> Array:
    """(m,) by how much the estimates of a run move where it is `other` that made the log, in the keys' units.

    Linear around the nominal values, the noise the sensor's. other: the machine with effects.
    """
    model, changed = BalanceModel(InverseSimulation(machine, [run])), BalanceModel(InverseSimulation(other, [run]))
    changed.rows = model.rows
    free = free_parameters(machine, [run], keys)
    zero, out = _around_nominal(model, free)
    jacobian = (out[1:] - out[0]).T / STEP
    # What the other machine's torque is beyond this one's: residuals are measured less predicted.
    beyond = out[0] - changed.residuals(free, [zero])[0]
    sigma = max(model.noise, 1e-300)
    return np.asarray(-_units(free) * (_inverse(jacobian, free, sigma) @ (jacobian.T @ beyond)) / sigma**2)


def _around_nominal(model: BalanceModel, free: Sequence[Free]) -> tuple[Array, Array]:
    """z of the nominal values, and the residuals (1 + m, samples) there and a step along each."""
    zero = np.maximum(np.zeros(len(free)), [f.lowest_z for f in free])
    return zero, model.residuals(free, [zero, *(zero + STEP * row for row in np.eye(len(free)))])


def _inverse(jacobian: Array, free: Sequence[Free], sigma: float) -> Array:
    """(m, m) covariance of z under the noise and the tolerances."""
    prior = np.diag([0.0 if f.prior_std is None else f.prior_std**-2 for f in free])
    return np.asarray(np.linalg.pinv(jacobian.T @ jacobian / sigma**2 + prior, rcond=1e-14))


def _units(free: Sequence[Free]) -> Array:
    """(m,) of a value per z."""
    return np.array([f.scale * (f.nominal if f.logarithmic else 1.0) for f in free])


# When a series of estimates leaves its baseline

WINDOW = 64
LENGTHS = tuple(2**i for i in range(WINDOW.bit_length()))
HEALTHY = 100  # cycles of the first baseline
GROWTH = (1, 2, 4)  # times as many, at which it is learned anew while nothing has alarmed
PATHS, CYCLES, ROUNDS = 300, 1000, 12  # simulated machines, cycles of each, halvings of the search


@dataclass(frozen=True)
class Baseline:
    """keys: of what is estimated. line: (1 or 2, m), the mean at payload 0 and its slope per kg. count: of cycles.

    whiten: (r, m), so that whiten @ deviation has unit covariance. load, weigh: (m,), the direction of a load and what
    measures its amount. spread: (v, c) of that amount's variance v + c payload²; spread_mean: its mean over the
    baseline. covariance: (m, m), of the deviations.
    """

    line: Array
    whiten: Array
    count: int
    load: Array
    weigh: Array
    spread: tuple[float, float]
    spread_mean: float
    covariance: Array
    keys: tuple[str, ...] = ()

    def deviation(self, x: Array, payload_kg: float | Array) -> Array:
        """(…, m) of estimates from the healthy mean at their payload (…)."""
        return np.asarray(
            x - np.stack([np.ones_like(payload_kg), payload_kg], axis=-1)[..., : len(self.line)] @ self.line
        )

    def z(self, deviation: Array, payload_kg: float | Array) -> Array:
        """(…, r) whitened."""
        if self.spread_mean > 0.0:
            variance = self.spread[0] + self.spread[1] * np.square(payload_kg)
            too_much = (deviation @ self.weigh) * (1.0 - np.sqrt(self.spread_mean / variance))
            deviation = deviation - np.multiply.outer(too_much, self.load)
        return np.asarray(deviation @ self.whiten.T)


SPREAD_KG = 10.0  # stated payloads that differ by less are one


def learn(healthy: Array, payloads_kg: Array | None, load: Array | None, keys: Sequence[str] = ()) -> Baseline:
    """healthy: (n, m) estimates; payloads_kg: (n,); load: (m,), what a load does to the estimates, None for none.

    Directions in which the estimates do not vary at all are left out.
    """
    n, m = healthy.shape
    payloads = np.zeros(n) if payloads_kg is None else np.asarray(payloads_kg, dtype=float)
    varied = float(np.std(payloads)) > SPREAD_KG
    design = np.column_stack([np.ones(n), payloads]) if varied else np.ones((n, 1))
    line: Array = np.asarray(np.linalg.lstsq(design, healthy, rcond=None)[0], dtype=float)
    off = healthy - design @ line
    free = n - design.shape[1]
    weigh, spread, mean = np.zeros(m), (0.0, 0.0), 0.0
    if varied and load is not None and np.any(load):
        inverse = np.linalg.pinv(off.T @ off / free, rcond=1e-12, hermitian=True)
        weigh = inverse @ load / float(load @ inverse @ load)
        amounts = off @ weigh
        spread = _spread(amounts**2, payloads**2)
        variance = spread[0] + spread[1] * payloads**2
        mean = float(np.mean(variance))
        off = off - np.outer(amounts * (1.0 - np.sqrt(mean / variance)), load)
    no_load = np.zeros(m) if load is None else load
    covariance = off.T @ off / free
    return Baseline(line, _whitening(off, free), n, no_load, weigh, spread, mean, covariance, tuple(keys))


def _spread(squares: Array, payloads2: Array) -> tuple[float, float]:
    """(v, c) of variances v + c payload², neither negative, v at least a hundredth of all."""
    from scipy.optimize import nnls

    scale = float(payloads2.max())
    least = 0.01 * float(np.mean(squares))
    (v, c), _ = nnls(np.column_stack([np.ones(len(squares)), payloads2 / scale]), squares)
    return max(float(v), least), float(c) / scale


def _whitening(off: Array, free: int) -> Array:
    size = np.maximum(np.sqrt(np.sum(off**2, axis=0) / free), 1e-300)
    scaled = off / size
    values, vectors = np.linalg.eigh(scaled.T @ scaled / free)
    keep = values > 1e-8 * values.max()
    return np.asarray((vectors[:, keep] / np.sqrt(values[keep])).T / size)


@cache
def threshold(dimension: int, healthy: int, cycles_between: float, varied: bool = False) -> float:
    """h for which simulated healthy machines alarm once in `cycles_between` cycles on average; varied: payloads do."""
    rng = np.random.default_rng(0)
    n, m = healthy, dimension
    x = rng.normal(size=(PATHS, n + CYCLES, m))
    carried = rng.uniform(0.0, 10_000.0, size=(PATHS, n + CYCLES)) * (1.0 if varied else 0.0)
    load = np.eye(m)[0] if varied else None
    ends = [*(n * times for times in GROWTH[1:] if times * n < n + CYCLES), n + CYCLES]
    counts = [n * times for times in GROWTH[: len(ends)]]
    # g for every cycle and length, before any alarm has shortened what is looked back on.
    ratio = np.full((len(LENGTHS), PATHS, CYCLES), -1.0, dtype=np.float32)
    for count, end in zip(counts, ends, strict=True):
        learned = [learn(x[p, :count], carried[p, :count], load) for p in range(PATHS)]
        z = np.array([b.z(b.deviation(x[p], carried[p]), carried[p]) for p, b in enumerate(learned)])
        sums = np.concatenate([np.zeros((PATHS, 1, z.shape[2])), np.cumsum(z[:, count:end], axis=1)], axis=1)
        for i, length in enumerate(LENGTHS):
            if length < sums.shape[1]:
                square = np.sum((sums[:, length:] - sums[:, :-length]) ** 2, axis=2)
                ratio[i, :, count - n + length - 1 : end - n] = 0.5 * square / length / (1.0 + length / count)

    def alarms(h: float) -> int:
        began = np.zeros(PATHS, dtype=int)
        total = 0
        for k in range(CYCLES):
            over = np.zeros(PATHS, dtype=bool)
            for i, length in enumerate(LENGTHS):
                over |= (ratio[i, :, k] > h) & (k + 1 - began >= length)
            total += int(over.sum())
            began[over] = k + 1
        return total

    low, high = 0.0, 60.0 + 10.0 * m
    wanted = PATHS * CYCLES / cycles_between
    for _ in range(ROUNDS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if alarms(middle) > wanted else (low, middle)
    return 0.5 * (low + high)
