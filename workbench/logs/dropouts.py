"""Dropouts: stretches in which a channel is exactly constant although the measured quantity is not."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from workbench.core.run import Array
from workbench.logs.faults import Fault, seconds
from workbench.logs.plausible import MOVING, driven_signals
from workbench.machines import Axis, Hoist, Kind

LEAST, LEAST_S = 10, 0.25  # samples, and time, that are worth a word; less time is where no chance explains it
CHANCE = 1e-6  # that equal samples in a row of a noisy channel come by chance
TURNS = 0.3  # share of turning points among a noisy channel's samples; white noise has 2/3
JUMP = 10.0  # times what nearly all steps keep below: how a channel comes back from a dropout

Stretch = tuple[int, int]  # first sample, one after the last


@dataclass(frozen=True, eq=False)
class Channel:
    """A channel's samples and when they were taken: column, time_s (n,). Each stretch is judged in constant time."""

    time_s: Array
    column: Array

    def rests(self) -> list[Stretch]:
        """Stretches of equal values that last; none of a channel that is constant throughout."""
        starts, ends = self._equal
        lasting = self._lasting
        return _pairs(starts[lasting], ends[lasting])

    def brief_freezes(self) -> list[Stretch]:
        """Shorter stretches of a noisy channel that are too long for chance."""
        starts, ends = self._equal
        return _pairs(*(ends_[~self._lasting & (ends - starts > self._most_by_chance(0))] for ends_ in (starts, ends)))

    def brief_jumps(self) -> list[Stretch]:
        """Shorter stretches with a jump of the channel before and after."""
        starts, ends = self._equal
        between = ~self._lasting & (starts > 0) & (ends < len(self.column))
        starts, ends = starts[between], ends[between]
        there = np.abs(self.column[starts] - self.column[starts - 1])
        back = np.abs(self.column[ends] - self.column[ends - 1])
        sudden = np.minimum(there, back) > self._least_jump
        return _pairs(starts[sudden], ends[sudden]) if self._least_jump > 0.0 else []

    def jumps(self, stretch: Stretch) -> bool:
        """Whether the channel jumps at an end of the stretch, which the motion of a stopped machine does not."""
        start, end = stretch
        before = abs(self.column[start] - self.column[start - 1]) if start else 0.0
        after = abs(self.column[end] - self.column[end - 1]) if end < len(self.column) else 0.0
        return self._least_jump > 0.0 and bool(max(before, after) > self._least_jump)

    def inside(self, stretch: Stretch) -> bool:
        """Whether the value is inside the channel's range: at an end a clipped channel rests."""
        low, high = self._range
        return bool(low < self.column[stretch[0]] < high)

    def too_long(self, stretch: Stretch) -> bool:
        """Whether the stretch is too long for chance, in a channel that is noisy elsewhere."""
        length = stretch[1] - stretch[0]
        return length > self._most_by_chance(length)

    def _most_by_chance(self, without: int) -> float:
        """Equal samples in a row, as the channel beside `without` of them is; infinite where it is not noisy."""
        steps, equal, turns = self._counts
        steps -= max(without, 0)
        if steps < 50:
            return math.inf
        share = (equal - max(without - 1, 0)) / steps
        if turns / steps < TURNS or share > 0.9:
            return math.inf
        return math.log(CHANCE / len(self.column)) / math.log(max(share, 0.01))

    @cached_property
    def _equal(self) -> tuple[np.ndarray, np.ndarray]:
        """First samples, and ones after the last, of all stretches of at least LEAST equal samples."""
        same = np.concatenate(([False], self.column[1:] == self.column[:-1], [False]))
        edges = np.flatnonzero(same[1:] != same[:-1])
        starts, ends = edges[::2], np.minimum(edges[1::2] + 1, len(self.column))
        long = (ends - starts >= LEAST) & (ends - starts < len(self.column))
        return starts[long], ends[long]

    @cached_property
    def _lasting(self) -> np.ndarray:
        starts, ends = self._equal
        return np.asarray(self.time_s[ends - 1] - self.time_s[starts] >= LEAST_S)

    @cached_property
    def _counts(self) -> tuple[int, int, int]:
        """Steps from sample to sample, equal ones among them, and turning points."""
        steps = np.diff(self.column)
        turns = np.count_nonzero(np.sign(steps[1:]) * np.sign(steps[:-1]) < 0.0)
        return len(steps), int(np.count_nonzero(steps == 0.0)), int(turns)

    @cached_property
    def _least_jump(self) -> float:
        """The largest step that the motion of this channel explains; 0 for a channel without motion."""
        size = np.abs(np.diff(self.column[:: max(1, len(self.column) // 200_000)]))
        low, high = self._range
        return max(JUMP * float(np.percentile(size, 98.0)), 0.05 * (high - low))

    @cached_property
    def _range(self) -> tuple[float, float]:
        return float(self.column.min()), float(self.column.max())


def _pairs(starts: np.ndarray, ends: np.ndarray) -> list[Stretch]:
    return [(int(start), int(end)) for start, end in zip(starts, ends, strict=True)]


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
