"""Checks of a run's time: it must rise; repeated stamps are merged, irregular steps and gaps are noted."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workbench.core.run import Array
from workbench.logs.faults import Fault, seconds

MIN_SAMPLES = 10
MIN_DURATION_S = 0.2
MAX_STEP_S = 0.5  # the median step; machines of this kind swing at some hertz
MIN_STEP_S = 2e-6
IRREGULAR = 0.1  # a step that far off the median, relative, makes time irregular
GAP_STEPS = 5.0  # a step of that many medians is a gap
MAX_AVERAGED = 0.01  # share of samples that may carry a repeated stamp with other values


def check_time(time_s: Array, row_name: Callable[[int], str], label: str, fault: Fault) -> None:
    """InputError, naming the row, for time that is missing, infinite, goes backwards or is far too short or coarse."""
    if len(time_s) < MIN_SAMPLES:
        rows = "only the header" if len(time_s) == 0 else f"{len(time_s)} row{'s' if len(time_s) > 1 else ''}"
        raise fault(f"holds {rows}; expected at least {MIN_SAMPLES} samples")
    if not np.isfinite(time_s).all():
        row = int(np.argmin(np.isfinite(time_s)))
        what = "missing" if np.isnan(time_s[row]) else "infinite"
        last = f", after {seconds(time_s[row - 1])}" if row else ""
        raise fault(f"{label} is {what} at {row_name(row)}{last}")
    steps = np.diff(time_s)
    if not np.isfinite(steps).all():
        raise fault(f"{label} spans more than numbers can hold")
    if (steps < 0.0).any():
        row = int(np.argmax(steps < 0.0))
        more = int(np.count_nonzero(steps < 0.0)) - 1
        tail = f", and {more} more times" if more else ""
        raise fault(
            f"{label} goes backwards from {seconds(time_s[row])} to {seconds(time_s[row + 1])} "
            f"at {row_name(row + 1)}{tail}"
        )
    duration = float(time_s[-1] - time_s[0])
    rising = steps[steps > 0.0]
    if not len(rising):
        raise fault(f"{label} stands still at {seconds(time_s[0])}")
    step = float(np.median(rising))
    if step > MAX_STEP_S:
        raise fault(
            f"{label} has a step of {step:g} s, expected at most {MAX_STEP_S} s; "
            "if it is in milliseconds, give the column a scale of 0.001"
        )
    if step < MIN_STEP_S:
        raise fault(f"{label} has a step of {step:g} s, expected at least {MIN_STEP_S:g} s; is it in days or hours?")
    if duration < MIN_DURATION_S:
        raise fault(f"{label} spans {duration:.3g} s, expected at least {MIN_DURATION_S} s")


def merge_repeated(time_s: Array, values: dict[str, Array], fault: Fault) -> tuple[Array, dict[str, Array], list[str]]:
    """Strictly rising time. Rows that repeat both stamp and values are dropped; where values
    differ under one stamp their mean stands for that instant, as long as that is rare.
    """
    fresh = np.concatenate(([True], np.diff(time_s) > 0.0))
    if fresh.all():
        return time_s, values, []
    starts = np.flatnonzero(fresh)
    sizes = np.diff(np.append(starts, len(time_s)))
    differs = np.zeros(len(starts), dtype=bool)
    merged: dict[str, Array] = {}
    for name, column in values.items():
        present = ~np.isnan(column)
        high = np.maximum.reduceat(np.where(present, column, -np.inf), starts)
        low = np.minimum.reduceat(np.where(present, column, np.inf), starts)
        count = np.add.reduceat(present.astype(np.int64), starts)
        total = np.add.reduceat(np.where(present, column, 0.0), starts)
        other = (count > 0) & (high != low)
        mean = np.divide(total, count, out=np.full(len(starts), np.nan), where=count > 0)
        merged[name] = np.where(other, mean, np.where(count > 0, high, np.nan))
        differs |= other
    averaged = int((sizes[differs] - 1).sum())
    first = time_s[starts[differs][0]] if averaged else 0.0
    if averaged > MAX_AVERAGED * len(time_s):
        raise fault(
            f"{averaged} of {len(time_s)} samples repeat a time stamp with other values, first at {seconds(first)}; "
            "are the stamps rounded too coarsely?"
        )
    notes = []
    if dropped := len(time_s) - len(starts) - averaged:
        where = time_s[starts[(sizes > 1) & ~differs][0]]
        notes.append(f"{dropped} repeated samples (same time, same values) dropped, first at {seconds(where)}")
    if averaged:
        notes.append(f"{averaged} samples repeat a time stamp with other values, averaged, first at {seconds(first)}")
    return time_s[starts], merged, notes


def time_notes(time_s: Array) -> list[str]:
    """Notes on a strictly rising time."""
    steps = np.diff(time_s)
    median = float(np.median(steps))
    notes = []
    if steps.max() > (1 + IRREGULAR) * median or steps.min() < (1 - IRREGULAR) * median:
        notes.append(
            f"time is irregular: steps from {steps.min():.4g} to {steps.max():.4g} s, median {median:.4g} s; kept as is"
        )
    gaps = np.flatnonzero(steps > GAP_STEPS * median)
    if len(gaps):
        longest = gaps[np.argmax(steps[gaps])]
        notes.append(
            f"{len(gaps)} gap{'s' if len(gaps) > 1 else ''} in time, the longest from {seconds(time_s[longest])} "
            f"to {seconds(time_s[longest + 1])}; signals count as straight lines there"
        )
    return notes
