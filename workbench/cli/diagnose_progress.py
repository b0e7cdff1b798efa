"""How far a diagnosis is: one bar on a terminal, a plain line a step elsewhere; both on stderr."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click

Tell = Callable[[str, int, int], None]


@contextmanager
def shown() -> Iterator[Tell]:
    """What to tell each step to: its sentence, how many of its stage are done, and of how many (0: unknown)."""
    if sys.stderr.isatty():
        with _bar() as tell:
            yield tell
    else:
        yield _Lines().tell


@contextmanager
def _bar() -> Iterator[Tell]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = BarColumn(bar_width=24), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}")
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)

        def tell(sentence: str, done: int, total: int) -> None:
            if total:
                bar.update(task, total=total, completed=done)
            bar.update(task, description=sentence)

        yield tell


class _Lines:
    """A line whenever there is something new to say."""

    def __init__(self) -> None:
        self.last = ""

    def tell(self, sentence: str, done: int, total: int) -> None:
        line = f"{done}/{total} {sentence}" if total else sentence
        if line != self.last:
            click.echo(line, err=True)
            self.last = line
