"""Stretches in which a channel is exactly constant, and whether its noise or its jumps make that a fault."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from workbench.run import Array

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
