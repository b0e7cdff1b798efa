"""Run a study or compare two, and how their results are shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from workbench.core.errors import InputError
from workbench.core.shown import View
from workbench.core.table import Column, Table, words
from workbench.figures.study_page import study_figures
from workbench.study import tables
from workbench.study.compare import Comparison, plain, plain_percent
from workbench.study.rows import index_table
from workbench.study.run import StudyResult


def _figure(number: int, needs: str) -> Any:
    def figure(result: StudyResult) -> Any:
        figures = study_figures(result)
        if len(figures) <= number:
            raise InputError(f"there is nothing to draw: it takes {needs}")
        return figures[number]

    return figure


def _columns(result: StudyResult) -> Mapping[str, Sequence[Any]]:
    """The index of the study: what a run was, what a sweep set, its metrics."""
    table = index_table(result.rows)
    return {name: table[name].to_pylist() for name in table.column_names}


VIEW = View(
    {"runs": lambda s: tables.run_table(s.rows)},
    {
        "runs": _figure(0, "a run that ends"),
        "start": _figure(1, "a run that ends"),
        "peaks": _figure(2, "two payloads"),
    },
    _columns,
    index="run_id",
)

_CHANGES = (words("metric"), *map(Column, ("mean A", "mean B", "mean Δ", "%", "median Δ", "largest Δ")))


def _changes(comparison: Comparison) -> Table:
    rows = []
    for change in comparison.changes:
        if change.noticeable:
            means = [plain(change.metric, number) for number in (change.mean_a, change.mean_b)]
            mean, *deltas = (
                plain(change.metric, delta, sign=True, digits=3)
                for delta in (change.mean_delta, change.median_delta, change.max_delta)
            )
            rows.append([change.metric, *means, mean, plain_percent(change.mean_percent), *deltas])
    return Table(_CHANGES, rows, f"{len(comparison.pairs)} runs are in both.")


def _change_columns(comparison: Comparison) -> Mapping[str, Sequence[Any]]:
    changes = comparison.changes
    names = ("metric", "runs", "mean_a", "mean_b", "mean_delta", "mean_percent", "median_delta", "max_delta")
    return {name: [getattr(change, name) for change in changes] for name in names}


COMPARISON = View({"changes": _changes}, {}, _change_columns, index="metric")
