"""Progress on stderr: a bar on a terminal, otherwise lines. One bar serves studies, tuning and diagnosis."""

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
def _shown(line: Show, *, counts: bool = False) -> Iterator[Show]:
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


@contextmanager
def shown(names: Sequence[str]) -> Iterator[Tell]:
    """The receiver of the progress of these studies; an interruption reports what is kept."""
    last: list[Progress] = []
    begun: dict[str, float] = {}
    say = _NowAndThen()

    def counted() -> str:
        failed = f" ({last[0].failed} failed)" if last[0].failed else ""
        return f"{last[0].name}: {last[0].done} of {last[0].runs} runs{failed}"

    def rate() -> str:
        made, seconds = last[0].done - last[0].kept, time.monotonic() - begun[last[0].name]
        return f", {made / seconds:.0f} runs/s" if made and seconds > 0.0 else ""

    try:
        with _shown(lambda *_: say(f"{counted()}{rate()}"), counts=True) as show:

            def tell(progress: Progress) -> None:
                last[:] = [progress]
                if progress.name not in begun:
                    begun[progress.name], say.next = time.monotonic(), time.monotonic() + LINE_EVERY_S
                    if progress.kept and not sys.stderr.isatty():
                        text = f"{progress.name}: goes on after {progress.kept} of {progress.runs} runs"
                        click.echo(text, err=True)
                of = "" if len(names) == 1 else f"{len(begun)}/{len(names)} "
                show(f"{of}{progress.name}{rate()}", progress.done, progress.runs)

            yield tell
    except KeyboardInterrupt:
        if last and last[0].done < last[0].runs:
            click.echo(f"\n{counted()} done and kept; the same command goes on from there.", err=True)
        raise


@contextmanager
def tuning() -> Iterator[Callable[[TuneProgress], None]]:
    """The receiver of the steps; Ctrl-C ends the tuning, and nothing is written."""
    from workbench.analysis.tune import STEPS

    def words(progress: TuneProgress) -> str:
        if not progress.tried or math.isnan(progress.cost):
            return progress.doing
        return f"{progress.doing}; {progress.tried} tried, least cost {progress.cost:.3f}"

    say = _NowAndThen()
    try:
        with _shown(lambda sentence, done, total: say(f"{done + 1}/{total} {sentence}")) as show:
            yield lambda progress: show(words(progress), progress.step, STEPS)
    except KeyboardInterrupt:
        click.echo("The tuning was stopped; nothing is written.", err=True)
        raise


class Stages:
    """Counts the stages of a diagnosis from 1; the last one is the report's, where there is one to write."""

    def __init__(self, show: Show, writes: bool) -> None:
        from workbench.diagnose.progress import Remaining, Stage

        self._show, self._total, self._remaining = show, len(Stage) if writes else len(Stage) - 1, Remaining()

    def tell(self, progress: DiagnoseProgress) -> None:
        """Receives the progress of the diagnosis."""
        from workbench.view.diagnosis import progress_words

        left = self._remaining(progress)
        rest = "" if left is None else f"; usually at most {max(left, 1.0):.0f} s more"
        self._at(f"{progress_words(progress)}{rest}", progress.stage.value + 1)

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
        if sentence != last[0]:
            last[0] = sentence
            click.echo(sentence, err=True)

    with _shown(line) as show:
        yield Stages(show, writes)
