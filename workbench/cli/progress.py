"""Progress on stderr: a bar on a terminal, otherwise lines. One bar and one writer of lines serve studies, tuning and
diagnosis."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from workbench.analysis.tune import TuneProgress
    from workbench.diagnose.progress import Progress as DiagnoseProgress
    from workbench.study.store import Progress, Tell

LINE_EVERY_S = 10.0
Show = Callable[[str, int, int | None], None]  # a sentence, what is done, and of how many


@contextmanager
def _shown(line: Callable[[str, int, int | None], None], *, counts: bool = False) -> Iterator[Show]:
    """A bar, or `line` where nobody looks. counts: of runs, with the remaining time; else of stages, with the time."""
    if not sys.stderr.isatty():
        yield line
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.progress import TimeRemainingColumn as Remaining

    words = TextColumn("{task.description}")
    columns = (words, BarColumn(), MofNCompleteColumn(), Remaining()) if counts else (
        BarColumn(bar_width=24), TimeElapsedColumn(), words)  # fmt: skip
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)
        yield lambda sentence, done, total: bar.update(task, description=sentence, completed=done, total=total)


class _NowAndThen:
    """A line every ten seconds; quick work prints nothing."""

    def __init__(self) -> None:
        self.next = time.monotonic() + LINE_EVERY_S

    def __call__(self, line: str) -> None:
        if time.monotonic() >= self.next:
            self.next = time.monotonic() + LINE_EVERY_S
            click.echo(line, err=True)


# Studies.


@contextmanager
def shown(names: Sequence[str]) -> Iterator[Tell]:
    """The receiver of the progress of these studies; an interruption reports what is kept."""
    last: list[Progress] = []
    begun: dict[str, float] = {}
    say = _NowAndThen()

    def rate(progress: Progress) -> str:
        made, seconds = progress.done - progress.kept, time.monotonic() - begun[progress.name]
        return f", {made / seconds:.0f} runs/s" if made and seconds > 0.0 else ""

    def line(sentence: str, done: int, total: int | None) -> None:
        say(f"{_counts(last[0])}{rate(last[0])}")

    try:
        with _shown(line, counts=True) as show:

            def tell(progress: Progress) -> None:
                last[:] = [progress]
                if progress.name not in begun:
                    begun[progress.name], say.next = time.monotonic(), time.monotonic() + LINE_EVERY_S
                    if progress.kept and not sys.stderr.isatty():
                        text = f"{progress.name}: goes on after {progress.kept} of {progress.runs} runs"
                        click.echo(text, err=True)
                of = "" if len(names) == 1 else f"{len(begun)}/{len(names)} "
                show(f"{of}{progress.name}{rate(progress)}", progress.done, progress.runs)

            yield tell
    except KeyboardInterrupt:
        if last and last[0].done < last[0].runs:
            click.echo(f"\n{_counts(last[0])} done and kept; the same command goes on from there.", err=True)
        raise


def _counts(progress: Progress) -> str:
    failed = f" ({progress.failed} failed)" if progress.failed else ""
    return f"{progress.name}: {progress.done} of {progress.runs} runs{failed}"


# Tuning.


@contextmanager
def tuning() -> Iterator[Callable[[TuneProgress], None]]:
    """The receiver of the steps; Ctrl-C ends the tuning, and nothing is written."""
    from workbench.analysis.tune import STEPS

    say = _NowAndThen()
    try:
        with _shown(lambda sentence, done, total: say(f"{done + 1}/{total} {sentence}")) as show:
            yield lambda progress: show(tuning_words(progress), progress.step, STEPS)
    except KeyboardInterrupt:
        click.echo("The tuning was stopped; nothing is written.", err=True)
        raise


def tuning_words(progress: TuneProgress) -> str:
    """The current step, and the result so far."""
    if not progress.tried or math.isnan(progress.cost):
        return progress.doing
    return f"{progress.doing}; {progress.tried} tried, least cost {progress.cost:.3f}"


# Diagnosis.


class Stages:
    """Counts the stages of a diagnosis from 1; the last one is the report's, where there is one to write."""

    def __init__(self, show: Show, writes: bool) -> None:
        from workbench.diagnose.progress import Stage

        self._show, self._total = show, len(Stage) if writes else len(Stage) - 1

    def tell(self, progress: DiagnoseProgress) -> None:
        """Receives the progress of the diagnosis."""
        from workbench.view.diagnosis import progress_words

        self._at(progress_words(progress), progress.stage.value + 1)

    def writing(self, sentence: str) -> None:
        """The report is being written."""
        self._at(sentence, self._total)

    def _at(self, sentence: str, stage: int) -> None:
        self._show(f"{stage}/{self._total} {sentence}", stage - 1, self._total)


@contextmanager
def stages(writes: bool) -> Iterator[Stages]:
    """The receiver of the stages while the block runs; without a terminal a line for each new message."""
    last = [""]

    def line(sentence: str, done: int, total: int | None) -> None:
        if (step := sentence.partition(", about ")[0]) != last[0]:
            last[0] = step
            click.echo(sentence, err=True)

    with _shown(line) as show:
        yield Stages(show, writes)
