"""Tables of a force over one variable: fitted beside the base parameters, judged on runs left out, then driven.

A table is a force against the motion at the place where it acts, a level for each direction, linear between the points,
as `measured_correction` has it. It is fitted with the machine taken as stiff; the driven simulation adds the effect of
the wire, of rests and of a file's rounding.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import (  # fmt: skip
    GAIN,
    TENSION_GAIN,
    Setting,
    base_parameters,
    bounds_of,
    setting_of,
)
from workbench.diagnose.hypotheses.held_out import HeldOut, folds_by_run
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.survey import of_run
from workbench.diagnose.machines import refitted_machine
from workbench.machines import Axis, Hoist, Table, kind_of, with_correction
from workbench.simulate.driven import changed, sensor

TURN = 2.0 * math.pi
POINTS, POINTS_OF_A_TURN = 17, 16
SPREAD = 0.02  # of the largest payload: payloads nearer than that are one


@dataclass(frozen=True)
class Curve:
    """An unknown cause's force over what explains it best: the residual at the place it acts on, by direction."""

    over: str
    acts_on: str
    at: Array
    forward: Array
    backward: Array
    std_forward: Array
    std_backward: Array
    explains: float


@dataclass(frozen=True)
class Ride:
    """One run. at: variable -> (n,). way: part -> direction of motion of guide and motor (or axis), -1 to 1, (n,)."""

    at: Mapping[str, Array]
    way: Mapping[str, Array]


def variables_of(problem: Problem) -> tuple[Table, ...]:
    """The variables that a table can be over in this campaign."""
    starts = {run.start_time_s for run in problem.runs}
    payloads = [run.payload_kg for run in problem.runs]
    without = set()
    if len(starts) == 1:
        without.add("campaign_time_s")
    if max(payloads) - min(payloads) <= SPREAD * max(payloads):
        without.add("payload_kg")
    return tuple(variable for variable in kind_of(problem.machine).tables if variable.over not in without)


def rides_of(problem: Problem, setting: Setting) -> list[Ride]:
    """All runs, simulated with the machine of these values."""
    bench = problem.bench
    chosen = [of_run(bench.base[j], setting, j) for j in range(len(problem.runs))]
    predicted = bench.predict([chosen])[0]
    kind, rides = kind_of(problem.machine), []
    for run, motion, (force, others), p in zip(problem.runs, bench.motions, predicted, chosen, strict=True):
        frame = kind.frame(run, motion.position, motion.speed, others, p)
        frame.load, _ = kind.transmitted(p, frame, force, motion.acceleration, run.payload_kg)
        here = changed(p, {"start_time_s": run.start_time_s - run.time_s[0]})
        at = {table.over: np.broadcast_to(table.of(frame, here), run.time_s.shape) for table in kind.tables}
        turned = {table.over: at[table.over] % TURN for table in kind.tables if table.turn}
        way = {acts_on: port.way(frame, here) for acts_on, port in kind.ports.items()}
        rides.append(Ride({**at, **turned}, way))
    return rides


def points_of(problem: Problem, rides: Sequence[Ride], variable: Table) -> Array:
    """The points of a table: evenly over the range of the runs; for the payload, the payloads of the runs."""
    if variable.turn:
        return np.linspace(0.0, TURN, POINTS_OF_A_TURN, endpoint=False, dtype=np.float64)
    if variable.over == "payload_kg":
        payloads = sorted({run.payload_kg for run in problem.runs})
        apart = [payloads[0]]
        apart += [b for b in payloads[1:] if b - apart[-1] > SPREAD * payloads[-1]]
        return np.array(apart if len(apart) > 2 else [apart[0], 0.5 * (apart[0] + apart[-1]), apart[-1]])[:POINTS]
    visited = [ride.at[variable.over][rows] for ride, rows in zip(rides, problem.rows, strict=True)]
    every = np.concatenate(visited)
    low, high = float(np.min(every)), float(np.max(every))
    return np.linspace(low, high, POINTS, dtype=np.float64)


