"""The pages that the build of the docs makes from declarations miss nothing that is declared."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.made_pages import FILE, made_pages
from workbench.effects import library_effects
from workbench.machines import RECORDS
from workbench.metrics import columns, metrics
from workbench.references import planned_kinds, recorded_kinds

MADE = made_pages()


@pytest.mark.parametrize("name", MADE.PAGES)
def test_a_page_of_the_docs_includes_what_is_made(name: str):
    page = (FILE.parents[1] / f"{name}.md").read_text(encoding="utf-8")
    assert f"```{{include}} made/{name}.md\n```\n" in page


def test_the_build_writes_every_page(tmp_path: Path):
    MADE.write(tmp_path / "made")
    assert {file.stem: file.read_text(encoding="utf-8") for file in (tmp_path / "made").iterdir()} == {
        name: page() for name, page in MADE.PAGES.items()
    }


def test_every_effect_has_its_section_with_all_its_parameters():
    page = MADE.effects_page()
    for effect in library_effects():
        assert f"### {effect.id}" in page and effect.meaning in page and f"    {effect.equation}\n" in page
        assert all(f"`{p.named(kind)}`" in page for p in effect.parameters for kind in effect.kinds)


def test_every_column_of_an_index_is_defined_with_its_unit():
    assert set(columns()) <= {metric.name for metric in metrics()}
    assert all(f"| `{metric.name}` | {metric.unit} | " in MADE.metrics_page() for metric in metrics())


def test_every_reference_and_every_record_has_its_lines():
    references, bounds = MADE.references_page(), MADE.bounds_page()
    assert all(f"| `{name}` | " in references for name in {**planned_kinds(), **recorded_kinds()})
    for record in RECORDS:
        assert all(f"| `{name}` | " in bounds for name, *_ in MADE.bounded(record))
