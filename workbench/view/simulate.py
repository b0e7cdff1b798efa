"""Simulate one motion under the speed loop, and how the run is shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from workbench.core.shown import View
from workbench.core.table import Column, Table, words
from workbench.simulate.loop import LoopResult
from workbench.study.labels import metric_label
from workbench.view.logs import run_figure
from workbench.view.numbers import figures
from workbench.view.study_figures import over_time


def _metrics(result: LoopResult) -> Table:
    rows = [
        [label.words, figures(value, 4), label.unit]
        for name, value in result.metrics.items()
        for label in [metric_label(name)]
    ]
    return Table(
        [words("metric"), Column("value"), words("unit")], rows, f"{result.case.name}: {result.outcome.value}."
    )


def _overview(result: LoopResult) -> Any:
    return over_time([(result.case.name, result.run)], result.case.machine, result.case.name)


def _columns(result: LoopResult) -> Mapping[str, Sequence[Any]]:
    return {"time_s": result.run.time_s, **result.run.signals}  # type: ignore[dict-item]


VIEW = View(
    {"metrics": _metrics},
    {"overview": _overview, "signals": lambda r: run_figure(r.run)},
    _columns,
    index="time_s",
)
