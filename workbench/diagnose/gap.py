"""How large the gap is, and how far a cause shrinks it on runs that its fit has not seen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr, stdtr

from workbench.core.errors import InputError
from workbench.core.names import listed
from workbench.core.numbers import figures
from workbench.core.run import Array
from workbench.diagnose.hypotheses.evidence import model_error_rms
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import Names, Scalar, Setting, base_parameters, bounds_of, key_told
from workbench.diagnose.hypotheses.held_out import HeldOut, fitted_without, folds_by_run, held_out, in_parts
from workbench.diagnose.hypotheses.problem import Problem, counting, rms
from workbench.diagnose.hypotheses.search import TOLERANCES, SearchResult
from workbench.diagnose.location.profiles import LEAST_RUNS, pieces
from workbench.diagnose.machines import machine_of
from workbench.machines import Axis, Hoist, kind_of
from workbench.simulate.driven import InverseSimulation
from workbench.simulate.replay import ReplayResult, simulate_replays

if TYPE_CHECKING:
    from workbench.diagnose.unknown import Explained


@dataclass(frozen=True)
class Gap:
    """How large the gap is after the base parameters were refitted within their tolerances.

    residual_rms, noise_rms: input, N m (N), below band_hz. force_rms_n: the same as a force on the carriage (None on
    an axis). speed_rmse_percent: open-loop replay of the refitted machine. nominal_*: before any refit.
    by_chance: probability that the furthest of as many honest values lies as far off as the worst tolerance says.
    """

    residual_rms: float
    noise_rms: float
    band_hz: float
    force_rms_n: float | None
    speed_rmse_percent: float
    nominal_residual_rms: float
    nominal_speed_rmse_percent: float
    worst_tolerance: tuple[str, float]
    significant: bool
    sentences: tuple[str, ...]
    by_chance: float = 1.0


@dataclass(frozen=True)
class RunResidual:
    """One run under the delivered machine, as `replay` prints it: rms while moving, N m (N). before: refitted within
    the tolerances; after: as delivered. share: of the gap's energy that this run holds. p_alike: that a run like the
    others leaves as much, see `outliers`; differs: whether that is improbable. stays: its share of what stays."""

    name: str
    share: float
    before: float
    after: float
    noise: float
    differs: bool = False
    p_alike: float = 1.0
    stays: float = 0.0


@dataclass(frozen=True)
class Delivered:
    """What `replay` gives with the delivered machine.yaml, in the band of the gap: rms of the residual while moving,
    N m (N); speed error in open loop, per cent; and each run. validated: the runs that were kept for the end."""

    residual_rms: float
    speed_rmse_percent: float
    runs: tuple[RunResidual, ...]
    validated: tuple[RunResidual, ...] = ()


EXCESS = 0.8  # of the noise, rms beside it: a machine without a gap stays below (no model is exact)
STRETCHED = 4.0  # tolerances: the furthest of ten honest values lies further off once in 1,600 machines
UNLIKELY = 0.01  # probability: of a run that leaves more than its like does, of a value so far off its tolerance
RARE = 1e-6  # probability: a smaller one is no number that anybody checks
SUSPECT = 1.5  # of the residual of those it is not fitted to: such a run is looked at again without its influence
GLANCE, CLOSE = 2, 10  # steps of a refit: that tell which hypothesis explains the others, and what it leaves of a run
FEWEST_RUNS = 4  # that tell one which is not like the others
UNLIKE = 0.1  # of the residual, rms: runs of one machine differ by so much, whatever the others' scatter is


def outliers(rms: Array) -> Array:
    """(n,) The probability that a run like the others leaves as much as each does, for the choice among n corrected.

    Deleted studentised residuals of the logarithms, one-sided (F. E. Grubbs, Annals of Mathematical Statistics 21,
    1950; C. E. Bonferroni). 1 with fewer than FEWEST_RUNS.
    """
    n = len(rms)
    if n < FEWEST_RUNS or not np.all(rms > 0.0):
        return np.ones(n)
    x = np.log(rms)
    others = np.array([np.delete(x, j) for j in range(n)])
    spread = np.maximum(np.std(others, axis=1, ddof=1), UNLIKE) * math.sqrt(1.0 + 1.0 / (n - 1))
    return np.minimum(n * stdtr(n - 2, (np.mean(others, axis=1) - x) / spread), 1.0)


def alike_of(problem: Problem, fits: Sequence[Fitted]) -> Array:
    """(runs,) The probability that a run like the others leaves as much as each does, see `outliers`.

    Compared is the residual of each run under the fit to the others, over what that fit leaves of those and what it
    cannot know of the run, rms: a slow run foretold by fast ones is no stranger. The fit without a run of another
    machine leaves noise of the others and much of that run. Such a run bends the fits that the others are compared by,
    and may hide what they have in common. So the one that stands out most under the first of the fits is compared with
    others that are fitted without it too, by the hypothesis that explains these best. That is not asked of one that is
    no suspect.
    """
    run_of, p = problem.run_of_row, np.ones(len(problem.runs))
    counted = np.unique(run_of)  # of a run nothing may count in the band
    if len(counted) < FEWEST_RUNS:
        return p
    inside = [run_of == j for j in counted]

    def compared(fit: Fitted, settings: Sequence[Setting], without: Sequence[np.ndarray]) -> Array:
        prior, white = np.diag(bounds_of(fit.free)[2] ** -2.0), problem.errors.whiten(fit.jacobian)
        ratios = []
        for row, mine, left_out in zip(problem.residuals(settings), inside, without, strict=True):
            own, seen = np.flatnonzero(mine[: problem.inputs]), np.flatnonzero(~left_out[: problem.inputs])
            known = white[~left_out]
            spread = np.linalg.pinv(known.T @ known + prior, rcond=1e-12, hermitian=True)
            unknown = math.sqrt(np.mean(np.sum((fit.jacobian[own] @ spread) * fit.jacobian[own], axis=1)))
            ratios.append(rms(row[own]) / math.hypot(rms(row[seen]), unknown))
        return np.array(ratios)

    settings = held_out(problem, fits[0], folds_by_run(problem)).settings
    unseen = compared(fits[0], [settings[j] for j in counted], inside)
    p[counted], odd = outliers(unseen), int(np.argmax(unseen))
    if unseen[odd] < SUSPECT:
        return p
    best = min(dict.fromkeys(fits), key=lambda fit: fitted_without(problem, fit, [inside[odd]], GLANCE)[0].objective)
    without = [mine | inside[odd] for mine in inside]
    alone = compared(best, [one.setting for one in fitted_without(problem, best, without, CLOSE)], without)
    p[counted[odd]] = outliers(alone)[odd]
    return p


def delivered_of(
    noise: Array, refitted: ReplayResult, corrected: ReplayResult, alike: Array | None = None
) -> Delivered:
    """Both machines as replayed: the numbers that the report prints are those that anybody gets with the file. noise:
    of each run, rms in the band, in the input's unit. alike: of each run, see `alike_of`."""
    before = np.nan_to_num([run.residual_rms_moving for run in refitted.runs])
    after = np.nan_to_num([run.residual_rms_moving for run in corrected.runs])
    length = np.array([np.count_nonzero(run.balance.moving) * run.simulated.sample_time_s for run in corrected.runs])
    beyond = [length * np.maximum(rms**2 - noise**2, 0.0) for rms in (before, after)]
    share, stays = (energy / max(float(np.sum(energy)), 1e-300) for energy in beyond)
    alike = np.ones(len(after)) if alike is None else alike
    rows = tuple(
        RunResidual(run.name, float(s), float(b), float(a), float(n), bool(p < UNLIKELY), float(p), float(left))
        for run, s, b, a, n, p, left in zip(corrected.runs, share, before, after, noise, alike, stays, strict=True)
    )
    return Delivered(corrected.residual_rms_moving, corrected.speed_rmse_percent, rows)


