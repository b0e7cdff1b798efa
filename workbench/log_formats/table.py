"""A log as columns of numbers, whatever its format."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.log_formats.declared import MB, Limits
from workbench.run import Array


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


class Meter:
    """Counts the samples produced. InputError as soon as they exceed the limits."""

    def __init__(self, columns: int, limits: Limits):
        self.limits = limits
        self.rows = [0] * columns

    def add(self, column: int, samples: int) -> None:
        """Count `samples` more of a column; call it before they are kept."""
        self.rows[column] += samples
        check_size(self.rows[column], sum(self.rows), self.limits)


def check_size(rows: int, samples: int, limits: Limits) -> None:
    """InputError for a column of too many rows, or too many samples of all columns."""
    if rows > limits.rows:
        raise InputError(f"holds more than {_count(limits.rows)} rows, the most that is read; cut it")
    if 8 * samples > limits.bytes:
        raise InputError(
            f"unpacks to more than {limits.bytes / MB:g} MB, the most that is read; cut it or leave columns out"
        )


def _count(rows: int) -> str:
    return f"{rows / MB:g} million" if rows >= MB else str(rows)


def gathered(count: int, pieces: Iterable[tuple[int, Array]], limits: Limits) -> list[Array]:
    """Whole columns from the pieces of an opener, within the limits. Pieces are freed as they are joined."""
    meter = Meter(count, limits)
    parts: list[list[Array]] = [[] for _ in range(count)]
    for column, piece in pieces:
        meter.add(column, len(piece))
        parts[column].append(piece)
    columns = []
    for part in parts:
        columns.append(np.concatenate(part) if part else np.empty(0))
        part.clear()
    return columns


def doubled(names: Sequence[str]) -> str | None:
    """The first name that occurs twice."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None
