"""The variables that the gap may depend on, and the share of it that a function of each explains on held-out runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.problem import Problem, counting
from workbench.identify.fit import bounded
from workbench.machines import kind_of
from workbench.simulate.driven import InverseSimulation
from workbench.simulate.lowpass import lowpass


@dataclass(frozen=True)
class Profile:
    """The gap over one variable: in each bin its mean and rms, N m (N), and its share of the energy.

    edges: (k + 1,); mean_forward, mean_backward, share: (k,), NaN where nothing lies; over frequency there is no mean,
    and share is what the best single wave of a bin takes of the energy. explains: share of the gap's energy that a
    function of this variable (and direction) takes away; interval: of it, 90 %, over runs.
    """

    variable: str
    label: str
    unit: str
    regime: str
    edges: Array
    mean_forward: Array
    mean_backward: Array
    share: Array
    explains: float
    interval: tuple[float, float]


TURN = 2.0 * math.pi
TURNS = 1.5  # passed at least: within one turn an angle is a height and no more
SPEED_EDGES = (0.0, 0.02, 0.05, 0.09, 0.14, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0)  # of the fastest: finer where it creeps
START_EDGES = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 13.0)  # periods of the band since the start of a motion


@dataclass(frozen=True)
class Variable:
    """at: (inputs,) its value at every residual of the input. edges: (k + 1,) of its bins.

    wraps: the last bin joins the first, a turn. straight: few values only, with straight lines between them.
    """

    name: str
    label: str
    unit: str
    regime: str
    at: Array
    edges: Array
    wraps: bool = False
    straight: bool = False


def variables(problem: Problem, gap: Array | None = None) -> list[Variable]:
    """All variables that these runs vary, the simplest explanation first.

    gap: (inputs,) measured less predicted input; with it the predicted one is among them.
    """
    candidates = [_direction(problem), *([_payload(problem)] if kind_of(problem.machine).payload else [])]
    candidates += [_speed(problem), _acceleration(problem), _since_start(problem), *_turns(problem), _position(problem)]
    candidates += [_run_time(problem), _campaign_time(problem), *([] if gap is None else [_input(problem, gap)])]
    return [variable for variable in candidates if np.ptp(variable.at) > 0.0]


def forward(problem: Problem) -> np.ndarray:
    """(inputs,) bool: hoisting or forward."""
    return of_rows(problem, lambda b, j: b.speeds[j]) > 0.0


def of_rows(problem: Problem, of_run: Callable[[InverseSimulation, int], Array]) -> Array:
    """The series of all runs, (n,) each from of_run, at the residuals of the input: (inputs,)."""
    return np.concatenate([of_run(problem.bench, j)[rows] for j, rows in enumerate(problem.rows)])


def times(problem: Problem) -> Array:
    """(inputs,) s, on each run's own clock."""
    return of_rows(problem, lambda b, j: b.runs[j].time_s)


def spacing(problem: Problem) -> Array:
    """(inputs,) s: the time between a residual and the next."""
    steps = [float(np.median(np.diff(run.time_s))) for run in problem.runs]
    strides = [int(np.min(np.diff(rows))) if len(rows) > 1 else 1 for rows in problem.rows]
    return np.repeat(np.multiply(steps, strides), problem.run_lengths)


def _direction(problem: Problem) -> Variable:
    at = np.where(forward(problem), 1.0, -1.0)
    return Variable("direction", "direction", "1", "all", at, np.array([-1.5, 0.0, 1.5]), straight=True)


def _payload(problem: Problem) -> Variable:
    at = of_rows(problem, lambda b, j: np.full(len(b.runs[j].time_s), b.runs[j].payload_kg))
    known = np.unique(at)
    between = 0.5 * (known[1:] + known[:-1])
    margin = 0.5 * float(np.max(np.diff(known))) if len(known) > 1 else 1.0
    edges = np.concatenate([[known[0] - margin], between, [known[-1] + margin]])
    return Variable("payload", "payload", "kg", "load", at, edges, straight=True)