def gap_of(problem: Problem, search: SearchResult, plain: ReplayResult, refitted: ReplayResult) -> Gap:
    """The gap: the residual with the base parameters refitted within their tolerances, `search.within_tolerances`.

    A fit that tolerances merely hold, `search.base`, may stretch one to ten times itself and hide a gap there;
    how far it does is the worst tolerance. plain, refitted: the machine as given and as refitted, replayed.
    """
    base, keys = search.base, base_parameters(problem.machine, problem.logged)
    left = refitted.residual_rms_moving
    key, count, by_chance = worst_tolerance(keys, base)
    excess = math.sqrt(max(left**2 - problem.noise**2, 0.0))
    stretched = abs(count) > STRETCHED
    kind = kind_of(problem.machine)
    lift = None if kind.transmission is None else kind.transmission(problem.machine)
    gap = Gap(
        residual_rms=left,
        noise_rms=problem.noise,
        band_hz=problem.band_hz,
        force_rms_n=None if lift is None else left / lift,
        speed_rmse_percent=refitted.speed_rmse_percent,
        nominal_residual_rms=plain.residual_rms_moving,
        nominal_speed_rmse_percent=plain.speed_rmse_percent,
        worst_tolerance=(key, count),
        significant=excess > EXCESS * problem.noise or stretched,
        sentences=(),
        by_chance=by_chance,
    )
    return replace(gap, sentences=tuple(_sentences(gap, unit_of(problem.machine), problem.own)))


