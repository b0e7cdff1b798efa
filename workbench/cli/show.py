"""Tables and sentences in the terminal."""

from __future__ import annotations

import math
import re
import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

from workbench.core.table import Table
from workbench.diagnose.progress import Progress as DiagnoseProgress
from workbench.diagnose.progress import Remaining, Stage

if TYPE_CHECKING:
    from workbench.analysis.tune import TuneProgress
    from workbench.study.store import Progress, Tell
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
    width = min(shutil.get_terminal_size((100, 24)).columns - 2, WIDTH)
    whole = textwrap.fill(tied, width, initial_indent=first, subsequent_indent=then, break_long_words=False)
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


# Progress on stderr: a bar on a terminal, otherwise lines. One bar serves studies, tuning and diagnosis.


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


@contextmanager
def stages(writes: bool) -> Iterator[tuple[Callable[[DiagnoseProgress], None], Callable[[str], None]]]:
    """The receivers of a diagnosis' progress, and of what is said while its report is written: the last stage, where
    there is one. Stages are counted from 1; without a terminal each new message is a line."""
    from workbench.view.diagnosis import progress_words

    last, total, remaining = "", len(Stage) if writes else len(Stage) - 1, Remaining()

    def line(sentence: str, done: int, of: int | None) -> None:
        nonlocal last
        if sentence != last:
            last = sentence
            click.echo(sentence, err=True)

    with _shown(line) as show:

        def at(sentence: str, stage: int) -> None:
            show(f"{stage}/{total} {sentence}", stage - 1, total)

        def tell(progress: DiagnoseProgress) -> None:
            left = remaining(progress)
            rest = "" if left is None else f"; usually at most {max(left, 1.0):.0f} s more"
            at(f"{progress_words(progress)}{rest}", progress.stage.value + 1)

        yield tell, lambda sentence: at(sentence, total)
