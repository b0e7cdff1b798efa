"""Held-out residuals: what a hypothesis, fitted to the other runs, leaves in the run it has not seen."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.evidence import is_lag
from workbench.diagnose.hypotheses.fit import BREAKDOWNS, Fitted, fit_hypothesis, is_timing, uncorrelated
from workbench.diagnose.hypotheses.free_parameters import (
    Estimate,
    PhaseOfEachRun,
    Setting,
    bounds_of,
    logarithmic_of,
    setting_of,
)
from workbench.diagnose.hypotheses.problem import Problem, once, rms
from workbench.diagnose.hypotheses.search import STUCK
from workbench.diagnose.hypotheses.signatures import stepped
from workbench.identify.fit import bounded
from workbench.machines import kind_of
from workbench.simulate.model_error import ErrorModel
from workbench.simulate.motion import PLAY

BLOCKS = 4  # of a run that no other can foretell
SAME_WAY = 0.01  # of its way, rms: so near to another one at every time a run repeats it
STRETCHES = 8  # of a run: so long a residual may hang together
PARTS = (0.3, 0.1)  # of a step that does not serve
MOST_STEPS = 20
MOST_EVALUATIONS = 40  # of the fit at another minimum
AS_GOOD = 20.0  # of the objective of all rows: a worse minimum is not the best one of some of them either
SETTLED = 0.005  # of the objective: a step that gains less ends the refit
ROUNDING = 1e-6  # of a signature: what another run's own value adds to this one's rows


@dataclass(frozen=True)
class HeldOut:
    """residual: (samples,) each row as predicted without its fold. settings: the fit without each fold."""

    residual: Array
    fold_of_row: np.ndarray
    settings: tuple[Setting, ...]

    def rms(self, inputs: int, fold: int | None = None) -> float:
        """Of the input's rows, all or of one fold."""
        rows = self.residual[:inputs]
        if fold is not None:
            rows = rows[self.fold_of_row[:inputs] == fold]
        return float(np.sqrt(np.mean(rows**2))) if len(rows) else math.nan


def folds_by_run(problem: Problem) -> np.ndarray:
    """(samples,) Each run is a fold; one that no other can foretell (`in_parts`) is cut into BLOCKS of time: the first
    has the run's number, the others come after the last run's."""
    folds = np.array(problem.run_of_row[: problem.inputs])
    for k, j in enumerate(in_parts(problem)):
        mine = np.flatnonzero(folds == j)
        block = np.arange(len(mine)) * BLOCKS // len(mine)
        folds[mine] = np.where(block > 0, len(problem.runs) + k * (BLOCKS - 1) + block - 1, j)
    return np.append(folds, folds[problem.pulled])


