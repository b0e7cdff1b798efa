"""The values that a fit may change, with scale, lower bound and tolerance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.errors import InputError, nearest
from workbench.core.run import Run
from workbench.machines import Axis, Hoist, Kind, get_value, kind_of, plant_of

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
    kind = kind_of(machine)
    empty = all(run.payload_kg == 0.0 for run in runs)
    silent = {value.key for value in kind.base if value.with_payload and empty}
    return [_free(machine, runs, key) for key in kind.free if key not in silent]


def fittable(machine: Hoist | Axis) -> dict[str, str | None]:
    """Every key that a fit may free -> its symbol in the plant (None: the sensor's)."""
    keys: dict[str, str | None] = {
        key: symbol
        for symbol, key in plant_of(machine).parameters.items()
        if isinstance(key, str) and key not in ("payload_kg", "motor.count")
    }
    return keys | dict.fromkeys(kind_of(machine).sensor)


def _checked(machine: Hoist | Axis, chosen: Sequence[str]) -> list[str]:
    valid = fittable(machine)
    for key in chosen:
        if key not in valid:
            raise InputError(f"cannot fit '{key}'; {nearest(key, valid)}", place="free")
    if len(set(chosen)) != len(chosen):
        raise InputError(f"a key stands twice in {', '.join(chosen)}", place="free")
    return list(chosen)


def _free(machine: Hoist | Axis, runs: Sequence[Run], key: str) -> Free:
    kind = kind_of(machine)
    nominal, symbol = get_value(machine, key), fittable(machine)[key]
    base = kind.base_value(key)
    std = base.std(machine, kind.largest_input(runs)) if base is not None and base.in_fit else None
    if base is not None and base.in_fit and base.spread == "factor":
        return Free(key, symbol, nominal, 1.0, True, 0.0, std)
    scale = std if std else 0.1 * max(abs(nominal), _typical(machine, runs, key))
    signed = any(word in key for word in SIGNED) and key != "gravity_m_s2"
    lowest = -math.inf if signed else (0.0 if "coulomb" in key or "viscous" in key else 1e-3 * abs(nominal))
    return Free(key, symbol, nominal, scale, False, lowest, 1.0 if std else None)


def _typical(machine: Hoist | Axis, runs: Sequence[Run], key: str) -> float:
    """A typical size for a value whose nominal may be zero, in its own unit; from the logs if the kind says so."""
    kind = kind_of(machine)
    size = kind.sized_by_runs.get(key, "input" if get_value(machine, key) == 0.0 else 0.0)
    if isinstance(size, float):
        return size
    force = float(np.sqrt(np.mean(np.concatenate([run[kind.plant.input] for run in runs]) ** 2)))
    if size == "input/speed":
        return force / max(float(np.ptp(_position(kind, run)) / run.duration_s) for run in runs)
    return force


def _position(kind: Kind, run: Run) -> np.ndarray:
    """(n,) of the driven coordinate."""
    position, speed = kind.plant.positions[0], kind.plant.speeds[0]
    if position in run:
        return run[position]
    return np.cumsum(run[speed]) * run.sample_time_s
