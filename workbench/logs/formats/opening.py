"""Opens a log as columns of numbers, in this process or in a worker, within the limits of its format."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.core.errors import InputError
from workbench.core.input_file import readable_file
from workbench.core.run import Array
from workbench.logs.formats import worker
from workbench.logs.formats.declared import Limits, LogFormat, Opened, plain_errors
from workbench.logs.formats.known import format_of


@dataclass(frozen=True)
class LogFile:
    """An open log: its column names. read: its columns, (n,) float64 with NaN for an empty cell, when they are asked
    for. row_name(i): data row i (from 0) as the user finds it, "line 12" or "row 11"."""

    file: Path
    names: tuple[str, ...]
    read: Callable[[Sequence[str]], Mapping[str, Array]]
    row_name: Callable[[int], str]


@contextmanager
def open_log(file: Path, *, uploaded: bool = False) -> Iterator[LogFile]:
    """Open a log file without reading its samples.

    uploaded: the file is from another person; it is parsed in a worker whatever its format, with lower limits.
    InputError, naming the file, for an unknown format and for a damaged file, including one on
    which the worker crashes or runs out of time or memory.
    """
    log_format = format_of(readable_file(file, "log"))
    limits = log_format.uploaded if uploaded else log_format.own
    opening = (worker.opened if log_format.isolated or uploaded else _opened_here)(file, log_format, limits)
    with _naming(file):
        opened = opening.__enter__()

    def read(wanted: Sequence[str]) -> Mapping[str, Array]:
        parts: list[list[Array]] = [[] for _ in wanted]
        joined = {}
        with _naming(file):
            for column, piece in limits.counted(opened.pieces(wanted, limits), len(wanted)):
                parts[column].append(piece)
            for name, part in zip(wanted, parts, strict=True):  # pieces are freed as they are joined
                joined[name] = np.concatenate(part) if part else np.empty(0)
                part.clear()
            if len({len(column) for column in joined.values()}) > 1:
                listed = ", ".join(f"{name} {len(column)}" for name, column in joined.items())
                raise InputError(f"its columns differ in length: {listed}")
        return joined

    try:
        names = tuple(opened.names)
        if doubled := [name for name in names if names.count(name) > 1]:
            raise InputError(f"column '{doubled[0]}' is doubled", file=file)
        yield LogFile(file, names, read, lambda row: log_format.row_name(file, row))
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
        worker.start_early(imports)


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
