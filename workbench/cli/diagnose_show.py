"""A diagnosis in the terminal: the answer first, then small tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from workbench.cli.show import filled, print_table, print_text
from workbench.core.table import Table
from workbench.diagnose.records import Diagnosis
from workbench.reports.diagnosis import hypotheses, words
from workbench.reports.diagnosis import tables as report

MOST_CANDIDATES = 5


def show(d: Diagnosis, out: Path | None) -> None:
    """Print the diagnosis. out: the folder of its files, None if nothing was written."""
    click.echo()
    print_text([d.verdict.sentence, words.probability_sentence(d)])
    if alike := words.alike_sentence(d):
        print_text([alike])
    if d.warnings:
        _titled("To know first")
        _listed(d.warnings)
    _titled("The gap", report.gap_table(d))
    _titled("Each run", report.runs_table(d))
    if d.where is not None:
        print_text([words.where_sentence(d)])
    if parameters := hypotheses.parameters_table(d):
        _titled("Found", parameters)
    _titled("Candidates, the best first", hypotheses.candidates_table(d, MOST_CANDIDATES, brief=True))
    if d.unknown is not None:
        _titled("What is known of the unknown cause")
        _listed([*words.reasons_of(d), *words.unknown_sentences(d)])
    if d.verdict.word == "no_gap":
        _titled("How far it shrinks")
        print_text([words.shrink_sentence(d)])
    else:
        _titled("How far it shrinks, on held-out runs", report.brief_shrink_table(d))
    _titled("What changes in the control study")
    # The first sentence says what was run; the report has it.
    _listed([d.why_no_consequences] if d.consequences is None else d.consequences.sentences[1:])
    _titled("The next run")
    print_text([words.next_run_sentence(d)])
    if out is None:
        click.echo("\nNothing is written without --out.")
    else:
        click.echo(f"\nReport: {out / 'diagnose.html'}\nMachine: {out / 'machine.yaml'}")
        click.echo(f"Numbers: {out / 'diagnosis.json'}")


def _titled(title: str, table: Table | None = None) -> None:
    click.echo()
    click.secho(title, bold=True)
    if table is not None:
        print_table(table, note=False)


def _listed(sentences: Sequence[str]) -> None:
    for sentence in sentences:
        click.echo(filled(sentence, "- ", "  "))
