"""A metric: a few running sums, how a sample changes them, and what they come to at the end.

The same functions run inside the compiled loop and on a measured log, so a batch of
thousands keeps no signals.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.run import Array
from workbench.trace.expr import Scalar, maximum, minimum

HUGE = 1e300
Signals = Mapping[str, Scalar]
Value = Callable[[Signals, Any], Scalar]


@dataclass(frozen=True, eq=False)
class Sums:
    """Running sums, which several metrics may read.

    update(sums, s, p, dt): new sums after a sample with signals s, which lasts dt.
    """

    start: tuple[float, ...]
    update: Callable[[Sequence[Scalar], Signals, Any, Scalar], Sequence[Scalar]]


@dataclass(frozen=True)
class Metric:
    """name and unit as results carry it; `definition` is the sentence in the docs.

    finish(sums, p, duration): the metric, or None where it has no meaning for this machine. optional: that
    may be so; results then have no such column.
    """

    name: str
    unit: str
    definition: str
    sums: Sums
    finish: Callable[[Sequence[float], Any, float], float | None]
    optional: bool = False


def largest(value: Value) -> Sums:
    return Sums((-HUGE,), lambda a, s, p, dt: [maximum(a[0], value(s, p))])


def smallest(value: Value) -> Sums:
    return Sums((HUGE,), lambda a, s, p, dt: [minimum(a[0], value(s, p))])


def integral(value: Value) -> Sums:
    """Each sample lasts until the next one."""
    return Sums((0.0,), lambda a, s, p, dt: [a[0] + value(s, p) * dt])


def the(number: int) -> Callable[[Sequence[float], Any, float], float]:
    """One of the sums as it stands."""
    return lambda sums, p, duration: float(sums[number])


class Observer:
    """All metrics as one set of running sums; what several read is kept once."""

    def __init__(self, metrics: Sequence[Metric], parameters: Sequence[str]) -> None:
        self.metrics = tuple(metrics)
        self.parameters = tuple(parameters)
        self.sums = tuple(dict.fromkeys(metric.sums for metric in self.metrics))
        self.start = [x for sums in self.sums for x in sums.start]
        self.size = len(self.start)

    def _parts(self, sums: Any) -> list[Sequence[Any]]:
        parts: list[Sequence[Any]] = []
        at = 0
        for each in self.sums:
            parts.append(sums[at : at + len(each.start)])
            at += len(each.start)
        return parts

    def update(self, sums: Sequence[Scalar], signals: Signals, p: Any, dt: Scalar) -> list[Scalar]:
        parts = zip(self.sums, self._parts(sums), strict=True)
        return [x for each, part in parts for x in each.update(part, signals, p, dt)]

    def finish(self, sums: Sequence[float] | Array, p: Any, duration_s: float) -> dict[str, float]:
        parts = dict(zip(self.sums, self._parts(sums), strict=True))
        found = {metric.name: metric.finish(parts[metric.sums], p, duration_s) for metric in self.metrics}
        return {name: float(value) for name, value in found.items() if value is not None}
