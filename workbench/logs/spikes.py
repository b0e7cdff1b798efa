"""Spikes: one or two samples far from their neighbours on both sides, which no machine produces."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workbench.logs.faults import seconds
from workbench.run import Array

LONGEST = 2  # samples
LONGEST_S = 0.02  # from the last sample before to the first one after, less a step; slower logs show real peaks
STEPS = 10.0  # times what nearly all steps of the signal keep below …
NEARLY_ALL = 98.0  # … per cent
RANGE = 0.2  # of the range that nearly all samples keep to
MOST = 0.002  # share of the samples: more is how the signal is
_SAMPLED = 200_000  # of the steps, for the percentiles of very long logs


def bridge_spikes(
    time_s: Array, values: dict[str, Array], label: Callable[[str], str]
) -> tuple[dict[str, Array], list[str]]:
    """The signals with spikes bridged by straight lines, and a note on each signal that had some."""
    notes: list[str] = []
    mended = dict(values)
    for name, column in values.items():
        spikes = find_spikes(time_s, column)
        if not spikes:
            continue
        mended[name] = column.copy()
        for start, end in spikes:
            mended[name][start:end] = np.interp(
                time_s[start:end], [time_s[start - 1], time_s[end]], [column[start - 1], column[end]]
            )
        start, count = spikes[0][0], sum(end - start for start, end in spikes)
        notes.append(
            f"{label(name)}: {count} sample{'s' if count > 1 else ''} far off the neighbours on both sides bridged by "
            f"straight lines, first {column[start]:.4g} at {seconds(time_s[start])}"
        )
    return mended, notes


def find_spikes(time_s: Array, column: Array) -> list[tuple[int, int]]:
    """(first sample, one after the last) of each spike; [] if there are so many that they belong to the signal."""
    if len(column) < 10:
        return []
    steps = np.diff(column)
    size = np.abs(steps)
    every = max(1, len(size) // _SAMPLED)
    low, high = np.percentile(column[::every], [2.0, NEARLY_ALL])
    least = max(STEPS * float(np.percentile(size[::every], NEARLY_ALL)), RANGE * float(high - low))
    if not 0.0 < least < np.inf:
        return []
    jumps = np.flatnonzero(size > least)
    if len(jumps) > 2 + 2 * MOST * len(column):
        return []
    spikes: list[tuple[int, int]] = []
    for at, jump in enumerate(jumps[:-1]):
        back = int(jumps[at + 1])
        start, end = int(jump) + 1, back + 1
        if end - start > LONGEST or time_s[back] - time_s[jump] > LONGEST_S * (1.0 + 1e-9):
            continue
        returns = abs(float(column[end] - column[start - 1])) < 0.5 * min(size[jump], size[back])
        if steps[jump] * steps[back] < 0.0 and returns and (not spikes or spikes[-1][1] < start):
            spikes.append((start, end))
    return spikes
