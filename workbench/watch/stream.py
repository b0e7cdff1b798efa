"""Cycles cut out of a stream of values, each written as a log, so that the watch takes it like any other.

A cycle is a motion between two stands, or what lies between the edges of a trigger. Values come signal by signal with
the time of their source; a value that does not change need not come again. The arrival time is passed in.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from operator import itemgetter
from pathlib import Path

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.core.whole_folder import whole_file, writable

TRIGGER = "trigger"
MOST_LEAD_S = 1.0  # of standing that a cycle keeps on either side
LONGEST_S = 3600.0  # a cycle that lasts longer is none
DRIFT = 1e-3  # of two clocks against each other
SPEED_OVER_S = 0.1  # over which a position's change is a speed
FEWEST = 20  # samples of a cycle that is worth a log
SAME_PAYLOAD_KG = 10.0
ORIGIN = "began.txt"  # when the first cycle of all began, on the source's clock
_TIME = itemgetter(0)


@dataclass(frozen=True)
class CutRules:
    """motion: the signal that says whether the machine moves; is_position: it is a position, and its change counts.

    still: speeds up to it are standing, in the signal's unit (a position's: per second). stand_s: a rest so long ends
    a cycle. silent_s: no value for so long while the machine moves is a stream that has stopped. slip_s: a clock
    that differs by less from the arrivals' has not jumped. triggered: a trigger marks the cycles instead.
    """

    motion: str
    still: float
    is_position: bool = False
    stand_s: float = 2.0
    silent_s: float = 2.0
    slip_s: float = 1.0
    triggered: bool = False


@dataclass(frozen=True)
class Cut:
    """One cycle on the source's clock. moves_s: its first and its last motion. series: (n, 2) times and values of each
    signal; the first time may lie before begin_s: that value holds until the next."""

    begin_s: float
    end_s: float
    moves_s: tuple[float, float]
    series: Mapping[str, Array]

    def times_and_values(self, name: str) -> tuple[Array, Array]:
        t, v = self.series.get(name, np.zeros((0, 2))).T
        return t, v

    def value(self, name: str, at_s: float) -> float:
        """What a signal held then; its first value where it came later, NaN where there is none."""
        t, v = self.times_and_values(name)
        return float(v[max(int(np.searchsorted(t, at_s, "right")) - 1, 0)]) if len(v) else math.nan


@dataclass(frozen=True)
class Spoilt:
    """A cycle that does not count, or a note. at_s: on the source's clock."""

    at_s: float
    reason: str
    in_cycle: bool


