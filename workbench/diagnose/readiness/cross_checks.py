"""Signals that say the same thing twice, against each other: a slip of sign or unit shows in their ratio."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.errors import InputError
from workbench.machine import Axis, Hoist
from workbench.run import Array, Run
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
        for text in _of_hoist(bench, j, file) if isinstance(bench.machine, Hoist) else _of_axis(bench, j, file):
            warnings.setdefault(text, []).append(run.name)
        slope = reference_slope(bench, j)
        if slope is not None and not 1.0 / FAR < slope < FAR:
            text = "the motion is not that of its reference; is the reference in another unit? No delay is read off it"
            warnings.setdefault(text, []).append(run.name)
    return [f"{text} ({', '.join(names)})." for text, names in warnings.items()]


def reference_slope(bench: Bench, j: int) -> float | None:
    """What the motion makes of its logged reference; None without one, 0 where they are not alike."""
    both = reference_of(bench.machine, bench.runs[j])
    return None if both is None else _slope(*both)


def reference_of(machine: Hoist | Axis, run: Run) -> tuple[Array, Array] | None:
    """(reference, motion) of one run, where the reference is logged."""
    if isinstance(machine, Axis):
        names = (machine.reference_signal, machine.position_signal)
    else:
        names = ("speed_reference_rad_s", "speed_motor_rad_s")
    if any(name not in run for name in names) or np.ptp(run[names[0]]) == 0.0:
        return None
    return run[names[0]], run[names[1]]


def _of_hoist(bench: Bench, j: int, file: object) -> list[str]:
    run, machine = bench.runs[j], bench.machine
    assert isinstance(machine, Hoist)
    found = []
    if "position_carriage_m" in run:
        slope = _slope(machine.lift_m_per_rad * bench.motions[j].position, run["position_carriage_m"])
        if slope < 1.0 / FAR or slope > FAR:
            raise InputError(
                f"position_carriage_m goes {slope:.3g} times the way that speed_motor_rad_s takes the carriage; "
                "is its sign flipped, or is it in another unit?",
                file=file,
                place=run.name,
            )
        if abs(slope - 1.0) > NEAR:
            found.append(
                "position_carriage_m does not go the way that speed_motor_rad_s and machine.yaml's drum and gearbox say"
            )
    if "tension_dead_line_n" in run:
        carried = (machine.carriage.mass_kg + run.payload_kg) * machine.gravity_m_s2 / 2.0
        ratio = float(np.mean(run["tension_dead_line_n"])) / carried
        if not 1.0 / FAR < ratio < FAR:
            raise InputError(
                f"tension_dead_line_n is {ratio * carried:.4g} N on average, half of carriage and payload weighs "
                f"{carried:.4g} N; is it in kN, of both falls, or its sign flipped?",
                file=file,
                place=run.name,
            )
    return found


def _of_axis(bench: Bench, j: int, file: object) -> list[str]:
    run, machine = bench.runs[j], bench.machine
    assert isinstance(machine, Axis)
    position, speed = machine.position_signal, machine.speed_signal
    if position not in run or speed not in run:
        return []
    differentiated = np.gradient(lowpass(run.time_s, run[position], bench.band_hz), run.time_s)
    slope = _slope(lowpass(run.time_s, run[speed], bench.band_hz), differentiated)
    if 1.0 / FAR < slope < FAR:
        return []
    raise InputError(
        f"{position} changes {slope:.3g} times as fast as {speed} says; is the sign of one of them flipped, "
        "or are they in different units?",
        file=file,
        place=run.name,
    )


def _slope(x: Array, y: Array) -> float:
    """Of y over x, by least squares in the one that is noisier; 0 where they do not go together."""
    a, b = x - x.mean(), y - y.mean()
    xx, yy, xy = float(a @ a), float(b @ b), float(a @ b)
    if xx == 0.0 or yy == 0.0 or abs(xy) < ALIKE * np.sqrt(xx * yy):
        return 0.0
    return xy / xx
