"""The pages that the build of the docs makes from declarations miss nothing that is declared."""

from __future__ import annotations

from pathlib import Path

import click
import pytest

from tests.support.made_pages import FILE, made_pages
from tests.test_docs import command_of, parts_of
from workbench.cli import COMMANDS
from workbench.effects import library_effects
from workbench.machines import KINDS, RECORDS
from workbench.metrics import columns, metrics
from workbench.references import planned_kinds, recorded_kinds

MADE = made_pages()
DOCS = FILE.parents[1]


def test_the_build_writes_every_page_and_some_page_of_the_docs_includes_it(tmp_path: Path):
    MADE.write(tmp_path / "made")
    assert {file.stem: file.read_text(encoding="utf-8") for file in (tmp_path / "made").iterdir()} == {
        name: page() for name, page in MADE.PAGES.items()
    }
    docs = "".join(page.read_text(encoding="utf-8") for page in DOCS.glob("*.md"))
    assert [name for name in MADE.PAGES if docs.count(f"```{{include}} made/{name}.md\n```\n") != 1] == []


def test_every_effect_has_its_section_with_all_its_parameters():
    page = MADE.effects_page()
    for effect in library_effects():
        assert f"### {effect.id}" in page and effect.meaning in page and f"    {effect.equation}\n" in page
        assert all(f"`{p.named(kind)}`" in page for p in effect.parameters for kind in effect.kinds)


def test_every_column_of_an_index_is_defined_with_its_unit():
    assert set(columns()) <= {metric.name for metric in metrics()}
    assert all(f"| `{metric.name}` | {metric.unit} | " in MADE.metrics_page() for metric in metrics())


def test_every_reference_and_every_signal_of_a_log_has_its_place():
    assert all(f"| `{name}` | " in MADE.references_page() for name in {**planned_kinds(), **recorded_kinds()})
    rows = {row.split(" | ")[0].strip("| "): row for row in MADE.signals_page().splitlines()}
    for name, kind in KINDS.items():
        assert all(f"`{signal}`" in rows[name] for signal in kind.signals.names)


def keys(record: type, prefix: str = "") -> list[str]:
    """Every key of a record and of the blocks in it, dotted."""
    found = []
    for name, field in record.model_fields.items():  # type: ignore[attr-defined]
        place = f"{prefix}{field.alias or name}"
        found += [place, *(key for block in MADE._records_in(field.annotation) for key in keys(block, f"{place}."))]
    return found


@pytest.mark.parametrize("record", RECORDS[:2])
def test_every_key_of_machine_yaml_has_its_line(record: type):
    page = MADE.keys_page()
    assert len(keys(record)) > 25
    assert [key for key in keys(record) if f"| `{key}` | " not in page and f"**{key}**: " not in page] == []


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_and_option_has_its_line(name: str):
    page = MADE.commands_page()
    for part in parts_of(command_of(name))[-1:]:
        options = [p for p in part.params if isinstance(p, click.Option) and not p.hidden]
        assert [p.opts[0] for p in options if f"`{p.opts[0]}" not in page and f", {p.opts[0]}" not in page] == []
