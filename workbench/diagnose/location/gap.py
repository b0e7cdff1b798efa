"""How large the gap is once the base parameters took what their tolerances allow, and no more."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import Scalar, base_parameters
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import TOLERANCES, SearchResult
from workbench.diagnose.location.records import Delivered, Gap, RunResidual
from workbench.machines import Axis, Hoist, kind_of
from workbench.simulate.replay import ReplayResult, replay_runs

EXCESS = 0.8  # of the noise, rms beside it: a machine without a gap stays below (no model is exact)
STRETCHED = 4.0  # tolerances: the furthest of ten honest values lies further off once in 1,600 machines


DIFFERS = 0.7  # of the energy beyond noise that stays: a run that holds so much alone is not like the others


def delivered_of(noise: float, refitted: ReplayResult, corrected: ReplayResult) -> Delivered:
    """Both machines as replayed: the numbers that the report prints are those that anybody gets with the file. noise:
    rms in the band, in the input's unit."""
    before = np.array([run.residual_rms_moving for run in refitted.runs])
    after = np.array([run.residual_rms_moving for run in corrected.runs])
    length = np.array([np.count_nonzero(run.balance.moving) for run in corrected.runs], dtype=float)
    before, after = np.nan_to_num(before), np.nan_to_num(after)
    beyond, stays = (length * np.maximum(x**2 - noise**2, 0.0) for x in (before, after))
    total, left = max(float(np.sum(beyond)), 1e-300), float(np.sum(stays))
    alone = [len(length) >= 3 and left > 0.0 and part > DIFFERS * left and rms > 2.0 * noise for part, rms in
             zip(stays, after, strict=True)]  # fmt: skip
    rows = tuple(
        RunResidual(run.name, float(part) / total, float(b), float(a), noise, one)
        for run, part, b, a, one in zip(corrected.runs, beyond, before, after, alone, strict=True)
    )
    return Delivered(corrected.residual_rms_moving, corrected.speed_rmse_percent, rows)


def gap_of(problem: Problem, search: SearchResult, refitted: ReplayResult) -> Gap:
    """The gap: the residual with the base parameters refitted within their tolerances, `search.within_tolerances`.

    A fit that tolerances merely hold, `search.base`, may stretch one to ten times itself and hide a gap there;
    how far it does is the worst tolerance. refitted: its machine, replayed.
    """
    base, keys = search.base, base_parameters(problem.machine, problem.runs)
    left = refitted.residual_rms_moving
    plain = replay_runs(problem.machine, problem.runs, problem.band_hz)
    worst = worst_tolerance(keys, base)
    excess = math.sqrt(max(left**2 - problem.noise**2, 0.0))
    stretched = abs(worst[1]) > STRETCHED
    kind = kind_of(problem.machine)
    lift = None if kind.lever is None else kind.lever(problem.machine)
    gap = Gap(
        residual_rms=left,
        noise_rms=problem.noise,
        band_hz=problem.band_hz,
        force_rms_n=None if lift is None else left / lift,
        speed_rmse_percent=refitted.speed_rmse_percent,
        nominal_residual_rms=plain.residual_rms_moving,
        nominal_speed_rmse_percent=plain.speed_rmse_percent,
        worst_tolerance=worst,
        significant=excess > EXCESS * problem.noise or stretched,
        sentences=(),
    )
    return replace(gap, sentences=tuple(_sentences(gap, unit_of(problem.machine))))


def worst_tolerance(keys: Mapping[str, Scalar], base: Fitted) -> tuple[str, float]:
    """The key of the base parameter that the fit moved furthest, and by how many of its tolerances."""
    moved = {
        key: float(z) / parameter.std
        for (key, parameter), z in zip(keys.items(), base.z, strict=False)  # the base parameters are the first of all
        if not parameter.logarithmic
    }
    key = max(moved, key=lambda k: abs(moved[k]), default="")
    return key, moved.get(key, 0.0)


def unit_of(machine: Hoist | Axis) -> str:
    """The unit of the input that the residual is in."""
    return kind_of(machine).drive.unit


def _sentences(gap: Gap, unit: str) -> list[str]:
    times = gap.residual_rms / gap.noise_rms
    force = "" if gap.force_rms_n is None else f", {gap.force_rms_n:.0f} N on the carriage"
    sentences = [
        f"As the machine is written down, measured and predicted input differ by {gap.nominal_residual_rms:.3g} {unit} "
        f"rms below {gap.band_hz:.3g} Hz.",
        f"With the base parameters refitted within {TOLERANCES:g} tolerances {gap.residual_rms:.3g} {unit} rms remain"
        f"{force}: {times:.1f} times the noise floor of {gap.noise_rms:.2g} {unit}.",
        f"Replayed in open loop, the speed is off by {gap.speed_rmse_percent:.3g} % "
        f"({gap.nominal_speed_rmse_percent:.3g} % before the refit).",
    ]
    key, count = gap.worst_tolerance
    if abs(count) > STRETCHED:
        sentences.append(
            f"Left to itself the refit moves {key} by {abs(count):.1f} tolerances: more than an honest nominal value "
            "is off."
        )
    sentences.append(
        "There is a gap." if gap.significant else "Noise and tolerances account for what remains: no significant gap."
    )
    return sentences