def folds_by_motion(problem: Problem) -> np.ndarray:
    """(samples,) As `folds_by_run`. But where all runs repeat one motion, whatever comes again in each of them one run
    foretells of the others: there each of BLOCKS of its time is a fold, in all runs at once."""
    ways = [motion.position - motion.position[0] for motion in problem.bench.motions]
    n = min(map(len, ways))
    as_long = max(map(len, ways)) - n <= SAME_WAY * n
    if not (as_long and all(rms(way[:n] - ways[0][:n]) <= SAME_WAY * rms(way) for way in ways)):
        return folds_by_run(problem)
    folds = np.concatenate([np.arange(count) * BLOCKS // max(count, 1) for count in problem.run_lengths])
    return np.append(folds, folds[problem.pulled])


def in_parts(problem: Problem) -> list[int]:
    """The runs that no others can foretell: where two at most count, for one alone tells little of what it does not
    vary; one that makes nearly all of the way forward, or back: no other tells friction from an offset of the sensor
    there; and one that has nearly all of the squares of the speed: no other tells what grows with it."""
    counted, ways, squares = np.unique(problem.run_of_row), problem.ways, problem.squares
    own = ways > settings.FORETOLD * np.sum(ways, axis=0)  # what stands still goes both ways, by noise
    most = ways > (1.0 - settings.FORETOLD) * np.sum(ways, axis=1, keepdims=True)
    fastest = squares > (1.0 - settings.FORETOLD) * np.sum(squares)
    return [int(j) for j in counted if len(counted) <= 2 or fastest[j] or np.any(own[:, j] & most[:, j])]


def held_out(problem: Problem, fitted: Fitted, fold_of_row: np.ndarray) -> HeldOut:
    """A refit to the other rows for each fold, started at the joint fit and followed to convergence; and at another
    minimum of how friction turns over near standstill, if there is one about as good: the other runs may lie there.

    Gauss-Newton steps with a Jacobian that each step corrects (C. G. Broyden, Mathematics of Computation 19, 1965); all
    folds are simulated together. A step is taken as far as it serves the runs that are left: all of it, or a part. One
    that promises next to nothing is the end.
    What is each run's own (a phase) is taken from that run itself: another run cannot know it. How late the log is no
    run knows alone, a slow one next to nothing: it stays as in the joint fit, unless an effect is a lag itself. What
    was computed once is kept.
    """
    asked = (fitted, fold_of_row.tobytes(), problem.errors.sizes)
    return once(problem, asked, lambda: _held_out(problem, fitted, fold_of_row))


def jackknifed(effect: str, estimate: Estimate, found: HeldOut) -> Estimate:
    """An estimate whose standard error is no less than what its value differs by between the fits without each fold
    (J. W. Tukey, Annals of Mathematical Statistics 29, 1958): a real machine's law is not quite the same in every run,
    of which no covariance of one fit tells. What is each run's own stays as it is."""
    return widened(effect, estimate, [found.settings[fold] for fold in np.unique(found.fold_of_row)])


def widened(effect: str, estimate: Estimate, others: Sequence[Setting], likely: Array | None = None) -> Estimate:
    """An estimate whose standard error is no less than its distance from the values of others, rms, as `likely` as each
    is; without that no less than the jackknife's of as many fits, each of which lacks one part."""
    if isinstance(estimate.value, tuple) or isinstance(estimate.std_error, tuple) or not others:
        return estimate
    name = f"{effect}__{estimate.name}"
    off = np.array([other[name] for other in others], float) - estimate.value
    if name.endswith("phase_rad"):
        off = (off + math.pi) % (2.0 * math.pi) - math.pi
    square = (len(off) - 1) * float(np.var(off)) if likely is None else float(np.average(off**2, weights=likely))
    return replace(estimate, std_error=max(estimate.std_error, math.sqrt(square)))


def _held_out(problem: Problem, fitted: Fitted, fold_of_row: np.ndarray) -> HeldOut:
    folds = max(int(np.max(fold_of_row, initial=-1)) + 1, len(problem.runs))  # the last may hold nothing that counts
    inside = [fold_of_row == fold for fold in range(folds)]
    weighed = problem if fitted.errors is None else problem.weighed_by(fitted.errors)
    refitted = tuple(refit.setting for refit in fitted_without(weighed, fitted, inside, elsewhere=True))
    residual = np.empty(problem.samples)
    for row, mine in zip(problem.residuals(refitted), inside, strict=True):
        residual[mine] = row[mine]
    return HeldOut(residual, fold_of_row, refitted)


@dataclass(frozen=True)
class Refit:
    """setting: of all values; objective: chi^2 of the rows that it is fitted to, and prior."""

    setting: Setting
    objective: float


def fitted_without(
    problem: Problem, fitted: Fitted, inside: Sequence[np.ndarray], most: int = MOST_STEPS, *, elsewhere: bool = False
) -> list[Refit]:
    """The refit to the other rows for each of several choices of rows, (samples,) bool; see `held_out`. most: steps.
    elsewhere: also from another minimum than the joint fit's."""
    lowest, highest, std = bounds_of(fitted.free)
    base, whiten = int(np.count_nonzero(np.isfinite(std))), problem.errors.whiten
    starts = [fitted, *(_elsewhere(problem, fitted, std) if elsewhere else [])]
    std = np.where(np.isfinite(std), std, _sizes_of_amounts(fitted))
    prior = np.diag(1.0 / std**2)
    asked, inside = len(inside), [*inside] * len(starts)
    z, slopes, rows = [], [], []
    for start in starts:
        white = whiten(np.column_stack([start.jacobian, start.residual]))
        for mine in inside[:asked]:
            z.append(start.z.copy())
            slopes.append(white[~mine, :-1].copy())
            rows.append(white[~mine, -1].copy())
    sizes = np.abs(fitted.jacobian)
    lag = any(is_lag(problem, name) for name in fitted.effects)
    timing = np.array([is_timing(k) and not lag for k in fitted.free for _ in k.lowest], dtype=bool)
    shown = [(np.max(sizes[~mine], axis=0) > ROUNDING * np.max(sizes, axis=0)) & ~timing for mine in inside]
    worth = [float(r @ r) + _pull(at, std) for at, r in zip(z, rows, strict=True)]

    steps: dict[int, Array | None] = dict.fromkeys(range(len(inside)))  # fold -> the step that has not served
    for _ in range(most):
        tried: list[tuple[int, Array]] = []
        for fold, step in list(steps.items()):
            j, at = slopes[fold], z[fold]
            if step is not None:
                tried += [(fold, np.clip(at + part * step, lowest, highest)) for part in PARTS]
                continue
            gradient, hessian = j.T @ rows[fold] + at / std**2, j.T @ j + prior
            steps[fold] = step = _step(hessian, gradient, (lowest - at, highest - at), shown[fold])
            moved = np.clip(at + step, lowest, highest) - at
            if -(2.0 * gradient + hessian @ moved) @ moved < SETTLED:
                del steps[fold]
            else:
                tried.append((fold, at + moved))
        if not tried:
            break
        there = [setting_of(fitted.free, at) for _, at in tried]
        found = fitted.residual + problem.differences(fitted.setting, there, fitted.residual)[1]
        better: dict[int, tuple[float, Array, Array]] = {}
        for (fold, at), row in zip(tried, whiten(found.T).T, strict=True):
            left, moved = row[~inside[fold]], at - z[fold]
            size = float(left @ left) + _pull(at, std)
            if math.isfinite(size):  # what the simulation has shown of the slope along this step
                slopes[fold] += np.outer(left - rows[fold] - slopes[fold] @ moved, moved / float(moved @ moved))
            if size < (better[fold][0] if fold in better else worth[fold] - SETTLED):
                better[fold] = (size, at, left)
        for fold, many in Counter(fold for fold, _ in tried).items():
            if fold in better:
                worth[fold], z[fold], rows[fold] = better[fold]
                steps[fold] = None
            elif many > 1:
                del steps[fold]
    for k in range(asked, len(inside)):
        if worth[k] < worth[k - asked]:  # what turns over elsewhere bends on the way: with slopes of its own to the end
            others = copy(problem.coarse([fitted.setting]))
            others.errors = _Seen(problem.errors, ~inside[k])  # type: ignore[assignment]
            try:
                last = fit_hypothesis(
                    others, fitted.effects, fitted.free, z[k], MOST_EVALUATIONS, base, starts[-1].jacobian
                )
            except BREAKDOWNS:  # the simulation breaks down on that way: the fold stays where it is
                continue
            z[k - asked], worth[k - asked] = last.z.copy(), last.objective
            own = _own(fitted, inside[k])  # which that fit has thrown anywhere
            z[k - asked][own] = fitted.z[own]
    points = [at + _own_step(fitted, mine, at - fitted.z) for at, mine in zip(z[:asked], inside, strict=False)]
    return [
        Refit(setting_of(fitted.free, np.clip(at, lowest, highest)), size)
        for at, size in zip(points, worth, strict=False)
    ]


def _sizes_of_amounts(fitted: Fitted) -> Array:
    """By how much each z may be off none: an amount by about its own size in the joint fit (unit information; R. E.
    Kass, L. Wasserman, J. Am. Stat. Assoc. 90, 1995), so that one which the other rows do not show is none."""
    sizes, at = np.full(len(fitted.z), np.inf), 0
    for parameter in fitted.free:
        mine = slice(at, at := at + parameter.size)
        size = float(np.linalg.norm(fitted.z[mine]))
        if parameter.amount and size > 0.0:
            sizes[mine] = size
    return sizes


@dataclass(frozen=True)
class _Seen:
    """An error model of the rows that a refit sees."""

    errors: ErrorModel
    rows: np.ndarray

    def whiten(self, rows: Array) -> Array:
        return self.errors.whiten(rows)[self.rows]


def _elsewhere(problem: Problem, fitted: Fitted, std: Array) -> list[Fitted]:
    """The same hypothesis, fitted to all rows from where friction turns over as nominal; if that is another minimum
    about as good."""
    turns = logarithmic_of(fitted.free) & np.isfinite(std)
    if not np.any(turns & (np.abs(fitted.z) > STUCK)):
        return []

    def found() -> list[Fitted]:
        nominal, base = np.where(turns, 0.0, fitted.z), int(np.count_nonzero(np.isfinite(std)))
        coarse, known, rough = problem.coarse([fitted.setting]), fitted.jacobian, not problem.fine
        try:  # what each fold makes of it is followed to its end
            other = fit_hypothesis(coarse, fitted.effects, fitted.free, nominal, MOST_EVALUATIONS, base, known, rough)
        except BREAKDOWNS:  # the simulation breaks down there: that is no minimum
            return []
        residual = fitted.residual + problem.differences(fitted.setting, [other.setting], fitted.residual)[1][0]
        white = problem.errors.whiten(residual)
        other = replace(other, residual=residual, chi2=float(white @ white))
        apart = np.any(turns & (np.abs(other.z - fitted.z) > STUCK))
        return [other] if apart and other.objective < fitted.objective + AS_GOOD else []

    return once(problem, (fitted, "elsewhere", problem.errors.sizes), found)


def _pull(z: Array, std: Array) -> float:
    return float(np.sum((z / std) ** 2))


def _step(hessian: Array, gradient: Array, box: tuple[Array, Array], shown: np.ndarray) -> Array:
    """The Newton step, the best one within the box around 0.

    What these rows do not show stays: rounding over a curvature of zero would throw it anywhere.
    """
    free, step = np.flatnonzero(shown & (np.diag(hessian) > 0.0)), np.zeros(len(gradient))
    step[free] = bounded(hessian[np.ix_(free, free)], -gradient[free], box[0][free], box[1][free])
    return step


def _own(fitted: Fitted, fold: np.ndarray) -> np.ndarray:
    """The indices in z of the values that belong to a fold's own runs: no other row shows them."""
    own = np.array(
        [isinstance(parameter, PhaseOfEachRun) for parameter in fitted.free for _ in parameter.lowest], dtype=bool
    )
    sizes = np.abs(fitted.jacobian)
    elsewhere, anywhere = np.max(sizes[~fold], axis=0, initial=0.0), np.max(sizes, axis=0, initial=0.0)
    return np.flatnonzero(own & (elsewhere <= ROUNDING * anywhere))


def _own_step(fitted: Fitted, fold: np.ndarray, step: Array) -> Array:
    """The least-squares step of a fold's own values, after `step` of all the others."""
    mine, moved = _own(fitted, fold), np.zeros(len(step))
    if len(mine) and np.any(fold):
        left = fitted.residual[fold] + fitted.jacobian[fold] @ step
        moved[mine] = -np.linalg.lstsq(fitted.jacobian[fold][:, mine], left, rcond=1e-8)[0]
    return moved


def play_estimated(problem: Problem, fit: Fitted, base: int) -> Fitted:
    """A fit of a play as it foretells left-out folds better: weighed as the problem is, or by plain least squares."""
    folds = folds_by_run(problem)
    both = weighed_both_ways(problem, fit, base)
    if len(both) < 2:
        return fit
    left = [held_out(problem, one, folds).rms(problem.inputs) for one in (fit, *both[1:])]  # that of the fit is known
    return both[int(np.argmin(left))]


def weighed_both_ways(problem: Problem, fit: Fitted, base: int) -> tuple[Fitted, ...]:
    """A fit, and with a play in it the same hypothesis by plain least squares, each with the other's z. base: how many
    of the first z are the base parameters'.

    The motor's flights through a play are short, mostly slow, and no law foretells their ends: as a model error is, so
    a whitened residual holds little of them. Plain least squares starts from the best shape of all that are tried.
    """
    if PLAY not in fit.effects or not kind_of(problem.machine).bridged_impacts:
        return (fit,)
    return once(problem, (fit, "both ways", problem.errors.sizes), lambda: _both_ways(problem, fit, base))


def _both_ways(problem: Problem, fit: Fitted, base: int) -> tuple[Fitted, ...]:
    plain = problem.weighed_by(uncorrelated(problem, fit))
    z = stepped(plain, fit, PLAY, base, everywhere=True)
    try:
        found = fit_hypothesis(plain, fit.effects, fit.free, z, base=base)
    except BREAKDOWNS:
        return (fit,)
    white = problem.errors.whiten(found.residual)
    found = replace(found, chi2=float(white @ white), errors=plain.errors, other=fit.z)
    return replace(fit, other=found.z), found


def significance(problem: Problem, without: Fitted, fit: Fitted, *, by_runs_alone: bool = False) -> float:
    """By how much a fit predicts left-out folds better than another one, in standard deviations of that.

        gain = sum_i (u_i^2 - w_i^2) / c + P_0 - P,    variance = V / c^2 + P_0 - P
        V = 4 sum_b (sum_(i in b) (u_i - w_i) w_i)^2,    c = max(V / (4 sum_i (u_i - w_i)^2), 1)

    u and w are the whitened held-out residuals of both, P_0 and P the squared distances of their base parameters from
    nominal in tolerances, which are data like the others. Were w independent of what the further effects predict,
    u - w, the gain would be the energy of u - w; it is off that by their product alone. The products are summed over
    stretches b as long as the residual hangs together, so a remainder with structure is no proof (a sandwich variance;
    W. K. Newey, K. D. West, Econometrica 55, 1987). White, w would give V = 4 sum (u_i - w_i)^2: c is how much wider it
    spreads, and its rows tell as much less beside a tolerance, which is known (quasi-likelihood; P. McCullagh, Annals
    of Statistics 11, 1983). So much less do they pull the base parameters off nominal: P_0 and P are those at the least
    chi^2 / c + P. Where the machine leaves more than its own model error, what hangs together may be another cause's,
    which bends base parameters, too: c is 1. No fold leaves a tolerance out: by chance alone P_0 - P is the square of a
    standard normal value, so it counts as many deviations as its root. by_runs_alone: without the tolerances.

    No row counts for more in w than in u where that is beyond chance: friction that turns over some samples away from
    where it did is off by all of itself there, and would outweigh the run (P. J. Huber, Annals of Mathematical
    Statistics 35, 1964).
    """
    folds = folds_by_run(problem)
    u, w = problem.errors.whiten(np.stack([held_out(problem, one, folds).residual for one in (without, fit)], axis=1)).T
    most = np.maximum(np.abs(u), settings.NUISANCE)
    w = np.clip(w, -most, most)
    product = np.bincount(stretches(problem), (u - w) * w)
    variance, white = 4.0 * float(product @ product), max(4.0 * float(np.sum((u - w) ** 2)), 1e-300)
    wider = max(variance / white, 1.0) if max(problem.errors.sizes) <= 1.0 else 1.0
    prior = 0.0 if by_runs_alone else _strain(problem, without, wider) - _strain(problem, fit, wider)
    return (float(u @ u - w @ w) / wider + prior) / math.sqrt(max(variance / wider**2 + max(prior, 0.0), 1e-300))


def foretold(problem: Problem, before: HeldOut, after: HeldOut) -> float:
    """By how much less one of two predictions leaves of the input's rows in left-out folds, in standard deviations of
    that: as `significance`, of the energies themselves."""
    u, w = (one.residual[: problem.inputs] for one in (before, after))
    product = np.bincount(stretches(problem)[: problem.inputs], (u - w) * w)
    return float(u @ u - w @ w) / math.sqrt(max(4.0 * float(product @ product), 1e-300))


def _strain(problem: Problem, fitted: Fitted, wider: float) -> float:
    """The squared distance of a fit's base parameters from nominal, in tolerances, where its rows tell `wider` times
    less, by one step from the fit."""
    if wider <= 1.0:
        return fitted.prior
    (lowest, highest, std), z = bounds_of(fitted.free), fitted.z
    white = problem.errors.whiten(np.column_stack([fitted.jacobian, fitted.residual])) / math.sqrt(wider)
    gradient, hessian = white[:, :-1].T @ white[:, -1] + z / std**2, white[:, :-1].T @ white[:, :-1]
    step = _step(hessian + np.diag(1.0 / std**2), gradient, (lowest - z, highest - z), np.ones(len(z), dtype=bool))
    return _pull(z + step, std)


def stretches(problem: Problem) -> np.ndarray:
    """(samples,) which of STRETCHES parts of which run, by time."""
    which = np.zeros(problem.samples, dtype=int)
    for j in range(len(problem.runs)):
        mine = np.flatnonzero(problem.run_of_row == j)
        which[mine] = j * STRETCHES + np.arange(len(mine)) * STRETCHES // max(len(mine), 1)
    return which
