"""Closed-loop metrics in a team's own tests: run a scenario, assert what its rows say.

In a project that has workbench installed, pytest knows the fixture `study_rows` by itself:

    from workbench.testing import assert_metric

    def test_full_load_leaves_the_drive_room(study_rows):
        rows = study_rows("scenarios/payloads.yaml")
        assert_metric(rows, "peak_torque_percent", below=150, where={"payload_kg": 9000})
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from workbench.study.rows import Row

StudyRows = Callable[[str | os.PathLike[str]], "list[Row]"]
MOST_LINES = 10


@pytest.fixture(scope="session")
def study_rows(request: pytest.FixtureRequest) -> StudyRows:
    """Rows of a scenario file, sought from pytest's root folder; each file is run once in a session."""
    known: dict[Path, list[Row]] = {}

    def rows(file: str | os.PathLike[str]) -> list[Row]:
        path = (request.config.rootpath / file).resolve()
        if path not in known:
            known[path] = run_scenario(path)
        return known[path]

    return rows


def run_scenario(file: str | os.PathLike[str]) -> list[Row]:
    """Run a scenario here and now and write nothing. InputError for a file that cannot be run."""
    from workbench.study.load import load_study
    from workbench.study.run import run_study

    return list(run_study(load_study(file)).rows)


def assert_metric(
    rows: Sequence[Row],
    metric: str,
    *,
    below: float | None = None,
    above: float | None = None,
    where: Mapping[str, float | str] | None = None,
) -> None:
    """Assert that a metric of every run that `where` chooses lies below and above the limits.

    metric: its name, or its name without the unit. where: column -> value, of `payload_kg`, `reference`,
    `run_id` or a swept field. A run that failed, and a choice of no run, fail the assertion.
    """
    __tracebackhide__ = True
    from workbench.study.compare import metric_named

    if below is None and above is None:
        raise TypeError("assert_metric needs below, above or both")
    chosen = _chosen(rows, where or {})
    name = metric_named(metric, rows[0].metrics)
    given = {"below": below, "above": above}
    limits = " and ".join(f"{word} {limit:g}" for word, limit in given.items() if limit is not None)
    lines = [line for row in chosen if (line := _fault(row, name, below, above))]
    if lines:
        more = f"\n  … and {len(lines) - MOST_LINES} more" if len(lines) > MOST_LINES else ""
        shown = "\n".join(f"  {line}" for line in lines[:MOST_LINES])
        raise AssertionError(f"{name} is not {limits} in {len(lines)} of {len(chosen)} runs:\n{shown}{more}")


def _fault(row: Row, metric: str, below: float | None, above: float | None) -> str:
    if not row.ok:
        return f"{row.run_id}: failed: {row.reason}"
    value = row[metric]
    # Written so that a value that is no number is a fault.
    if (below is None or value < below) and (above is None or value > above):
        return ""
    return f"{row.run_id}: {value:.6g}"


def _chosen(rows: Sequence[Row], where: Mapping[str, float | str]) -> list[Row]:
    from workbench.core.errors import check_known

    if not rows:
        raise AssertionError("there are no runs")
    columns = {"run_id", "payload_kg", "reference", *(name for row in rows for name in row.assigned)}
    chosen = list(rows)
    for column, wanted in where.items():
        check_known("unknown column", column, columns, place="where")
        chosen = [row for row in chosen if _value(row, column) == wanted]
        if not chosen:
            there = sorted({str(_value(row, column)) for row in rows})
            raise AssertionError(f"no run has {column} {wanted!r}; there are: {', '.join(there[:20])}")
    return chosen


def _value(row: Row, column: str) -> object:
    if column in row.assigned:
        return row.assigned[column]
    return getattr(row, column, None)
