"""The outputs of a model that a fit compares with the log, for many sets of parameters at once.

`BalanceModel` predicts the torque (force) that the measured motion takes; its noise is
the sensor's, and no bias is integrated. `SpeedModel` predicts the speed under the
measured input, the paper's own figure; use it if the measured input is reliable.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Protocol

import numpy as np

from workbench.core.run import Array, Run
from workbench.effects import logged_input, true_input
from workbench.engine import kernels
from workbench.identify.parameters import Free
from workbench.simulate.driven import InverseSimulation, changed, sensor, start_point
from workbench.simulate.lowpass import lowpass, noise_rms

SAMPLES_PER_PERIOD = 4.0  # of the band, that a fit looks at; more say nothing new


TRUSTED = 1e-5  # of the speed scale: what a replay is believed to
NYQUIST = math.inf  # the whole band


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
        self.lags = int(2 * SAMPLES_PER_PERIOD)

    def on(self, runs: Sequence[Run]) -> BalanceModel:
        """The same samples of other runs that were sampled alike."""
        other = BalanceModel(InverseSimulation(self.bench.machine, runs, self.bench.band_hz))
        other.rows, other.run_lengths = self.rows, self.run_lengths
        return other

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


class SpeedModel:
    """Simulated minus measured speed under the measured input, from the first sample of each run."""

    def __init__(self, bench: InverseSimulation, tolerance: float = kernels.TOLERANCE) -> None:
        self.bench, self.tolerance = bench, tolerance
        speeds = [noise_rms(r.time_s, m.speed, NYQUIST) for r, m in zip(bench.runs, bench.motions, strict=True)]
        self.noise = max(float(np.sqrt(np.mean(np.square(speeds)))), TRUSTED * bench.scale)
        self.run_lengths = tuple(len(run.time_s) for run in bench.runs)
        self.lags = max(1, int(1.0 / bench.runs[0].sample_time_s))

    def residuals(self, free: Sequence[Free], sets: Sequence[Array]) -> Array:
        """(sets, samples), in the speed's unit."""
        plant, model = self.bench.plant, self.bench.model
        chosen = [values_of(self.bench, free, z) for z in sets]
        out = []
        for j, run in enumerate(self.bench.runs):
            parameters = [values[j] for values, _, _ in chosen]
            at, speed = start_point(plant, run, self.bench.motions[j])
            many = len(parameters)
            start, _ = model.starts([at] * many, [speed] * many, [float(run.time_s[0])] * many, parameters)
            logged = [(self.bench.inputs[j] - offset) / gain for _, gain, offset in chosen]
            inputs = np.stack([true_input(model.active, run.time_s, u) for u in logged], axis=-1)
            states = kernels.replay(
                plant,
                model.table(parameters),
                run.time_s[:, None],
                inputs,
                start,
                model.scales(self.bench.scale, parameters),
                effects=model.effects,
                tolerance=self.tolerance,
            )
            out.append(states[:, len(plant.positions), :] - self.bench.motions[j].speed[:, None])
        return np.concatenate(out).T