def _speed(problem: Problem) -> Variable:
    kind = kind_of(problem.machine)
    at = np.abs(of_rows(problem, lambda b, j: b.speeds[j])) * kind.transmission_of(problem.machine)
    edges = float(np.max(at)) * np.array(SPEED_EDGES)
    return Variable("speed", f"speed of the {kind.moved.noun}", kind.moved.speed_unit, "speed", at, edges)


def _acceleration(problem: Problem) -> Variable:
    kind = kind_of(problem.machine)
    lift, unit = kind.transmission_of(problem.machine), f"{kind.moved.unit}/s²"

    def smooth(b: InverseSimulation, j: int) -> Array:
        return lowpass(b.runs[j].time_s, b.motions[j].acceleration, b.band_hz) * lift

    at = of_rows(problem, smooth)
    top = float(np.max(np.abs(at)))
    edges = top * np.array([-1.0, -0.6, -0.35, -0.18, -0.06, 0.06, 0.18, 0.35, 0.6, 1.0])
    return Variable("acceleration", f"acceleration of the {kind.moved.noun}", unit, "acceleration", at, edges)


def _since_start(problem: Problem) -> Variable:
    """Time since the machine last started from rest, or since the run's beginning."""

    def since(b: InverseSimulation, j: int) -> Array:
        t, going = b.runs[j].time_s, b.moving[j]
        begins = np.flatnonzero(np.diff(np.concatenate([[False], going]).astype(int)) == 1)
        if not len(begins):
            return np.zeros(len(t))
        which = np.clip(np.searchsorted(begins, np.arange(len(t)), side="right") - 1, 0, None)
        return np.maximum(t - t[begins][which], 0.0)

    at = of_rows(problem, since)
    longest = float(np.max(at))
    edges = [e / problem.band_hz for e in START_EDGES if e / problem.band_hz < longest]
    return Variable("since_start", "time since the start of the motion", "s", "start", at, np.array([*edges, longest]))


def way(problem: Problem) -> Array:
    """(inputs,) height of the carriage or position of the axis, m or rad."""
    return of_rows(problem, place)


def _position(problem: Problem) -> Variable:
    at = way(problem)
    moved = kind_of(problem.machine).moved
    return Variable("position", moved.position, moved.unit, "position", at, _even(at, 24))


def place(bench: InverseSimulation, j: int) -> Array:
    """(n,) position of the carriage (on an inextensible wire) or of the axis, m or rad."""
    kind = kind_of(bench.machine)
    return kind.place_of(bench.machine, bench.runs[j].start_position_m, bench.motions[j].position)


def _turns(problem: Problem) -> list[Variable]:
    """Angles folded to one turn, of the parts that turned often enough."""
    kind, turns = kind_of(problem.machine), []
    for part in kind.turning:
        if part.folded is not None:
            name, label = part.folded
            angle = TURN * part.turns_per_displacement(problem.machine) * way(problem)
            turns += _folded(name, label, angle)
    return turns


def _folded(name: str, label: str, angle: Array) -> list[Variable]:
    if np.ptp(angle) < TURNS * TURN:
        return []
    edges = np.linspace(0.0, TURN, 13)
    return [Variable(name, label, "rad", "periodic", angle % TURN, edges, wraps=True)]


def _input(problem: Problem, gap: Array) -> Variable:
    """The predicted input of the motion; the measured one contains the gap itself."""
    drive = kind_of(problem.machine).drive
    at = of_rows(problem, lambda b, j: b.measured[j]) - gap
    return Variable("input", f"{drive.quantity} that the motion takes", drive.unit, "load", at, _even(at, 10))


def _run_time(problem: Problem) -> Variable:
    at = of_rows(problem, lambda b, j: b.runs[j].time_s - b.runs[j].time_s[0])
    return Variable("run_time", "time since the run's start", "s", "time", at, _even(at, 16))