def columns_of(problem: Problem, rides: Sequence[Ride], variable: Table, at: Array, gain: float) -> Array:
    """(samples, 2 points) the change of the prediction by a level of one: first all forward, then all backward."""
    input_gain = gain * lever_of(problem.machine, variable.acts_on)
    torque, tension = [], []
    for j, ride in enumerate(rides):
        way = ride.way[variable.acts_on]
        hats = hats_of(ride.at[variable.over], at, variable.turn)
        levels = np.hstack([hats * np.maximum(way, 0.0)[:, None], hats * np.minimum(way, 0.0)[:, None]])
        smooth = problem.smooth_at(j)(levels)
        torque.append(input_gain * smooth)
        if j in problem.tension:
            share = kind_of(problem.machine).ports[variable.acts_on].share
            tension.append(share * problem.noise / problem.tension_noise * smooth)
    return np.concatenate([*torque, *tension])


def hats_of(x: Array, at: Array, turn: bool) -> Array:
    """(n, points) the weight of each point at x: linear between points, constant beyond the ends."""
    if turn:
        closed = np.append(at, at[0] + TURN)
        x = at[0] + (x - at[0]) % TURN
    else:
        closed, x = at, np.clip(x, at[0], at[-1])
    k = np.clip(np.searchsorted(closed, x, side="right") - 1, 0, len(closed) - 2)
    share = (x - closed[k]) / (closed[k + 1] - closed[k])
    hats = np.zeros((len(x), len(at)))
    rows = np.arange(len(x))
    hats[rows, k] = 1.0 - share
    hats[rows, (k + 1) % len(at)] += share
    return hats


def gain_of(problem: Problem, setting: Setting) -> float:
    """The logged input over the true one."""
    value = setting.get(GAIN, sensor(problem.machine)[0])
    return value if isinstance(value, float) else float(np.mean(value))


def lever_of(machine: Hoist | Axis, acts_on: str) -> float:
    """Input that a force (torque) at a place takes on a stiff machine: m/rad, or 1."""
    kind = kind_of(machine)
    return kind.transmission_of(machine) if kind.ports[acts_on].on_moved else 1.0


BENDS = (0.03, 0.1, 0.3, 1.0)  # of the table's size: how far a level may lie off the line between its neighbours
LOOSE = 2.0  # of the table's size: how far a level may lie off zero
NEARLY = 1.05  # of the least that is left: the smoothest table within it is taken
CAREFUL = 0.5  # of a logarithmic base parameter: how far one step may lead


@dataclass(frozen=True)
class TableFit:
    """levels: (2 points,) forward, then backward; z: (base,) the fit's numbers that go with them.

    std: of levels, by leaving out one run after the other. before, after: (groups,) sums of squares of the
    input's residual on what was left out, without and with the table; noise: the noise's. bend: the
    smoothness taken. others: (groups, base + 2 points) z and levels fitted without each group.
    """

    levels: Array
    z: Array
    std: Array
    before: Array
    after: Array
    noise: Array
    bend: float
    others: Array

    @property
    def explains(self) -> float:
        """Share of the residual's energy above the noise that the table takes away where it was not fitted."""
        gap = float(np.sum(self.before - self.noise))
        return float(np.sum(self.before - self.after)) / gap if gap > 0.0 else 0.0


