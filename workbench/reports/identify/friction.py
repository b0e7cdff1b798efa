"""The friction law of a machine, and the friction that a log shows."""

from __future__ import annotations

import numpy as np

from workbench.core.run import Array
from workbench.identify.iteration import friction_speed
from workbench.machines import Axis, Hoist, kind_of, plant_of
from workbench.simulate.driven import sensor
from workbench.simulate.lowpass import lowpass
from workbench.simulate.replay import ReplayResult


def law(machine: Hoist | Axis, speed: Array) -> Array:
    """Friction (N, N m) at speeds (m/s, rad/s): the guide's on a hoist, Coulomb and viscous on an axis."""
    p = plant_of(machine).values(machine)
    return np.asarray(kind_of(machine).friction.law(speed, p), dtype=float)


def force_balance(machine: Hoist | Axis, result: ReplayResult) -> tuple[Array, Array]:
    """Speed and friction force at the moving samples of all runs: the law plus the residual of the balance.

    On a hoist the residual torque is converted to a force at the carriage through gearbox, drum and the two falls.
    """
    gain, _ = sensor(machine)
    kind = kind_of(machine)
    lever = kind.lever_of(machine)
    speeds, forces = [], []
    for run in result.runs:
        balance = run.balance
        speed = friction_speed(kind, balance)
        both = np.column_stack([speed, law(machine, speed)])
        smooth = lowpass(balance.run.time_s, both, balance.band_hz)[balance.moving]
        speeds.append(smooth[:, 0])
        forces.append(smooth[:, 1] + balance.residual[balance.moving] / gain / lever)
    return np.concatenate(speeds), np.concatenate(forces)


def combined_weight(machine: Hoist | Axis, result: ReplayResult) -> float | None:
    """The weight of carriage and payload, mean over the runs, by which the paper's Fig. 7 divides; None for an axis."""
    kind = kind_of(machine)
    if kind.weight is None:
        return None
    return kind.weight(machine, float(np.mean([run.balance.run.payload_kg for run in result.runs])))
