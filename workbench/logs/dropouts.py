"""Dropouts: stretches in which a channel is exactly constant although the measured quantity is not."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from workbench.core.run import Array
from workbench.logs.plausible import MOVING
from workbench.logs.raw_run import RawRun, seconds, stretches

LEAST, LEAST_S = 10, 0.25  # samples, and time, that are worth a word; less time is where no chance explains it
CHANCE = 1e-6  # that equal samples in a row of a noisy channel come by chance
TURNS = 0.3  # share of turning points among a noisy channel's samples; white noise has 2/3
JUMP = 10.0  # times what nearly all steps keep below: how a channel comes back from a dropout

Stretch = tuple[int, int]  # first sample, one after the last


class Channel:
    """A channel's samples and when they were taken: column, time_s (n,). Each stretch is judged in constant time."""

    def __init__(self, time_s: Array, column: Array) -> None:
        self.time_s, self.column = time_s, column
        self.low, self.high = float(column.min()), float(column.max())
        steps = np.diff(column)
        turns = np.count_nonzero(np.sign(steps[1:]) * np.sign(steps[:-1]) < 0.0)
        self._counts = len(steps), int(np.count_nonzero(steps == 0.0)), int(turns)
        starts, ends = stretches(steps == 0.0)
        ends = np.minimum(ends + 1, len(column))
        long = (ends - starts >= LEAST) & (ends - starts < len(column))
        self._starts, self._ends = starts[long], ends[long]  # of at least LEAST equal samples
        self._lasting = time_s[self._ends - 1] - time_s[self._starts] >= LEAST_S

    def rests(self) -> list[Stretch]:
        """Stretches of equal values that last; none of a channel that is constant throughout."""
        return self._chosen(self._lasting)

    def brief_freezes(self) -> list[Stretch]:
        """Shorter stretches of a noisy channel that are too long for chance."""
        return self._chosen(~self._lasting & (self._ends - self._starts > self._most_by_chance(0)))

    def brief_jumps(self) -> list[Stretch]:
        """Shorter stretches with a jump of the channel before and after."""
        between = ~self._lasting & (self._starts > 0) & (self._ends < len(self.column))
        return [stretch for stretch in self._chosen(between) if min(self._ends_of(stretch)) > self._least_jump > 0.0]

    def jumps(self, stretch: Stretch) -> bool:
        """Whether the channel jumps at an end of the stretch, which the motion of a stopped machine does not."""
        return max(self._ends_of(stretch)) > self._least_jump > 0.0

    def inside(self, stretch: Stretch) -> bool:
        """Whether the value is inside the channel's range: at an end a clipped channel rests."""
        return bool(self.low < self.column[stretch[0]] < self.high)

    def too_long(self, stretch: Stretch) -> bool:
        """Whether the stretch is too long for chance, in a channel that is noisy elsewhere."""
        length = stretch[1] - stretch[0]
        return length > self._most_by_chance(length)

    def _chosen(self, which: np.ndarray) -> list[Stretch]:
        return [(int(a), int(b)) for a, b in zip(self._starts[which], self._ends[which], strict=True)]

    def _ends_of(self, stretch: Stretch) -> tuple[float, float]:
        """The steps to the stretch and from it; 0 at an end of the log."""
        start, end = stretch
        column = self.column
        before = abs(float(column[start] - column[start - 1])) if start else 0.0
        return before, abs(float(column[end] - column[end - 1])) if end < len(column) else 0.0

    def _most_by_chance(self, without: int) -> float:
        """Equal samples in a row, as the channel beside `without` of them is; infinite where it is not noisy."""
        steps, equal, turns = self._counts
        steps -= max(without, 0)
        share = (equal - max(without - 1, 0)) / max(steps, 1)
        if steps < 50 or turns / steps < TURNS or share > 0.9:
            return math.inf
        return math.log(CHANCE / len(self.column)) / math.log(max(share, 0.01))

    @cached_property
    def _least_jump(self) -> float:
        """The largest step that the motion of this channel explains; 0 for a channel without motion."""
        size = np.abs(np.diff(self.column[:: max(1, len(self.column) // 200_000)]))
        return max(JUMP * float(np.percentile(size, 98.0)), 0.05 * (self.high - self.low))


KEPT = 1.0 / 3.0  # of the run that must be whole
CARRIES_ON = 0.7  # of the sum around it: what the motors give together where one of them gives nothing


def cut_dropouts(run: RawRun) -> None:
    """Keep the longest part of a run without a dropout of its input or motion. InputError when that is too short."""
    lost: dict[Stretch, str] = {}
    time_s, inputs = run.time_s, run.kind.inputs
    for name in (*inputs, run.position, run.speed):
        if name not in run.values:
            continue
        channel = Channel(time_s, run.values[name])
        for stretch in [*channel.rests(), *(channel.brief_freezes() if name in inputs else channel.brief_jumps())]:
            problem = f"{run.label(name)} is exactly {channel.column[stretch[0]]:.6g} from {_span(time_s, stretch)}"
            verdict = "lost" if channel.jumps(stretch) else ""
            if name in inputs:
                verdict = _input_dropout(run, name, channel, stretch)
            if verdict == "note":
                run.notes.append(f"{problem} while the machine moves; kept")
            elif verdict == "lost":
                lost.setdefault(stretch, f"{problem} while the machine moves")
    if not lost:
        return
    parts, at = [], 0
    for start, end in sorted(lost):
        if start > at:
            parts.append((at, start))
        at = max(at, end)
    first, end = max([*parts, (at, len(time_s))], key=lambda part: part[1] - part[0])
    problem = lost[min(lost)]
    if len(lost) > 1:
        problem += f", and {len(lost) - 1} more such stretch{'es' if len(lost) > 2 else ''}"
    if end - first < KEPT * len(time_s):
        raise run.fault(f"{problem}; is the channel frozen? What is whole beside it is too short")
    span = f"{seconds(time_s[first])} to {seconds(time_s[end - 1])}"
    left_out = f"{len(time_s) - end + first} samples are left out"
    run.notes.append(f"{problem}; the run is kept from {span}, {left_out}")
    run.entry = run.begun_at(first, run.entry.name, run.values)
    run.cut(first, end)


def drop_frozen(run: RawRun) -> None:
    """Optional channels that are frozen for a while are dropped: noisy elsewhere, or with a jump at the end. A
    reference may well rest."""
    for name in run.kind.signals.optional:
        if name not in run.values or name == run.kind.reference[0]:
            continue
        channel = Channel(run.time_s, run.values[name])
        for stretch in channel.rests():
            if channel.jumps(stretch) or (channel.inside(stretch) and channel.too_long(stretch)):
                run.drop(name, f"it is exactly {channel.column[stretch[0]]:.6g} from {_span(run.time_s, stretch)}")
                break


def _input_dropout(run: RawRun, name: str, channel: Channel, stretch: Stretch) -> str:
    """ "lost", "note" (odd, yet a machine may do so), or "" for a rest that is none."""
    start, end = stretch
    if run.speed in run.values:
        nominal = run.kind.nominal_speed
        moving = 0.0 if nominal is None else MOVING * nominal(run.machine)
        moves = float(np.mean(np.abs(run.values[run.speed][start:end]))) > moving
    else:
        position = run.values[run.position]
        moves = float(np.ptp(position[start:end])) > 0.01 * float(np.ptp(position))
    zero = channel.column[start] == 0.0
    if not moves or not (zero or (channel.inside(stretch) and channel.too_long(stretch))):
        return ""
    if not run.kind.holds_load:
        return "note" if zero or channel.too_long(stretch) else ""
    total = run.values[run.kind.plant.input]
    if name != run.kind.plant.input and zero:
        # One motor may fail and the other carry on: then the sum goes on as around the stretch.
        width = end - start
        around = np.concatenate((total[max(0, start - width) : start], total[end : end + width]))
        if len(around) and abs(total[start:end].mean()) > CARRIES_ON * abs(around.mean()):
            return "note"
    return "lost"


def _span(time_s: Array, stretch: Stretch) -> str:
    return f"{seconds(time_s[stretch[0]])} to {seconds(time_s[stretch[1] - 1])}"