class TableFitter:
    """Tables beside the base parameters, from the nominal machine on, against the base parameters' own fit.

    From the nominal machine, since that fit may be far away from where the base parameters belong: it has bent
    them as far as the data wanted, friction's turn at standstill by orders of magnitude.
    """

    def __init__(self, problem: Problem, fitted: Fitted) -> None:
        self.problem, self.fitted = problem, fitted
        _, _, self.std = bounds_of(fitted.free)
        self.groups = folds_by_run(problem)
        self.count = int(self.groups.max()) + 1
        self.careful = np.concatenate(
            [np.full(len(parameter.lowest), bool(parameter.logarithmic)) for parameter in fitted.free]
        )
        self.move_to(np.zeros(len(fitted.z)))
        self.before = self._alone()

    def move_to(self, z: Array) -> None:
        """Linearise at other base values."""
        self.z = z
        self.residual, self.jacobian = self.problem.evaluate(self.fitted.free, z)

    def left(self, columns: Array, fit: TableFit) -> Array:
        """(samples,) the residual with a table, linearised."""
        return self.residual + self.jacobian @ (fit.z - self.z) - columns @ fit.levels

    def _alone(self) -> Array:
        """(groups,) sums of squares of the input's residual, with the base parameters fitted without that group."""
        r, x = self.fitted.residual, -self.fitted.jacobian
        hold = np.diag(1.0 / self.std**2)
        normal, right = self._normal(x, r)
        costs = []
        for g in range(self.count):
            step = np.linalg.solve(normal.sum(0) - normal[g] + hold, right.sum(0) - right[g] - hold @ self.fitted.z)
            rows = np.flatnonzero(self.groups[: self.problem.inputs] == g)
            costs.append(float(np.sum((r[rows] - x[rows] @ step) ** 2)))
        return np.array(costs)

    def fit(
        self, at: Array, columns: Array, turn: bool, lever: float, levels: Array | None = None, z: Array | None = None,
        residual: Array | None = None, bend: float | None = None,
    ) -> TableFit:  # fmt: skip
        """at: (points,). columns: (samples, 2 points). lever: input over force, so that sizes are right.

        levels, z, residual: the state of a driven simulation with a table; without a table by default.
        bend: the smoothness; by default chosen on the groups held out.
        """
        z = self.z if z is None else z
        residual = self.residual if residual is None else residual
        state = np.concatenate([z, np.zeros(columns.shape[1]) if levels is None else levels])
        x, base = np.hstack([-self.jacobian, columns]), len(z)
        normal, right = self._normal(x, residual)
        size, of_group = self.fitted.rms(self.problem.inputs) / lever, self.groups[: self.problem.inputs]
        noise = np.asarray(np.bincount(of_group, minlength=self.count) * self.problem.noise**2, dtype=float)

        def solved(bend: float) -> TableFit:
            hold = np.zeros((len(state),) * 2)
            hold[:base, :base] = np.diag(1.0 / self.std**2)
            hold[base:, base:] = _smooth(at, turn, bend * size, LOOSE * size)
            pull = hold @ state
            fitted = state + self._step(normal.sum(0) + hold, right.sum(0) - pull)
            after, others = [], []
            for g in range(self.count):
                without = self._step(normal.sum(0) - normal[g] + hold, right.sum(0) - right[g] - pull)
                rows = np.flatnonzero(of_group == g)
                after.append(float(np.sum((residual[rows] - x[rows] @ without) ** 2)))
                others.append(state + without)
            spread = np.array(others)[:, base:] - np.mean(others, axis=0)[base:]
            std = np.sqrt((self.count - 1) / self.count * np.sum(spread**2, axis=0))
            return TableFit(
                fitted[base:], fitted[:base], std, self.before, np.array(after), noise, bend, np.array(others)
            )

        fits = [solved(allowed) for allowed in (BENDS if bend is None else (bend,))]
        least = min(float(fit.after.sum()) for fit in fits)
        return next(fit for fit in fits if fit.after.sum() <= NEARLY * least)

    def _normal(self, x: Array, residual: Array) -> tuple[Array, Array]:
        """(groups, k, k) and (groups, k), of whitened rows."""
        white = self.problem.errors.whiten(np.column_stack([x, residual]))
        parts = [white[self.groups == g] for g in range(self.count)]
        return np.array([p[:, :-1].T @ p[:, :-1] for p in parts]), np.array([p[:, :-1].T @ p[:, -1] for p in parts])

    def _step(self, normal: Array, right: Array) -> Array:
        """The least-squares step. Logarithmic parameters move by CAREFUL at most; the others are refitted to that."""
        step = np.linalg.solve(normal, right)
        far = np.flatnonzero(self.careful & (np.abs(step[: len(self.careful)]) > CAREFUL))
        if len(far):
            free = np.setdiff1d(np.arange(len(step)), far)
            step[far] = np.sign(step[far]) * CAREFUL
            step[free] = np.linalg.solve(
                normal[np.ix_(free, free)], right[free] - normal[np.ix_(free, far)] @ step[far]
            )
        return np.asarray(step, dtype=float)


