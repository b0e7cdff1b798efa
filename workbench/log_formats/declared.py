"""The declaration of a log format. A new format is a `LogFormat` in a file of its own, listed in known.py."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from workbench.run import Array

MB = 1_000_000


@dataclass(frozen=True)
class Limits:
    """Limits for one log, measured on the data produced from it, not on the sizes that its header claims.

    rows: of the columns that are read. bytes: of these columns, 8 a sample. seconds: of processor time.
    memory_bytes: beyond what the worker holds before it opens the file.
    """

    rows: int
    bytes: int
    seconds: float
    memory_bytes: int


OWN = Limits(rows=50 * MB, bytes=4000 * MB, seconds=300.0, memory_bytes=2000 * MB)
UPLOADED = Limits(rows=5 * MB, bytes=400 * MB, seconds=8.0, memory_bytes=1000 * MB)


@dataclass(frozen=True)
class Opened:
    """An opened file whose samples are not read yet.

    names: the columns of numbers that it may hold. pieces(wanted): (index in wanted, some of that column's
    samples, NaN where one is missing), in the order of the file; it may raise any exception.
    """

    names: Sequence[str]
    pieces: Callable[[Sequence[str], Limits], Iterator[tuple[int, Array]]]


def row_number(file: Path, row: int) -> str:
    """The name of data row `row`, counted from 0, in a file without lines."""
    return f"row {row + 1}"


@dataclass(frozen=True)
class LogFormat:
    """One format of logs.

    name: as in "is not a readable MAT file". suffixes: lower case, with the dot. open: looks into a file; a function
    of a module, for a worker imports it by name. isolated: its parser is not made for damaged files, so that it
    never runs in this process. imports: modules that it needs, loaded before a file is touched. about: a sentence
    for the documentation. own, uploaded: what a file may take that its user owns, and one that came from elsewhere.
    row_name: how a user finds a data row.
    """

    name: str
    suffixes: tuple[str, ...]
    open: Callable[[Path], Opened]
    about: str
    isolated: bool = True
    imports: tuple[str, ...] = field(default=())
    own: Limits = OWN
    uploaded: Limits = UPLOADED
    row_name: Callable[[Path, int], str] = row_number
