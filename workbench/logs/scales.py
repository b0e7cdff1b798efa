"""Redundant signals: an error of unit, sign or size of an optional signal shows in its ratio to the other one."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from workbench.kinds import Kind
from workbench.logs.faults import Fault
from workbench.machine import Axis, Hoist
from workbench.run import Array

FAR = 2.0  # a ratio beyond this or its inverse is a unit, not a machine
ALIKE = 0.9  # correlation: below, two signals do not show the same motion
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