def _campaign_time(problem: Problem) -> Variable:
    begins = {run.start_time_s for run in problem.runs}
    at = of_rows(problem, lambda b, j: b.runs[j].start_time_s + b.runs[j].time_s - b.runs[j].time_s[0])
    at = at if len(begins) > 1 else np.zeros(len(at))  # else it is the run's time
    return Variable("campaign_time", "time since the campaign began", "s", "time", at, _even(at, 6))


def _even(at: Array, bins: int) -> Array:
    return np.linspace(float(np.min(at)), float(np.max(at)), bins + 1)


SMOOTH = 1e-2  # of the data's weight: bends between bins cost so much; what lies between is bridged
BLOCKS = 8  # of a run's time, where runs cannot be held out against each other
RIDGE = 1e-9  # of the largest: directions of the parameters that nothing shows
NEVER_SEEN = 1e-12  # of the columns' energy: a bin that nothing lies in
DRAWS = 400  # of the bootstrap
LEAST_RUNS = 3  # to hold out one


@dataclass(frozen=True)
class Free:
    """The freedom of the base parameters beside a profile. columns: (inputs, m) of the prediction per z.

    low, high: (m,) how far each z may still go; hold: (m,) one over its tolerance, on the residual's scale.
    """

    columns: Array
    low: Array
    high: Array
    hold: Array


@dataclass(frozen=True)
class Explained:
    """One variable's part of the gap, (inputs,), each run predicted from the other runs."""

    variable: Variable
    part: Array
    share: float
    interval: tuple[float, float]


def explain(problem: Problem, gap: Array, variable: Variable, free: Free, seed: int) -> Explained:
    """The best function of a variable, with the base parameters free within their tolerances; noise and model error as
    every fit weighs them."""
    columns, bend = basis(problem, variable)
    # Of a few runs each piece by all others: every other piece may be a machine's way there, or all its way back.
    folds = run_of(problem) if counting(problem) >= LEAST_RUNS else pieces(problem)
    part = held_out(gap, columns, bend, free, folds, problem)
    share, interval = share_of(problem, gap, gap - part, seed)
    return Explained(variable, part, share, interval)


def run_of(problem: Problem) -> np.ndarray:
    return problem.run_of_row[: problem.inputs]


def blocks(problem: Problem) -> np.ndarray:
    """(inputs,) two folds: every other piece of each run's time."""
    return pieces(problem) % BLOCKS % 2


def share_of(problem: Problem, gap: Array, left: Array, seed: int) -> tuple[float, tuple[float, float]]:
    """The share of the gap's energy beyond noise that is not in `left`, and its 90 % interval by a bootstrap.

    Over runs; over pieces of time where there are fewer than three of them.
    """
    return _drawn(problem, gap, left, seed, run_of(problem) if counting(problem) >= LEAST_RUNS else pieces(problem))


def share_in_time(problem: Problem, gap: Array, left: Array, seed: int) -> tuple[float, tuple[float, float]]:
    """As `share_of`, by a bootstrap over pieces of time: for windows, which do not carry over to new runs."""
    return _drawn(problem, gap, left, seed, pieces(problem))


def _drawn(
    problem: Problem, gap: Array, left: Array, seed: int, units: np.ndarray
) -> tuple[float, tuple[float, float]]:
    weight = spacing(problem)
    gone = np.bincount(units, weight * (gap**2 - left**2))
    there = np.bincount(units, weight * (gap**2 - problem.noise**2))
    kept = np.flatnonzero(np.bincount(units))
    draw = np.vstack([kept, np.random.default_rng(seed).choice(kept, (DRAWS, len(kept)))])
    gone, there = (np.sum(each[draw], axis=1) for each in (gone, there))
    share, *drawn = np.where(there > 0.0, np.clip(gone / np.where(there > 0.0, there, 1.0), 0.0, 1.0), 0.0)
    low, high = np.quantile(drawn, [0.05, 0.95])
    return float(share), (float(low), float(high))


