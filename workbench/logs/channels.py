"""Checks of single signals: infinite, dead, frozen or clipped channels."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np

from workbench.logs.faults import Fault, seconds
from workbench.run import Array

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
