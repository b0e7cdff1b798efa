"""Opens a log as columns of numbers, in this process or in a worker, within the limits of its format."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from workbench.core.errors import InputError
from workbench.core.input_file import readable_file
from workbench.core.run import Array
from workbench.logs.formats import worker
from workbench.logs.formats.declared import Limits, LogFormat, Opened, plain_errors
from workbench.logs.formats.known import format_of


@dataclass(frozen=True)
class Table:
    """The columns asked for, each (n,) float64 with NaN for an empty cell, and where each row stands in the file.

    `row_name(i)` names data row i (from 0) as the user finds it: "line 12" or "row 11".
    InputError when the columns differ in length.
    """

    file: Path
    columns: Mapping[str, Array]
    row_name: Callable[[int], str]

    def __post_init__(self) -> None:
        lengths = {name: len(column) for name, column in self.columns.items()}
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise InputError(f"its columns differ in length: {listed}", file=self.file)


@dataclass(frozen=True)
class LogFile:
    """An open log: its column names, and a reader of chosen columns."""

    file: Path
    names: tuple[str, ...]
    read: Callable[[Sequence[str]], Table]


@contextmanager
def open_log(file: Path, *, uploaded: bool = False) -> Iterator[LogFile]:
    """Open a log file without reading its samples.

    uploaded: the file is from another person; it is parsed in a worker whatever its format, with lower limits.
    InputError, naming the file, for an unknown format and for a damaged file, including one on
    which the worker crashes or runs out of time or memory.
    """
    log_format = format_of(readable_file(file, "log"))
    limits = log_format.uploaded if uploaded else log_format.own
    apart = log_format.isolated or uploaded
    opening: AbstractContextManager[Opened] = (worker.opened if apart else _opened_here)(file, log_format, limits)
    with _naming(file):
        opened = opening.__enter__()
    try:
        if len(set(opened.names)) < len(opened.names):
            doubled = next(name for name in opened.names if list(opened.names).count(name) > 1)
            raise InputError(f"column '{doubled}' is doubled", file=file)

        def read(wanted: Sequence[str]) -> Table:
            parts: list[list[Array]] = [[] for _ in wanted]
            with _naming(file):
                for column, piece in limits.counted(opened.pieces(wanted, limits), len(wanted)):
                    parts[column].append(piece)
            columns = []
            for part in parts:  # pieces are freed as they are joined
                columns.append(np.concatenate(part) if part else np.empty(0))
                part.clear()
            return Table(file, dict(zip(wanted, columns, strict=True)), partial(log_format.row_name, file))

        yield LogFile(file, tuple(opened.names), read)
    finally:
        opening.__exit__(None, None, None)


def expect(files: Iterable[Path], *, uploaded: bool = False) -> None:
    """Start the worker that these logs will need, if any, so that it is ready for the first one."""
    imports: dict[str, None] = {}
    for file in files:
        try:
            log_format = format_of(file)
        except InputError:
            continue
        if uploaded or log_format.isolated:
            imports |= dict.fromkeys(log_format.imports)
    if imports:
        worker.start_early(tuple(imports))


@contextmanager
def _opened_here(file: Path, log_format: LogFormat, limits: Limits) -> Iterator[Opened]:
    with plain_errors(log_format.name, limits):
        opened = log_format.open(file)

    def pieces(wanted: Sequence[str], limits: Limits) -> Iterator[tuple[int, Array]]:
        with plain_errors(log_format.name, limits):
            yield from opened.pieces(wanted, limits)

    yield Opened(opened.names, pieces)


@contextmanager
def _naming(file: Path) -> Iterator[None]:
    """Add the file's name to errors without one."""
    try:
        yield
    except InputError as error:
        if error.file is not None:
            raise
        raise InputError(error.problem, file=file, line=error.line, place=error.place) from error
