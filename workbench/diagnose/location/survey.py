"""The data for the location of a gap: the residual of the base parameters, the course of each run, the drive's loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from workbench.core.run import Array, integrated
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import Setting, bounds_of
from workbench.diagnose.hypotheses.problem import Problem
from workbench.machines import kind_of
from workbench.simulate.driven import changed
from workbench.simulate.lowpass import lowpass
from workbench.simulate.model_error import ErrorModel

BLOCK = 2.0  # periods of the band: over so long a time what is left is averaged to see how it hangs together
MOST, NORMAL = 0.9, 1.645  # of the blocks: what a few of them leave may be an event; the same of a normal distribution
HUBER, ROUNDS = 1.5, 15
FREE = 10.0  # of what is left: how far the law may be put right beside a port


@dataclass(frozen=True)
class Loop:
    """Rows in the order of the input's. residual: (inputs,) logged input less the loop's. columns: (inputs, k) of the
    law, as far as it is open. noise: of a row taken as independent of the others."""

    residual: Array
    columns: Array
    noise: float


def loop_of(problem: Problem) -> Loop | None:
    """Whether the drive's control loop asked for the logged input: a test for errors of the input's sensor.

    A force on the machine disturbs the motion, and the loop answers it: the input follows the control error. An error
    of the input's sensor disturbs nothing. With the reference logged, the input of a linear loop is

        u + k₀ u̇ = k₁ e + k₂ ∫e dt + k₃ ∫∫e dt² + k₄ ė + k₅ r + k₆ ṙ + k₇ r̈ + c + d t,   e = r − y

    for any gains and any delay; c and d belong to each run (weight, drift). The residual of this fit is the sensor's
    error, unless the loop is not linear: then it is large everywhere and carries little weight. None if a run lacks
    the reference or the signal that follows it.
    """
    reference, follows = kind_of(problem.machine).reference
    if not all(reference in run and follows in run for run in problem.bench.runs):
        return None
    shared, own, inputs = [], [], []
    for j, (run, rows) in enumerate(zip(problem.bench.runs, problem.rows, strict=True)):
        t, r = run.time_s, run[reference]
        law = _law(t, problem.bench.measured[j], r, r - run[follows], problem.band_hz)
        inputs.append(problem.bench.measured[j][rows])
        shared.append(law[rows])
        line = np.zeros((len(rows), 2 * len(problem.runs)))
        line[:, 2 * j], line[:, 2 * j + 1] = 1.0, (t[rows] - t[0]) / max(float(np.ptp(t)), 1e-300)
        own.append(line)
    u, columns = np.concatenate(inputs), np.hstack([np.concatenate(shared), np.concatenate(own)])
    columns = columns / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
    residual = u - columns @ _robust(columns, u)
    noise = _independent(problem, residual)
    return Loop(residual, columns * FREE * noise, noise)


def _law(t: Array, u: Array, r: Array, e: Array, band_hz: float) -> Array:
    once = integrated(e, t)
    rate = np.gradient(lowpass(t, r, 2.0 * band_hz), t)
    every = np.stack([e, once, integrated(once, t), np.gradient(e, t), r, rate, np.gradient(rate, t)], axis=1)
    return np.column_stack([np.gradient(u, t), lowpass(t, every, band_hz)])


def _robust(columns: Array, y: Array) -> Array:
    """P. J. Huber, Robust Statistics, 1981, 7.3."""
    weights: Array = np.ones(len(y))
    z: Array = np.zeros(columns.shape[1])
    for _ in range(ROUNDS):
        root = np.sqrt(weights)[:, None]
        z = np.asarray(np.linalg.lstsq(columns * root, y * root[:, 0], rcond=1e-9)[0], dtype=float)
        left = np.abs(y - columns @ z)
        scale = max(1.4826 * float(np.median(left)), 1e-300)
        weights = np.asarray(np.minimum(1.0, HUBER * scale / np.maximum(left, 1e-300)), dtype=float)
    return np.asarray(z, dtype=float)


def _independent(problem: Problem, residual: Array) -> float:
    """The standard deviation of a row that would give the observed scatter of block means if rows were independent."""
    means, lengths, at = [], [], 0
    for run, rows in zip(problem.bench.runs, problem.rows, strict=True):
        mine, t = residual[at : at + len(rows)], run.time_s[rows]
        at += len(rows)
        if not len(rows):
            continue
        block = ((t - t[0]) * problem.band_hz / BLOCK).astype(int)
        counts = np.bincount(block)
        full = counts > 0.5 * counts.max()
        means.append((np.bincount(block, mine)[full]) / counts[full])
        lengths.append(counts[full])
    every = float(np.quantile(np.abs(np.concatenate(means) * np.sqrt(np.concatenate(lengths))), MOST)) / NORMAL
    return max(every, problem.noise)


OVERSAMPLED = 16.0  # samples to a period of the band: what is folded over at standstill is sharper than the band
TURN = 2.0 * np.pi
RESTING = 0.01  # of the fastest speed
LOUD = 4.0  # of the input's noise: a loop that leaves no more is as good as linear


@dataclass(frozen=True)
class Course:
    """One run, simulated with the fitted machine and thinned: all arrays (n,), SI.

    way: sign of the speed of carriage (axis), turning over as its friction does. speed, acceleration, position:
    of carriage (axis). turn, turn_rate: of the motor (axis), rad (m). torque: the input that the motion takes; carried:
    of it, what goes through the gearbox to the load; since_start: s since the machine last came out of rest.
    mass: of carriage and payload, kg. at: (rows,) s, of the residual's rows.
    """

    time: Array
    at: Array
    way: Array
    speed: Array
    acceleration: Array
    position: Array
    turn: Array
    turn_rate: Array
    turn_acceleration: Array
    torque: Array
    carried: Array
    since_start: Array
    start_time_s: float
    payload: float
    mass: float


@dataclass(frozen=True)
class Survey:
    """residual: (samples,) measured minus predicted at the nominal machine, linearised. base: (samples, m) the change
    of the prediction by each base parameter, for one standard deviation of its tolerance.

    noise: rms of a row; errors: noise and discrepancy, as the rows are weighed. runs: the courses. inputs: rows of the
    input; behind them those of the dead line's tension, on the input's scale, where a force counts `felt` times; then,
    with `loop`, those of the drive's loop, where only an error of the input's sensor shows.
    lever: input over force at the carriage, of a stiff machine. turns: name -> rad of it per rad of the motor.
    """

    residual: Array
    base: Array
    noise: float
    errors: ErrorModel
    runs: tuple[Course, ...]
    run_of_row: np.ndarray
    inputs: int
    pulled: np.ndarray
    felt: float
    loop: bool
    lever: float
    gravity: float
    band_hz: float
    hoist: bool
    turns: Mapping[str, float]

    @property
    def left(self) -> Array:
        """(samples,) the residual after a linear refit of the base parameters within their tolerances."""
        white = self.errors.whiten(np.column_stack([self.base, self.residual]))
        a, y = white[:, :-1], white[:, -1]
        z = np.linalg.solve(a.T @ a + np.eye(a.shape[1]), a.T @ y)
        return np.asarray(self.residual - self.base @ z, dtype=float)

    def shown(self, rows: Array, pull: float, sensed: bool) -> Array:
        """(inputs, k) of an input -> (samples, k): its effect on all logged signals.

        pull: of the dead line's tension, +1 for a force on the carriage. sensed: whether the input's sensor alone
        has it.
        """
        parts = [rows]
        if self.felt:
            parts.append(pull * self.felt * 0.5 / self.lever * rows[self.pulled])
        if self.loop:
            parts.append(rows * float(sensed))
        return np.vstack(parts)


def survey_of(problem: Problem, fit: Fitted, own: int | None = None) -> Survey:
    """fit: the base parameters' own, within their tolerances. own: how many of its first z are theirs, None for all;
    the others, of the effects it names, stay as fitted."""
    _, _, std = bounds_of(fit.free)
    held = np.array([bool(k.logarithmic) for k in fit.free for _ in k.lowest])
    if own is not None:
        held[own:] = True
    # What nobody knows (a factor, either way) is looked at from where the fit put it; the rest from its nominal value.
    back = np.where(held, 0.0, fit.z)
    usual = np.where(np.isfinite(std), std, 1.0)
    kind, machine = kind_of(problem.machine), problem.machine
    lever = kind.transmission_of(machine)
    turns = {part.part: TURN * part.turns_per_displacement(machine) * lever for part in kind.turning}
    felt = 0.0
    if problem.has_tension:
        felt = problem.noise / problem.tension_noise
    setting = fit.setting
    residual, base, errors = fit.residual - fit.jacobian @ back, -fit.jacobian * usual, problem.errors
    loop = loop_of(problem)
    gap = float(np.sqrt(np.mean(residual[: problem.inputs] ** 2)))
    if loop is not None and loop.noise > max(gap, LOUD * problem.noise):
        loop = None  # its law leaves more than the gap itself, for it is not linear: it says nothing of the gap
    if loop is not None:
        residual, base, errors = _with_loop(loop, residual, base, errors)
    return Survey(
        residual=residual,
        base=base,
        noise=problem.noise,
        errors=errors,
        runs=tuple(courses_of(problem, setting)),
        run_of_row=np.asarray(problem.run_of_row),
        inputs=problem.inputs,
        pulled=problem.pulled,
        felt=felt,
        loop=loop is not None,
        lever=lever,
        gravity=kind.gravity(machine),
        band_hz=problem.band_hz,
        hoist=not kind.whole,
        turns=turns,
    )


def _with_loop(loop: Loop, residual: Array, base: Array, errors: ErrorModel) -> tuple[Array, Array, ErrorModel]:
    """The loop's rows behind the others: its law is open there, the machine's base parameters show nothing."""
    n, k = len(loop.residual), loop.columns.shape[1]
    below = np.hstack([np.zeros((n, base.shape[1])), loop.columns])
    base = np.vstack([np.hstack([base, np.zeros((len(base), k))]), below])
    errors = ErrorModel(
        np.concatenate([errors.white, np.full(n, loop.noise)]),
        np.concatenate([errors.moving, errors.moving[:n]]),
        np.concatenate([errors.standstill, errors.standstill[:n]]),
        np.concatenate([errors.carry, errors.carry[:n]]),
        errors.sizes,
    )
    return np.concatenate([residual, loop.residual]), base, errors


def courses_of(problem: Problem, setting: Setting) -> list[Course]:
    """Every run as a machine of these values goes through it."""
    bench = problem.bench
    values = [of_run(bench.base[j], setting, j) for j in range(len(problem.runs))]
    predicted = bench.predict([values])[0]
    return [_course(problem, j, values[j], *predicted[j]) for j in range(len(problem.runs))]


def _course(problem: Problem, j: int, p, torque: Array, states: Array) -> Course:  # type: ignore[no-untyped-def]
    bench, run = problem.bench, problem.bench.runs[j]
    motion, t, band = bench.motions[j], run.time_s, problem.band_hz
    stride = max(1, int(1.0 / (OVERSAMPLED * band * run.sample_time_s)))
    smooth = lowpass(t, np.stack([motion.speed, torque], axis=1), 2.0 * band)
    alpha = np.gradient(smooth[:, 0], t)
    kind = kind_of(problem.machine)
    here = kind.frame(run, motion.position, smooth[:, 0] if kind.moved.placed_by_log else motion.speed, states, p)
    port = next(iter(kind.ports.values()))  # where what moves rubs
    way = port.way(here, p)
    acceleration = alpha if kind.moved.placed_by_log else np.gradient(lowpass(t, here.v, 2.0 * band), t)
    carried, mass = kind.transmitted(p, here, smooth[:, 1], alpha, run.payload_kg)
    cut = slice(None, None, stride)
    return Course(
        time=t[cut], at=t[problem.rows[j]], way=way[cut], speed=here.v[cut], acceleration=acceleration[cut],
        position=here.x[cut], turn=here.angle[cut], turn_rate=smooth[cut, 0], turn_acceleration=alpha[cut],
        torque=smooth[cut, 1], carried=np.broadcast_to(carried, t.shape)[cut],
        since_start=_since_start(t, motion.speed)[cut], start_time_s=run.start_time_s - float(t[0]),
        payload=float(run.payload_kg), mass=float(mass),
    )  # fmt: skip


def _since_start(t: Array, speed: Array) -> Array:
    """(n,) s since the machine last came out of rest, 0 where it rests; from the run's beginning before that."""
    going = np.abs(speed) > RESTING * np.max(np.abs(speed))
    begins = np.flatnonzero(np.diff(np.concatenate([[False], going]).astype(int)) == 1)
    if not len(begins):
        return np.asarray(t - t[0])
    which = np.clip(np.searchsorted(begins, np.arange(len(t)), side="right") - 1, 0, None)
    return np.maximum(t - t[begins][which], 0.0)


