"""Identification of a campaign's machine: friction levels by iteration, then all free values in one fit."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench import __version__
from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.core.shown import Shown
from workbench.identify.fit import Fit, fit
from workbench.identify.iteration import Levels, friction_levels
from workbench.identify.models import BalanceModel
from workbench.identify.parameters import free_parameters
from workbench.logs import Campaign
from workbench.machines import Axis, Hoist, kind_of, with_values
from workbench.simulate.driven import Bench
from workbench.simulate.replay import ReplayResult, own_log, replay_runs


@dataclass(frozen=True, repr=False)
class Identification(Shown):
    """An identification: the machine, the fit, the paper's iteration, and replays before and after."""

    campaign: Campaign
    machine: Hoist | Axis
    fit: Fit
    levels: Levels
    before: ReplayResult
    after: ReplayResult


def identify(
    campaign: Campaign, *, free: Sequence[str] | None = None, band_hz: float | None = None, date: str = ""
) -> Identification:
    """Fit the campaign's machine to its runs; `free` are keys of machine.yaml, None for the kind's default.

    date: when, for the record; the caller's clock. Without it the same runs give the same record.
    """
    machine = campaign.machine
    bench = Bench(machine, campaign.runs, band_hz)
    levels = friction_levels(bench)
    parameters = free_parameters(machine, campaign.runs, free)
    ties = _ties(machine, [f.key for f in parameters])
    model = BalanceModel(bench)

    def own(z: Array) -> Array:
        """Residuals of the fitted model on its own log: the motion that the measured input gives it, sampled."""
        values = {f.key: f.value(float(x)) for f, x in zip(parameters, z, strict=True)}
        return model.on(own_log(with_values(machine, values), campaign.runs)).residuals(parameters, [z])[0]

    try:
        result = fit(model, parameters, ties, own)
    except (np.linalg.LinAlgError, ZeroDivisionError, OverflowError) as error:
        problem = "the fit breaks down, its numbers are not finite; is a value of machine.yaml in another unit?"
        raise InputError(problem, file=campaign.path) from error
    identified = with_values(machine, result.values())
    identified = identified.model_copy(update={"identified": record(campaign, result, levels, bench.band_hz, date)})
    return Identification(
        campaign,
        identified,
        result,
        levels,
        replay_runs(machine, campaign.runs, bench.band_hz),
        replay_runs(identified, campaign.runs, bench.band_hz),
    )


def _ties(machine: Hoist | Axis, keys: Sequence[str]) -> list[tuple[str, str]]:
    """Pairs of values that are kept equal, because the runs show only two sums of the three; see `Kind.ties`."""
    return [pair for pair, third in kind_of(machine).ties if all(key in keys for key in (*pair, third))]


def _digest(runs: Sequence[Run]) -> str:
    """SHA-256 of the samples that the fit has seen, as they were read and repaired."""
    digest = hashlib.sha256()
    for run in runs:
        for name, column in (("time_s", run.time_s), *sorted(run.signals.items())):
            digest.update(f"{run.name}\0{name}\0{len(column)}\0".encode() + np.ascontiguousarray(column).tobytes())
    return digest.hexdigest()


def record(campaign: Campaign, result: Fit, levels: Levels, band_hz: float, date: str) -> dict[str, object]:
    """The record of the identification that goes into the machine's file."""
    return {
        "campaign": campaign.name,
        "runs": [run.name for run in campaign.runs],
        **({"date": date} if date else {}),
        "data_sha256": _digest(campaign.runs),
        "version": __version__,
        "method": "joint least squares on the band-limited torque balance, tolerances as priors",
        "band_hz": float(f"{band_hz:.6g}"),
        "residual_rms": float(f"{result.residual_rms:.6g}"),
        "noise_rms": float(f"{result.noise_rms:.6g}"),
        "parameters": {
            f.key: {
                "value": float(f"{value:.8g}"),
                "std_error": float(f"{error:.4g}"),
                "nominal": f.nominal,
                "held_by_tolerance": f.prior_std is not None,
            }
            for f, value, error in zip(result.free, result.value, result.std_error, strict=True)
        },
        "paper_iteration": {
            "forward": float(f"{levels.forward[-1]:.8g}"),
            "backward": float(f"{levels.backward[-1]:.8g}"),
            "rounds": len(levels.forward) - 1,
            "settled": levels.settled,
        },
        "statements": list(result.statements),
    }