def pieces(problem: Problem) -> np.ndarray:
    """(inputs,) which of BLOCKS pieces of which run. A run of which no sample counts has none."""
    at, piece = times(problem), np.empty(problem.inputs, dtype=int)
    for j, count in enumerate(problem.run_lengths):
        if count:
            mine = run_of(problem) == j
            gone = (at[mine] - at[mine].min()) / max(float(np.ptp(at[mine])), 1e-9)
            piece[mine] = j * BLOCKS + np.minimum((gone * BLOCKS).astype(int), BLOCKS - 1)
    return piece


def profile_of(problem: Problem, gap: Array, explained: Explained, regime: str) -> Profile:
    """The mean gap in the bins of a variable."""
    v, ahead, k = explained.variable, forward(problem), len(explained.variable.edges) - 1
    bins = np.clip(np.searchsorted(v.edges, v.at, side="right") - 1, 0, k - 1)
    energy = np.bincount(bins, spacing(problem) * gap**2, k)
    return Profile(
        v.name, v.label, v.unit, regime, v.edges,
        _means(bins[ahead], gap[ahead], k), _means(bins[~ahead], gap[~ahead], k),
        energy / max(float(energy.sum()), 1e-300), explained.share, explained.interval,
    )  # fmt: skip


def _means(bins: np.ndarray, values: Array, k: int) -> Array:
    count = np.bincount(bins, minlength=k)
    total = np.bincount(bins, values, k)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def held_out(
    gap: Array, columns: Array, bend: Array, free: Free, folds: np.ndarray, weighed: Problem | None = None
) -> Array:
    """(inputs,) the prediction of each fold by `columns` and the base, fitted to the other folds.

    bend: (k, k) the penalty on rough amounts. weighed: by whose noise and model error; all samples alike without it.
    """
    a = np.hstack([columns, free.columns])
    rows, hold = np.column_stack([a, gap]), free.hold
    if weighed is not None:
        rows = np.pad(rows, ((0, weighed.samples - len(rows)), (0, 0)))  # of a dead line
        rows = weighed.errors.whiten(rows)[: len(gap)]
        hold = hold * (math.sqrt(weighed.share) / weighed.noise)
    k, m = columns.shape[1], free.columns.shape[1]
    cost = np.zeros((k + m, k + m))
    scale = float(np.mean(np.sum(rows[:, :k] ** 2, axis=0))) if k else 0.0
    cost[:k, :k] = scale * (SMOOTH * bend + 1e-6 * np.eye(k))
    cost[k:, k:] = np.diag(hold**2)
    low = np.concatenate([np.full(k, -np.inf), free.low])
    high = np.concatenate([np.full(k, np.inf), free.high])
    mine = {f: rows[folds == f] for f in np.unique(folds)}
    parts = {f: (x[:, :-1].T @ x[:, :-1], x[:, :-1].T @ x[:, -1]) for f, x in mine.items()}
    gram, pull = sum(g for g, _ in parts.values()), sum(b for _, b in parts.values())
    out = np.zeros_like(gap)
    for f, (g, b) in parts.items():
        if len(parts) == 1:
            g, b = np.zeros_like(g), np.zeros_like(b)
        out[folds == f] = a[folds == f] @ bounded(gram - g + cost, pull - b, low, high)
    return out


class OnTop:
    """Functions on top of a fit, fitted to the other runs; what the fit's own parameters explain is projected out, so
    that they stay where all runs have put them."""

    def __init__(self, problem: Problem, left: Array, free: Free) -> None:
        """left: (inputs,) the fit's residual; free: its parameters."""
        self.left, self._inputs = left, len(left)
        rows = np.vstack([free.columns, np.diag(free.hold)])
        sizes = np.linalg.norm(rows, axis=0)
        u, s, _ = np.linalg.svd(rows / np.where(sizes > 0.0, sizes, 1.0), full_matrices=False)
        self._base = u[:, s > RIDGE * max(s[0], 1e-300)] if len(s) else u
        self._folds = run_of(problem) if counting(problem) >= LEAST_RUNS else blocks(problem)
        self._nothing = Free(np.zeros((len(left), 0)), np.zeros(0), np.zeros(0), np.zeros(0))

    def after(self, columns: Array, bend: Array) -> Array:
        """(inputs,) what the columns leave of it on runs they were not fitted to."""
        sizes = np.sum(columns**2, axis=0)
        seen = sizes > NEVER_SEEN * np.sum(sizes)
        shown = columns[:, seen]
        base = self._base[: self._inputs]
        shown = shown - base @ (base.T @ shown)
        return self.left - held_out(self.left, shown, bend[np.ix_(seen, seen)], self._nothing, self._folds)