def _smooth(at: Array, turn: bool, bend: float, size: float) -> Array:
    """The penalty on the levels of both directions: the distance from the line of their neighbours over `bend`, and the
    distance from zero over `size`."""
    m = len(at)
    rows = []
    for k in range(m) if turn else range(1, m - 1):
        before, after = at[k] - at[k - 1], at[(k + 1) % m] - at[k]
        if turn:
            before, after = before % TURN, after % TURN
        # The kink over the shorter step: the second difference where the steps are alike.
        step = min(before, after)
        row = np.zeros(m)
        row[k - 1] += step / before
        row[(k + 1) % m] += step / after
        row[k] -= step / before + step / after
        rows.append(row)
    second = np.array(rows).reshape(-1, m)
    both = np.kron(np.eye(2), second.T @ second / bend**2 + np.eye(m) / size**2)
    return np.asarray(both, dtype=float)


def telling_points(at: Array, levels: Array, most: int) -> Array:
    """Up to `most` of the points `at`, (n,), such that lines between them follow `levels`, (2 n,), most closely."""
    curves = levels.reshape(2, -1)
    kept = [0, len(at) - 1]
    while len(kept) < most:
        order = np.sort(kept)
        off = np.max([np.abs(curve - np.interp(at, at[order], curve[order])) for curve in curves], axis=0)
        off[kept] = -1.0
        kept.append(int(np.argmax(off)))
    return at[np.sort(kept)]


ROUNDS = 4  # driven simulations with the table, at most
WORTH_ANOTHER = 0.97  # of the rms before: a round that gains less is the last
FINER = 3  # times as many points to choose from
WORTH_REFINING = 0.9  # of what is left: points of their own choice have to earn their place
LEVEL_DIGITS, POINT_DIGITS = 6, 8  # of the numbers in a file

AnyMachine = TypeVar("AnyMachine", bound=Hoist | Axis)