def worst_tolerance(keys: Mapping[str, Scalar], base: Fitted) -> tuple[str, float, float]:
    """The key of the base parameter that the fit moved furthest, by how many of its tolerances, and the probability
    that the furthest of as many honest values (normal, the tolerance as standard deviation) lies so far off."""
    moved = {
        key: float(z) / parameter.std
        for (key, parameter), z in zip(keys.items(), base.z, strict=False)  # the base parameters are the first of all
        if not parameter.logarithmic
    }
    key = max(moved, key=lambda k: abs(moved[k]), default="")
    count = moved.get(key, 0.0)
    return key_told(key), count, -math.expm1(len(moved) * math.log1p(-2.0 * ndtr(-abs(count)))) if count else 1.0


def unit_of(machine: Hoist | Axis) -> str:
    """The unit of the input that the residual is in."""
    return kind_of(machine).drive.unit


def _sentences(gap: Gap, unit: str, own: Names = ()) -> list[str]:
    times = gap.residual_rms / gap.noise_rms
    force = "" if gap.force_rms_n is None else f", {gap.force_rms_n:.0f} N on the carriage"
    sentences = [
        f"As the machine is written down, measured and predicted input differ by {figures(gap.nominal_residual_rms)} "
        f"{unit} rms below {figures(gap.band_hz)} Hz.",
        f"With the base parameters refitted within {TOLERANCES:g} tolerances"
        f"{f', beside {listed(own)},' if own else ''} {figures(gap.residual_rms)} {unit} rms "
        f"remain{force}: {times:.1f} times the noise floor of {figures(gap.noise_rms, 2)} {unit}.",
        f"Replayed in open loop, the speed is off by {figures(gap.speed_rmse_percent)} % "
        f"({figures(gap.nominal_speed_rmse_percent)} % before the refit).",
    ]
    if stretch := stretch_of(gap):
        sentences.append(f"Left to itself the refit puts {stretch}.")
    account = "Noise accounts" if stretch else "Noise and tolerances account"
    sentences.append(f"{account} for {'a part of ' if gap.significant else ''}what remains.")
    return sentences


def stretch_of(gap: Gap, always: bool = False) -> str:
    """How far the refit moves a base parameter, and how seldom an honest value lies so far off; where that is not
    improbable without that, or "" if not `always`."""
    key, count = gap.worst_tolerance
    off = f"{key} {abs(count):.1f} tolerances {'above' if count > 0.0 else 'below'} its value"
    if gap.by_chance >= UNLIKELY:
        return off if always else ""
    seldom = f"in {float(f'{1.0 / gap.by_chance:.2g}'):,.0f}" if gap.by_chance > RARE else "in over a million"
    return f"{off}, as one machine {seldom} would by chance"


DRAWS = 2000  # of the bootstrap


@dataclass(frozen=True)
class Shrink:
    """The reduction of the gap on held-out runs. before, after, noise: rms in `unit`, below band_hz; model_error: rms
    of what the verdict allows for beside the noise, as no lumped model is exact.

    by_run: name -> (before, after). ci95: of the factor (`_interval`). speed_*: open-loop replay.
    """

    before: float
    after: float
    noise: float
    unit: str
    band_hz: float
    factor: float
    ci95: tuple[float, float]
    speed_rmse_percent_before: float
    speed_rmse_percent_after: float
    by_run: Mapping[str, tuple[float, float]]
    sentences: tuple[str, ...] = ()
    model_error: float = 0.0

    @property
    def parts(self) -> dict[str, float]:
        """What the residual before consists of, rms; the squares add up to its square."""
        rest, whole = self.after**2, max(self.before, self.after) ** 2
        noise = min(self.noise**2, rest)
        model_error = min(self.model_error**2, rest - noise)
        energy = {"taken away": whole - rest, "sensor noise": noise, "model error that is allowed for": model_error}
        energy["beyond both"] = rest - noise - model_error
        return {name: math.sqrt(max(part, 0.0)) for name, part in energy.items()}


@dataclass(frozen=True)
class Folds:
    """Held-out residuals without and with the effects named."""

    before: HeldOut
    after: HeldOut


def folds_of(search: SearchResult, names: Names, unknown: Explained | None = None) -> Folds:
    """unknown: the table that represents an unknown cause, if there is one."""
    folds = folds_by_run(search.problem)
    before = held_out(search.problem, search.within_tolerances, folds)
    if unknown is not None:
        return Folds(before, unknown.held_out)
    after = held_out(search.problem, search.fits[names], folds) if names else before
    return Folds(before, after)


