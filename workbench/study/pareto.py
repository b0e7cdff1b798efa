"""Pareto fronts: the runs that no other run dominates, and the knee of each front.

Both costs are better when smaller. A run is on the front when no other is at least as good in
both and better in one.

The knee: the front's costs are each brought to 0…1, from the best to the worst on the front; the
chord joins its two ends; the knee is the run farthest below the chord. Beyond it on either side a
little of one cost is bought dearly with the other. A front of fewer than three runs, or one that
nowhere lies below its chord, has no knee. (Distance to the chord: I. Das, "On characterizing the
'knee' of the Pareto curve", Structural Optimization 18, 1999, for two costs.)

Which drawn fields a metric depends on: Spearman rank correlations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from workbench.core.errors import InputError, nearest
from workbench.core.run import Array
from workbench.study.labels import Label, field_label
from workbench.study.rows import Row, metrics_of

NEAR = 1e-9


@dataclass(frozen=True)
class Front:
    """The front of one group of runs. rows: from the smallest first cost to the largest; knee: one of them or None."""

    payload_kg: float
    reference: str
    costs: tuple[str, str]
    rows: tuple[Row, ...]
    knee: Row | None


def non_dominated(first: Array, second: Array) -> npt.NDArray[np.intp]:
    """Indices of the non-dominated points, by rising `first`. Of equal points the earliest is kept.

    first, second: (n,) costs, finite.
    """
    order = np.lexsort((np.arange(len(first)), second, first))
    falling = second[order]
    below = np.concatenate(([True], falling[1:] < np.minimum.accumulate(falling)[:-1])) if len(order) else order > 0
    return order[below]


def knee(first: Array, second: Array) -> int | None:
    """The place of the knee on a front: (n,) rising and (n,) falling costs. None where there is none."""
    if len(first) < 3:
        return None
    x = (first - first[0]) / (first[-1] - first[0])
    y = (second - second[-1]) / (second[0] - second[-1])
    depth = (1.0 - x - y) / np.sqrt(2.0)  # below the chord from (0, 1) to (1, 0)
    at = int(np.argmax(depth))
    return at if depth[at] > NEAR else None


def fronts(
    rows: Sequence[Row], second: str = "", first: str = "move_time_s", *, by_reference: bool = False
) -> list[Front]:
    """The front of each payload: all references against one another, or each by itself.

    first, second: metrics to be kept small, without a second the largest torque or force; `wire_tension_swing_n` is
    max_wire_tension_n − min_wire_tension_n where the rows have no such metric. Failed runs are left out. InputError
    for a metric that the rows do not have.
    """
    good = [row for row in rows if row.ok]
    second = second or metrics_of(rows).peak
    groups: dict[tuple[float, str], list[Row]] = {}
    for row in good:
        groups.setdefault((row.payload_kg, row.reference if by_reference else ""), []).append(row)
    return [_front(payload, kind, members, (first, second)) for (payload, kind), members in sorted(groups.items())]


def cost(row: Row, name: str) -> float:
    """A row's cost; InputError for what it has no number of."""
    if name == "wire_tension_swing_n" and name not in row.metrics:
        return row["max_wire_tension_n"] - row["min_wire_tension_n"]
    if name not in row.metrics:
        raise InputError(f"no metric '{name}'; {nearest(name, row.metrics)}")
    return row[name]


def _front(payload_kg: float, reference: str, rows: Sequence[Row], costs: tuple[str, str]) -> Front:
    first, second = (np.array([cost(row, name) for row in rows]) for name in costs)
    known = np.flatnonzero(np.isfinite(first) & np.isfinite(second))
    chosen = known[non_dominated(first[known], second[known])]
    at = knee(first[chosen], second[chosen])
    front = tuple(rows[i] for i in chosen)
    return Front(payload_kg, reference, costs, front, None if at is None else front[at])


@dataclass(frozen=True)
class Correlation:
    """Spearman's rank correlation of a drawn field with a metric."""

    column: str
    value: float

    @property
    def label(self) -> Label:
        return field_label(self.column)


def rank_correlations(rows: Sequence[Row], columns: Sequence[str], metric: str) -> list[Correlation]:
    """Of each field with the metric, the strongest first; a field or metric that is constant is left out."""
    good = [row for row in rows if row.ok]
    if len(good) < 3:
        return []
    wanted = _ranks(np.array([row[metric] for row in good]))
    correlations = []
    for column in columns:
        values = [row.assigned.get(column) for row in good]
        if any(value is None or isinstance(value, str) for value in values):
            continue
        drawn = _ranks(np.array(values, dtype=float))
        if np.ptp(drawn) > 0.0 and np.ptp(wanted) > 0.0:
            correlations.append(Correlation(column, float(np.corrcoef(drawn, wanted)[0, 1])))
    return sorted(correlations, key=lambda field: -abs(field.value))


def _ranks(values: Array) -> Array:
    """Of equal values the mean of their ranks."""
    _, where, count = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(count)
    return np.asarray((last - (count - 1) / 2.0)[where], dtype=float)
