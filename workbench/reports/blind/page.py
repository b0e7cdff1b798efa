"""score.json, score.md and score.html of a blind test."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from workbench.blind import measures
from workbench.blind.later import WithNextRun
from workbench.blind.power import Power
from workbench.blind.score import Sheet
from workbench.core.table import Table
from workbench.core.whole_folder import check_free, whole_folder, write_json
from workbench.figures import blind as figures
from workbench.reports.blind import tables
from workbench.reports.blind.as_json import to_json
from workbench.reports.blind.words import answer, sentences
from workbench.view.page import Section, save_page


def write_score(sheet: Sheet, folder: Path, power: Power | None = None, next_runs: Sequence[WithNextRun] = ()) -> None:
    """Write the files into an empty folder, or none."""
    check_free(folder)
    parts = sections(sheet, power, next_runs)
    with whole_folder(folder) as hidden:
        write_json(hidden / "score.json", to_json(sheet, power, next_runs))
        (hidden / "score.md").write_text(markdown(parts), encoding="utf-8")
        save_page(parts, hidden / "score.html", f"Blind test: {sheet.title}", answer(sheet))


def sections(sheet: Sheet, power: Power | None = None, next_runs: Sequence[WithNextRun] = ()) -> list[Section]:
    """The sections of the page; those without rows are omitted."""
    rows = sheet.rows
    parts = [
        Section(tables=[*tables.sheets(rows), tables.amounts(rows)]),
        Section("The seal", points=sentences(sheet)),
    ]
    if power is not None:
        chart = [(figures.power(power.effects, power.unit), "")]
        heading = "The power of these runs"
        parts.append(Section(heading, sentences=power.sentences, tables=[tables.power(power)], figures=chart))
    if next_runs:
        said, table = tables.settled_text(next_runs, rows), tables.next_runs(next_runs)
        parts.append(Section("Open cases with the recommended next run", sentences=[said], tables=[table]))
    for heading, table in tables.sizes_by_kind(rows):
        parts.append(Section(heading, tables=[table]))
    parts[-1] = replace(parts[-1], figures=[(_by_size(sheet), "")])
    curve = figures.reliability(measures.reliability(rows))
    parts.append(Section("Probabilities", tables=[tables.reliability(rows)], figures=[(curve, "")]))
    for heading, table in tables.methods_by_kind(rows):
        parts.append(Section(heading, tables=[table]))
    matrix = [(figures.confusion(counts), "")] if (counts := tables.confusion_counts(rows)) else []
    parts.append(Section("Answers", tables=[tables.confusion(rows)], figures=matrix))
    wrong = tables.misses(rows)
    if wrong:
        parts.append(Section("Misses", tables=[wrong]))
    return parts


def markdown(parts: Sequence[Section]) -> str:
    """The sections without their figures, as Markdown."""
    return "\n\n".join(block for part in parts for block in _blocks(part)) + "\n"


def _blocks(part: Section) -> Iterator[str]:
    if part.heading:
        yield f"## {part.heading}"
    yield from part.sentences
    if part.points:
        yield "\n".join(f"- {point}" for point in part.points)
    for table in part.tables:
        yield from _shown(table)


def _shown(table: Table) -> Iterator[str]:
    if table:
        yield table.markdown()
        if table.note:
            yield table.note


def _by_size(sheet: Sheet) -> object:
    chosen = [measures.measure(key) for key in ("named", "first_three", "place")]
    known = [name for name, *_ in measures.SIZES]
    groups = {name: rows for name, rows in measures.by_size(sheet.rows).items() if name in known}
    shares = {measure.line: {name: measure.share(rows) for name, rows in groups.items()} for measure in chosen}
    return figures.right_by_size(shares)