def shrink_of(
    search: SearchResult,
    keys: Mapping[str, Scalar],
    names: Names,
    folds: Folds,
    seed: int,
    unknown: Explained | None = None,
) -> Shrink:
    """names: the effects of the verdict; empty without a gap, which then does not shrink."""
    problem = search.problem
    before, after = folds.before.rms(problem.inputs), folds.after.rms(problem.inputs)
    plain = _machines(problem, keys, (), folds.before.settings)
    better = unknown.machines if unknown is not None else _machines(problem, keys, names, folds.after.settings)
    speed = [_speed(problem, each) for each in ([plain] if better == plain else [plain, better])]
    sentences, cut = [], [problem.runs[j].name for j in in_parts(problem)]
    if (few := counting(problem)) <= 2:
        only, each = ("One run", "it") if few == 1 else ("Two runs", "each")
        sentences.append(
            f"{only} only: four blocks of {each} were held out in turn, which says less than other runs would."
        )
    elif cut:
        sentences.append(
            f"Of {' and '.join(cut)} four blocks were held out in turn, not the whole run: without "
            f"{'it' if len(cut) == 1 else 'one of them'} the others go one way only."
        )
    return Shrink(
        before=before,
        after=after,
        noise=problem.noise,
        unit=kind_of(problem.machine).drive.unit,
        band_hz=problem.band_hz,
        factor=before / max(after, 1e-12),
        ci95=_interval(problem, folds, seed),
        speed_rmse_percent_before=speed[0],
        speed_rmse_percent_after=speed[-1],
        by_run=_by_run(problem, folds),
        sentences=tuple(sentences),
        model_error=model_error_rms(problem.with_model_error((1.0, 1.0))),
    )


def _by_run(problem: Problem, folds: Folds) -> dict[str, tuple[float, float]]:
    by_run = {}
    for j, run in enumerate(problem.runs):
        rows = np.flatnonzero(problem.run_of_row[: problem.inputs] == j)
        if len(rows):
            sizes = [float(np.sqrt(np.mean(fold.residual[rows] ** 2))) for fold in (folds.before, folds.after)]
            by_run[run.name] = (sizes[0], sizes[1])
    return by_run


def _interval(problem: Problem, folds: Folds, seed: int) -> tuple[float, float]:
    """The 95 % interval of the factor, by a bootstrap over folds; over pieces of time where there are fewer than
    three."""
    of_row = folds.before.fold_of_row[: problem.inputs]
    if len(np.unique(of_row)) < LEAST_RUNS:
        of_row = pieces(problem)
    both = (held_out.residual[: problem.inputs] ** 2 for held_out in (folds.before, folds.after))
    sums = np.array([np.bincount(of_row, squares) for squares in both])[:, np.bincount(of_row) > 0]
    draw = np.random.default_rng(seed).integers(0, sums.shape[1], (DRAWS, sums.shape[1]))
    totals = np.sum(sums[:, draw], axis=2)
    factors = np.sqrt(totals[0] / np.maximum(totals[1], 1e-300))
    low, high = np.quantile(factors, [0.025, 0.975])
    return float(low), float(high)


def _machines(
    problem: Problem, keys: Mapping[str, Scalar], names: Names, settings: Sequence[Setting]
) -> list[Hoist | Axis | None]:
    """For each run the machine that was fitted to the other runs; None if the fit is not a valid machine."""
    machines: list[Hoist | Axis | None] = [None] * len(problem.runs)
    for j in range(len(machines)):
        with suppress(InputError):
            own = {k: v[j] if isinstance(v, tuple) else v for k, v in settings[j].items()}
            machines[j] = machine_of(problem, keys, names, own)
    return machines


def _speed(problem: Problem, machines: Sequence[Hoist | Axis | None]) -> float:
    """The rms speed error of the held-out runs in open-loop replay, per cent of the campaign's speed scale; NaN if no
    run can be replayed. Runs of which nothing counts have none."""
    squares: list[tuple[float, float]] = []
    each = zip(problem.runs, machines, problem.rows, strict=False)
    benches = [InverseSimulation(m, [run], problem.band_hz) for run, m, rows in each if len(rows) and m is not None]
    for bench, states in zip(benches, simulate_replays(*benches), strict=True):
        error = 100.0 * rms(states[:, len(bench.plant.positions)] - bench.motions[0].speed) / problem.bench.scale
        if math.isfinite(error):
            squares.append((error**2, len(bench.runs[0].time_s) * bench.runs[0].sample_time_s))
    total = sum(time for _, time in squares)
    return math.sqrt(sum(square * time for square, time in squares) / total) if total else math.nan
