"""Missing samples: short gaps are bridged; longer gaps are errors or drop the signal. Each is reported."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from workbench.core.run import Array
from workbench.logs.faults import Fault, seconds

MAX_MISSING = 5  # samples in a row that may be bridged …
MAX_BRIDGE_S = 0.1  # … as long as the samples either side are no farther apart
MAX_SHARE = 0.05  # of a signal's samples that may be missing
MIN_KEPT = 0.5  # of a run that must be left when its end, or what is missing in its middle, is cut off
LEAST_PART = 0.1  # of a run: a shorter stretch between holes is left out


def fill_gaps(
    time_s: Array, values: dict[str, Array], needed: Collection[str], label: Callable[[str], str], fault: Fault
) -> tuple[Array, dict[str, Array], list[str]]:
    """Signals without a missing sample.

    A short gap is bridged by a straight line; a short one at the start takes the first
    value that is there. A needed signal that ends early shortens the run. A longer gap
    is an error in a needed signal; an optional signal is dropped for it.
    """
    notes: list[str] = []
    for name in needed:
        if np.isnan(values[name]).all():
            raise fault(f"{label(name)} holds no numbers at all")
    end = min((int(np.flatnonzero(~np.isnan(values[name]))[-1]) + 1 for name in needed), default=len(time_s))
    if end < len(time_s):
        ended = [label(name) for name in needed if np.isnan(values[name][end:]).any()]
        if end < MIN_KEPT * len(time_s):
            raise fault(f"{ended[0]} ends at {seconds(time_s[end - 1])}, the run at {seconds(time_s[-1])}")
        notes.append(
            f"{ended[0]} ends at {seconds(time_s[end - 1])}; the run's last {len(time_s) - end} samples are cut off"
        )
        time_s, values = time_s[:end], {name: column[:end] for name, column in values.items()}
    filled: dict[str, Array] = {}
    for name, column in values.items():
        missing = np.isnan(column)
        if not missing.any():
            filled[name] = column
            continue
        problem, text, first_s = _bridgeable(time_s, missing)
        if problem and name in needed:
            raise fault(f"{label(name)}: {problem}")
        if problem:
            notes.append(f"{label(name)} dropped: {problem}")
            continue
        filled[name] = np.where(missing, np.interp(time_s, time_s[~missing], column[~missing]), column)
        notes.append(f"{label(name)}: {text} bridged by straight lines, first at {seconds(first_s)}")
    return time_s, filled, notes


def whole_stretches(time_s: Array, values: dict[str, Array], needed: Collection[str]) -> list[tuple[int, int]]:
    """(first, end) of the stretches of a run between holes of its needed signals that are too long to bridge.

    Only stretches of at least LEAST_PART of the run count, and a hole at the run's end is not one; [] where what is
    left is too little of the run, or nothing has to be cut.
    """
    hole = np.zeros(len(time_s), dtype=bool)
    for name in needed:
        missing = np.isnan(values[name])
        starts, ends = _stretches(missing)
        before, after = np.maximum(starts - 1, 0), np.minimum(ends, len(time_s) - 1)
        long = (ends - starts > MAX_MISSING) | (time_s[after] - time_s[before] > MAX_BRIDGE_S * (1 + 1e-9))
        for start, end in zip(starts[long & (ends < len(time_s))], ends[long & (ends < len(time_s))], strict=True):
            hole[start:end] = True
    if not hole.any():
        return []
    firsts, ends = _stretches(~hole)
    kept = [(int(a), int(b)) for a, b in zip(firsts, ends, strict=True) if b - a >= LEAST_PART * len(time_s)]
    return kept if sum(b - a for a, b in kept) >= MIN_KEPT * len(time_s) else []


def _stretches(chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First samples, and ones after the last, of the stretches of chosen samples."""
    edges = np.diff(np.concatenate(([0], chosen.astype(np.int8), [0])))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def _bridgeable(time_s: Array, missing: np.ndarray) -> tuple[str, str, float]:
    """(what forbids bridging or "", what there is to bridge, time of the first missing sample)."""
    starts, ends = _stretches(missing)
    lengths = ends - starts
    before, after = np.maximum(starts - 1, 0), np.minimum(ends, len(time_s) - 1)
    widths = time_s[after] - time_s[before]
    long = (lengths > MAX_MISSING) | (widths > MAX_BRIDGE_S * (1 + 1e-9))
    total, first = int(lengths.sum()), float(time_s[starts[0]])
    if long.any():
        worst = int(np.argmax(np.where(long, widths, 0.0)))
        return (
            (
                f"{lengths[worst]} samples in a row are missing from {seconds(time_s[starts[worst]])} to "
                f"{seconds(time_s[ends[worst] - 1])}; at most {MAX_MISSING} within {MAX_BRIDGE_S} s can be bridged"
            ),
            "",
            first,
        )
    if total > MAX_SHARE * len(time_s):
        return f"{total} of {len(time_s)} samples are missing, the first at {seconds(first)}", "", first
    plural = "s" if total > 1 else ""
    return "", f"{total} missing sample{plural} in {len(starts)} gap{'s' if len(starts) > 1 else ''}", first
