"""Which drawn fields a metric depends on: Spearman rank correlations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.run import Array
from workbench.study.results.labels import Label, field_label
from workbench.study.results.row import Row


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
