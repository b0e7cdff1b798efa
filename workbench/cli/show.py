"""Tables and sentences in the terminal."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Sequence

import click

WIDTH = 98


def print_table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> None:
    """A table of ready text; a column whose head starts with a blank holds words and is set left."""
    from rich.console import Console
    from rich.table import Table

    console = Console()
    shown = Table(box=None, pad_edge=False, padding=(0, 1))
    for name in head:
        words = name.startswith(" ")
        shown.add_column(name.strip(), justify="left" if words else "right", no_wrap=True, vertical="bottom")
    for line in lines:
        shown.add_row(*line)
    # A pipe has no width of its own; the table's is kept whole there.
    if not console.is_terminal:
        console = Console(width=100)
    console.print(shown)


def print_text(sentences: Sequence[str], *, dim: bool = False) -> None:
    """A paragraph a sentence, wrapped to the terminal."""
    for sentence in sentences:
        click.secho(textwrap.fill(sentence, min(_width(), WIDTH), break_long_words=False), dim=dim)


def print_notes(notes: Sequence[str]) -> None:
    """What the reader of the logs has to say, a line each."""
    if notes:
        click.echo("Notes on the logs:")
        for note in notes:
            click.echo(textwrap.fill(note, min(_width(), WIDTH), initial_indent="  ", subsequent_indent="    "))
        click.echo()


def _width() -> int:
    return shutil.get_terminal_size((100, 24)).columns - 2