@dataclass(frozen=True, eq=False)
class Tried:
    """A table over one variable, fitted linearly. lever: input over force."""

    variable: Table
    at: Array
    columns: Array
    lever: float
    fit: TableFit

    @property
    def left(self) -> float:
        """The sum of squares of its residual on the groups held out."""
        return float(self.fit.after.sum())

    def curve(self, levels: Array | None = None) -> Curve:
        levels = self.fit.levels if levels is None else levels
        m, std = len(self.at), self.fit.std
        return Curve(
            self.variable.over, self.variable.acts_on, self.at,
            levels[:m], levels[m:], std[:m], std[m:], self.fit.explains,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Driven:
    """A table in the driven simulation. last: the linear fit there; fitted: the base values fitted with the table."""

    tried: Tried
    last: TableFit
    fitted: Fitted
    rms: float

    @property
    def curve(self) -> Curve:
        return self.tried.curve(self.last.levels)


def with_table(machine: AnyMachine, curve: Curve) -> AnyMachine:
    """The machine with the curve as its measured correction, rounded as a file has it."""
    at = [_rounded(x, POINT_DIGITS) for x in curve.at]
    forward, backward = ([_rounded(x, LEVEL_DIGITS) for x in levels] for levels in (curve.forward, curve.backward))
    return with_correction(machine, curve.over, curve.acts_on, at, forward, backward)


class Tables:
    """One campaign's tables, from the nominal machine on; `base` is the base parameters' own fit."""

    def __init__(self, problem: Problem, base: Fitted) -> None:
        self.problem, self.base = problem, base
        self.keys = base_parameters(problem.machine, problem.logged)
        self.fitter = TableFitter(problem, base)
        nominal = setting_of(base.free, self.fitter.z)
        self.rides, self.gain = rides_of(problem, nominal), gain_of(problem, nominal)

    def linear(self, variable: Table, at: Array | None = None) -> Tried:
        at = points_of(self.problem, self.rides, variable) if at is None else at
        columns = columns_of(self.problem, self.rides, variable, at, self.gain)
        lever = self.gain * lever_of(self.problem.machine, variable.acts_on)
        return Tried(variable, at, columns, lever, self.fitter.fit(at, columns, variable.turn, lever))

    def refined(self, tried: Tried) -> Tried:
        """The table with its points moved: close together at a step, far apart on a line. Unchanged if not better."""
        if tried.variable.turn or tried.variable.over == "payload_kg":
            return tried
        fine = np.linspace(tried.at[0], tried.at[-1], FINER * (len(tried.at) - 1) + 1)
        again = self.linear(
            tried.variable, telling_points(fine, self.linear(tried.variable, fine).fit.levels, len(tried.at))
        )
        return again if again.left < WORTH_REFINING * tried.left else tried

    def driven(self, tried: Tried) -> Driven:
        """The table in the driven simulation, refitted while that leaves more than the stiff machine did."""
        problem, variable, at = self.problem, tried.variable, tried.at
        lowest, highest, _ = bounds_of(self.base.free)
        fitter = TableFitter(problem, self.base)
        fit, columns, best = tried.fit, tried.columns, None
        for _ in range(ROUNDS):
            fitted = replace(self.base, z=np.clip(fit.z, lowest, highest))
            rows = self._residual(fitted.setting, tried.curve(fit.levels))
            rms = float(np.sqrt(np.mean(rows[: problem.inputs] ** 2)))
            enough = best is not None and rms > WORTH_ANOTHER * best.rms
            if best is None or rms < best.rms:
                best = Driven(tried, fit, replace(fitted, residual=rows), rms)
            if enough:
                break
            fitter.move_to(fitted.z)
            setting = fitted.setting
            columns = columns_of(problem, rides_of(problem, setting), variable, at, gain_of(problem, setting))
            fit = fitter.fit(at, columns, variable.turn, tried.lever, fit.levels, fitted.z, rows, tried.fit.bend)
        assert best is not None
        return best

    def held_out(self, driven: Driven) -> tuple[HeldOut, tuple[Hoist | Axis, ...]]:
        """Each fold driven with table and base values fitted without it; and the machines, one for each fold."""
        problem, base = self.problem, len(self.base.z)
        lowest, highest, _ = bounds_of(self.base.free)
        residual, settings, machines = np.array(driven.fitted.residual), [], []
        for fold, other in enumerate(driven.last.others):
            fitted = replace(self.base, z=np.clip(other[:base], lowest, highest))
            curve = driven.tried.curve(other[base:])
            rows = self.fitter.groups == fold
            residual[rows] = self._residual(fitted.setting, curve)[rows]
            settings.append(fitted.setting)
            machines.append(with_table(refitted_machine(problem, self.keys, fitted), curve))
        return HeldOut(residual, self.fitter.groups, tuple(settings)), tuple(machines)

    def _residual(self, setting: Setting, curve: Curve) -> Array:
        """(samples,) measured minus predicted, of a machine as a file says it, beside what no file holds."""
        problem = self.problem
        machine = with_table(refitted_machine(problem, self.keys, setting), curve)
        thin = Problem(machine, problem.runs, problem.band_hz)
        with_it = thin if problem.thin else thin.exact()
        with_it.rows, with_it.noise = problem.rows, problem.noise  # the tension's rows are scaled by the noise
        in_no_file = {symbol: value for symbol, value in setting.items() if symbol == TENSION_GAIN}
        return with_it.residuals([in_no_file])[0]


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")
