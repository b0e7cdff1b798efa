"""Cycles cut out of a stream of values, each written as a log, so that the watch takes it like any other.

A cycle is a motion between two stands, or what lies between the edges of a trigger. Values come signal by signal with
the time of their source; a value that does not change need not come again. The arrival time is passed in.
"""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array

TRIGGER = "trigger"
MOST_LEAD_S = 1.0  # of standing that a cycle keeps on either side
LONGEST_S = 3600.0  # a cycle that lasts longer is none
DRIFT = 1e-3  # of two clocks against each other
SPEED_OVER_S = 0.1  # over which a position's change is a speed


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
    """One cycle on the source's clock. moves_s: its first and its last motion. series: (times, values) of each signal;
    the first time may lie before begin_s: that value holds until the next."""

    begin_s: float
    end_s: float
    moves_s: tuple[float, float]
    series: Mapping[str, tuple[list[float], list[float]]]


@dataclass(frozen=True)
class Spoilt:
    """A cycle that does not count, or a note. at_s: on the source's clock."""

    at_s: float
    reason: str
    in_cycle: bool


@dataclass
class _Series:
    times: deque[float] = field(default_factory=deque)
    values: deque[float] = field(default_factory=deque)

    def add(self, t: float, value: float) -> None:
        self.times.append(t)
        self.values.append(value)

    def forget(self, before: float) -> None:
        """All but the last value before that time."""
        while len(self.times) > 1 and self.times[1] <= before:
            self.times.popleft()
            self.values.popleft()

    def between(self, begin: float, end: float) -> tuple[list[float], list[float]]:
        pairs = [(t, v) for t, v in zip(self.times, self.values, strict=True) if t <= end]
        first = max((i for i, (t, _) in enumerate(pairs) if t <= begin), default=0)
        return [max(t, begin) if i == 0 else t for i, (t, _) in enumerate(pairs[first:])], [v for _, v in pairs[first:]]


class Cutter:
    """Values in, cycles out; `cycles` and `spoilt` are emptied by who reads them."""

    def __init__(self, rules: CutRules) -> None:
        self.rules = rules
        self.cycles: deque[Cut] = deque()
        self.spoilt: deque[Spoilt] = deque()
        self._lead = min(MOST_LEAD_S, 0.5 * rules.stand_s)
        self._clear()

    def _clear(self) -> None:
        self._series: dict[str, _Series] = {}
        self._latest = -math.inf  # of the source's clock
        self._arrived = -math.inf  # when that value came
        self._stood_since: float | None = None
        self._moved = -math.inf
        self._began: float | None = None
        self._ended: float | None = None
        self._high: bool | None = None
        self._prompt = -math.inf  # the source's clock less the arrival's, of the promptest value

    @property
    def in_cycle(self) -> bool:
        return self._began is not None

    def add(self, signal: str, t: float, value: float, arrived_s: float) -> None:
        """A value of a signal (or of TRIGGER) at time t of its source, NaN where it is bad."""
        series = self._series.get(signal)
        last = -math.inf if series is None else series.times[-1]
        if not self._clock_jumps(t, last, arrived_s) and t <= last:  # come again, or out of order
            return
        self._goes_on_after_silence(t)
        self._series.setdefault(signal, _Series()).add(t, value)
        if t >= self._latest:
            self._latest, self._arrived = t, arrived_s
        if self.rules.triggered:
            if signal == TRIGGER and math.isfinite(value):
                self._edge(t, value != 0.0)
        elif signal == self.rules.motion and math.isfinite(value):
            self._motion(t, self._speed(t, value))
        self._close(self._latest)

    def tick(self, arrived_s: float) -> None:
        """Time goes on without values: nothing has changed since, or the stream has stopped."""
        if self._latest == -math.inf:
            return
        now = self._latest + (arrived_s - self._arrived)
        if self._began is not None and self._ended is None and self._moving(now):
            if arrived_s - self._arrived > self.rules.silent_s:
                self._spoil(f"no value came for {self.rules.silent_s:g} s while the machine moved")
            return
        self._close(now)

    def broken(self, reason: str) -> None:
        """The line is lost: a cycle that is under way does not count, and standing has to be seen again."""
        if self._began is not None:
            self._spoil(reason)
        self._clear()

    # What spoils a cycle.

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

    def _goes_on_after_silence(self, t: float) -> None:
        under_way = self._began is not None and self._ended is None and self._moving(t)
        if under_way and t - self._latest > self.rules.silent_s:
            self._spoil(f"no value came for {t - self._latest:.1f} s while the machine moved")
            self._begin_anew(t)

    def _begin_anew(self, t: float) -> None:
        """From t on, with what each signal held before: a value that does not change does not come again."""
        held = {name: series.values[-1] for name, series in self._series.items()}
        self._clear()
        for name, value in held.items():
            self._series[name] = _Series(deque([-math.inf]), deque([value]))
        if not self.rules.is_position and abs(held.get(self.rules.motion, math.nan)) <= self.rules.still:
            self._stood_since = t
        if self.rules.triggered and TRIGGER in held:
            self._high = held[TRIGGER] != 0.0

    def _spoil(self, reason: str) -> None:
        self.spoilt.append(Spoilt(self._latest, reason, self._began is not None))
        self._began = self._ended = self._stood_since = self._high = None
        if not self.rules.triggered:
            self._moved = self._latest

    # Where a cycle begins and ends.

    def _moving(self, now: float) -> bool:
        if self.rules.triggered:
            return bool(self._high)
        return now - self._moved <= self._lead or self._stood_since is None

    def _speed(self, t: float, value: float) -> float:
        if not self.rules.is_position:
            return abs(value)
        series = self._series[self.rules.motion]
        for a, b in zip(reversed(series.times), reversed(series.values), strict=True):
            if a <= t - SPEED_OVER_S:
                return abs(value - b) / (t - a) if math.isfinite(b) else 0.0
        return 0.0

    def _motion(self, t: float, speed: float) -> None:
        rules = self.rules
        if speed <= rules.still:
            if self._stood_since is None:
                self._stood_since = t
            return
        stood = self._stood_since is not None and t - self._stood_since >= rules.stand_s
        if self._began is None and stood:
            self._began = t - self._lead
        self._stood_since, self._moved = None, t

    def _edge(self, t: float, high: bool) -> None:
        if self._high is False and high:
            self._began = t
        elif self._high and not high and self._began is not None:
            self._ended = t
        self._high = high

    def _close(self, now: float) -> None:
        """Ends a cycle, when all that belongs to it has had the time to come."""
        if self._began is None:
            self._forget(now - self.rules.stand_s - MOST_LEAD_S)
            return
        if now - self._began > LONGEST_S:
            self._spoil(f"it lasted longer than {LONGEST_S:g} s")
            return
        if self.rules.triggered:
            end = self._ended
            rested = end is not None and now - end >= self._lead
        else:
            end = self._moved + self._lead
            rested = self._stood_since is not None and now - self._stood_since >= self.rules.stand_s
        if not rested or end is None:
            return
        series = {name: kept.between(self._began, end) for name, kept in self._series.items() if name != TRIGGER}
        quiet = 0.0 if self.rules.triggered else self._lead
        self.cycles.append(Cut(self._began, end, (self._began + quiet, end - quiet), series))
        self._began = self._ended = None
        self._forget(now - self.rules.stand_s - MOST_LEAD_S)

    def _forget(self, before: float) -> None:
        for kept in self._series.values():
            kept.forget(before)


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
