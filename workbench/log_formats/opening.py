"""Opens a log, in this process or in a worker, within the limits of its format."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path

from workbench.errors import InputError
from workbench.log_formats import process
from workbench.log_formats.declared import Limits, LogFormat, Opened
from workbench.log_formats.known import format_of
from workbench.log_formats.parsing import plain_errors
from workbench.log_formats.table import LogFile, Table, doubled, gathered
from workbench.run import Array


@contextmanager
def open_log(file: Path, *, uploaded: bool = False) -> Iterator[LogFile]:
    """Open a log file without reading its samples.

    uploaded: the file is from another person; it is parsed in a worker whatever its format, with lower limits.
    InputError, naming the file, for an unknown format and for a damaged file, including one on
    which the worker crashes or runs out of time or memory.
    """
    log_format = format_of(file)
    limits = log_format.uploaded if uploaded else log_format.own
    apart = log_format.isolated or uploaded
    opening: AbstractContextManager[Opened] = (
        process.opened(file, log_format, limits) if apart else _opened_here(file, log_format, limits)
    )
    with _naming(file):
        opened = opening.__enter__()
    try:
        if (name := doubled(opened.names)) is not None:
            raise InputError(f"column '{name}' is doubled", file=file)

        def read(wanted: Sequence[str]) -> Table:
            with _naming(file):
                columns = gathered(len(wanted), opened.pieces(wanted, limits), limits)
            return Table(file, dict(zip(wanted, columns, strict=True)), partial(log_format.row_name, file))

        yield LogFile(file, tuple(opened.names), read)
    finally:
        opening.__exit__(None, None, None)


def expect(files: Iterable[Path], *, uploaded: bool = False) -> None:
    """Start the worker that these logs will need, if any, so that it is ready for the first one."""
    known = [log_format for file in files if (log_format := _known(file)) is not None]
    imports = [name for log_format in known if uploaded or log_format.isolated for name in log_format.imports]
    if imports:
        process.start_early(tuple(dict.fromkeys(imports)))


def _known(file: Path) -> LogFormat | None:
    try:
        return format_of(file)
    except InputError:
        return None


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
