"""The residuals of a campaign's local balance for any setting of base values and effects."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from types import SimpleNamespace
from typing import Any, TypeVar

import numpy as np

from workbench.core.run import Array, Run, averaged
from workbench.diagnose.hypotheses.free_parameters import (
    GAIN,
    LOG_TIMING,
    OFFSET,
    TENSION_GAIN,
    FreeParameter,
    Names,
    Scalar,
    Setting,
    inward,
    setting_of,
)
from workbench.effects import Effect, effects_for, find, idle_sensors, logged_input, parts, ranges_of, searchable
from workbench.machines import kind_of
from workbench.simulate.driven import InverseSimulation
from workbench.simulate.lowpass import SAMPLING_SHARE, LowpassAt, lowpass, noise_rms
from workbench.simulate.model_error import ErrorModel, Sizes, error_model
from workbench.simulate.motion import GUARD_S, beside, impacts_of

# Periods of the band from one sample that a search simulates to the next: what that changes is below what a hoist's
# sensors leave. An axis logs its reversals so finely that a fit without them stays beside the best: there only what is
# tried linearly is simulated so, where little is asked.
THIN = 0.07
MOST_SAMPLES = 100_000  # of all runs: more take minutes. Half the rate of 50,000 put the mass of EMPS 2.3 % off
LEAST_RATE_HZ = 200.0  # of what is averaged
MOST_ROWS = 1500  # of a run: many more take long and say little beside the model error, which hangs together
SAMPLES_PER_PERIOD = 4.0  # of the band; more say nothing new
GROUP = 16  # sets that take the same steps: their differences are free of step-size noise
STEP = 1e-3  # of z, for derivatives
LATE_STEP = 0.5  # of a sample, for derivatives by a delay: friction jumps between two samples, not on the way
LATE_OF_BAND = 0.05  # of its period, at least: over less, the jumps of friction outweigh what the band shows

TENSION = "tension_dead_line_n"
LEAST_KEPT = 0.5  # of a run's samples: fewer are no run any more
TENSION_TRUST = 0.0015  # of the mean tension: a load cell's linearity, beside its noise
SENSOR_KEYS = (GAIN, OFFSET, TENSION_GAIN)

Found = TypeVar("Found")


def rms(values: float | Array) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else 0.0


class Problem:
    """Measured minus predicted input of all runs while the machine moves, thinned to nearly independent samples.

    Where impacts of a play come again, the motion is bridged across them and the samples beside them are left out.

    A search simulates `thin`, at some of the samples; what it finds is refitted `exact`, at all of them.
    logged: the runs as they were logged; runs: as slow as serves where no impacts are heard, which all else is of.
    rows: of each run, the samples looked at; run_lengths: how many. share: how many
    independent values one sample stands for. noise: of input and motion, rms in the band, in the input's unit, of the
    runs of which something counts; input_noise: the input's part of it;
    row_noise: (inputs,) that of each sample, as it is weighed; run_noise: (runs,) that of each run, as it is stated.
    errors: noise and model error, as the data are weighed (`ErrorModel`).
    own: effects that are taken for the machine's own, whose values every setting has, and every machine of a fit.
    Where runs of a hoist log the dead line's tension, its residual follows behind that of the torque, on the torque's
    scale: `inputs` is how many rows are the torque's; pulled: of each row of a tension, the row of its torque. tension:
    in the band, by the number of the run.
    """

    def __init__(self, machine: Any, runs: Sequence[Run], band_hz: float | None = None) -> None:
        kind = kind_of(machine)
        self.machine, self.logged = machine, tuple(runs)
        impacts = impacts_of(machine, runs)  # which need every sample
        self.runs = runs = self.logged if any(map(len, impacts)) else as_slow_as_serves(runs, band_hz)
        self.active = searchable(machine, runs)
        self.bench = InverseSimulation(machine, runs, band_hz, self.active, parts(machine, runs), impacts, THIN)
        self.fine = kind.floor == "own"
        self._idle = idle_sensors(machine, runs)
        ranges = [r for effect in effects_for(kind.name).values() for r in ranges_of(effect, machine, runs)]
        self._turning = {r.symbol for r in ranges if r.scan == "order"}
        way = max(float(np.max(np.abs(motion.position))) for motion in self.bench.motions)
        angles = {"order": way, "waves": 2.0 * math.pi * way, "frequency": max(run.duration_s for run in runs)}
        gone = [np.max(np.abs(v)) * (t[1] - t[0]) for v, t in zip(self.bench.speeds, self.bench.times, strict=True)]
        self._gone = float(max(gone)) / max(way, 1e-300)  # of all of the way, from one thin sample to the next
        # symbol -> rad that a wave turns over all of the way, or of the time, by 1 of the value
        self._wave_angles = {r.symbol: angles[r.scan] for r in ranges if r.scan in angles}
        self._smooth: dict[tuple[int, bool], tuple[np.ndarray, LowpassAt]] = {}
        self.band_hz = self.bench.band_hz
        self.rows: list[np.ndarray] = []
        spacing = []
        bench = self.bench
        for run, at_speed, impacts_s, every in zip(bench.runs, bench.moving, bench.impacts, bench.every, strict=True):
            every = 1 if self.fine else every
            moving = (at_speed & ~beside(run.time_s, impacts_s, GUARD_S))[::every]
            step = every * run.sample_time_s
            stride = max(1, int(1.0 / (SAMPLES_PER_PERIOD * self.band_hz * step)))
            stride = max(stride, int(np.count_nonzero(moving)) // MOST_ROWS)
            self.rows.append(every * np.flatnonzero(moving)[::stride])
            spacing.append(stride * step)
        self.run_lengths = tuple(len(rows) for rows in self.rows)
        self.line = kind.dead_line if kind.dead_line and any(kind.dead_line.signal in run for run in runs) else None
        self.has_tension, self.tension = self.line is not None, dict[int, Array]()
        if self.line is not None:
            name, logged = self.line.signal, {j: run for j, run in enumerate(self.runs) if self.line.signal in run}
            self.tension = {j: lowpass(run.time_s, run[name], self.band_hz) for j, run in logged.items()}
            floor = [noise_rms(run.time_s, run[name], self.band_hz) for run in logged.values()]
            level = float(np.mean([np.mean(tension) for tension in self.tension.values()]))
            self.tension_noise = float(np.hypot(np.sqrt(np.mean(np.square(floor))), TENSION_TRUST * level))
        self.inputs = sum(self.run_lengths)
        of_row = np.repeat(np.arange(len(self.runs)), self.run_lengths)
        self.pulled = np.flatnonzero(np.isin(of_row, [*self.tension]))
        self.run_of_row = np.append(of_row, of_row[self.pulled])
        self.share = min(1.0, 2.0 * self.band_hz * float(np.mean(spacing)))
        self.late = ranges_of(self.effect("speed_delay"), machine, self.runs)[0].symbol
        counted = [j for j, rows in enumerate(self.rows) if len(rows)] or range(len(self.runs))
        self.noise = self.input_noise = max(rms(np.array([self.bench.noise[j] for j in counted])), 1e-12)
        self.row_noise, self.run_noise = np.full(self.inputs, self.noise), np.array(self.bench.noise)
        self.thin = (max(self.bench.every) > 1 and not self.fine) or any(map(len, self.bench.impacts))
        self.evaluations = 0
        self.kept: dict[Any, Any] = {}  # as held-out fits, by fit and folds: several steps ask for the same
        self.deaf = self.rough = False
        self.own: Names = ()
        self.errors = self.errors_of_rows()

    def effect(self, name: str) -> Effect:
        """A declared effect of the machine's kind."""
        return find(name, self.active.kind)

    def errors_of_rows(self) -> ErrorModel:
        """Rows beside an impact of a play count less: where its teeth meet some milliseconds off what a law foretells,
        all of the input is in the residual for as long."""
        tension, noise = 0.5 * self.noise if self.has_tension else None, self.row_noise
        if self.struck:
            input_rms = rms(np.concatenate([u[at] for u, at in zip(self.bench.measured, self.rows, strict=True)]))
            runs = zip(self.bench.runs, self.rows, self.bench.impacts, strict=True)
            apart = [np.abs(run.time_s[at][:, None] - np.append(hits, math.inf)) for run, at, hits in runs]
            nearest_s = np.concatenate([np.min(one, axis=1) for one in apart])  # of the impacts of a row's run
            noise = np.hypot(noise, input_rms * np.exp(-nearest_s / GUARD_S))
        return error_model(self.bench, self.rows, noise, self.share, self.noise, self.pulled, tension)

    def noisier(self, noise: float | Array) -> Problem:
        """The same campaign with further noise, rms in the band, of all samples or of each one, (inputs,), independent
        of its own."""
        beside = self._with(row_noise=np.hypot(self.row_noise, noise), noise=math.hypot(self.noise, rms(noise)))
        beside.errors = beside.errors_of_rows().sized(self.errors.sizes)
        return beside

    def with_model_error(self, sizes: Sizes) -> Problem:
        """The same campaign, weighed with a model error of other sizes (see `ErrorModel`)."""
        return self.weighed_by(self.errors.sized(sizes))

    def weighed_by(self, errors: ErrorModel) -> Problem:
        return self._with(errors=errors)

    def _with(self, **changed: Any) -> Problem:
        beside = copy(self)
        vars(beside).update(changed)
        return beside

    def moving_after(self, late_s: float) -> Problem:
        """The same campaign without the samples whose motion has ended in a log that shows it late_s too late: there
        the torque is that of standstill already, which no law of friction foretells. Itself where a run would keep too
        few, and beside a dead line's tension."""
        kept = []  # of each run's rows
        for run, at, moving in zip(self.bench.runs, self.rows, self.bench.moving, strict=True):
            then = np.searchsorted(run.time_s, run.time_s[at] + late_s)
            kept.append(moving[np.minimum(then, len(run.time_s) - 1)])
        if self.has_tension or not all(np.count_nonzero(some) > LEAST_KEPT * len(some) for some in kept):
            return self
        beside = self._with(rows=[at[some] for at, some in zip(self.rows, kept, strict=True)])
        beside.run_lengths = tuple(len(at) for at in beside.rows)
        beside.inputs = sum(beside.run_lengths)
        beside.run_of_row = np.repeat(np.arange(len(self.runs)), beside.run_lengths)
        beside.row_noise = self.row_noise[np.concatenate(kept)]
        beside.errors = beside.errors_of_rows().sized(self.errors.sizes)
        return beside

    def exact(self) -> Problem:
        """The same campaign, simulated at every sample of the logs."""
        return self._with(thin=False, kept={})

    def coarse(self, settings: Iterable[Setting]) -> Problem:
        """The same campaign simulated thin, itself where that would not do: a wave of the motor's turn passes between
        the samples."""
        if self.fine or max(self.bench.every) == 1 or any(key in self._turning for s in settings for key in s):
            return self
        return self._with(thin=True)

    def quick(self) -> Problem:
        """The same campaign, of which `linear` asks little."""
        return self._with(rough=self.fine)

    def linear(self, base: Setting, others: Sequence[Setting]) -> Array:
        """What each other setting adds to the residuals at `base`, for an estimate, (others, samples): where little is
        asked simulated thin, but for a wave that turns by more than a half from one of those samples to the next."""
        if not self.rough:
            return self.differences(base, others)[1]
        angles = [[np.max(s[key]) * angle for key, angle in self._wave_angles.items() if key in s] for s in others]
        change = self._with(thin=True, fine=False).differences(base, others)[1]
        change[[max(turned, default=0.0) * self._gone >= math.pi for turned in angles]] = math.nan
        if exact := np.flatnonzero(~np.all(np.isfinite(change), axis=1)).tolist():
            change[exact] = self.differences(base, [others[i] for i in exact])[1]
        return change

    def _time_s(self, j: int, thin: bool) -> Array:
        """The simulated times of run j."""
        return self.bench.times[j] if thin else self.runs[j].time_s

    @property
    def struck(self) -> bool:
        """Whether impacts of a play come again in the runs, and neither a lag of a sensor nor a wrong inertia has made
        them."""
        return not self.deaf and any(len(impacts) for impacts in self.bench.impacts)

    @property
    def ways(self) -> Array:
        """(2, runs) how far each run goes forward and back in what counts of it, m (rad)."""
        ways = np.zeros((2, len(self.runs)))
        for j, (run, motion, rows) in enumerate(zip(self.runs, self.bench.motions, self.rows, strict=True)):
            along = (motion.speed * np.gradient(run.time_s))[rows]
            ways[:, j] = np.sum(np.maximum(along, 0.0)), np.sum(np.maximum(-along, 0.0))
        return ways

    @property
    def squares(self) -> Array:
        """(runs,) the integral of the square of the speed over what counts of each run, m²/s (rad²/s)."""
        motions = zip(self.runs, self.bench.motions, self.rows, strict=True)
        return np.array([np.sum((motion.speed**2 * np.gradient(run.time_s))[rows]) for run, motion, rows in motions])

    def with_own(self, effects: Names) -> Problem:
        """The same campaign of a machine that has these effects of its own."""
        return self._with(own=effects, kept={})

    def without_impacts(self) -> Problem:
        """The same campaign, where something else explains what looked like impacts, as the kinks of a late signal."""
        beside = self._with(deaf=True)
        beside.errors = beside.errors_of_rows().sized(self.errors.sizes)
        return beside

    @property
    def samples(self) -> int:
        """The number of residuals."""
        return len(self.run_of_row)

    def residuals(self, settings: Sequence[Setting]) -> Array:
        """(settings, samples), in the input's unit. Each group's differences are noise-free, beside its first."""
        return np.concatenate([self._group(settings[k : k + GROUP]) for k in range(0, len(settings), GROUP)])

    def differences(self, base: Setting, others: Sequence[Setting], known: Array | None = None) -> tuple[Array, Array]:
        """Residuals at `base`, (samples,), and what each other setting adds to them, (others, samples). known: the
        former, where that is known."""
        if not len(others):
            return self._group([base])[0] if known is None else known, np.zeros((0, self.samples))
        # Those that need the same part of the model go together.
        order = np.argsort(self.bench.parts_needed(self.tables(others)), kind="stable")
        change = np.empty((len(others), self.samples))
        first = None
        for k in range(0, len(others), GROUP - 1):
            group = order[k : k + GROUP - 1]
            out = self._group([base, *(others[i] for i in group)], known)
            first = out[0] if first is None else first
            change[group] = out[1:] - out[0]
        assert first is not None
        return first, change

    def evaluate(
        self, free: Sequence[FreeParameter], z: Array, only: Iterable[int] | None = None, known: Array | None = None
    ) -> tuple[Array, Array]:
        """Residual (samples,), `known` where it is, and its Jacobian (samples, len(z), or those of `only`) by
        differences, at an upper bound inward."""
        which = list(range(len(z)) if only is None else only)
        steps = inward(free, z, np.concatenate([self._steps(parameter) for parameter in free]))
        moved = [setting_of(free, z + steps[k] * np.eye(len(z))[k]) for k in which]
        base, change = self.differences(setting_of(free, z), moved, known)
        return base, change.T / steps[which]

    def _steps(self, parameter: FreeParameter) -> Array:
        """Of each z of a parameter, for derivatives. What turns a wave over all of the way, or of the time, turns it at
        the end by no more than a phase's own step does."""
        if isinstance(parameter, Scalar) and parameter.symbol in (LOG_TIMING, self.late):
            return np.array(
                [max(LATE_STEP * self.runs[0].sample_time_s, LATE_OF_BAND / self.band_hz) / parameter.scale]
            )
        if isinstance(parameter, Scalar) and parameter.symbol in self._wave_angles:
            return np.array([STEP / max(self._wave_angles[parameter.symbol] * parameter.origin, 1.0)])
        return np.full(parameter.size, STEP)

    def _group(self, settings: Sequence[Setting], known: Array | None = None) -> Array:
        """Residuals of a few settings, (settings, samples). Where every sample counts, it does for the first one: by
        what the others differ from it is simulated thin, for it changes with the motion's finest parts by much less.
        known: the residual of the first one."""
        self.evaluations += 1
        if self.thin or len(settings) == 1 or self.coarse(settings) is self:
            found = self._simulated(settings, self.thin and not self.fine)
        else:
            found = self._simulated(settings, thin=True)
            if not np.all(np.isfinite(found)):  # longer steps have broken down
                return self._simulated(settings, thin=False)
            known = self._simulated(settings[:1], thin=False)[0] if known is None else known
        return found if known is None else found + (known - found[:1])

    def _simulated(self, settings: Sequence[Setting], thin: bool) -> Array:
        tables = self.tables(settings)
        said = dict(zip(SENSOR_KEYS, (*kind_of(self.machine).sensor_of(self.machine), 1.0), strict=True))
        gain, offset, tension_gain = (np.array([{**said, **s}[key] for s in settings], float) for key in SENSOR_KEYS)
        torque, tension = [], []
        for j, required in enumerate(self.bench.required(tables, thin)):
            rows, smooth = self.rows[j], self.smooth_at(j, thin)
            logged = smooth(self._logged(j, required[:, 0], tables[j], thin)) * gain + offset
            torque.append(self.bench.measured[j][rows, None] - logged)
            if j in self.tension:
                sets = [self._parameters(tables[j], i) for i in range(len(settings))]
                pulls = [self._tension(self._time_s(j, thin), required[:, 1:, i], p) for i, p in enumerate(sets)]
                logged = smooth(np.stack(pulls, axis=-1)) * tension_gain
                tension.append((self.tension[j][rows, None] - logged) * (self.noise / self.tension_noise))
        return np.concatenate([*torque, *tension]).T

    def _logged(self, j: int, required: Array, table: Array, thin: bool) -> Array:
        """(n, sets) of the true input -> of what the sensor shows: another where an effect on it is at work."""
        rows = [self.bench.row_of[symbol] for symbol in self._idle]
        at_work = np.flatnonzero(np.any(table[rows] != np.array(list(self._idle.values()))[:, None], axis=0))
        if not len(at_work):
            return required
        logged, time = required.copy(), self._time_s(j, thin)
        for i in at_work:
            logged[:, i] = logged_input(self.active, time, required[:, i], vars(self._parameters(table, int(i))))
        return logged

    def smooth_at(self, j: int, thin: bool = False) -> LowpassAt:
        """The low-pass of run j at its rows."""
        known = self._smooth.get((j, thin))
        if known is None or known[0] is not self.rows[j]:
            at = self.rows[j] / self.bench.every[j] if thin else self.rows[j]
            known = self._smooth[j, thin] = self.rows[j], LowpassAt(self._time_s(j, thin), self.band_hz, at)
        return known[1]

    def _parameters(self, table: Array, i: int) -> SimpleNamespace:
        """One set of a run's table, by symbol."""
        return SimpleNamespace(**dict(zip(self.bench.symbols, table[:, i].tolist(), strict=True)))

    def tables(self, settings: Sequence[Setting]) -> list[Array]:
        """Each run's parameters (symbols, settings)."""
        row_of, tables = self.bench.row_of, np.repeat(self.bench.table[:, :, None], len(settings), axis=2)
        for i, setting in enumerate(settings):
            for symbol, value in setting.items():
                if symbol not in SENSOR_KEYS and symbol != LOG_TIMING:
                    tables[:, row_of[symbol], i] = value
            # Added, so that an effect's delay is weighed from none at all, which is beside what is known of the log.
            known = self.machine.log.speed_late_s if self.late in setting else 0.0
            tables[:, row_of[self.late], i] += np.add(known, setting.get(LOG_TIMING, 0.0))
        return list(tables)

    def _tension(self, time_s: Array, states: Array, p: SimpleNamespace) -> Array:
        """The dead line's tension (n,) that goes with the driven states."""
        line = kind_of(self.machine).dead_line
        assert line is not None
        return np.asarray(line.force(time_s, states, p, self.bench.model.effects))


def as_slow_as_serves(runs: Sequence[Run], band_hz: float | None = None) -> tuple[Run, ...]:
    """The runs, where they hold more than MOST_SAMPLES as slower loggers show them, at LEAST_RATE_HZ or more, and fast
    enough for a band that is asked for."""
    many = math.ceil(sum(len(run.time_s) for run in runs) / MOST_SAMPLES)
    least = max(LEAST_RATE_HZ, (band_hz or 0.0) / SAMPLING_SHARE)
    return tuple(averaged(run, min(many, int(1.0 / (least * run.sample_time_s) + 1e-6))) for run in runs)


def counting(problem: Problem) -> int:
    """The number of runs of which anything counts: that move, in the band."""
    return len(np.unique(problem.run_of_row))


def once(problem: Problem, asked: Any, find: Callable[[], Found]) -> Found:
    """What `find` gives, computed once and kept. asked: what it hangs on."""
    if asked not in problem.kept:
        problem.kept[asked] = find()
    found: Found = problem.kept[asked]
    return found
