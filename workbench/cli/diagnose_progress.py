"""The progress of a diagnosis on stderr: a bar on a terminal, otherwise one line for each stage."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click

from workbench.diagnose.progress import Progress, Stage
from workbench.reports.diagnosis.progress import progress_words

Show = Callable[[str, int, int], None]


class Stages:
    """Counts the stages of the command from 1; the last one is the report's.

    writes: whether there is a report to write; without one there is a stage less.
    """

    def __init__(self, show: Show, writes: bool) -> None:
        self.show, self.total = show, len(Stage) if writes else len(Stage) - 1

    def tell(self, progress: Progress) -> None:
        """Receives the progress of the diagnosis."""
        self.show(progress_words(progress), progress.stage.value + 1, self.total)

    def writing(self, sentence: str) -> None:
        """The report is being written."""
        self.show(sentence, self.total, self.total)


@contextmanager
def shown(writes: bool) -> Iterator[Stages]:
    """The receiver of the stages while the block runs."""
    if sys.stderr.isatty():
        with _bar() as show:
            yield Stages(show, writes)
    else:
        yield Stages(_Lines().show, writes)


@contextmanager
def _bar() -> Iterator[Show]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = BarColumn(bar_width=24), TimeElapsedColumn(), TextColumn("{task.description}")
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)

        def show(sentence: str, stage: int, total: int) -> None:
            if total:
                bar.update(task, total=total, completed=stage - 1)
            bar.update(task, description=_line(sentence, stage, total))

        yield show


class _Lines:
    """One line for each new message."""

    def __init__(self) -> None:
        self.last = ""

    def show(self, sentence: str, stage: int, total: int) -> None:
        line = _line(sentence, stage, total)
        if line != self.last:
            click.echo(line, err=True)
            self.last = line


def _line(sentence: str, stage: int, total: int) -> str:
    return f"{stage}/{total} {sentence}" if total else sentence
