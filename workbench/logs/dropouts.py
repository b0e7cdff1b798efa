"""Stretches in which a channel stands exactly still although what it measures does not."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from workbench.kinds import Kind
from workbench.logs.faults import Fault, seconds
from workbench.logs.plausible import MOVING, driven_signals
from workbench.machine import Axis, Hoist
from workbench.run import Array

LEAST, LEAST_S = 10, 0.25  # samples, and time, that are worth a word
CHANCE = 1e-6  # that equal samples in a row of a noisy channel come by chance
TURNS = 0.3  # share of turning points among a noisy channel's samples; white noise has 2/3
JUMP = 10.0  # times what nearly all steps keep below: how a channel comes back from a dropout
KEPT = 1.0 / 3.0  # of the run that must be whole
CARRIES_ON = 0.7  # of the sum around it: what the motors give together where one of them gives nothing

Stretch = tuple[int, int]  # first sample, one after the last


@dataclass(frozen=True)
class Part:
    """The samples first … end − 1 of a run, and what is to be said of the rest."""

    first: int
    end: int
    notes: list[str]


def whole_part(
    time_s: Array,
    values: Mapping[str, Array],
    kind: Kind,
    machine: Hoist | Axis,
    label: Callable[[str], str],
    fault: Fault,
) -> Part:
    """The longest part of a run without a dropout of its input or motion. InputError when that is too short."""
    lost: dict[Stretch, str] = {}
    notes: list[str] = []
    moving = 0.0 if kind.nominal_speed is None else MOVING * kind.nominal_speed(machine)
    for name in (*kind.inputs, *driven_signals(kind)):
        if name not in values:
            continue
        for stretch in rests(time_s, values[name]):
            said = f"{label(name)} is exactly {values[name][stretch[0]]:.6g} from {_span(time_s, stretch)}"
            if name in kind.inputs:
                verdict = _input_dropout(values, name, stretch, kind, moving)
                if verdict == "note":
                    notes.append(f"{said} while the machine moves; kept")
                if verdict != "lost":
                    continue
            elif not _motion_dropout(values[name], stretch):
                continue
            lost.setdefault(stretch, f"{said} while the machine moves")
    if not lost:
        return Part(0, len(time_s), notes)
    stretches = sorted(lost)
    more = f", and {len(lost) - 1} more such stretch{'es' if len(lost) > 2 else ''}" if len(lost) > 1 else ""
    said = lost[stretches[0]] + more
    first, end = _longest_whole(len(time_s), stretches)
    if end - first < KEPT * len(time_s):
        raise fault(f"{said}; is the channel frozen? What is whole beside it is too short")
    kept = f"kept from {seconds(time_s[first])} to {seconds(time_s[end - 1])}"
    return Part(first, end, [*notes, f"{said}; the run is {kept}, {len(time_s) - end + first} samples are left out"])


def drop_frozen(
    time_s: Array, values: dict[str, Array], optional: tuple[str, ...], label: Callable[[str], str]
) -> tuple[dict[str, Array], list[str]]:
    """Without the optional channels that stand still for a while although they are noisy, or jump on from there."""
    notes = []
    kept = dict(values)
    for name in optional:
        if name not in values:
            continue
        column = values[name]
        for stretch in rests(time_s, column):
            if _motion_dropout(column, stretch) or (_inside(column, stretch) and _too_long(column, stretch)):
                notes.append(
                    f"{label(name)} dropped: it is exactly {column[stretch[0]]:.6g} from {_span(time_s, stretch)}"
                )
                del kept[name]
                break
    return kept, notes


def rests(time_s: Array, column: Array) -> list[Stretch]:
    """Stretches of equal values, long enough to be worth a word; none of a channel that is constant throughout."""
    same = np.concatenate(([False], column[1:] == column[:-1], [False]))
    edges = np.flatnonzero(same[1:] != same[:-1])
    starts, ends = edges[::2], edges[1::2] + 1
    lengths, last = ends - starts, np.minimum(ends, len(column)) - 1
    long = (lengths < len(column)) & (lengths >= LEAST) & (time_s[last] - time_s[starts] >= LEAST_S)
    return [(int(start), int(end)) for start, end in zip(starts[long], ends[long], strict=True)]


def _input_dropout(values: Mapping[str, Array], name: str, stretch: Stretch, kind: Kind, moving: float) -> str:
    """ "lost", "note" (odd, yet a machine may do so), or "" for a rest that is none."""
    start, end = stretch
    column = values[name]
    if not _moves(values, stretch, kind, moving):
        return ""
    zero = column[start] == 0.0
    if not zero and not (_inside(column, stretch) and _too_long(column, stretch)):
        return ""
    if not kind.holds_load:
        return "note" if zero or _too_long(column, stretch) else ""
    total = values[kind.plant.input]
    if name != kind.plant.input and zero:
        # One motor may fail and the other carry on: then the sum goes on as around the stretch.
        width = end - start
        around = np.concatenate((total[max(0, start - width) : start], total[end : end + width]))
        if len(around) and abs(total[start:end].mean()) > CARRIES_ON * abs(around.mean()):
            return "note"
    return "lost"


def _moves(values: Mapping[str, Array], stretch: Stretch, kind: Kind, moving: float) -> bool:
    start, end = stretch
    position, speed = driven_signals(kind)
    if speed in values:
        return float(np.mean(np.abs(values[speed][start:end]))) > moving
    return float(np.ptp(values[position][start:end])) > 0.01 * float(np.ptp(values[position]))


def _motion_dropout(column: Array, stretch: Stretch) -> bool:
    """Whether motion that stands still jumps at an end of it, as none does that has really stopped."""
    start, end = stretch
    size = np.abs(np.diff(column[:: max(1, len(column) // 200_000)]))
    least = max(JUMP * float(np.percentile(size, 98.0)), 0.05 * float(np.ptp(column)))
    before = abs(column[start] - column[start - 1]) if start else 0.0
    after = abs(column[end] - column[end - 1]) if end < len(column) else 0.0
    return least > 0.0 and bool(max(before, after) > least)


def _inside(column: Array, stretch: Stretch) -> bool:
    """Not at an end of the channel's range, where a clipped one rests."""
    return bool(column.min() < column[stretch[0]] < column.max())


def _too_long(column: Array, stretch: Stretch) -> bool:
    """Whether a channel that is noisy elsewhere cannot rest for so long by chance."""
    start, end = stretch
    steps = np.concatenate((np.diff(column[:start]), np.diff(column[end:])))
    if len(steps) < 50:
        return False
    equal = float(np.mean(steps == 0.0))
    turns = float(np.mean(steps[1:] * steps[:-1] < 0.0))
    if turns < TURNS or equal > 0.9:
        return False
    return end - start > math.log(CHANCE / len(column)) / math.log(max(equal, 0.01))


def _longest_whole(n: int, lost: list[Stretch]) -> Stretch:
    """The longest part between stretches that overlap or follow each other."""
    parts, at = [], 0
    for start, end in lost:
        if start > at:
            parts.append((at, start))
        at = max(at, end)
    parts.append((at, n))
    return max(parts, key=lambda part: part[1] - part[0])


def _span(time_s: Array, stretch: Stretch) -> str:
    return f"{seconds(time_s[stretch[0]])} to {seconds(time_s[stretch[1] - 1])}"
