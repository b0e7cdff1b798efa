"""docs/metrics.md is what the declarations say, and misses no column of an index."""

from __future__ import annotations

from pathlib import Path

from workbench.metrics import columns, metrics
from workbench.reports.declared_pages import metrics_page

PAGE = Path(__file__).resolve().parents[2] / "docs" / "metrics.md"


def test_the_docs_are_made_from_the_declarations():
    said = "run: python -m workbench.reports.declared_pages metrics > docs/metrics.md"
    assert PAGE.read_text(encoding="utf-8") == metrics_page(), said


def test_every_column_of_an_index_is_defined_with_its_unit():
    assert set(columns()) <= {metric.name for metric in metrics()}
    assert all(f"| `{metric.name}` | {metric.unit} | " in metrics_page() for metric in metrics())
