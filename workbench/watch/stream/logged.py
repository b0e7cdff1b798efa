"""A cycle's series on one time grid, as a log with what is said of it."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.run import Array
from workbench.watch.stream.cut import Cut

FEWEST = 20  # samples of a cycle that is worth a log
SAME_PAYLOAD_KG = 10.0
ORIGIN = "began.txt"  # when the first cycle of all began, on the source's clock


def on_grid(cut: Cut, motion: str) -> tuple[Array, dict[str, Array]]:
    """(n,) times from 0 and (n,) values of each signal, NaN where the source said so.

    The step is the median one of the signal `motion`. Between two values that came one step apart lies a straight
    line; a value that did not come again held until a step before the next one. InputError for too few values.
    """
    times = np.asarray(cut.series.get(motion, ([], []))[0])
    inside = times[(times >= cut.begin_s) & (times <= cut.end_s)]
    if len(inside) < FEWEST:
        raise InputError(f"{len(inside)} values of {motion} came within {cut.end_s - cut.begin_s:.1f} s")
    step = float(np.median(np.diff(inside)))
    count = int((cut.end_s - cut.begin_s) / step) + 1
    grid: Array = np.asarray(cut.begin_s + step * np.arange(count), dtype=float)
    return grid - cut.begin_s, {name: _held(grid, *series, step) for name, series in cut.series.items()}


def _held(grid: Array, times: Sequence[float], values: Sequence[float], step: float) -> Array:
    """(n,) of a series that need not come again while it does not change."""
    t, v = np.asarray(times), np.asarray(values)
    late = np.flatnonzero(np.diff(t) > 1.5 * step)
    t, v = np.insert(t, late + 1, t[late + 1] - step), np.insert(v, late + 1, v[late])
    return np.asarray(np.interp(grid, t, v, left=math.nan))


def start_value(cut: Cut, name: str) -> float:
    """A signal's value when the cycle began; NaN where there is none."""
    times, values = cut.series.get(name, ([], []))
    before = [value for t, value in zip(times, values, strict=True) if t <= cut.begin_s]
    return before[-1] if before else next(iter(values), math.nan)


def with_payload(cut: Cut, name: str) -> tuple[Cut, float]:
    """The cycle from where its payload has been picked up, and that payload, kg.

    InputError where the payload changes while the machine moves, or is no payload.
    """
    times, values = cut.series.get(name, ([], []))
    first, last = cut.moves_s
    at_first = [v for t, v in zip(times, values, strict=True) if t <= first][-1:] or [math.nan]
    carried = at_first + [v for t, v in zip(times, values, strict=True) if first < t < last]
    if not all(math.isfinite(value) and value >= 0.0 for value in carried):
        raise InputError(f"{name} is {min(carried):g}, expected kg, 0 or more")
    if max(carried) - min(carried) > SAME_PAYLOAD_KG:
        raise InputError(f"{name} changed from {carried[0]:g} to {carried[-1]:g} kg within it")
    others = [t for t, v in zip(times, values, strict=True) if abs(v - carried[0]) > SAME_PAYLOAD_KG]
    picked_up = min((t for t in times if t > max((t for t in others if t < first), default=-math.inf)), default=first)
    set_down = min((t for t in others if t > last), default=math.inf)
    return replace(cut, begin_s=max(cut.begin_s, picked_up), end_s=min(cut.end_s, set_down)), carried[0]


class Logs:
    """A folder that cycles are written to: `cycle_DATE.csv` and what is said of it, each whole or not at all."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot be written: {error.strerror or error}", file=folder) from error
        file = folder / ORIGIN
        self._origin = float(file.read_text(encoding="utf-8")) if file.is_file() else None

    def write(
        self, begin_s: float, time_s: Array, signals: Mapping[str, Array], said: Mapping[str, float]
    ) -> Path:  # fmt: skip
        """said: payload_kg and start_position_m, of kinds that have them. OSError where it cannot be written."""
        if self._origin is None:
            self._origin = begin_s
            self._replace(ORIGIN, repr(begin_s))
        stamp = datetime.fromtimestamp(begin_s, UTC).strftime("%Y-%m-%d_%H-%M-%S.%f")[:-3]
        name, k = f"cycle_{stamp}.csv", 1
        while (self.folder / name).exists():  # a clock that was set back
            name, k = f"cycle_{stamp}_{k}.csv", k + 1
        said = {**said, "start_time_s": round(begin_s - self._origin, 6)}
        self._replace(f"{name}.yaml", "".join(f"{key}: {value!r}\n" for key, value in said.items()))
        head = ",".join(("time_s", *signals))
        rows = np.column_stack([time_s, *signals.values()]).tolist()
        lines = [",".join("" if math.isnan(value) else f"{value:.10g}" for value in row) for row in rows]
        self._replace(name, "\n".join((head, *lines, "")))
        return self.folder / name

    def _replace(self, name: str, text: str) -> None:
        hidden = self.folder / f".{name}.part"
        hidden.write_text(text, encoding="utf-8")
        os.replace(hidden, self.folder / name)
