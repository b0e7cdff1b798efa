"""A metric: what it is called, how it is judged and shown, and how it is computed; declared once.

Everything that shows a metric reads its declaration: the index, the tables, the report, the comparison,
the figures, the dashboard and docs/metrics.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Flag, auto
from functools import cached_property
from typing import Any, Literal

from workbench.core.run import Array
from workbench.symbolic.expr import Scalar, Scalars, Signals, maximum, minimum, where

HUGE = 1e300
NOTHING = 1e-9  # in the unit shown: rounding, written 0
Value = Callable[[Signals, Any], Scalar]
Better = Literal["lower", "higher", "zero"]


class View(Flag):
    """A place that shows a choice of metrics. The index, `workbench compare` and the docs show all of them."""

    RUNS = auto()  # the table with a line a run
    SWEPT_RUNS = auto()  # the same table where swept values take some of its room
    QUANTILES = auto()  # the table of many runs
    EXTREMES = auto()  # the table of the runs at the ends
    DRIVE = auto()  # the report's table of the drive
    MOTION = auto()  # the report's table of motion and wire
    SENTENCES = auto()  # what a swept value does, in words
    SWEEP = auto()  # the figure over a swept value
    SPREAD = auto()  # the histograms of a sample
    COMPARE = auto()  # the dashboard's page Compare
    CARDS = auto()  # the numbers at the top of the dashboard's page Study


INDEX_ONLY = View(0)
# A metric that says nothing about views is shown wherever metrics are chosen. The report's two tables hold what
# the table of the runs leaves out.
EVERYWHERE = ~(View.DRIVE | View.MOTION)


@dataclass(frozen=True, eq=False)
class Accumulators:
    """Running accumulators, which several metrics may read.

    update(accumulators, s, p, dt): new accumulators after a sample with signals s, which lasts dt.
    """

    start: tuple[float, ...]
    update: Callable[[Scalars, Signals, Any, Scalar], Scalars]


@dataclass(frozen=True, kw_only=True)
class Metric:
    """The declaration that every metric has.

    name: its column in index.parquet, with the unit in it. unit: as people read it, "–" for a bare number.
    label: its name in text and on axes, in lower case. definition: the sentence in docs/metrics.md.
    better: which way it gets better; "zero": the nearer to zero; None: it says what a run was, not how good.
    visible: the smallest difference that means anything, in `unit`.
    shown_in, scale: the unit of tables and figures, and the factor from `unit` to it. decimals: in that unit;
    None: as many as `visible` asks for. significant: digits in place of decimals, where a metric's size differs from
    machine to machine. head: of a table's column, "" for the label; note: what the table's
    caption says of it, "" for the label. taken_at: the side of the machine, where a reader might take it for
    another. extremes: the names of the runs at its high (+1) and low (-1) end; None: the worst one.
    fixed: a column of every index by the format. views: the places that show it.
    """

    name: str
    unit: str
    label: str
    better: Better | None
    visible: float
    definition: str
    shown_in: str = ""
    scale: float = 1.0
    decimals: int | None = None
    significant: int | None = None
    head: str = ""
    note: str = ""
    taken_at: str = ""
    extremes: tuple[tuple[str, int], ...] | None = None
    fixed: bool = False
    views: View = EVERYWHERE

    @property
    def shown_unit(self) -> str:
        """The unit of tables and figures; "" for a bare number."""
        unit = self.shown_in or self.unit
        return "" if unit == "–" else unit

    @property
    def heading(self) -> str:
        """The label as the start of a line: `Largest speed error`."""
        return self.label[0].upper() + self.label[1:]

    @property
    def title(self) -> str:
        """The heading with the side of the machine: `Largest speed error, motor side`."""
        return f"{self.heading}, {self.taken_at}" if self.taken_at else self.heading

    @property
    def worst(self) -> Callable[..., float]:
        """max or min: the worst of several values; of a metric that should be zero the largest, either way."""
        if self.better == "zero":
            return lambda values: max(values, key=abs)
        return min if self.better == "higher" else max

    @property
    def ends(self) -> tuple[tuple[str, int], ...]:
        """(name, +1 or -1) of the runs at the ends that a table of many runs shows."""
        if self.extremes is not None:
            return self.extremes
        return ((f"worst {self.label}", -1 if self.better == "higher" else 1),)

    def text(self, value: float) -> str:
        """A value (in `unit`) in a table's cell; a dash for no number."""
        if not math.isfinite(value):
            return "–"
        decimals = self.decimals
        if self.significant is not None:
            size = abs(self.scale * value)
            decimals = max(0, self.significant - 1 - math.floor(math.log10(size))) if size > NOTHING else 0
        elif decimals is None:
            decimals = max(0, -math.floor(math.log10(self.visible * self.scale) + 1e-9))
        text = f"{self.scale * value:.{decimals}f}"
        return text.removeprefix("-") if not text.strip("-0.") else text  # no minus before nothing

    def worse_by(self, a: float, b: float) -> float:
        """By how much b is worse than a, in `unit`; negative where it is better."""
        if self.better == "zero":
            a, b = abs(a), abs(b)
        return a - b if self.better == "higher" else b - a


@dataclass(frozen=True, kw_only=True)
class LoopMetric(Metric):
    """Taken at every sample, from accumulators. The same functions run in the compiled loop and on a measured log.

    finish(accumulators, p, duration_s): the metric, or None where it has no meaning for this machine. optional: that
    may be so; results then have no such column.
    """

    accumulators: Accumulators = field(repr=False)
    finish: Callable[[Sequence[float], Any, float], float | None] = field(repr=False)
    optional: bool = False


