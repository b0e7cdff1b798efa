"""score.json and score.html of a blind test."""

from __future__ import annotations

from pathlib import Path

from workbench.blind import measures
from workbench.blind.power import Power
from workbench.blind.score import Score
from workbench.blind.share import Share
from workbench.figures import blind as figures
from workbench.figures.save import Section, save_page
from workbench.reports.blind import tables
from workbench.reports.blind.as_json import to_json
from workbench.reports.blind.words import sentences
from workbench.whole_folder import check_free, whole_folder, write_json


def write_score(score: Score, folder: Path, power: Power | None = None, settled: Share | None = None) -> None:
    """Write both files into an empty folder, or none."""
    check_free(folder)
    with whole_folder(folder) as hidden:
        write_json(hidden / "score.json", to_json(score, power, settled))
        save_page(sections(score, power, settled), hidden / "score.html", f"Blind test {score.folder.name}")


def sections(score: Score, power: Power | None = None, settled: Share | None = None) -> list[Section]:
    """The sections of the page; those without rows are omitted."""
    more = [tables.settled(settled)] if settled is not None and settled.of else []
    parts = [
        Section(sentences=[*sentences(score), *more], tables=[*tables.sheets(score.rows), tables.amounts(score.rows)])
    ]
    if power is not None:
        chart = [(figures.power(power.effects, power.unit), power.note)]
        heading = "The power of these runs"
        parts.append(Section(heading, sentences=power.sentences, tables=[tables.power(power)], figures=chart))
    parts.append(Section("By the size of the gap", tables=[tables.sizes(score.rows)], figures=[(_by_size(score), "")]))
    curve = figures.reliability(measures.reliability(score.rows))
    parts.append(Section("Probabilities", tables=[tables.reliability(score.rows)], figures=[(curve, "")]))
    parts.append(Section("Beside other methods", tables=[tables.methods(score.rows)]))
    parts.append(Section("Answers", tables=[tables.confusion(score.rows)]))
    wrong = tables.misses(score.rows)
    if wrong:
        parts.append(Section("Misses", tables=[wrong]))
    return parts


def _by_size(score: Score) -> object:
    chosen = [measures.measure(key) for key in ("named", "first_three", "place")]
    groups = measures.by_size(score.rows)
    shares = {measure.line: {name: measure.share(rows) for name, rows in groups.items()} for measure in chosen}
    return figures.right_by_size(shares)
