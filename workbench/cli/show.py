"""Tables and sentences in the terminal."""

from __future__ import annotations

import re
import shutil
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from workbench.core.table import Table

if TYPE_CHECKING:
    from workbench.view.page import Section

WIDTH = 98
PIPE_WIDTH = 100
TIE = "\u00a0"  # a blank at which no line is broken
# What a number is not parted from, the longest first; N m has a blank of its own.
_UNITS = (
    r"N m s/rad|N m/rad|N m/s|N m|N s/m|kg m²|kg|kN|N|rad/s²|rad/s|rad|m/s³|m/s²|m/s|mm|m|ms|s|Hz|kW|W|kJ|J|Pa|dB|%"
)
_NUMBER_AND_UNIT = re.compile(rf"(?:(?<=\d) )?(?<![\w/])(?:{_UNITS})(?![\w/²³])")


def print_table(table: Table, *, note: bool = True) -> None:
    """The table, and its note below."""
    from rich.console import Console

    console = Console()
    if console.is_terminal:
        console.print(table)
    else:  # a pipe has no width of its own
        click.echo(table.text(PIPE_WIDTH))
    if note and table.note:
        print_text([table.note], dim=True)


def print_text(sentences: Sequence[str], *, dim: bool = False) -> None:
    """One paragraph for each sentence, wrapped to the terminal."""
    for sentence in sentences:
        click.secho(filled(sentence), dim=dim)


def filled(text: str, first: str = "", then: str = "") -> str:
    """A paragraph wrapped to the terminal: `first` begins the first line, `then` the others. A number keeps its unit.

    Words joined by `TIE` stay together too. All blanks are printed as plain ones.
    """
    tied = _NUMBER_AND_UNIT.sub(lambda match: match[0].replace(" ", TIE), text)
    whole = textwrap.fill(
        tied, min(_width(), WIDTH), initial_indent=first, subsequent_indent=then, break_long_words=False
    )  # fmt: skip
    return whole.replace(TIE, " ")


def print_sections(sections: Sequence[Section]) -> None:
    """Headings, sentences, points and tables of sections; figures and what stands below tables are for the page."""
    for number, section in enumerate(sections):
        if number and (section.heading or section.tables):
            click.echo()
        if section.heading:
            click.secho(section.heading, bold=True)
        print_text(section.sentences)
        for point in section.points:
            click.echo(filled(point, "- ", "  "))
        for table in section.tables:
            print_table(table, note=False)


def print_notes(notes: Sequence[str]) -> None:
    """The notes of the log reader, one line each."""
    if notes:
        click.echo("Notes on the logs:")
        for note in notes:
            click.echo(filled(note, "  ", "    "))
        click.echo()


def _width() -> int:
    return shutil.get_terminal_size((100, 24)).columns - 2
