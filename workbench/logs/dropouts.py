"""Dropouts: stretches in which a channel is exactly constant although the measured quantity is not."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from workbench.kinds import Kind
from workbench.logs.faults import Fault, seconds
from workbench.logs.plausible import MOVING, driven_signals
from workbench.logs.still import Channel, Stretch
from workbench.machine import Axis, Hoist
from workbench.run import Array

KEPT = 1.0 / 3.0  # of the run that must be whole
CARRIES_ON = 0.7  # of the sum around it: what the motors give together where one of them gives nothing


@dataclass(frozen=True)
class Part:
    """The samples first … end − 1 of a run, and notes on the others."""

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
        channel = Channel(time_s, values[name])
        is_input = name in kind.inputs
        for stretch in [*channel.rests(), *(channel.brief_freezes() if is_input else channel.brief_jumps())]:
            problem = f"{label(name)} is exactly {values[name][stretch[0]]:.6g} from {_span(time_s, stretch)}"
            if is_input:
                verdict = _input_dropout(values, name, channel, stretch, kind, moving)
                if verdict == "note":
                    notes.append(f"{problem} while the machine moves; kept")
                if verdict != "lost":
                    continue
            elif not channel.jumps(stretch):
                continue
            lost.setdefault(stretch, f"{problem} while the machine moves")
    if not lost:
        return Part(0, len(time_s), notes)
    stretches = sorted(lost)
    more = f", and {len(lost) - 1} more such stretch{'es' if len(lost) > 2 else ''}" if len(lost) > 1 else ""
    problem = lost[stretches[0]] + more
    first, end = _longest_whole(len(time_s), stretches)
    if end - first < KEPT * len(time_s):
        raise fault(f"{problem}; is the channel frozen? What is whole beside it is too short")
    kept = f"kept from {seconds(time_s[first])} to {seconds(time_s[end - 1])}"
    return Part(first, end, [*notes, f"{problem}; the run is {kept}, {len(time_s) - end + first} samples are left out"])


def drop_frozen(
    time_s: Array, values: dict[str, Array], optional: tuple[str, ...], label: Callable[[str], str]
) -> tuple[dict[str, Array], list[str]]:
    """The signals without optional channels that are frozen for a while: noisy elsewhere, or with a jump at the end."""
    notes = []
    kept = dict(values)
    for name in optional:
        if name not in values:
            continue
        channel = Channel(time_s, values[name])
        for stretch in channel.rests():
            if channel.jumps(stretch) or (channel.inside(stretch) and channel.too_long(stretch)):
                value = values[name][stretch[0]]
                notes.append(f"{label(name)} dropped: it is exactly {value:.6g} from {_span(time_s, stretch)}")
                del kept[name]
                break
    return kept, notes


def _input_dropout(
    values: Mapping[str, Array], name: str, channel: Channel, stretch: Stretch, kind: Kind, moving: float
) -> str:
    """ "lost", "note" (odd, yet a machine may do so), or "" for a rest that is none."""
    start, end = stretch
    if not _moves(values, stretch, kind, moving):
        return ""
    zero = values[name][start] == 0.0
    if not zero and not (channel.inside(stretch) and channel.too_long(stretch)):
        return ""
    if not kind.holds_load:
        return "note" if zero or channel.too_long(stretch) else ""
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


def _longest_whole(n: int, lost: list[Stretch]) -> Stretch:
    """The longest part outside the given stretches, which may overlap."""
    parts, at = [], 0
    for start, end in lost:
        if start > at:
            parts.append((at, start))
        at = max(at, end)
    parts.append((at, n))
    return max(parts, key=lambda part: part[1] - part[0])


def _span(time_s: Array, stretch: Stretch) -> str:
    return f"{seconds(time_s[stretch[0]])} to {seconds(time_s[stretch[1] - 1])}"
