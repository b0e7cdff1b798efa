"""The declaration of a log format, the limits of what a file may hold, and channels of several rates over one time.

A new format is a module `NAME_file.py` in this folder with one `LogFormat`; see known.py.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array

MB = 1_000_000
TIME = "time_s"


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

    def check(self, rows: int, samples: int) -> None:
        """InputError for a column of too many rows, or too many samples of all columns."""
        if rows > self.rows:
            count = f"{self.rows / MB:g} million" if self.rows >= MB else str(self.rows)
            raise InputError(f"holds more than {count} rows, the most that is read; cut it")
        if 8 * samples > self.bytes:
            said = f"unpacks to more than {self.bytes / MB:g} MB, the most that is read; cut it or leave columns out"
            raise InputError(said)

    def counted(self, pieces: Iterable[tuple[int, Array]], columns: int) -> Iterator[tuple[int, Array]]:
        """The pieces of an opener, each counted before it is handed on. InputError as soon as they are too many."""
        rows = [0] * columns
        for column, piece in pieces:
            rows[column] += len(piece)
            self.check(rows[column], sum(rows))
            yield column, piece


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


@dataclass(frozen=True)
class LogFormat:
    """One format of logs.

    name: as in "is not a readable MAT file". suffixes: lower case, with the dot. open: looks into a file; a function
    of a module, for a worker imports it by name. isolated: its parser is not made for damaged files, so that it
    never runs in this process. imports: every module that it needs, loaded before a file is touched, since the worker
    can open no other file afterwards; one that is not installed is left out. about: a sentence for the documentation.
    own, uploaded: what a file may take that its user owns, and one that came from elsewhere. row_name: how a user
    finds a data row, counted from 0.
    """

    name: str
    suffixes: tuple[str, ...]
    open: Callable[[Path], Opened]
    about: str
    isolated: bool = True
    imports: tuple[str, ...] = field(default=())
    own: Limits = OWN
    uploaded: Limits = UPLOADED
    row_name: Callable[[Path, int], str] = lambda file, row: f"row {row + 1}"


@contextmanager
def plain_errors(format_name: str, limits: Limits) -> Iterator[None]:
    """Whatever a parser raises on a damaged file becomes an InputError. The caller adds the file's name."""
    try:
        yield
    except InputError:
        raise
    except MemoryError as error:
        said = f"takes more than the {limits.memory_bytes / MB:g} MB of memory that a log may; is it damaged?"
        raise InputError(said) from error
    except Exception as error:
        if isinstance(error, OSError) and error.errno and error.strerror:
            raise InputError(f"cannot be read: {error.strerror}") from error
        first = (str(error).splitlines() or [""])[0] or type(error).__name__
        raise InputError(f"is not a readable {format_name} file: {first[:200]}") from error


def real_numbers(name: str, values: Array) -> Array:
    """A channel as float64. InputError for what is no row of real numbers."""
    if values.dtype.kind not in "fiub" or values.ndim != 1:
        raise InputError(f"holds {values.dtype}, expected real numbers", place=name)
    return np.ascontiguousarray(values, dtype=np.float64)


@dataclass(frozen=True)
class Channel:
    """One channel of a file. unit: as the file says it, "" where it does not. time_s, values: (n,)."""

    name: str
    unit: str
    time_s: Array
    values: Array


def titled(name: str, unit: str) -> str:
    """A column's name with its unit behind it."""
    return f"{name} [{unit}]" if unit else name


def distinct(names: Sequence[str]) -> list[str]:
    """Unique names: repeated ones get a number."""
    seen: dict[str, int] = {}
    out = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        out.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return out


def at_times(channel: Channel, time_s: Array) -> Array:
    """The channel at other times: linear between its samples, missing beyond its ends."""
    known = np.isfinite(channel.values) & np.isfinite(channel.time_s)
    t, v = channel.time_s[known], channel.values[known]
    if len(t) == len(time_s) and np.array_equal(t, time_s):
        return v
    if len(t) == 0:
        return np.full(len(time_s), np.nan)
    # Half a step of its own beyond its ends still belongs to it: clocks of groups do not begin at the same moment.
    slack = 0.5 * float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    out = np.interp(time_s, t, v)
    out[(time_s < t[0] - slack) | (time_s > t[-1] + slack)] = np.nan
    return np.asarray(out)


def over_time(
    names: Sequence[str], rows: int, time_s: Callable[[], Array], channel: Callable[[str], Channel]
) -> Opened:
    """An opened file of channels of several rates: `time_s`, and the channels at these times."""

    def pieces(wanted: Sequence[str], limits: Limits) -> Iterator[tuple[int, Array]]:
        limits.check(rows, rows * len(wanted))
        at = time_s()
        for index, name in enumerate(wanted):
            yield index, at if name == TIME else np.ascontiguousarray(at_times(channel(name), at))

    return Opened([TIME, *names], pieces)


def fastest(channels: Sequence[Channel]) -> Array:
    """The time of the channel with the most samples. ValueError where there is none."""
    return max(channels, key=lambda channel: len(channel.time_s)).time_s
