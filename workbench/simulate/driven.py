"""Inverse simulation: the torque that a measured motion requires, with the plant driven by the measured speed.

Carriage, wire and sheave are simulated under the measured motor motion, and Eq. 15
gives the torque. Measured minus predicted, both low-passed alike, is the local
balance: it does not drift, as an open-loop replay does.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from workbench.effects import Active, logged_input, moved_by, true_run
from workbench.engine import kernels
from workbench.kinds import kind_of
from workbench.machine import Axis, Hoist
from workbench.plants import Plant, plant_of
from workbench.run import Array, Run
from workbench.simulate.band import default_band
from workbench.simulate.lowpass import inside, lowpass, noise_rms
from workbench.simulate.motion import Motion, motion_of, moving
from workbench.simulate.plant_model import plant_model

# Relative to the speed scale, per sample. A measured speed is noisy; its noise need not be integrated exactly.
TOLERANCE = 1e-4


@dataclass(frozen=True)
class Balance:
    """The balance of one run: all arrays (n,), in the input's unit (N m or N).

    measured, predicted: low-passed to `band_hz`; residual is their difference.
    inside: away from the ends. moving: inside, and not at rest (see `motion.moving`).
    states: (n, other states), simulated; for a hoist sheave angle, height, sheave speed, carriage speed.
    """

    run: Run
    motion: Motion
    measured: Array
    predicted: Array
    inside: np.ndarray
    moving: np.ndarray
    states: Array
    band_hz: float
    noise_rms: float

    @property
    def residual(self) -> Array:
        return self.measured - self.predicted


class Bench:
    """Runs of one machine, prepared for many predictions with changed parameters."""

    def __init__(
        self,
        machine: Hoist | Axis,
        runs: Sequence[Run],
        band_hz: float | None = None,
        active: Active | None = None,
    ) -> None:
        """active: effects in place of the machine's own."""
        self.machine, self.runs, self.plant = machine, tuple(runs), plant_of(machine)
        self.model = plant_model(machine, active)
        self.base = [
            self.model.values(machine, run.payload_kg, run.start_time_s - float(run.time_s[0])) for run in self.runs
        ]
        self.band_hz = band_hz if band_hz is not None else default_band(machine, self.plant, self.base, self.runs)
        # The motion behind the log: what a late speed sensor shows is brought forward first.
        self.motions = [motion_of(true_run(run, self.model.active), self.plant, self.band_hz) for run in self.runs]
        self._late = moved_by(self.model.active)
        self.scale = speed_scale(machine, self.runs, self.motions)
        self.inputs = [run[self.plant.input] for run in self.runs]
        self.measured = [lowpass(run.time_s, u, self.band_hz) for run, u in zip(self.runs, self.inputs, strict=True)]
        self.inside = [inside(run.time_s, self.band_hz) for run in self.runs]
        self.moving = [
            i & moving(run.time_s, m.speed, self.scale, self.band_hz)
            for run, m, i in zip(self.runs, self.motions, self.inside, strict=True)
        ]
        self.noise = [noise_rms(r.time_s, u, self.band_hz) for r, u in zip(self.runs, self.inputs, strict=True)]

    def predict(self, values: Sequence[Sequence[SimpleNamespace]]) -> list[list[tuple[Array, Array]]]:
        """The true input that each run's motion requires, for sets of parameters; not low-passed.

        values: for every set, a run's parameters by symbol. Returns for every set and run
        the input (n,) and the other states (n, states). The sets of a run take the same
        steps, sixteen at a time, so their differences are free of step-size noise.
        """

        def one(j: int) -> Array:
            return self._predict_run(j, [chosen[j] for chosen in values])

        workers = min(len(self.runs), os.cpu_count() or 1)
        first = one(0)  # compiles, if need be, in one thread only
        with ThreadPoolExecutor(workers) as pool:
            by_run = [first, *pool.map(one, range(1, len(self.runs)))]
        return [[(out[:, 0, i], out[:, 1:, i]) for out in by_run] for i in range(len(values))]

    def _predict_run(self, j: int, sets: Sequence[SimpleNamespace]) -> Array:
        plant, run = self.plant, self.runs[j]
        motions = self._motions_behind(j, sets)
        points = [start_point(plant, run, motion) for motion in motions] * (len(sets) // len(motions))
        clocks = [float(run.time_s[0])] * len(sets)
        start, _ = self.model.starts([at for at, _ in points], [speed for _, speed in points], clocks, sets)
        travelled = np.stack([motion.position - motion.position[0] for motion in motions], axis=-1)
        n = len(plant.positions)
        return kernels.driven(
            plant,
            self.model.table(sets),
            run.time_s[:, None],
            travelled + start[0],
            np.stack([motion.speed for motion in motions], axis=-1),
            np.stack([motion.acceleration for motion in motions], axis=-1),
            np.concatenate([start[1:n], start[n + 1 :]]),
            self.model.scales(self.scale, sets),
            effects=self.model.effects,
            tolerance=TOLERANCE,
            threads=1,
        )

    def _motions_behind(self, j: int, sets: Sequence[SimpleNamespace]) -> list[Motion]:
        """The true motion of run j: one for all sets, or one for each if the sets differ in the sensor's delay."""
        base = self.base[j]
        if not any(getattr(p, name) != getattr(base, name) for p in sets for name in self._late):
            return [self.motions[j]]
        found: dict[tuple[float, ...], Motion] = {}
        keys = [tuple(getattr(p, name) for name in self._late) for p in sets]
        for key in keys:
            if key not in found:
                behind = true_run(self.runs[j], self.model.active, dict(zip(self._late, key, strict=True)))
                found[key] = motion_of(behind, self.plant, self.band_hz)
        return [found[key] for key in keys]

    def balances(self, values: Sequence[SimpleNamespace] | None = None) -> list[Balance]:
        """Each run's balance under one set of parameters, the machine's own by default."""
        predicted = self.predict([self.base if values is None else values])[0]
        gain, offset = sensor(self.machine)
        active = self.model.active
        return [
            Balance(
                run,
                motion,
                measured,
                lowpass(run.time_s, gain * logged_input(active, run.time_s, raw) + offset, self.band_hz),
                within,
                going,
                states,
                self.band_hz,
                noise,
            )
            for run, motion, measured, (raw, states), within, going, noise in zip(
                self.runs, self.motions, self.measured, predicted, self.inside, self.moving, self.noise, strict=True
            )
        ]


def sensor(machine: Hoist | Axis) -> tuple[float, float]:
    """gain, offset of the logged input: logged = gain * true + offset."""
    return kind_of(machine).sensor_of(machine)


def start_point(plant: Plant, run: Run, motion: Motion) -> tuple[float, float]:
    """Where a run starts: height (or position), and the driven speed, averaged over the first samples."""
    at = float(motion.position[0]) if plant.positions[0] in run else run.start_position_m
    return at, float(np.mean(motion.speed[:5]))


def speed_scale(machine: Hoist | Axis, runs: Sequence[Run], motions: Sequence[Motion]) -> float:
    """The speed that errors refer to: a motor's nominal speed, or an axis' largest measured speed."""
    nominal = kind_of(machine).nominal_speed
    if nominal is not None:
        return nominal(machine)
    return max(float(np.max(np.abs(m.speed))) for m in motions)


def pooled_rms(parts: Sequence[Array]) -> float:
    """Root mean square over all samples of all parts."""
    together = np.concatenate(parts)
    return float(np.sqrt(np.mean(together**2))) if len(together) else float("nan")


def changed(p: SimpleNamespace, changes: Mapping[str, float]) -> SimpleNamespace:
    """Parameters with some of them replaced."""
    return SimpleNamespace(**{**vars(p), **changes})