@dataclass(frozen=True)
class RunFacts:
    """What is known of a run beside its samples: its reference, its hold torque and its end. SI, up positive.

    move_windows: start and end (s) of each move of the reference. acceleration_m_s2: that the reference was
    planned with. hold_torque_nm: of all motors, at the start. end_position_m, reference_end_m: heights.
    """

    move_windows: tuple[tuple[float, float], ...]
    acceleration_m_s2: float
    hold_torque_nm: float
    end_position_m: float
    reference_end_m: float


@dataclass(frozen=True, kw_only=True)
class RunMetric(Metric):
    """Taken from the run's reference and its end. known_before: of a run that failed too."""

    value: Callable[[RunFacts], float] = field(repr=False)
    known_before: bool = False


def largest(value: Value) -> Accumulators:
    return Accumulators((-HUGE,), lambda a, s, p, dt: [maximum(a[0], value(s, p))])


def smallest(value: Value) -> Accumulators:
    return Accumulators((HUGE,), lambda a, s, p, dt: [minimum(a[0], value(s, p))])


def integral(value: Value) -> Accumulators:
    """Each sample lasts until the next one."""
    return Accumulators((0.0,), lambda a, s, p, dt: [a[0] + value(s, p) * dt])


def root_mean(accumulators: Sequence[float], p: Any, duration: float) -> float:
    """Of an integral of squares."""
    return math.sqrt(max(accumulators[0], 0.0) / duration)


def beyond(value: str, reference: str) -> tuple[Accumulators, Callable[[Sequence[float], Any, float], float]]:
    """How far a signal goes beyond the largest or the smallest value of its whole reference; 0 within them."""

    def ends(a: Scalars, s: Signals, p: Any, dt: Scalar) -> list[Scalar]:
        x, r = s[value], s[reference]
        return [maximum(a[0], x), minimum(a[1], x), maximum(a[2], r), minimum(a[3], r)]

    return Accumulators((-HUGE, HUGE, -HUGE, HUGE), ends), lambda a, p, duration: max(a[0] - a[2], a[3] - a[1], 0.0)


def settling(moves: Value, off: Value) -> Accumulators:
    """Until when the reference moved, and until when what follows it was off it; both true or false."""

    def until(a: Scalars, s: Signals, p: Any, dt: Scalar) -> list[Scalar]:
        now = s["time_s"] + dt
        return [where(moves(s, p), now, a[0]), where(off(s, p), now, a[1])]

    return Accumulators((0.0, 0.0), until)


def after_the_move(accumulators: Sequence[float], p: Any, duration: float) -> float:
    """Of `settling`, s."""
    return max(accumulators[1] - accumulators[0], 0.0)


def as_summed(number: int) -> Callable[[Sequence[float], Any, float], float]:
    """One of the accumulators as it stands."""
    return lambda accumulators, p, duration: float(accumulators[number])


class Observer:
    """Metrics of the loop as one set of running accumulators; accumulators that several metrics read are kept once."""

    def __init__(self, metrics: Sequence[LoopMetric], parameters: Sequence[str]) -> None:
        self.metrics = tuple(metrics)
        self.parameters = tuple(parameters)
        self.accumulators = tuple(dict.fromkeys(metric.accumulators for metric in self.metrics))
        self.start = [x for accumulators in self.accumulators for x in accumulators.start]
        self.size = len(self.start)

    def _parts(self, values: Any) -> list[Sequence[Any]]:
        parts: list[Sequence[Any]] = []
        at = 0
        for accumulators in self.accumulators:
            parts.append(values[at : at + len(accumulators.start)])
            at += len(accumulators.start)
        return parts

    def update(self, values: Scalars, signals: Signals, p: Any, dt: Scalar) -> list[Scalar]:
        """The running accumulators after one more sample with these signals, which lasts dt."""
        parts = zip(self.accumulators, self._parts(values), strict=True)
        return [x for accumulators, part in parts for x in accumulators.update(part, signals, p, dt)]

    def finish(self, values: Sequence[float] | Array, p: Any, duration_s: float) -> dict[str, float]:
        """Metric by name, from the accumulators at a run's end; without those that have no meaning for this machine."""
        parts = dict(zip(self.accumulators, self._parts(values), strict=True))
        results = {metric.name: metric.finish(parts[metric.accumulators], p, duration_s) for metric in self.metrics}
        return {name: float(value) for name, value in results.items() if value is not None}


@dataclass(frozen=True)
class MetricSet:
    """metrics: in the order in which tables show them. parameters: the observer's, by the loop's symbols.

    Conclusions read the rest. peak: the largest input; above: the same above what holds the load; rms; error: largest
    error of tracking; rms_error; fastest: largest speed; end: position error at the end; astray: from which end error
    on, in its unit, or as many times the metric `window`. input_words: torque or force; input_unit: as sentences give
    it; moved: what moves; sides: of an end error, positive first. payload: whether runs carry one. limited_by: who is
    limited.
    """

    metrics: tuple[Metric, ...]
    parameters: tuple[str, ...]
    peak: str
    above: str
    rms: str
    error: str
    rms_error: str
    fastest: str
    end: str
    astray: float
    input_words: str
    input_unit: str
    rate_unit: str
    moved: str
    sides: tuple[str, str]
    payload: bool
    window: str = ""

    @cached_property
    def by_name(self) -> Mapping[str, Metric]:
        return {metric.name: metric for metric in self.metrics}

    @cached_property
    def observer(self) -> Observer:
        """As the compiled loop takes them."""
        return Observer([m for m in self.metrics if isinstance(m, LoopMetric)], self.parameters)
