"""Units of a log: its signals against each other, against the drive, and the input against what the motion takes.

A log in mm under a name that says m, or in kN under one that says N, is off by a factor that no machine is off by; it
is refused with the factor that would fit. An optional signal of another unit or sign is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from workbench.core.run import Array
from workbench.logs.faults import Fault
from workbench.machines import Axis, Hoist, Kind, kind_of

FAR = 2.0  # of two signals of one motion: beyond it, or below its inverse, one is in another unit
ALIKE = 0.9  # correlation: below, they do not show the same motion
TOO_FAST, TOO_STRONG = 2.0, 2.0  # times what the drive states
OFF = 20.0  # times what the nominal machine takes for this motion, or a part of it
SMOOTH = 0.003  # of the run's duration
# What a factor is usually called.
UNITS = (
    (1e-3, "milli"), (1e-2, "centi"), (1e3, "kilo"), (1.0 / 60.0, "a minute"), (1e-3 / 60.0, "milli a minute"),
)  # fmt: skip
ANGLES = (
    (math.pi / 180.0, "degrees"), (2.0 * math.pi, "turns"), (2.0 * math.pi / 60.0, "rpm"), (1e-3, "milli"),
)  # fmt: skip


def check_axis_units(
    machine: Hoist | Axis, time_s: Array, values: Mapping[str, Array], label: Callable[[str], str], fault: Fault
) -> None:
    """InputError for a signal that is another unit's. Kinds that state limits are not looked at."""
    kind = kind_of(machine)
    drive = getattr(machine, "drive", None)
    if kind.limits is not None or drive is None or len(time_s) < 50:
        return
    position, speed, name = kind.plant.positions[0], kind.plant.speeds[0], kind.plant.input
    if position in values and speed in values:
        _one_motion(position, speed, time_s, values, label, fault)
    rate, acceleration = _motion(kind, time_s, values)
    moved = speed if speed in values else position
    fast, top = float(np.percentile(np.abs(rate), 99.0)), drive.top_speed
    if top and fast > TOO_FAST * top:
        raise fault(
            f"{label(moved)} moves at {fast:.4g}, the drive's top speed is {top:g}"
            f"{_fits(top / fast, moved, below=True)}"
        )
    strong = float(np.percentile(np.abs(values[name]), 99.0))
    if strong > TOO_STRONG * drive.limit:
        raise fault(
            f"{label(name)} reaches {strong:.4g} {kind.drive.unit}, the drive's limit is {drive.limit:g} "
            f"{kind.drive.unit}{_fits(drive.limit / strong, name, below=True)}"
        )
    taken = _taken(kind, machine, values, rate, acceleration)
    ratio = float(np.sqrt(np.mean(values[name] ** 2))) / taken if taken > 0.0 else 1.0
    if not 1.0 / OFF < ratio < OFF:
        raise fault(
            f"{label(name)} is {ratio:.3g} times what this machine takes for the motion of {label(moved)}"
            f"{_fits(1.0 / ratio, name)} for {name}{_fits(ratio, moved).replace('; ', ', or ', 1)} for {moved}; "
            "or is machine.yaml another machine's?"
        )


def _one_motion(
    position: str, speed: str, time_s: Array, values: Mapping[str, Array], label: Callable[[str], str], fault: Fault
) -> None:
    """Position and integrated speed change alike."""
    v = values[speed]
    way = np.concatenate(([0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(time_s))))
    # A drift of the integral and an offset say nothing of the unit.
    a, b = (y - np.polyval(np.polyfit(time_s, y, 1), time_s) for y in (way, values[position]))
    xx, yy, xy = float(a @ a), float(b @ b), float(a @ b)
    if not (xx > 0.0 and yy > 0.0) or abs(xy) < ALIKE * math.sqrt(xx) * math.sqrt(yy):
        return
    slope = xy / xx
    if not 1.0 / FAR < slope < FAR:
        raise fault(
            f"{label(position)} changes {slope:.4g} times as much as the integrated {label(speed)}"
            f"{_fits(1.0 / slope, position)} for {position}{_fits(slope, speed).replace('; ', ', or ', 1)} for {speed}"
        )


def _motion(kind: Kind, time_s: Array, values: Mapping[str, Array]) -> tuple[Array, Array]:
    """Smoothed speed and acceleration, (n,)."""
    from scipy.ndimage import gaussian_filter1d

    position, speed = kind.plant.positions[0], kind.plant.speeds[0]
    step_s = float(np.median(np.diff(time_s)))
    width = max(SMOOTH * float(time_s[-1] - time_s[0]) / step_s, 1.0)
    smooth = gaussian_filter1d(values[speed if speed in values else position], width, mode="nearest")
    rate = smooth if speed in values else np.gradient(smooth, time_s)
    return rate, np.gradient(rate, time_s)


