"""Inverse simulation: the torque that a measured motion requires, with the plant driven by the measured speed.

Carriage, wire and sheave are simulated under the measured motor motion, and Eq. 15
gives the torque. Measured minus predicted, both low-passed alike, is the local
balance: it does not drift, as an open-loop replay does.
"""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from operator import attrgetter
from types import SimpleNamespace

import numpy as np

from workbench.core.run import Array, Run, integrated
from workbench.effects import Part, logged_input, sizes_of
from workbench.effects.active import Active, moved_by, true_input, true_motion
from workbench.engine import kernels
from workbench.engine.kernels import FEW_LANES, MOST_STEPS, lanes_for
from workbench.machines import Machine, Plant, kind_of, plant_of
from workbench.simulate.loop import PlantModel, plant_model
from workbench.simulate.lowpass import default_band, inside, lowpass, noise_rms
from workbench.simulate.motion import GUARD_S, PLAY, Motion, beside, bridged, motion_of, moving

# Relative to the speed scale, per sample. A measured speed is noisy; its noise need not be integrated exactly.
TOLERANCE = 1e-4
THIN_TOLERANCE = 1e-3  # between thinned samples: what one step there is off is a fraction of the noise
MOTIONS_KEPT = 4  # of each run, behind a late sensor
STEP_OF_PLAY_S = 8e-5  # at least: a twentieth of the time in which parts that meet come apart, or to rest
SMOOTH = 0.25  # of the sampling rate of thinned times: the band that a motion keeps there