def basis(problem: Problem, v: Variable) -> tuple[Array, Array]:
    """(inputs, k) columns of a function of the variable for each direction, and the penalty on its bends."""
    ahead = forward(problem)
    if v.name == "direction":
        return np.stack([ahead, ~ahead], axis=1).astype(float), np.zeros((2, 2))
    shape, bend = hats(v)
    both = np.hstack([np.where(ahead[:, None], shape, 0.0), np.where(ahead[:, None], 0.0, shape)])
    zero = np.zeros_like(bend)
    return both, np.block([[bend, zero], [zero, bend]])


def hats(v: Variable) -> tuple[Array, Array]:
    """(samples, k) piecewise linear between the bins' edges, a line only where few values are known; and (k, k) what a
    bend costs: its second differences, squared."""
    knots = v.edges[[0, -1]] if v.straight else v.edges
    which = np.clip(np.searchsorted(knots, v.at, side="right") - 1, 0, len(knots) - 2)
    part = (v.at - knots[which]) / (knots[which + 1] - knots[which])
    hats = np.zeros((len(v.at), len(knots)))
    rows = np.arange(len(v.at))
    hats[rows, which] = 1.0 - part
    hats[rows, which + 1] += part
    if v.wraps:
        hats[:, 0] += hats[:, -1]
        hats = hats[:, :-1]
    eye = np.eye(hats.shape[1])
    bend = np.roll(eye, 1, 0) - 2.0 * eye + np.roll(eye, -1, 0) if v.wraps else np.diff(eye, 2, axis=0)
    return hats, bend.T @ bend


def best_of(explained: Sequence[Explained], margin: float = 0.03) -> Explained:
    """The variable that explains most; among nearly equal ones the first, which is the simplest."""
    most = max(variable.share for variable in explained)
    return next(variable for variable in explained if variable.share >= most - margin)


PER_RESOLUTION = 3.0  # frequencies tried within 1/(length of a run)
BINS = 16
FEWEST_WAVES = 2.0  # in the longest run: a slower wave is a trend
MOST_WAVES = 600.0  # over the way of the longest run
FINE = 16.0  # cells of the grid to a wave
FEWEST_ROWS = 8  # of a run and way: fewer say nothing of a wave


def wave_in_time(problem: Problem, gap: Array, seed: int) -> tuple[Explained, Profile]:
    """The one frequency, Hz, whose wave in time explains most of the gap."""
    longest = max(run.duration_s for run in problem.runs)
    tried = _tried(longest, problem.band_hz)
    return _wave(problem, gap, seed, times(problem), tried, ("frequency", "frequency", "Hz", "time"), False)


def wave_along_the_way(problem: Problem, gap: Array, seed: int) -> tuple[Explained, Profile] | None:
    """The wave over the carriage's height (the axis' position) that explains most of the gap, one for each direction.

    Rotating parts repeat so: motor, drum, a roller. Every run has its own phase, because a motor turns many times
    within the uncertainty of the height.
    """
    at, runs = way(problem), run_of(problem)
    longest = max(float(np.ptp(at[runs == j])) for j in np.unique(runs))
    if longest <= 0.0:
        return None
    tried = _tried(longest, MOST_WAVES / longest)
    unit = f"1/{kind_of(problem.machine).moved.unit}"
    return _wave(problem, gap, seed, at, tried, ("wave", "frequency over the way", unit, "periodic"), True)


