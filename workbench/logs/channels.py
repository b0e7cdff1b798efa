"""Checks of single signals: infinite, dead or clipped channels, and spikes of one or two samples."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np

from workbench.core.run import Array
from workbench.logs.faults import Fault, seconds

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


MIN_PLATEAU = 5  # samples in a row at the extreme value
MIN_CLIPPED = 10  # samples at the extreme value in all
PLATEAU_RATIO = 3  # … and that many times longer than the signal rests anywhere else


def refuse_infinite(time_s: Array, values: Mapping[str, Array], label: Callable[[str], str], fault: Fault) -> None:
    for name, column in values.items():
        infinite = np.isinf(column)
        if infinite.any():
            raise fault(f"{label(name)} is infinite at {seconds(time_s[int(np.argmax(infinite))])}")


def is_constant(column: Array) -> bool:
    return bool(column.min() == column.max())


def drop_dead(
    values: dict[str, Array], optional: Collection[str], keep: Collection[str], label: Callable[[str], str]
) -> tuple[dict[str, Array], list[str]]:
    """Optional channels that are zero throughout are dropped, except those in `keep`."""
    dead = [name for name in optional if name in values and name not in keep and not values[name].any()]
    notes = [f"{label(name)} dropped: it is zero throughout" for name in dead]
    return {name: column for name, column in values.items() if name not in dead}, notes


def clipped(time_s: Array, column: Array) -> str | None:
    """A sentence if a noisy signal often rests at its largest or smallest value, as a clipped signal does."""
    if is_constant(column):
        return None
    for extreme, word in ((float(column.max()), "largest"), (float(column.min()), "smallest")):
        at = column == extreme
        count = int(np.count_nonzero(at))
        if count < MIN_CLIPPED or extreme == 0.0:
            continue
        plateau, start = _longest_rest(column, at)
        elsewhere, _ = _longest_rest(column, ~at)
        if plateau >= MIN_PLATEAU and plateau >= PLATEAU_RATIO * elsewhere:
            return (
                f"may be clipped: {count} samples at its {word} value {extreme:g}, "
                f"the longest stretch from {seconds(time_s[start])}"
            )
    return None


def _longest_rest(column: Array, among: np.ndarray) -> tuple[int, int]:
    """(length, start) of the longest run of equal consecutive values among some samples."""
    same = (np.diff(column) == 0.0) & among[1:] & among[:-1]
    edges = np.diff(np.concatenate(([0], same.astype(np.int8), [0])))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    if not len(starts):
        return 1, int(np.argmax(among)) if among.any() else 0
    longest = int(np.argmax(ends - starts))
    return int(ends[longest] - starts[longest]) + 1, int(starts[longest])
