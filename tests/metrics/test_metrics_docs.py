"""docs/metrics.md is what the declarations say, and misses no column of an index."""

from __future__ import annotations

from pathlib import Path

from workbench.metrics import METRICS
from workbench.reports.metric_docs import OF_THE_RUN, metrics_page
from workbench.study.execute.chunk import _KNOWN_BEFORE
from workbench.study.results.row import METRICS as IN_EVERY_INDEX

PAGE = Path(__file__).resolve().parents[2] / "docs" / "metrics.md"


def test_the_docs_are_made_from_the_declarations():
    said = "run: python -m workbench.reports.metric_docs > docs/metrics.md"
    assert PAGE.read_text(encoding="utf-8") == metrics_page(), said


def test_every_column_of_an_index_is_defined_with_its_unit():
    defined = {name for name, _, _ in OF_THE_RUN} | {metric.name for metric in METRICS}
    assert {*IN_EVERY_INDEX, *_KNOWN_BEFORE} <= defined
    assert all(f"| `{name}` | " in metrics_page() for name in defined)
