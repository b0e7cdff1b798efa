"""The runs compared with their machine and with each other: signs, units, and whether all are of one machine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.diagnose.readiness.rigid import Rigid
from workbench.machines import kind_of
from workbench.simulate.driven import Bench

WRONG_UNIT = 5.0  # inertia over the nominal one, or the inverse: no such machine, but such units
ODD_INERTIA, ODD_LOAD = 2.0, 1.4  # over the nominal ones: worth a warning
LOADS_APART = 1.25  # of the loads that runs hold over the nominal ones: offsets and payload errors stay below
INERTIAS_APART = 2.0  # a lag of a tenth of a second takes a third off the inertia of a brisk run
SPEED_SLIPS = (("rpm", 60.0 / (2.0 * math.pi)), ("degrees per second", 180.0 / math.pi))

Ratios = list[tuple[str, float]]


def check_machine(bench: Bench, rigid: Sequence[Rigid], file: object) -> list[str]:
    """Warnings. InputError for signals upside down or in another unit, and for runs of different machines."""
    _check_signs(bench, rigid, file)
    _check_units(bench, rigid, file)
    struck = any(len(blows) for blows in bench.blows)
    return [*_check_one_machine(rigid, file, kind_of(bench.machine).holds_load, struck), *_odd(rigid)]


def listed(names: Sequence[str], most: int = 6) -> str:
    """run a; runs a, b and c"""
    if len(names) == 1:
        return f"run {names[0]}"
    shown = list(names[:most])
    if len(names) > most:
        return f"runs {', '.join(shown)} and {len(names) - most} more"
    return f"runs {', '.join(shown[:-1])} and {shown[-1]}"


def _of(which: Sequence[Rigid], all_runs: Sequence[Run]) -> str:
    """in 4 of 6 runs (a, b, c, d)"""
    names = ", ".join(r.run for r in which)
    if len(all_runs) == 1:
        return f"in run {names}"
    many = f"all {len(all_runs)}" if len(which) == len(all_runs) else f"{len(which)} of {len(all_runs)}"
    return f"in {many} runs ({names})"


def _check_signs(bench: Bench, rigid: Sequence[Rigid], file: object) -> None:
    """On a hoist the load shows whether torque or speed has the wrong sign; on an axis it can be either."""
    signal, runs, kind = bench.plant.input, bench.runs, kind_of(bench.machine)
    positive = f"{kind.directions.positive} is positive"
    sinking = [r for r in rigid if r.hold is not None and r.hold < 0.0]
    both = [r for r in sinking if r.inertia is not None and r.inertia > 0.0]
    torque = [r for r in sinking if r not in both]
    braked = [r for r in rigid if r.inertia is not None and r.inertia < 0.0 and r not in sinking]
    if torque:
        raise InputError(
            f"torque pulls the load down and falls where the load is lifted faster {_of(torque, runs)}: is the sign of "
            f"{signal} flipped? {positive}; give its columns a scale of -1",
            file=file,
        )
    if both:
        raise InputError(
            f"torque pulls the load down {_of(both, runs)}: are torque and speed both counted downwards? "
            "Up is positive; give both columns a scale of -1",
            file=file,
        )
    if braked and kind.holds_load:
        raise InputError(
            f"speed rises against the torque {_of(braked, runs)}: is its sign flipped? "
            f"{positive}; give its column a scale of -1",
            file=file,
        )
    if braked:
        raise InputError(
            f"speed rises against {signal} {_of(braked, runs)}: is the sign of {signal} or of the motion flipped? "
            f"{positive} for both; give the column a scale of -1",
            file=file,
        )


def _check_units(bench: Bench, rigid: Sequence[Rigid], file: object) -> None:
    """A speed k times too large gives 1/k of the inertia, and so does an axis' force k times too small."""
    off = [r for r in rigid if r.inertia is not None and not 1.0 / WRONG_UNIT < r.inertia < WRONG_UNIT]
    if not off:
        return
    typical = float(np.median([r.inertia for r in off if r.inertia is not None]))
    load = kind_of(bench.machine).holds_load
    signals = bench.plant.speeds[0] if load else f"{bench.plant.input} or the motion"
    unit = next((unit for unit, k in SPEED_SLIPS if 0.7 < typical * k < 1.4), None)
    guess = f"is {signals} in {unit}?" if unit else f"is {signals} in another unit, or machine.yaml another machine's?"
    if unit:
        scale = next(1.0 / k for name, k in SPEED_SLIPS if name == unit)
        guess += f" Then give the column a scale of {scale:.6g}"
    raise InputError(
        f"the torque that an acceleration takes is {typical:.3g} times what the nominal inertia needs "
        f"{_of(off, bench.runs)}; {guess}",
        file=file,
    )