def since_reversal(c: Course) -> Array:
    """(n,) m (rad): how far it went since it last turned round."""
    gone = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(c.position)))])
    turned = np.concatenate([[True], np.diff(c.speed > 0.0)])
    return np.asarray(gone - np.maximum.accumulate(np.where(turned, gone, 0.0)), dtype=float)


def of_run(base: SimpleNamespace, setting: Setting, j: int) -> SimpleNamespace:
    """Run j's parameters; what belongs to the sensors stays out."""
    known = {key: value for key, value in setting.items() if hasattr(base, key)}
    return changed(base, {key: value[j] if isinstance(value, tuple) else value for key, value in known.items()})


def at_rows(survey: Survey, columns: Sequence[Array]) -> Array:
    """Each run's columns, (n, k), low-passed as the residual is, at its rows: (inputs, k)."""
    return np.concatenate([smooth_at(c, x, survey.band_hz) for c, x in zip(survey.runs, columns, strict=True)])


def smooth_at(course: Course, columns: Array, band_hz: float) -> Array:
    """A run's columns, (n, k), low-passed as the residual is, at its rows."""
    out = lowpass(course.time, columns, band_hz)
    right = np.clip(np.searchsorted(course.time, course.at), 1, len(course.time) - 1)
    left = right - 1
    share = ((course.at - course.time[left]) / (course.time[right] - course.time[left]))[:, None]
    return np.asarray((1.0 - share) * out[left] + share * out[right], dtype=float)
