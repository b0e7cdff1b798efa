"""The progress of a tuning on stderr: a bar on a terminal, otherwise a line every ten seconds."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click

from workbench.analysis.tune import STEPS, TuneProgress

LINE_EVERY_S = 10.0


@contextmanager
def shown() -> Iterator[Callable[[TuneProgress], None]]:
    """The receiver of the steps; Ctrl-C ends the tuning, and nothing is written."""
    try:
        if sys.stderr.isatty():
            with _bar() as say:
                yield say
        else:
            yield _Lines().say
    except KeyboardInterrupt:
        click.echo("The tuning was stopped; nothing is written.", err=True)
        raise


@contextmanager
def _bar() -> Iterator[Callable[[TuneProgress], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = BarColumn(bar_width=24), TimeElapsedColumn(), TextColumn("{task.description}")
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=STEPS)
        yield lambda progress: bar.update(task, completed=progress.step, description=words(progress))


class _Lines:
    """A line every ten seconds; a quick tuning prints nothing."""

    def __init__(self) -> None:
        self.next = time.monotonic() + LINE_EVERY_S

    def say(self, progress: TuneProgress) -> None:
        if time.monotonic() >= self.next:
            self.next = time.monotonic() + LINE_EVERY_S
            click.echo(f"{progress.step + 1}/{STEPS} {words(progress)}", err=True)


def words(progress: TuneProgress) -> str:
    """The current step, and the result so far."""
    if not progress.tried or math.isnan(progress.cost):
        return progress.doing
    return f"{progress.doing}; {progress.tried} tried, least cost {progress.cost:.3f}"