class Cutter:
    """Values in, cycles out; `cycles` and `spoilt` are emptied by who reads them."""

    def __init__(self, rules: CutRules) -> None:
        self.rules = rules
        self.cycles: deque[Cut] = deque()
        self.spoilt: deque[Spoilt] = deque()
        lead, stand = min(MOST_LEAD_S, 0.5 * rules.stand_s), rules.stand_s
        # What marks a cycle is above `still` in it. It begins after a rest of `stand`, and is cut when one of `wait`
        # has passed: all that belongs to it has had the time to come.
        by_motion, by_trigger = (rules.motion, rules.still, stand, lead, stand), (TRIGGER, 0.0, 0.0, 0.0, lead)
        marks = by_trigger if rules.triggered else by_motion
        self._marker, self._still, self._stand, self._lead, self._wait = marks
        self._clear()

    def _clear(self) -> None:
        self._series: dict[str, list[tuple[float, float]]] = {}
        self._latest = -math.inf  # of the source's clock
        self._arrived = -math.inf  # when that value came
        self._prompt = -math.inf  # the source's clock less the arrival's, of the promptest value
        self._began: float | None = None  # the cycle under way
        self._rests: float | None = None  # since when
        self._moved = -math.inf

    @property
    def in_cycle(self) -> bool:
        return self._began is not None

    def _moves(self, now: float) -> bool:
        """In a cycle, and not at rest."""
        return self._began is not None and (self._rests is None or now - self._moved <= self._lead)

    def add(self, signal: str, t: float, value: float, arrived_s: float) -> None:
        """A value of a signal (or of TRIGGER) at time t of its source, NaN where it is bad."""
        last = self._series[signal][-1][0] if signal in self._series else -math.inf
        if not self._clock_jumps(t, last, arrived_s) and t <= last:  # come again, or out of order
            return
        if t - self._latest > self.rules.silent_s and self._moves(t):
            self._spoil(f"no value came for {t - self._latest:.1f} s while the machine moved")
            self._begin_anew(t)
        self._series.setdefault(signal, []).append((t, value))
        if t >= self._latest:
            self._latest, self._arrived = t, arrived_s
        if signal == self._marker and math.isfinite(value):
            if self._speed(t, value) <= self._still:
                self._rests = t if self._rests is None else self._rests
            else:
                rested = self._rests is not None and t - self._rests >= self._stand
                if rested and self._began is not None:
                    self._cut()
                if rested:
                    self._began = t - self._lead
                self._rests, self._moved = None, t

    def tick(self, arrived_s: float) -> None:
        """All that has come so far is in: ends a cycle, and forgets. Without values time goes on: nothing has changed
        since, or the stream has stopped."""
        if self._latest == -math.inf:
            return
        quiet = arrived_s - self._arrived
        now = self._latest + quiet
        if self._began is not None and now - self._began > LONGEST_S:
            self._spoil(f"it lasted longer than {LONGEST_S:g} s")
        elif self._moves(now) and quiet > self.rules.silent_s:
            self._spoil(f"no value came for {self.rules.silent_s:g} s while the machine moved")
        elif self._began is not None and self._rests is not None and now - self._rests >= self._wait:
            self._cut()
        if self._began is None:
            for kept in self._series.values():
                before = bisect_right(kept, now - self.rules.stand_s - MOST_LEAD_S, key=_TIME)
                del kept[: max(before - 1, 0)]

    def broken(self, reason: str) -> None:
        """The line is lost: a cycle that is under way does not count, and standing has to be seen again."""
        if self._began is not None:
            self._spoil(reason)
        self._clear()

    def _clock_jumps(self, t: float, last: float, arrived_s: float) -> bool:
        """A line delays, and never hurries: a value that is ahead of the promptest one has another clock."""
        if last == -math.inf:  # a server first tells what it has, which may be old
            return False
        offset = t - arrived_s
        prompt = self._prompt - DRIFT * max(arrived_s - self._arrived, 0.0)
        ahead = offset - prompt if prompt > -math.inf else 0.0
        self._prompt = max(prompt, offset)
        back = last - t > self.rules.slip_s and self._latest - t > self.rules.slip_s
        if not back and ahead <= self.rules.slip_s:
            return False
        way = f"back by {self._latest - t:.1f} s" if back else f"ahead by {ahead:.1f} s"
        self._spoil(f"the clock of the source jumped {way}")
        self._begin_anew(t)
        self._prompt = offset
        return True

    def _begin_anew(self, t: float) -> None:
        """From t on, with what each signal held before: a value that does not change does not come again."""
        held = {name: series[-1][1] for name, series in self._series.items()}
        self._clear()
        self._series = {name: [(-math.inf, value)] for name, value in held.items()}
        if self.rules.triggered or not self.rules.is_position:
            self._rests = t if abs(held.get(self._marker, math.nan)) <= self._still else None

    def _spoil(self, reason: str) -> None:
        self.spoilt.append(Spoilt(self._latest, reason, self._began is not None))
        self._began = self._rests = None
        self._moved = self._latest

    def _speed(self, t: float, value: float) -> float:
        """Of the marker; a trigger's is its value."""
        if self.rules.triggered or not self.rules.is_position:
            return abs(value)
        series = self._series[self._marker]
        before = bisect_right(series, t - SPEED_OVER_S, key=_TIME) - 1
        way = abs(value - series[before][1]) / (t - series[before][0]) if before >= 0 else 0.0
        return way if math.isfinite(way) else 0.0

    def _cut(self) -> None:
        """The cycle under way is whole."""
        assert self._began is not None and self._rests is not None
        end = self._rests if self.rules.triggered else self._moved + self._lead
        moves = self._began + self._lead, end - self._lead
        series = {name: _between(kept, self._began, end) for name, kept in self._series.items() if name != TRIGGER}
        came = {name: kept for name, kept in series.items() if len(kept)}
        self.cycles.append(Cut(self._began, end, moves, came))
        self._began = None


