"""A cycle's parameters with standard errors, from its torque balance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.identify.fit import STEP, fit
from workbench.identify.models import BalanceModel
from workbench.identify.parameters import free_parameters
from workbench.kinds import kind_of
from workbench.machine import Axis, Hoist
from workbench.run import Array, Run
from workbench.simulate.driven import Bench


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
    """What is estimated of each cycle."""
    kind = kind_of(machine)
    return kind.watched or kind.free


def estimate(machine: Hoist | Axis, run: Run, keys: Sequence[str] | None = None) -> Estimate:
    """Least squares of one run's torque balance over its noise, and over the tolerances; see `identify.fit`.

    InputError where the machine hardly moves in the run.
    """
    keys = watched_keys(machine) if keys is None else tuple(keys)
    model = BalanceModel(Bench(machine, [run]))
    free = free_parameters(machine, [run], keys)
    result = fit(model, free)
    m = len(free)
    zero = np.maximum(np.zeros(m), [f.lowest_z for f in free])
    out = model.residuals(free, [zero, *(zero + STEP * row for row in np.eye(m))])
    jacobian = (out[1:] - out[0]).T / STEP
    sigma = max(result.noise_rms, result.residual_rms)
    normal = jacobian.T @ jacobian / sigma**2
    prior = np.diag([0.0 if f.prior_std is None else f.prior_std**-2 for f in free])
    in_z = np.linalg.pinv(normal + prior, rcond=1e-14) @ normal
    unit = np.array([f.scale * (f.nominal if f.logarithmic else 1.0) for f in free])
    return Estimate(
        keys,
        np.array(result.value),
        np.array(result.std_error),
        unit[:, None] * in_z / unit[None, :],
        result.residual_rms_before,
        result.noise_rms,
    )