@dataclass(frozen=True)
class Balance:
    """The balance of one run: all arrays (n,), in the input's unit (N m or N).

    measured, predicted: low-passed to `band_hz`; residual is their difference.
    inside: away from the ends. moving: inside, not at rest (see `motion.moving`), no impact of a play near.
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


class InverseSimulation:
    """Runs of one machine, prepared for many predictions with changed parameters."""

    def __init__(
        self,
        machine: Machine,
        runs: Sequence[Run],
        band_hz: float | None = None,
        active: Active | None = None,
        parts: Sequence[Part] = (),
        impacts: Sequence[Array] = (),
        thin: float = 0.0,
    ) -> None:
        """active: effects in place of the machine's own. impacts: times of each run where the acceleration is bridged.
        parts: of them, the smallest first; the first one that has
        all that is at work is simulated, which takes less time. thin: periods of the band from one sample that
        `required` looks at to the next, 0 for every sample of the log."""
        self.machine, self.runs, self.plant = machine, tuple(runs), plant_of(machine)
        self.model = plant_model(machine, active)
        self.base = [
            self.model.values(machine, run.payload_kg, run.start_time_s - float(run.time_s[0]), run.name)
            for run in self.runs
        ]
        self.band_hz = band_hz if band_hz is not None else default_band(machine, self.plant, self.base, self.runs)
        self.impacts = tuple(impacts) or tuple(np.zeros(0) for _ in self.runs)
        self._logged = []
        for run, at in zip(self.runs, self.impacts, strict=True):
            motion = motion_of(run, self.plant, self.band_hz)
            if len(at):
                motion = replace(motion, acceleration=bridged(run.time_s, motion.acceleration, at))
            self._logged.append(motion)
        self.every = [max(1, int(thin / (self.band_hz * run.sample_time_s))) for run in self.runs]
        self.times = [run.time_s[::n] for run, n in zip(self.runs, self.every, strict=True)]
        # The motion behind the log: what a late speed sensor shows is brought forward.
        self.motions = [self._behind_log(j) for j in range(len(self.runs))]
        self.symbols = tuple(vars(self.base[0]))
        self.row_of = {symbol: row for row, symbol in enumerate(self.symbols)}
        self.table = np.array([[vars(p)[symbol] for symbol in self.symbols] for p in self.base], dtype=float)
        self.parts = tuple(parts)
        self.models = [PlantModel(self.plant, replace(self.model.active, effects=part.effects)) for part in parts]
        self._late = moved_by(self.model.active)
        self._behind: OrderedDict[tuple[int, bool, tuple[float, ...]], Motion] = OrderedDict()
        self.scale = speed_scale(machine, self.runs, self.motions)
        self.inputs = [run[self.plant.input] for run in self.runs]
        self.measured = [lowpass(run.time_s, u, self.band_hz) for run, u in zip(self.runs, self.inputs, strict=True)]
        self.inside = [inside(run.time_s, self.band_hz) for run in self.runs]
        self.moving = [
            i & moving(run.time_s, m.speed, self.scale, self.band_hz)
            for run, m, i in zip(self.runs, self.motions, self.inside, strict=True)
        ]
        self.judged = [self._judged(j) for j in range(len(self.runs))]
        self.noise = [noise_rms(r.time_s, u, self.band_hz) for r, u in zip(self.runs, self.inputs, strict=True)]

    @cached_property
    def speeds(self) -> list[Array]:
        """(n,) of each run, of the driven coordinate in the band."""
        return [lowpass(run.time_s, m.speed, self.band_hz) for run, m in zip(self.runs, self.motions, strict=True)]

    @cached_property
    def _smooth(self) -> list[Motion]:
        return [self._logged[j] if n == 1 else self._smoothed(j) for j, n in enumerate(self.every)]

    def predict(self, values: Sequence[Sequence[SimpleNamespace]]) -> list[list[tuple[Array, Array]]]:
        """The true input that each run's motion requires, for sets of parameters; not low-passed.

        values: for every set, a run's parameters by symbol. Returns for every set and run
        the input (n,) and the other states (n, states). The sets of a run take the same
        steps, sixteen at a time, so their differences are free of step-size noise.
        """
        columns = attrgetter(*self.symbols)
        tables = [np.array([columns(chosen[j]) for chosen in values], dtype=float).T for j in range(len(self.runs))]
        by_run = self.required(tables)
        return [[(out[:, 0, i], out[:, 1:, i]) for out in by_run] for i in range(len(values))]

    def required(self, tables: Sequence[Array], thin: bool = False) -> list[Array]:
        """As `predict`, of each run's table (symbols, sets): (n, 1 + other states, sets) of each run. thin: at the
        times `self.times` only, n of them, under the motion without what those cannot show."""
        needed = next((k for k, enough in enumerate(self._enough(tables)) if np.all(enough)), len(self.parts))
        model = self.models[needed] if needed < len(self.models) else self.model
        rows = [self.row_of[name] for name in model.names]
        own = [table[rows] for table in tables]
        motions = [self._motions_behind(j, table, thin) for j, table in enumerate(tables)]
        points = [
            [start_point(self.plant, run, m) for m in candidates]
            for run, (candidates, _) in zip(self.runs, motions, strict=True)
        ]
        first = [point for at, (_, which) in zip(points, motions, strict=True) for point in map(at.__getitem__, which)]
        clocks = [float(run.time_s[0]) for run, table in zip(self.runs, tables, strict=True) for _ in table.T]
        every = np.hstack(own)
        start, _ = model.starts([at for at, _ in first], [speed for _, speed in first], clocks, every)
        scales = model.scales(self.scale, every)
        order = sorted(range(len(self.runs)), key=lambda j: len(self.runs[j].time_s))
        # Runs at once: one set of parameters each, or where nearly every step goes from sample to sample, so that a run
        # takes the same steps in any company: fits compare what they have simulated in one with another.
        sets = tables[0].shape[1]
        together = min(self.every) > 1 if thin else sets == 1
        many = max(1, FEW_LANES[0] // sets) if together else 1
        groups = [order[k : k + many] for k in range(0, len(order), many)]

        def some(group: Sequence[int]) -> list[Array]:
            return self._required_of(group, thin, model, own, motions, start, scales)

        found = some(groups[0])  # compiles, if need be, in one thread only
        if len(groups) > 1:
            found += [out for outs in _pool(os.getpid()).map(some, groups[1:]) for out in outs]
        return [found[order.index(j)] for j in range(len(order))]

    def _required_of(
        self,
        group: Sequence[int],
        thin: bool,
        model: PlantModel,
        tables: Sequence[Array],
        motions: Sequence[tuple[Sequence[Motion], Sequence[int]]],
        start: Array,
        scales: Array,
    ) -> list[Array]:
        """Of some runs, whose sets of parameters are the lanes of one kernel and take the same steps: the shorter runs
        stand at their ends until the longest one ends, too."""
        sets, n = tables[0].shape[1], len(self.plant.positions)
        count = sets * len(group)
        lanes = lanes_for(count, self.model.effects)
        full = np.minimum(np.arange(max(count, lanes)), count - 1)  # spare lanes repeat the last set
        columns = np.concatenate([j * sets + np.arange(sets) for j in group])[full]
        before = np.cumsum([0, *(len(motions[j][0]) for j in group)])
        which = np.concatenate([k + np.array(motions[j][1]) for k, j in zip(before, group, strict=False)])[full]
        times = [self.times[j] if thin else self.runs[j].time_s for j in group for _ in motions[j][0]]
        moved = [motion for j in group for motion in motions[j][0]]
        longest = max(map(len, times))

        def in_lanes(series: Sequence[Array], ends: Sequence[float], steps: Sequence[float] | None = None) -> Array:
            """ends: where a series goes on from at its run's end, by `steps`."""
            whole = list(series)
            for i, (values, end) in enumerate(zip(series, ends, strict=True)):
                if more := longest - len(values):
                    after = end + (steps[i] if steps else 0.0) * np.arange(1, more + 1)
                    whole[i] = np.concatenate([values, after])
            return whole[0][:, None] if len(whole) == 1 else np.column_stack(whole).take(which, axis=1, mode="clip")

        still = [0.0] * len(moved)
        travelled = [motion.position - motion.position[0] for motion in moved]
        start, played = start[:, columns], any(one.symbol.startswith(PLAY) for one in model.effects.memory)
        out = kernels.driven(
            self.plant,
            np.hstack([tables[j] for j in group])[:, full],
            in_lanes(times, [t[-1] for t in times], [t[-1] - t[-2] for t in times]),
            in_lanes(travelled, [x[-1] for x in travelled]) + start[0],
            in_lanes([motion.speed for motion in moved], still),
            in_lanes([motion.acceleration for motion in moved], still),
            np.concatenate([start[1:n], start[n + 1 :]]),
            scales[:, columns],
            effects=model.effects,
            tolerance=THIN_TOLERANCE if thin and min(self.every) > 1 else TOLERANCE,
            threads=1,
            lanes=lanes,
            most_steps=round(max(t[1] - t[0] for t in times) / STEP_OF_PLAY_S) if played else MOST_STEPS,
        )
        lengths = [len(self.times[j]) if thin else len(self.runs[j].time_s) for j in group]
        return [out[:length, :, k * sets : (k + 1) * sets] for k, length in enumerate(lengths)]

    def parts_needed(self, tables: Sequence[Array]) -> np.ndarray:
        """(sets,) which of `parts` has all that is at work in a set, in any run; len(parts) for the whole."""
        enough = [*self._enough(tables), np.ones(tables[0].shape[1], dtype=bool)]
        return np.argmax(enough, axis=0)

    def _enough(self, tables: Sequence[Array]) -> Iterator[np.ndarray]:
        """Of each of `parts`: (sets,) whether it has all that is at work."""
        for part in self.parts:
            rows, off = [self.row_of[symbol] for symbol in part.off], np.array(list(part.off.values()))[:, None]
            yield np.all([np.all(table[rows] == off, axis=0) for table in tables], axis=0)

    def _motions_behind(self, j: int, table: Array, thin: bool) -> tuple[list[Motion], list[int]]:
        """The true motions of run j, which differ where sets differ in the sensor's delay, and each set's."""
        rows = [self.row_of[name] for name in self._late]
        keys = list(map(tuple, table[rows].T.tolist()))
        different = {key: i for i, key in enumerate(dict.fromkeys(keys))}
        return [self._motion_behind(j, key, thin) for key in different], [different[key] for key in keys]

    def _motion_behind(self, j: int, key: tuple[float, ...], thin: bool) -> Motion:
        own = tuple(getattr(self.base[j], name) for name in self._late)
        if key == own and not (thin and self.every[j] > 1):
            return self.motions[j]
        if (j, thin, key) not in self._behind:
            self._behind[j, thin, key] = self._behind_log(j, dict(zip(self._late, key, strict=True)), thin)
            while len(self._behind) > MOTIONS_KEPT * len(self.runs):
                self._behind.popitem(last=False)
        return self._behind[j, thin, key]

    def _behind_log(self, j: int, values: Mapping[str, float] | None = None, thin: bool = False) -> Motion:
        """The motion of run j behind its sensor: a delay and the low-pass may change places. values: by symbol, where
        not the active ones."""
        motion, every, time_s = self._logged[j], 1, self.runs[j].time_s
        if thin:
            motion, every = self._smooth[j], self.every[j]
        position, speed = (  # straight between the thinned times: what is there says all
            true_motion(self.model.active, time_s[::every], x[::every], values) for x in (motion.position, motion.speed)
        )
        acceleration = true_motion(self.model.active, time_s, motion.acceleration, values)
        return Motion(*map(np.ascontiguousarray, (position, speed, acceleration[::every])))

    def _smoothed(self, j: int) -> Motion:
        """The logged motion of run j without what is too quick for its thinned times.

        Between samples the simulated speed is linear: it is made such that the lines pass on the same motion (a line
        through samples h apart takes (pi f h)^2 / 3 off a wave, a second difference over 12 adds it), and the position
        is its integral, else it would jump at each of them.
        """
        every, time_s, motion, at = self.every[j], self.runs[j].time_s, self._logged[j], self.times[j]
        speed, acceleration = lowpass(
            time_s, np.column_stack([motion.speed, motion.acceleration]), SMOOTH / (every * self.runs[j].sample_time_s)
        ).T
        thin = speed[::every].copy()
        thin[1:-1] -= np.diff(thin, 2) / 12.0
        position = integrated(thin, at)
        position += lowpass(at, motion.position[::every] - position, self.band_hz)
        return Motion(np.interp(time_s, at, position), np.interp(time_s, at, thin), acceleration)

    def starts(self) -> Array:
        """(states, runs): where each run begins, with the load held."""
        points = [start_point(self.plant, run, motion) for run, motion in zip(self.runs, self.motions, strict=True)]
        clocks = [float(run.time_s[0]) for run in self.runs]
        return self.model.starts([x for x, _ in points], [w for _, w in points], clocks, self.base)[0]

    def true_inputs(self) -> list[Array]:
        """The true input (n,) of each run, recovered from the logged one."""
        gain, offset = sensor(self.machine)
        return [
            true_input(self.model.active, run.time_s, (logged - offset) / gain)
            for run, logged in zip(self.runs, self.inputs, strict=True)
        ]

    def _judged(self, j: int) -> np.ndarray:
        """(n,) bool: the samples that residuals are judged by: moving, and so in a late log too; no impact beside."""
        run = self.runs[j]
        going = self.moving[j] & ~beside(run.time_s, self.impacts[j], GUARD_S)
        if self._late:
            going &= moving(run.time_s, self._logged[j].speed, self.scale, self.band_hz)
        return going

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
                self.runs, self.motions, self.measured, predicted, self.inside, self.judged, self.noise, strict=True
            )
        ]