def _between(series: list[tuple[float, float]], begin: float, end: float) -> Array:
    """(n, 2) from what held at `begin`."""
    first = max(bisect_right(series, begin, key=_TIME) - 1, 0)
    kept: Array = np.array(series[first : bisect_right(series, end, key=_TIME)], dtype=float).reshape(-1, 2)
    kept[:1, 0] = np.maximum(kept[:1, 0], begin)
    return kept


def on_grid(cut: Cut, motion: str) -> tuple[Array, dict[str, Array]]:
    """(n,) times from 0 and (n,) values of each signal, NaN where the source said so.

    The step is the median one of the signal `motion`. Between two values that came one step apart lies a straight
    line; a value that did not come again held until a step before the next one. InputError for too few values.
    """
    times, _ = cut.times_and_values(motion)
    inside = times[(times >= cut.begin_s) & (times <= cut.end_s)]
    if len(inside) < FEWEST:
        raise InputError(f"{len(inside)} values of {motion} came within {cut.end_s - cut.begin_s:.1f} s")
    step = float(np.median(np.diff(inside)))
    count = int((cut.end_s - cut.begin_s) / step) + 1
    grid: Array = np.asarray(cut.begin_s + step * np.arange(count), dtype=float)
    signals = {}
    for name in cut.series:
        t, v = cut.times_and_values(name)
        late = np.flatnonzero(np.diff(t) > 1.5 * step)
        t, v = np.insert(t, late + 1, t[late + 1] - step), np.insert(v, late + 1, v[late])
        signals[name] = np.asarray(np.interp(grid, t, v, left=math.nan))
    return grid - cut.begin_s, signals


def with_payload(cut: Cut, name: str) -> tuple[Cut, float]:
    """The cycle from where its payload has been picked up, and that payload, kg.

    InputError where the payload changes while the machine moves, or is no payload.
    """
    t, v = cut.times_and_values(name)
    first, last = cut.moves_s
    payload = cut.value(name, first) if len(t) and t[0] <= first else math.nan
    carried = np.array([payload, *v[(first < t) & (t < last)]])
    if not np.all(np.isfinite(carried) & (carried >= 0.0)):
        raise InputError(f"{name} is {min(carried):g}, expected kg, 0 or more")
    if np.ptp(carried) > SAME_PAYLOAD_KG:
        raise InputError(f"{name} changed from {carried[0]:g} to {carried[-1]:g} kg within it")
    others = t[np.abs(v - payload) > SAME_PAYLOAD_KG]
    picked_up = t[t > max(others[others < first], default=-math.inf)][0]
    set_down = min(others[others > last], default=math.inf)
    begin, end = max(cut.begin_s, float(picked_up)), min(cut.end_s, float(set_down))
    return replace(cut, begin_s=begin, end_s=end), payload


class Logs:
    """A folder that cycles are written to: `cycle_DATE.csv` and what is said of it, each whole or not at all."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        with writable(folder):
            folder.mkdir(parents=True, exist_ok=True)
        file = folder / ORIGIN
        self._origin = float(file.read_text(encoding="utf-8")) if file.is_file() else None

    def write(self, begin_s: float, time_s: Array, signals: Mapping[str, Array], said: Mapping[str, float]) -> Path:
        """said: payload_kg and start_position_m, of kinds that have them. UnwritableError on a full disk."""
        if self._origin is None:
            self._write(ORIGIN, repr(begin_s))
            self._origin = begin_s
        stamp = datetime.fromtimestamp(begin_s, UTC).strftime("%Y-%m-%d_%H-%M-%S.%f")[:-3]
        name, k = f"cycle_{stamp}.csv", 1
        while (self.folder / name).exists():  # a clock that was set back
            name, k = f"cycle_{stamp}_{k}.csv", k + 1
        said = {**said, "start_time_s": round(begin_s - self._origin, 6)}
        self._write(f"{name}.yaml", "".join(f"{key}: {value!r}\n" for key, value in said.items()))
        head = ",".join(("time_s", *signals))
        rows = np.column_stack([time_s, *signals.values()]).tolist()
        lines = [",".join("" if math.isnan(value) else f"{value:.10g}" for value in row) for row in rows]
        self._write(name, "\n".join((head, *lines, "")))
        return self.folder / name

    def _write(self, name: str, text: str) -> None:
        with whole_file(self.folder / name) as part:
            part.write_text(text, encoding="utf-8")
