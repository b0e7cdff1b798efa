"""What a fit compares with the log: the values that it may change, and what the model then predicts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Protocol

import numpy as np

from workbench.core import yaml_strict
from workbench.core.errors import InputError, check_known
from workbench.core.run import Array, Run, integrated
from workbench.effects import logged_input
from workbench.machines import Axis, Hoist, get_value, kind_of, plant_of
from workbench.simulate.driven import InverseSimulation, changed, sensor
from workbench.simulate.lowpass import lowpass
from workbench.simulate.model_error import ANY, ErrorModel, model_error_of

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
        if self.logarithmic:
            return self.nominal * math.exp(self.scale * z)
        return max(self.lowest, self.nominal + self.scale * z)  # at its bound, whatever rounding says

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
        check_known("cannot fit", key, valid, place="free")
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
    if (bounds := yaml_strict.bounds_of(yaml_strict.field_at(type(machine), tuple(key.split("."))))) is not None:
        lowest = max(lowest, bounds.lowest)  # what the fit ends at is written to a file that is to be read
    return Free(key, symbol, nominal, scale, False, lowest, 1.0 if std else None)


def _typical(machine: Hoist | Axis, runs: Sequence[Run], key: str) -> float:
    """A typical size for a value whose nominal may be zero, in its own unit; from the logs if the kind says so."""
    kind = kind_of(machine)
    value = kind.value(key)
    size = value.scale if value and value.scale else "input" if get_value(machine, key) == 0.0 else 0.0
    if isinstance(size, float):
        return size
    force = float(np.sqrt(np.mean(np.concatenate([run[kind.plant.input] for run in runs]) ** 2)))
    if size == "input/speed":
        at, speed = kind.plant.positions[0], kind.plant.speeds[0]
        ways = [run[at] if at in run else integrated(run[speed], run.time_s) for run in runs]
        return force / max(float(np.ptp(way) / run.duration_s) for way, run in zip(ways, runs, strict=True))
    return force


SAMPLES_PER_PERIOD = 4.0  # of the band, that a fit looks at; more say nothing new
FINELY = 1.1  # of the error model's sizes, from one tried to the next


class OutputModel(Protocol):
    """Residuals (samples,) of all runs, for sets of z; `lags`: the samples over which they are correlated."""

    noise: float
    lags: int
    run_lengths: tuple[int, ...]

    def residuals(self, free: Sequence[Free], sets: Sequence[Array]) -> Array: ...


def values_of(bench: InverseSimulation, free: Sequence[Free], z: Array) -> tuple[list[SimpleNamespace], float, float]:
    """Plant parameters of every run, and the sensor's gain and offset, at z."""
    gain, offset = sensor(bench.machine)
    changes = {}
    for parameter, at in zip(free, z, strict=True):
        if parameter.symbol is not None:
            changes[parameter.symbol] = parameter.value(float(at))
        elif parameter.key.endswith("gain"):
            gain = parameter.value(float(at))
        else:
            offset = parameter.value(float(at))
    return [changed(p, changes) for p in bench.base], gain, offset


class BalanceModel:
    """Measured minus predicted input while the machine moves, low-passed and thinned to independent samples."""

    def __init__(self, bench: InverseSimulation) -> None:
        self.bench = bench
        self.noise = max(float(np.sqrt(np.mean(np.square(bench.noise)))), 1e-12)
        self.rows: list[np.ndarray] = []
        for run, moving in zip(bench.runs, bench.moving, strict=True):
            stride = max(1, int(1.0 / (SAMPLES_PER_PERIOD * bench.band_hz * run.sample_time_s)))
            self.rows.append(np.flatnonzero(moving)[::stride])
        self.run_lengths = tuple(len(rows) for rows in self.rows)
        together = kind_of(bench.machine).model_error.time_s * bench.band_hz
        self.lags = int(SAMPLES_PER_PERIOD * max(2.0, together))

    def on(self, runs: Sequence[Run]) -> BalanceModel:
        """The same samples of other runs that were sampled alike."""
        other = BalanceModel(InverseSimulation(self.bench.machine, runs, self.bench.band_hz))
        other.rows, other.run_lengths = self.rows, self.run_lengths
        return other

    def spread(self, residual: Array) -> Array:
        """(samples,) standard deviation of each residual, by the error model of a diagnosis at its likeliest sizes:
        more where a law of friction turns over, the more the less exact it is there. That errors hang together is left
        to the standard errors: a fit that whitens them looks at what changes quickly, which no lumped model foretells.
        """
        parts = model_error_of(self.bench, self.rows)
        errors = ErrorModel(np.full(len(residual), self.noise), *parts, carry=np.zeros(len(residual)))
        return errors.sized(errors.likeliest(residual, FINELY, ANY)[1]).std

    def residuals(self, free: Sequence[Free], sets: Sequence[Array]) -> Array:
        """(sets, samples), in the input's unit."""
        chosen = [values_of(self.bench, free, z) for z in sets]
        predicted = self.bench.predict([values for values, _, _ in chosen])
        out = []
        for j, run in enumerate(self.bench.runs):
            raw = np.stack(
                [logged_input(self.bench.model.active, run.time_s, predicted[i][j][0]) for i in range(len(sets))],
                axis=-1,
            )
            smooth = lowpass(run.time_s, raw, self.bench.band_hz)[self.rows[j]]
            sensors = np.array([[gain, offset] for _, gain, offset in chosen])
            out.append(self.bench.measured[j][self.rows[j], None] - (smooth * sensors[:, 0] + sensors[:, 1]))
        return np.concatenate(out).T
