"""Run a study or compare two, and how their results are shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from workbench.core.errors import InputError
from workbench.core.table import Column, Table, words
from workbench.core.yaml_strict import Document
from workbench.face.logs import PathLike
from workbench.face.view import View
from workbench.figures.study_page import study_figures
from workbench.machines import Axis, Hoist, default_hoist
from workbench.study import tables
from workbench.study.compare import Comparison, plain, plain_percent, why_unmatched
from workbench.study.compare import compare as compare_rows
from workbench.study.load import Study, changed, load_study, plan_study, read_standalone
from workbench.study.rows import Row, index_table, read_rows
from workbench.study.run import StudyResult, run_study


def study(
    scenario: PathLike | Mapping[str, Any] | Study, *, machine: Hoist | Axis | None = None, **changes: Any
) -> StudyResult:
    """Run a scenario, every payload with every reference, and keep rows and signals in memory.

    scenario: a file, or the same keys as a dict. machine: in place of the scenario's. changes: other values of the
    scenario's keys, such as payloads_kg=[0, 9000]. InputError names the key or the place in the file.
    """
    planned = _planned(scenario, machine)
    if machine is not None or changes:
        new = changed(planned.scenario, changes)
        planned = plan_study(new, planned.machine if machine is None else machine, planned.recordings)
    return run_study(planned)


def _planned(scenario: PathLike | Mapping[str, Any] | Study, machine: Hoist | Axis | None) -> Study:
    if isinstance(scenario, Study):
        return scenario
    if not isinstance(scenario, Mapping):
        return load_study(scenario)
    hoist = default_hoist() if machine is None else machine
    data = {"name": "study", **scenario}
    return plan_study(read_standalone(Document(Path("the scenario"), data, {}), hoist), hoist)


def compare(a: StudyResult | PathLike, b: StudyResult | PathLike) -> Comparison:
    """Every metric of study b against study a, over the runs that both have; results or folders of results."""
    rows_a, rows_b = _rows(a), _rows(b)
    comparison = compare_rows(rows_a, rows_b)
    if not comparison.pairs:
        raise InputError(f"no run is in both studies: {why_unmatched(rows_a, rows_b)}")
    return comparison


def _rows(result: StudyResult | PathLike) -> Sequence[Row]:
    return result.rows if isinstance(result, StudyResult) else read_rows(Path(result))


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
