"""The reduction of the gap on held-out runs, in torque and in open-loop speed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.errors import InputError
from workbench.diagnose.hypotheses.free_parameters import Names, Scalar, Setting
from workbench.diagnose.hypotheses.held_out import HeldOut, folds_by_run, held_out
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import SearchResult
from workbench.diagnose.machines import machine_of
from workbench.diagnose.unexplained.unknown import Explained
from workbench.machines import Axis, Hoist, kind_of
from workbench.simulate.replay import replay_runs

DRAWS = 2000  # of the bootstrap


@dataclass(frozen=True)
class Shrink:
    """The reduction of the gap on held-out runs. before, after, noise: rms in `unit`, below band_hz.

    by_run: name -> (before, after). ci95: of the factor, a bootstrap over runs. speed_*: open-loop replay.
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
    speed = _speed(problem, plain), _speed(problem, better)
    sentences = []
    if len(problem.runs) == 1:
        sentences.append(
            "One run only: four blocks of it were held out in turn, which says less than other runs would."
        )
    return Shrink(
        before=before,
        after=after,
        noise=problem.noise,
        unit=kind_of(problem.machine).drive.unit,
        band_hz=problem.band_hz,
        factor=before / max(after, 1e-12),
        ci95=_interval(folds, problem.inputs, seed),
        speed_rmse_percent_before=speed[0],
        speed_rmse_percent_after=speed[1],
        by_run=_by_run(problem, folds),
        sentences=tuple(sentences),
    )


def _by_run(problem: Problem, folds: Folds) -> dict[str, tuple[float, float]]:
    by_run = {}
    for j, run in enumerate(problem.runs):
        rows = np.flatnonzero(problem.run_of_row[: problem.inputs] == j)
        if len(rows):
            sizes = [float(np.sqrt(np.mean(fold.residual[rows] ** 2))) for fold in (folds.before, folds.after)]
            by_run[run.name] = (sizes[0], sizes[1])
    return by_run


def _interval(folds: Folds, inputs: int, seed: int) -> tuple[float, float]:
    """The 95 % interval of the factor, by a bootstrap over folds."""
    of_row = folds.before.fold_of_row[:inputs]
    count = int(np.max(of_row)) + 1 if inputs else 0
    sums = np.array(
        [
            [np.sum(held_out.residual[:inputs][of_row == f] ** 2) for f in range(count)]
            for held_out in (folds.before, folds.after)
        ]
    )
    draw = np.random.default_rng(seed).integers(0, max(count, 1), (DRAWS, max(count, 1)))
    totals = np.sum(sums[:, draw], axis=2)
    factors = np.sqrt(totals[0] / np.maximum(totals[1], 1e-300))
    low, high = np.quantile(factors, [0.025, 0.975])
    return float(low), float(high)


def _machines(
    problem: Problem, keys: Mapping[str, Scalar], names: Names, settings: Sequence[Setting]
) -> list[Hoist | Axis | None]:
    """For each run the machine that was fitted to the other runs; None if the fit is not a valid machine."""
    machines: list[Hoist | Axis | None] = []
    for j in range(len(problem.runs)):
        setting = settings[j] if len(settings) == len(problem.runs) else settings[0]
        try:
            machines.append(machine_of(problem, keys, names, for_run(setting, j)))
        except InputError:
            machines.append(None)
    return machines


def _speed(problem: Problem, machines: Sequence[Hoist | Axis | None]) -> float:
    """The rms speed error of the held-out runs in open-loop replay, per cent; NaN if no run can be replayed."""
    squares: list[tuple[float, int]] = []
    for j, run in enumerate(problem.runs):
        machine = machines[j] if len(machines) == len(problem.runs) else machines[0]
        if machine is None:
            continue
        error = replay_runs(machine, [run], problem.band_hz).speed_rmse_percent
        if math.isfinite(error):
            squares.append((error**2 * len(run.time_s), len(run.time_s)))
    total = sum(n for _, n in squares)
    return math.sqrt(sum(s for s, _ in squares) / total) if total else math.nan


def for_run(setting: Setting, j: int) -> dict[str, float]:
    """The setting with the values of run j."""
    return {k: v[j] if isinstance(v, tuple) else v for k, v in setting.items()}