def _check_one_machine(rigid: Sequence[Rigid], file: object, holds_load: bool, struck: bool) -> list[str]:
    """InputError where runs hold loads, or axes show inertias, of two machines. A warning for a hoist's inertia:
    a slow run hardly shows it, and a load that swings hides some of it; the load that is held says more. A warning
    as well where blows of a play come again: the inertia behind it goes with the motor part of the time only."""
    loads = [(r.run, r.hold) for r in rigid if r.hold is not None]
    inertias = [(r.run, r.inertia) for r in rigid if r.inertia is not None]
    warnings = []
    for ratios, apart, what, remedy in (
        (loads, LOADS_APART, "load", ", or is payload_kg wrong"),
        (inertias, INERTIAS_APART, "inertia", ", or is their speed in another unit" if holds_load else ""),
    ):
        split = _two_groups([(name, value) for name, value in ratios if value is not None], apart)
        if split is None:
            continue
        others, odd = split
        one = len(odd) == 1
        said = (
            f"{listed([n for n, _ in odd])} disagree{'s' if one else ''} with the machine and with the others: "
            f"{'its' if one else 'their'} {what} is {_span(odd)} times the nominal one, that of "
            f"{listed([n for n, _ in others])} {_span(others)} times; "
            f"{'is it' if one else 'are they'} of another machine{remedy}?"
        )
        if not struck and (what == "load" or not holds_load):
            raise InputError(said, file=file)
        warnings.append(f"{said[0].upper()}{said[1:]}")
    return warnings


def _odd(rigid: Sequence[Rigid]) -> list[str]:
    """Warnings if all runs agree with each other but not with machine.yaml."""
    sentences = []
    for what, ratios, odd in (
        ("inertia", [r.inertia for r in rigid if r.inertia is not None], ODD_INERTIA),
        ("load", [r.hold for r in rigid if r.hold is not None], ODD_LOAD),
    ):
        typical = float(np.median(ratios)) if ratios else 1.0
        if not 1.0 / odd <= typical <= odd:
            sentences.append(
                f"The {what} is about {typical:.2f} times what machine.yaml says in all runs; "
                "is it this machine's file?"
            )
    return sentences


def _two_groups(ratios: Ratios, apart: float) -> tuple[Ratios, Ratios] | None:
    """The runs split at the largest step of their ratios, the group nearer to 1 first; None if it is small."""
    if len(ratios) < 2:
        return None
    ordered = sorted(ratios, key=lambda named: named[1])
    steps = [math.log(b[1] / a[1]) for a, b in pairwise(ordered)]
    at = int(np.argmax(steps))
    if steps[at] < math.log(apart):
        return None
    low, high = ([named for named in ratios if named in part] for part in (ordered[: at + 1], ordered[at + 1 :]))
    off = [abs(float(np.median([math.log(value) for _, value in group]))) for group in (low, high)]
    return (low, high) if off[0] <= off[1] else (high, low)


def _span(ratios: Ratios) -> str:
    values = [value for _, value in ratios]
    low, high = f"{min(values):.2f}", f"{max(values):.2f}"
    return low if low == high else f"{low} to {high}"
