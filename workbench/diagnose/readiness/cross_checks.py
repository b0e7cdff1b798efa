"""Redundant signals compared with each other: an error of sign or unit shows in their ratio."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.machines import Axis, Hoist, kind_of
from workbench.simulate.driven import Bench
from workbench.simulate.lowpass import lowpass

FAR = 2.0  # a ratio beyond this or its inverse is a unit, not a machine
NEAR = 0.1  # what geometry, layers and a yielding wire may make of it
ALIKE = 0.8  # correlation: below, the two do not show the same motion


def check_other_signals(bench: Bench, going: Sequence[int], file: object) -> list[str]:
    """Warnings. InputError where two signals of one run contradict each other."""
    warnings: dict[str, list[str]] = {}
    for j in going:
        run = bench.runs[j]
        for text in _of_kind(bench, j, file):
            warnings.setdefault(text, []).append(run.name)
        slope = reference_slope(bench, j)
        if slope is not None and not 1.0 / FAR < slope < FAR:
            text = "the motion is not that of its reference; is the reference in another unit? No delay is read off it"
            warnings.setdefault(text, []).append(run.name)
    return [f"{text} ({', '.join(names)})." for text, names in warnings.items()]


def reference_slope(bench: Bench, j: int) -> float | None:
    """The slope of the motion over its logged reference; None without a reference, 0 if they are not related."""
    both = reference_of(bench.machine, bench.runs[j])
    return None if both is None else _slope(*both)


def reference_of(machine: Hoist | Axis, run: Run) -> tuple[Array, Array] | None:
    """(reference, motion) of one run, where the reference is logged."""
    names = kind_of(machine).reference
    if any(name not in run for name in names) or np.ptp(run[names[0]]) == 0.0:
        return None
    return run[names[0]], run[names[1]]


def _of_kind(bench: Bench, j: int, file: object) -> list[str]:
    """Warnings about run j. InputError if two of its signals contradict each other."""
    run, kind = bench.runs[j], kind_of(bench.machine)
    if kind.cross_checks is None:
        return []

    def smooth(values: Array) -> Array:
        return lowpass(run.time_s, values, bench.band_hz)

    odd = []
    for check in kind.cross_checks(bench.machine, run, bench.motions[j].position, smooth, _slope):
        if not 1.0 / FAR < check.ratio < FAR:
            raise InputError(check.wrong, file=file, place=run.name)
        if check.odd and abs(check.ratio - 1.0) > NEAR:
            odd.append(check.odd)
    return odd


def _slope(x: Array, y: Array) -> float:
    """The slope of y over x, by least squares in the noisier of the two; 0 if they are not related."""
    a, b = x - x.mean(), y - y.mean()
    xx, yy, xy = float(a @ a), float(b @ b), float(a @ b)
    if xx == 0.0 or yy == 0.0 or abs(xy) < ALIKE * np.sqrt(xx * yy):
        return 0.0
    return xy / xx
