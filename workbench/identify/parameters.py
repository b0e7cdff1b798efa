"""Which values a fit may change: how far, on what scale, and held by which tolerance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.errors import InputError, nearest
from workbench.machine import Axis, Hoist, get_value
from workbench.plants import plant_of
from workbench.run import Run

# What turns over at standstill is a property of the rollers that nobody knows: a factor of ten either way.
SLOPE_LOG_STD = math.log(10.0)

HOIST_DEFAULT = (
    "guide.coulomb_hoisting_n",
    "guide.coulomb_lowering_n",
    "guide.atan_slope_s_per_m",
    "motor.rotor_inertia_kg_m2",
    "carriage.mass_kg",
    "sensors.payload_scale",
    "bearing.pin_friction_coefficient",
    "wire.youngs_modulus_pa",
    "sensors.torque_gain",
    "sensors.torque_offset_nm",
)
AXIS_DEFAULT = ("inertia", "viscous", "coulomb_forward", "coulomb_backward", "gravity_constant")  # roles of Axis
LOGARITHMIC = ("guide.atan_slope_s_per_m",)
SIGNED = ("gravity", "offset")


@dataclass(frozen=True)
class Free:
    """One value to be fitted, in the fit's own coordinate z: value = nominal + scale z, or nominal exp(scale z).

    symbol: its name in the plant's equations, None for the sensor's gain and offset.
    prior_std: one standard deviation of z that the tolerances allow, None where nothing holds it.
    """

    key: str
    symbol: str | None
    nominal: float
    scale: float
    logarithmic: bool
    lowest: float
    prior_std: float | None

    def value(self, z: float) -> float:
        return self.nominal * math.exp(self.scale * z) if self.logarithmic else self.nominal + self.scale * z

    def std_error(self, z: float, std_z: float) -> float:
        """A standard error of z, in the value's own unit."""
        return std_z * self.scale * (self.value(z) if self.logarithmic else 1.0)

    @property
    def lowest_z(self) -> float:
        return -math.inf if self.logarithmic else (self.lowest - self.nominal) / self.scale


def free_parameters(machine: Hoist | Axis, runs: Sequence[Run], chosen: Sequence[str] | None = None) -> list[Free]:
    """The values to fit: `chosen` keys of machine.yaml, or the default set of the machine's kind.

    A hoist's default: both friction levels and the slope, and what `tolerances` allow,
    held by them. An axis': inertia, viscous, both Coulomb levels, the constant load, free.
    """
    if chosen is not None:
        return [_free(machine, runs, key) for key in _checked(machine, chosen)]
    if isinstance(machine, Hoist):
        keys: list[str] = list(HOIST_DEFAULT)
        if all(run.payload_kg == 0.0 for run in runs):
            keys.remove("sensors.payload_scale")
        return [_free(machine, runs, key) for key in keys]
    return [_free(machine, runs, machine.value_of[role]) for role in AXIS_DEFAULT]


def fittable(machine: Hoist | Axis) -> dict[str, str | None]:
    """Every key that a fit may free -> its symbol in the plant (None: the sensor's)."""
    keys: dict[str, str | None] = {
        key: symbol
        for symbol, key in plant_of(machine).parameters.items()
        if isinstance(key, str) and key not in ("payload_kg", "motor.count")
    }
    if isinstance(machine, Hoist):
        return keys | {"sensors.torque_gain": None, "sensors.torque_offset_nm": None}
    return keys | {machine.value_of["gain"]: None, machine.value_of["offset"]: None}


def _checked(machine: Hoist | Axis, chosen: Sequence[str]) -> list[str]:
    valid = fittable(machine)
    for key in chosen:
        if key not in valid:
            raise InputError(f"cannot fit '{key}'; {nearest(key, valid)}", place="--free")
    if len(set(chosen)) != len(chosen):
        raise InputError(f"a key stands twice in {', '.join(chosen)}", place="--free")
    return list(chosen)


def _free(machine: Hoist | Axis, runs: Sequence[Run], key: str) -> Free:
    nominal = get_value(machine, key)
    symbol = fittable(machine)[key]
    if key in LOGARITHMIC:
        return Free(key, symbol, nominal, 1.0, True, 0.0, SLOPE_LOG_STD)
    std = _tolerance(machine, runs, key)
    scale = std if std else 0.1 * max(abs(nominal), _typical(machine, runs, key))
    signed = any(word in key for word in SIGNED) and key != "gravity_m_s2"
    lowest = -math.inf if signed else (0.0 if "coulomb" in key or "viscous" in key else 1e-3 * abs(nominal))
    return Free(key, symbol, nominal, scale, False, lowest, None if std is None else 1.0)


def _tolerance(machine: Hoist | Axis, runs: Sequence[Run], key: str) -> float | None:
    """One standard deviation of a value in its own unit; None where nothing holds it in a fit.

    A hoist's friction levels are held too, each by its own: motion shows their sum well and
    their difference only together with weight and offset, and that is where a hold is needed.
    The dynamics of an axis are what is looked for: free.
    """
    if isinstance(machine, Hoist):
        t = machine.tolerances
        relative = {
            "guide.coulomb_hoisting_n": t.coulomb,
            "guide.coulomb_lowering_n": t.coulomb,
            "motor.rotor_inertia_kg_m2": t.rotor_inertia,
            "carriage.mass_kg": t.carriage_mass,
            "sensors.payload_scale": t.payload,
            "bearing.pin_friction_coefficient": t.pin_friction,
            "wire.youngs_modulus_pa": t.wire_stiffness,
            "sensors.torque_gain": t.torque_gain,
        }
        if key == "sensors.torque_offset_nm":
            return t.torque_offset_nm or None
        return (relative[key] * abs(get_value(machine, key)) or None) if key in relative else None
    if key == machine.value_of["gain"]:
        return machine.role("gain_tolerance") or None
    if key == machine.value_of["offset"]:
        return machine.offset_tolerance(max(float(np.max(np.abs(run[machine.input_signal]))) for run in runs)) or None
    return None


def _typical(machine: Hoist | Axis, runs: Sequence[Run], key: str) -> float:
    """A size for values whose nominal may be zero, in their own unit, from the logs."""
    signal = machine.input_signal if isinstance(machine, Axis) else "torque_motor_nm"
    force = float(np.sqrt(np.mean(np.concatenate([run[signal] for run in runs]) ** 2)))
    if isinstance(machine, Hoist) or "mass" in key or "inertia" in key or "standstill" in key:
        return 0.0 if get_value(machine, key) else force
    if "viscous" in key:
        return force / max(float(np.ptp(_position(machine, run)) / run.duration_s) for run in runs)
    return force


def _position(machine: Axis, run: Run) -> np.ndarray:
    if machine.position_signal in run:
        return run[machine.position_signal]
    return np.cumsum(run[machine.speed_signal]) * run.sample_time_s