def _wave(
    problem: Problem, gap: Array, seed: int, at: Array, tried: Array, said: tuple[str, str, str, str], each_way: bool
) -> tuple[Explained, Profile]:
    """One frequency for all runs; amplitude and phase for each run (and direction).

    Fitted to every other piece of time and judged on the rest: a wave continues, a burst does not.
    """
    groups = [run_of(problem) == j for j in range(len(problem.runs))]
    if each_way:
        ahead = forward(problem)
        groups = [mine & side for mine in groups for side in (ahead, ~ahead)]
    groups = [mine for mine in groups if np.sum(mine) >= FEWEST_ROWS]
    power = sum((_taken(gap[mine], at[mine], tried) for mine in groups), np.zeros(len(tried)))
    best = float(tried[int(np.argmax(power))])
    part = _held_out(problem, gap, best * at, groups)
    share, interval = share_of(problem, gap, gap - part, seed)
    edges = np.geomspace(tried[0], tried[-1], BINS + 1)
    name, label, unit, regime = said
    explained = Explained(
        Variable(name, label, unit, regime, np.full(problem.inputs, best), edges), part, share, interval
    )
    bins = np.clip(np.searchsorted(edges, tried, side="right") - 1, 0, BINS - 1)
    # Of each bin its best wave: a sum would count the noise of ever more frequencies, the higher they are.
    taken = np.zeros(BINS)
    np.maximum.at(taken, bins, power)
    nothing = np.full(BINS, np.nan)
    profile = Profile(
        name, f"{label}, best at {best:.3g} {unit}", unit, regime, edges, nothing, nothing,
        taken / max(float(gap @ gap), 1e-300), share, interval,
    )  # fmt: skip
    return explained, profile


def _tried(longest: float, highest: float) -> Array:
    """Even frequencies, whole multiples of their distance, from FEWEST_WAVES on."""
    distance = 1.0 / (PER_RESOLUTION * longest)
    first = math.ceil(FEWEST_WAVES * PER_RESOLUTION)
    last = max(math.ceil(highest / distance), 2 * first)
    return np.asarray(distance * np.arange(first, last + 1), dtype=float)


def _taken(gap: Array, at: Array, tried: Array) -> Array:
    """The energy that a wave of each frequency explains: least squares with two amounts, at times of any spacing.

    The sums over all samples are Fourier transforms, of the samples put on a fine grid.
    """
    distance, highest = float(tried[1] - tried[0]), float(tried[-1])
    n = math.ceil(FINE * highest / distance)
    step = 1.0 / (n * distance)
    cell = np.round((at - at.min()) / step).astype(int)
    cell %= n  # what lies a whole period of all frequencies further on is in phase
    order = np.round(tried / distance).astype(int)
    sums = np.conj(np.fft.fft(np.bincount(cell, gap, n)))
    twice = np.conj(np.fft.fft(np.bincount(cell, minlength=n)))[2 * order]
    a, b = sums[order].real, sums[order].imag
    cc, ss, cs = 0.5 * (len(gap) + twice.real), 0.5 * (len(gap) - twice.real), 0.5 * twice.imag
    det = np.maximum(cc * ss - cs * cs, 1e-6 * (cc + ss) ** 2)
    return np.asarray((ss * a * a - 2.0 * cs * a * b + cc * b * b) / det, dtype=float)


def _held_out(problem: Problem, gap: Array, turns: Array, groups: list[np.ndarray]) -> Array:
    out, halves = np.zeros_like(gap), blocks(problem)
    waves = np.stack([np.cos(2.0 * math.pi * turns), np.sin(2.0 * math.pi * turns)], axis=1)
    for mine in groups:
        for half in (0, 1):
            test, train = mine & (halves == half), mine & (halves != half)
            if np.sum(train) >= FEWEST_ROWS // 2:
                out[test] = waves[test] @ np.linalg.lstsq(waves[train], gap[train], rcond=1e-9)[0]
    return out
