"""The progress of a batch on stderr: a bar on a terminal, otherwise a line from time to time."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from workbench.study.batch import Progress, Tell

LINE_EVERY_S = 10.0


@contextmanager
def shown(names: Sequence[str]) -> Iterator[Tell]:
    """The receiver of the progress of these studies; an interruption reports what is kept."""
    last: list[Progress] = []

    def remember(say: Callable[[Progress], None]) -> Tell:
        def tell(progress: Progress) -> None:
            last[:] = [progress]
            say(progress)

        return tell

    try:
        if sys.stderr.isatty():
            with _bar(len(names)) as bar:
                yield remember(bar)
        else:
            yield remember(_Lines().say)
    except KeyboardInterrupt:
        if last and last[0].done < last[0].runs:
            click.echo(f"\n{_counts(last[0])} done and kept; the same command goes on from there.", err=True)
        raise


@contextmanager
def _bar(studies: int) -> Iterator[Callable[[Progress], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[rate]}")
    with Bar(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None, rate="")
        begun: dict[str, float] = {}

        def say(progress: Progress) -> None:
            if progress.name not in begun:
                bar.reset(task)
                begun[progress.name] = time.monotonic()
            words = progress.name if studies == 1 else f"{len(begun)}/{studies} {progress.name}"
            bar.update(
                task, description=words, total=progress.runs, completed=progress.done,
                rate=_rate(progress, time.monotonic() - begun[progress.name]),
            )  # fmt: skip

        yield say


class _Lines:
    """Reports where the study continues, then a line every ten seconds; a quick study prints nothing."""

    def __init__(self) -> None:
        self.name = ""
        self.begun = self.next = 0.0

    def say(self, progress: Progress) -> None:
        now = time.monotonic()
        if progress.name != self.name:
            self.name, self.begun, self.next = progress.name, now, now + LINE_EVERY_S
            if progress.kept:
                click.echo(f"{progress.name}: goes on after {progress.kept} of {progress.runs} runs", err=True)
        elif now >= self.next:
            self.next = now + LINE_EVERY_S
            click.echo(f"{_counts(progress)}{_rate(progress, now - self.begun)}", err=True)


def _counts(progress: Progress) -> str:
    failed = f" ({progress.failed} failed)" if progress.failed else ""
    return f"{progress.name}: {progress.done} of {progress.runs} runs{failed}"


def _rate(progress: Progress, seconds: float) -> str:
    made = progress.done - progress.kept
    return f", {made / seconds:.0f} runs/s" if made and seconds > 0.0 else ""
