"""Checks of a campaign before a diagnosis, beyond those of its reader: motion, length, one machine, signs, units."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.core.errors import InputError
from workbench.diagnose.readiness.cross_checks import check_other_signals
from workbench.diagnose.readiness.rigid import as_well_shown, rigid_of
from workbench.diagnose.readiness.same_machine import check_machine, listed
from workbench.diagnose.readiness.variety import variety
from workbench.logs import Campaign
from workbench.machines import kind_of
from workbench.simulate.blows import blows_of
from workbench.simulate.driven import Bench
from workbench.simulate.lowpass import LEAST_PERIODS, lowpass, noise_rms

FEWEST = 20.0  # independent values while moving: about as many as a diagnosis turns numbers
ABOVE_NOISE = 5.0  # in the band: less is no motion


def check_runs(campaign: Campaign) -> tuple[str, ...]:
    """Warnings: effects that these runs cannot show or tell apart.

    InputError, naming the runs, for runs that are too short, that all stand still, that are of
    different machines, and for signals of the wrong sign or unit.
    """
    bench = Bench(campaign.machine, campaign.runs, blows=blows_of(campaign.machine, campaign.runs))
    file = campaign.path / "runs.yaml"
    _check_lengths(bench, file)
    going = [j for j in range(len(bench.runs)) if moves(bench, j)]
    if not going:
        raise InputError(
            f"{'the run stands' if len(bench.runs) == 1 else 'all runs stand'} still; a diagnosis needs motion: "
            "without it there is no friction and no inertia to see",
            file=file,
        )
    _check_frozen(bench, going, file)
    _check_enough(bench, going, file)
    rigid = [rigid_of(bench, j) for j in going]
    if kind_of(bench.machine).holds_load:  # the load says which signal is upside down; else the signals have to say it
        odd, warnings = check_machine(bench, rigid, file), check_other_signals(bench, going, file)
    else:
        warnings, odd = check_other_signals(bench, going, file), check_machine(bench, as_well_shown(rigid), file)
    still = [run.name for j, run in enumerate(bench.runs) if j not in going]
    if still:
        one = len(still) == 1
        who = listed(still).replace("run", "Run", 1)
        warnings.append(
            f"{who} {'stands' if one else 'stand'} still throughout and {'adds' if one else 'add'} "
            "nothing to the diagnosis."
        )
    return (*warnings, *odd, *variety(bench, going))


def moves(bench: Bench, j: int) -> bool:
    """Whether run j moves: faster than at rest, and beyond the noise of its motion."""
    run, motion = bench.runs[j], bench.motions[j]
    speed = lowpass(run.time_s, motion.speed, bench.band_hz)[bench.inside[j]]
    noise = noise_rms(run.time_s, motion.speed, bench.band_hz)
    return bool(bench.moving[j].any()) and float(np.max(np.abs(speed))) > ABOVE_NOISE * noise


def _check_lengths(bench: Bench, file: object) -> None:
    needed = LEAST_PERIODS / bench.band_hz
    short = [run for run in bench.runs if run.duration_s < needed]
    if short:
        spans = ", ".join(f"{run.name} lasts {run.duration_s:.3g} s" for run in short[:6])
        raise InputError(
            f"{spans}; a diagnosis in the band of {bench.band_hz:.3g} Hz needs at least {needed:.3g} s of a run "
            f"({LEAST_PERIODS:g} periods); leave {'it' if len(short) == 1 else 'them'} out of runs.yaml",
            file=file,
        )


def _check_enough(bench: Bench, going: Sequence[int], file: object) -> None:
    moving = sum(float(np.count_nonzero(bench.moving[j])) * bench.runs[j].sample_time_s for j in going)
    needed = FEWEST / (2.0 * bench.band_hz)
    if moving < needed:
        raise InputError(
            f"{'the run moves' if len(bench.runs) == 1 else 'the runs together move'} for {moving:.2g} s, rests and "
            f"both ends left out; a diagnosis in the band of {bench.band_hz:.3g} Hz needs at least {needed:.2g} s",
            file=file,
        )


def _check_frozen(bench: Bench, going: Sequence[int], file: object) -> None:
    name = bench.plant.input
    for j in going:
        values = bench.inputs[j]
        if values.min() == values.max():
            raise InputError(
                f"{name} is {values[0]:g} throughout while the machine moves; is the channel frozen?",
                file=file,
                place=bench.runs[j].name,
            )