@lru_cache(maxsize=1)
def _pool(process: int) -> ThreadPoolExecutor:
    """The threads of a process: a fit asks for them hundreds of times, and a child has none of its parent's."""
    return ThreadPoolExecutor(os.cpu_count() or 1)


def sensor(machine: Machine) -> tuple[float, float]:
    """gain, offset of the logged input: logged = gain * true + offset."""
    return kind_of(machine).sensor_of(machine)


def start_point(plant: Plant, run: Run, motion: Motion) -> tuple[float, float]:
    """Where a run starts: height (or position), and the driven speed, averaged over the first samples."""
    at = float(motion.position[0]) if plant.positions[0] in run else run.start_position_m
    return at, float(np.mean(motion.speed[:5]))


def speed_scale(machine: Machine, runs: Sequence[Run], motions: Sequence[Motion]) -> float:
    """The speed that errors refer to: a motor's nominal speed, or an axis' largest measured speed; where no run moves,
    the one that goes with its size."""
    nominal = kind_of(machine).nominal_speed
    if nominal is not None:
        return nominal(machine)
    return max(float(np.max(np.abs(m.speed))) for m in motions) or sizes_of(machine, runs).speed


def pooled_rms(parts: Sequence[Array], steps_s: Sequence[float] = ()) -> float:
    """Root mean square over the time of all parts, whose samples lie steps_s apart; without it, over all samples."""
    together = np.concatenate(parts)
    time = np.repeat(steps_s or np.ones(len(parts)), [len(part) for part in parts])
    return float(np.sqrt(np.average(together**2, weights=time))) if len(together) else float("nan")


def changed(p: SimpleNamespace, changes: Mapping[str, float]) -> SimpleNamespace:
    """Parameters with some of them replaced."""
    return SimpleNamespace(**{**vars(p), **changes})
