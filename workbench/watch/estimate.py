"""A cycle's parameters with standard errors, from its torque balance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array, Run
from workbench.identify.fit import STEP, fit
from workbench.identify.model import BalanceModel, Free, free_parameters
from workbench.machines import Axis, Hoist, kind_of
from workbench.simulate.driven import InverseSimulation


@dataclass(frozen=True)
class Estimate:
    """keys: of machine.yaml; values, errors: (m,), each in its key's unit, held by the machine's tolerances.

    resolution: (m, m); column j is what a true change of parameter j by one does to the estimates, in their units. A
    parameter that the cycle hardly shows moves others with it, or nothing. residual_rms, noise_rms: of the balance of
    the machine as identified, and of the sensor.
    """

    keys: tuple[str, ...]
    values: Array
    errors: Array
    resolution: Array
    residual_rms: float
    noise_rms: float


def watched_keys(machine: Hoist | Axis) -> tuple[str, ...]:
    """What is estimated of each cycle: of three values that a cycle shows as two sums (`Kind.ties`), two."""
    kind = kind_of(machine)
    thirds = {third for _, third in kind.ties}
    return kind.watched or tuple(key for key in kind.free if key not in thirds)


def estimate(machine: Hoist | Axis, run: Run, keys: Sequence[str] | None = None) -> Estimate:
    """Least squares of one run's torque balance over its noise, and over the tolerances; see `identify.fit`.

    InputError where the machine hardly moves in the run.
    """
    keys = watched_keys(machine) if keys is None else tuple(keys)
    model = BalanceModel(InverseSimulation(machine, [run]))
    free = free_parameters(machine, [run], keys)
    result = fit(model, free)
    sigma = max(result.noise_rms, result.residual_rms)
    _, out = _around_nominal(model, free)
    jacobian = (out[1:] - out[0]).T / STEP
    in_z = _inverse(jacobian, free, sigma) @ (jacobian.T @ jacobian / sigma**2)
    unit = _units(free)
    return Estimate(
        keys,
        np.array(result.value),
        np.array(result.std_error),
        unit[:, None] * in_z / unit[None, :],
        result.residual_rms_before,
        result.noise_rms,
    )


def shift(machine: Hoist | Axis, run: Run, other: Hoist | Axis, keys: Sequence[str]) -> Array:
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
