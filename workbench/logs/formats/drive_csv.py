"""CSV as drives and scopes write it: lines before the columns, semicolons or tabs, decimal commas, several rates.

TwinCAT Scope exports (Beckhoff TE13xx) have rows of properties, `Name`, `SampleTime[ms]`, `Unit` and more, whose key
stands again at each group of columns; below them the first column of a group is its time in ms, the others its
channels, and the last line may be EOF. Every other file is taken as: lines that are no numbers, of which the last with
as many cells as the numbers is the header, or the one before it where that is a row of units; then rows of numbers. Its
first column that is called a time is the time, else there is none.

Trends of Rockwell's Studio 5000 have a line `Header:,Date,Time,TAG,…` and lines `Data,DATE,HH:MM:SS;mmm,VALUE,…`. Made
from two public programs that write and read them (ICS Studio; a trend viewer's parser with its tests), not from an
export of Rockwell's own. Dates differ by country and are not read: a clock that goes back by hours is the next day.
Scope: the public exports of CagtayFabry/pytcs, and Beckhoff's manual TE13xx, "Export in csv".
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from workbench.core.errors import InputError
from workbench.core.input_file import read_input
from workbench.core.run import Array
from workbench.logs.formats.declared import Channel

MOST_HEAD = 200  # lines before the numbers
_DATE = re.compile(r'"?\d{4}-\d{2}-\d{2}[T ]\d{2}:\d{2}(:\d{2}([.,]\d{1,6})?)?(Z|[+-]\d{2}:?\d{2})?"?')
SCOPE_KEY = "SampleTime[ms]"
FILETIME = 1e16  # beyond it a time is one of Windows, in 100 ns
_CLOCK = re.compile(r"(\d{1,2}):(\d{2}):(\d{2})(?:[;.,](\d{1,6}))?(?: *([AP])M)?", re.IGNORECASE)
TIME_UNITS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "min": 60.0}
_TIME = re.compile(r"^(time|zeit|timestamp|zeitstempel|t)(_(s|ms|us|µs|min))?\b", re.IGNORECASE)
_UNIT = re.compile(r"^(.*?)\s*[\[(/]\s*([^\])]*?)\s*[\])]?\s*$")
_NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?")


def read_drive_csv(file: Path) -> list[Channel]:
    """The channels with their own times, s; times are NaN where the file has none. InputError, naming the line."""
    lines = [line.rstrip("\r") for line in _text(file).split("\n")]
    while lines and (not lines[-1].strip() or lines[-1].strip() == "EOF"):
        lines.pop()
    if not lines:
        raise InputError("is empty", file=file)
    if any(line.startswith("Header:") for line in lines[:MOST_HEAD]):
        return _of_trend(lines, file)
    mark = _separator(lines)
    first = _first_row(lines, mark, file)
    head = [[cell.strip().strip('"') for cell in line.split(mark)] for line in lines[:first]]
    numbers = _numbers(lines, first, mark, file)
    scope = next((row for row in head if row[0] == SCOPE_KEY), None)
    return _of_scope(head, numbers, file) if scope is not None else _of_columns(head, numbers, file)


def split_unit(title: str) -> tuple[str, str]:
    """`Torque [Nm]`, `Torque (Nm)`, `Torque / Nm` -> name and unit; unit "" where there is none."""
    matched = _UNIT.match(title) if re.search(r"[\[(]|\s/\s", title) else None
    return (matched.group(1).strip(), matched.group(2).strip()) if matched else (title.strip(), "")


def _text(file: Path) -> str:
    data = read_input(file, "drive log")
    for mark, name in ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if data.startswith(mark):
            return data.decode(name, errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def _separator(lines: Sequence[str]) -> str:
    """The separator of cells: a tab or a semicolon before a comma, which may be the decimal mark."""
    sample = lines[-min(len(lines), 20) :]
    for mark in ("\t", ";"):
        if all(mark in line for line in sample):
            return mark
    return "," if all("," in line for line in sample) else "\t"


def _first_row(lines: Sequence[str], mark: str, file: Path) -> int:
    for i, line in enumerate(lines[:MOST_HEAD]):
        cells = [cell.strip() for cell in line.split(mark)]
        filled = [cell for cell in cells if cell]
        numbers = filled[1:] if filled and _DATE.fullmatch(filled[0]) else filled
        if len(cells) > 1 and len(filled) > 1 and all(_NUMBER.fullmatch(cell) for cell in numbers):
            return i
    raise InputError(f"no row of numbers within {MOST_HEAD} lines; is it a log?", file=file)


def _numbers(lines: Sequence[str], first: int, mark: str, file: Path) -> Array:
    """(rows, cells), NaN where a cell is empty."""
    width = max(len(line.split(mark)) for line in lines[first : first + 5])
    rows = []
    for number, line in enumerate(lines[first:], first + 1):
        if not line.strip():
            continue
        cells = line.split(mark)
        if len(cells) > width and any(cell.strip() for cell in cells[width:]):
            raise InputError(f"row has {len(cells)} cells, expected {width}", file=file, line=number)
        try:
            row = [_value(cell) if cell.strip() else np.nan for cell in cells[:width]]
        except ValueError:
            bad = next((cell for cell in cells if cell.strip() and not _NUMBER.fullmatch(cell.strip())), cells[0])
            raise InputError(f"{bad.strip()[:40]!r} is not a number", file=file, line=number) from None
        rows.append(row + [np.nan] * (width - len(row)))
    return np.array(rows, dtype=np.float64)


def _value(cell: str) -> float:
    """A number, or an ISO date-time as seconds since 1970; without a zone it is taken as UTC. ValueError else."""
    try:
        return float(cell.replace(",", "."))
    except ValueError:
        if not _DATE.fullmatch(cell.strip()):
            raise
        at = datetime.fromisoformat(cell.strip().replace(",", "."))
        return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()


def _of_scope(head: Sequence[Sequence[str]], numbers: Array, file: Path) -> list[Channel]:
    properties = {row[0]: row for row in head if len(row) > 1}
    names = next(row for row in reversed(head) if row[0] == "Name")
    units = properties.get("Unit", [])
    channels, times = [], 0
    for j in range(numbers.shape[1]):
        title = names[j] if j < len(names) else ""
        if title == "Name" or j == 0:  # the key again: a group's time
            times = j
            continue
        if not title:
            continue
        used = np.isfinite(numbers[:, times]) & np.isfinite(numbers[:, j])
        unit = units[j] if j < len(units) else ""
        time_s = numbers[used, times] * (1e-7 if numbers[0, times] > FILETIME else 1e-3)
        channels.append(Channel(title, "" if unit in ("(None)", "None") else unit, time_s, numbers[used, j]))
    if not channels:
        raise InputError("holds no channels", file=file)
    return channels


def _of_trend(lines: Sequence[str], file: Path) -> list[Channel]:
    head = next(i for i, line in enumerate(lines) if line.startswith("Header:"))
    names = [name.strip() for name in next(csv.reader([lines[head]]))[3:]]
    rows, times = [], list[float]()
    for number, row in enumerate(csv.reader(lines[head + 1 :]), head + 2):
        if row[:1] != ["Data"]:
            continue
        clock = _CLOCK.fullmatch(row[2].strip()) if len(row) == len(names) + 3 else None
        try:
            rows.append([_value(cell) if cell.strip() else np.nan for cell in row[3:]])
        except ValueError as error:
            raise InputError(f"{error}; expected numbers", file=file, line=number) from error
        if clock is None:
            expected = f"expected Data, a date, a time such as 13:05:00;250 and {len(names)} values"
            raise InputError(f"row has {len(row)} cells, {expected}", file=file, line=number)
        hour = int(clock[1]) % 12 + 12 * (clock[5].upper() == "P") if clock[5] else int(clock[1])
        at = 3600.0 * hour + 60.0 * int(clock[2]) + int(clock[3]) + float(f"0.{clock[4] or 0}")
        days = round((times[-1] - at) / 86400.0) if times else 0
        times.append(at + 86400.0 * days)
    if not rows or not names:
        raise InputError("holds no rows of data", file=file)
    values, time_s = np.array(rows), np.array(times)
    return [Channel(*split_unit(name), time_s, values[:, j]) for j, name in enumerate(names)]


def _of_columns(head: Sequence[Sequence[str]], numbers: Array, file: Path) -> list[Channel]:
    width = numbers.shape[1]
    rows = [row for row in head if len([cell for cell in row if cell]) > 1 and len(row) >= width - 1]
    if not rows:
        raise InputError("has no header: no line before the numbers has as many cells", file=file)
    row = rows[-1]
    under = [""] * width
    if len(rows) > 1 and all(len(cell.strip("[]() ")) <= 6 and "_" not in cell for cell in row):  # units
        under, row = [cell.strip("[]() ") for cell in row], rows[-2]
    titles, units = [], []
    for j in range(width):
        name, unit = split_unit(row[j]) if j < len(row) else ("", "")
        titles.append(name)
        units.append(unit or (under[j] if j < len(under) else ""))
    at = next((j for j, name in enumerate(titles) if _TIME.match(name)), None)
    if at is None:
        time_s = np.full(len(numbers), np.nan)
    else:
        unit = units[at] or titles[at].rpartition("_")[2]  # `t [ms]` or `t_ms`
        time_s = TIME_UNITS.get(unit.lower(), 1.0) * numbers[:, at]
    channels = [
        Channel(name, unit, time_s[np.isfinite(numbers[:, j])], numbers[np.isfinite(numbers[:, j]), j])
        for j, (name, unit) in enumerate(zip(titles, units, strict=True))
        if name and j != at and np.isfinite(numbers[:, j]).any()
    ]
    if not channels:
        raise InputError("holds no columns of numbers", file=file)
    return channels
