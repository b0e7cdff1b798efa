"""The friction law of a machine, and the friction that a log shows."""

from __future__ import annotations

import numpy as np

from workbench.machine import Axis, Hoist
from workbench.plants import plant_of
from workbench.plants.axis import friction as axis_friction
from workbench.plants.hoist import guide_friction
from workbench.run import Array
from workbench.simulate.driven import sensor
from workbench.simulate.lowpass import lowpass
from workbench.simulate.replay import ReplayResult


def law(machine: Hoist | Axis, speed: Array) -> Array:
    """Friction (N, N m) at speeds (m/s, rad/s): the guide's on a hoist, Coulomb and viscous on an axis."""
    p = plant_of(machine).values(machine)
    force = guide_friction(speed, p) if isinstance(machine, Hoist) else axis_friction(speed, p)
    return np.asarray(force, dtype=float)


def force_balance(machine: Hoist | Axis, result: ReplayResult) -> tuple[Array, Array]:
    """Speed and friction force at the moving samples of all runs: the law plus what the balance leaves over.

    On a hoist the torque left over is carried over to the carriage, on the lever of drum, gear and two falls.
    """
    gain, _ = sensor(machine)
    lever = machine.lift_m_per_rad if isinstance(machine, Hoist) else 1.0
    speeds, forces = [], []
    for run in result.runs:
        balance = run.balance
        speed = balance.states[:, -1] if isinstance(machine, Hoist) else balance.motion.speed
        both = np.column_stack([speed, law(machine, speed)])
        smooth = lowpass(balance.run.time_s, both, balance.band_hz)[balance.moving]
        speeds.append(smooth[:, 0])
        forces.append(smooth[:, 1] + balance.residual[balance.moving] / gain / lever)
    return np.concatenate(speeds), np.concatenate(forces)


def combined_weight(machine: Hoist | Axis, result: ReplayResult) -> float | None:
    """What the paper's Fig. 7 divides by: the weight of carriage and payload, mean over the runs; None for an axis."""
    if not isinstance(machine, Hoist):
        return None
    payloads = [run.balance.run.payload_kg * machine.sensors.payload_scale for run in result.runs]
    return (machine.carriage.mass_kg + float(np.mean(payloads))) * machine.gravity_m_s2