def _taken(kind: Kind, machine: Hoist | Axis, values: Mapping[str, Array], rate: Array, acceleration: Array) -> float:
    """Rms of the input that the nominal machine takes at most: every part counted with its size."""
    top = float(np.percentile(np.abs(rate), 99.0))
    body = kind.rigid(machine, 0.0)
    inertia = abs(body.inertia) * float(np.sqrt(np.mean(acceleration**2)))
    role = getattr(machine, "role", None)
    if role is None or top == 0.0:
        return 0.0
    friction = max(role("coulomb_forward"), role("coulomb_backward")) + role("viscous") * top
    return inertia + friction + abs(role("gravity_sine")) + abs(role("gravity_constant"))


def _fits(factor: float, signal: str, *, below: bool = False) -> str:
    """; a scale of 0.001 (mm …) would fit: the usual factor next to the one that is needed, or the largest below it."""
    units = ANGLES if "_rad" in signal else UNITS
    if below:
        scale, unit = max(((s, u) for s, u in units if s <= TOO_FAST * factor), default=(factor, ""))
    else:
        scale, unit = min(units, key=lambda one: abs(math.log(abs(factor) / one[0])))
        if abs(math.log(abs(factor) / scale)) > math.log(3.0):
            scale, unit = abs(factor), ""
    sign = -1.0 if factor < 0.0 else 1.0
    return f"; a scale of {sign * scale:.6g}{f' ({unit})' if unit else ''} would fit"


LARGEST = 1e9  # of any signal in SI units; beyond it no sensor measures


def drop_wrong_scale(
    kind: Kind,
    machine: Hoist | Axis,
    payload_kg: float,
    time_s: Array,
    values: dict[str, Array],
    label: Callable[[str], str],
) -> tuple[dict[str, Array], list[str]]:
    """The signals without optional ones of another unit or sign, and the reasons."""
    reasons: dict[str, str] = {}
    for name, (other, twin) in _twins(kind, machine, time_s, values).items():
        slope = _slope(twin, values[name])
        if slope is not None and not 1.0 / FAR < slope < FAR:
            reasons[name] = f"it changes {slope:.3g} times as much as {other} says"
    if kind.dead_line is not None and (line := kind.dead_line.signal) in values:
        carried, mean = kind.dead_line.at_rest(machine, payload_kg), float(np.mean(values[line]))
        if not carried / FAR < mean < carried * FAR:
            reasons[line] = f"it is {mean:.4g} N on average, at rest the load makes it {carried:.4g} N"
    notes = [f"{label(name)} dropped: {why}; is it in another unit?" for name, why in reasons.items()]
    return {name: column for name, column in values.items() if name not in reasons}, notes


def check_sizes(
    values: dict[str, Array], needed: tuple[str, ...], label: Callable[[str], str], fault: Fault
) -> tuple[dict[str, Array], list[str]]:
    """The signals without optional ones of impossible size. InputError for a needed signal."""
    kept, notes = dict(values), []
    for name, column in values.items():
        largest = max(abs(float(column.min())), abs(float(column.max())))
        if largest <= LARGEST:
            continue
        problem = f"reaches {largest:.3g}, expected at most {LARGEST:g} in SI units"
        if name in needed:
            raise fault(f"{label(name)} {problem}")
        notes.append(f"{label(name)} dropped: it {problem}")
        del kept[name]
    return kept, notes


def _twins(
    kind: Kind, machine: Hoist | Axis, time_s: Array, values: Mapping[str, Array]
) -> dict[str, tuple[str, Array]]:
    """Optional signal -> the redundant signal, and its values in the optional signal's unit."""
    reference, follows = kind.reference
    twins = {reference: (follows, values[follows])} if follows in values else {}
    speed, placed = kind.plant.speeds[0], kind.plant.positions[kind.plant.placed]
    if kind.lever is not None and placed in values:
        v = values[speed]
        way = np.concatenate(([0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(time_s))))
        twins[placed] = (f"the integrated {speed}", kind.lever(machine) * way)
    return {name: twin for name, twin in twins.items() if name in values}


def _slope(x: Array, y: Array) -> float | None:
    """Of y over x by least squares; None where they do not go together."""
    a, b = x - x.mean(), y - y.mean()
    xx, yy, xy = float(a @ a), float(b @ b), float(a @ b)
    if not (xx > 0.0 and yy > 0.0 and np.isfinite(xx * yy)) or abs(xy) < ALIKE * np.sqrt(xx) * np.sqrt(yy):
        return None
    return xy / xx
