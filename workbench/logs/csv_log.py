"""CSV logs: comma-separated, one header row, decimal points, UTF-8."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.logs.table import LogFile, Table, doubled, float_array
from workbench.run import Array

MISSING = ["", "nan", "NaN", "NAN", "NA", "n/a", "null", "NULL", "None", "-nan", "#N/A"]
_HEADER_BYTES = 1_000_000
_NUMBER = re.compile(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*")
_DECIMAL_COMMA = re.compile(r"\d,\d")


def open_csv(file: Path) -> LogFile:
    """Reads the header. InputError when there is none, a name is doubled, or commas do not separate it."""
    with file.open("rb") as stream:
        start = stream.read(_HEADER_BYTES)
    if not start:
        raise InputError("is empty", file=file)
    if b"\0" in start:
        raise InputError("holds binary data; expected comma-separated text in UTF-8", file=file)
    lines = [line for line in start.removeprefix(b"\xef\xbb\xbf").splitlines()[:20] if line.strip()]
    if not lines:
        raise InputError("is empty", file=file)
    try:
        header, sample = lines[0].decode("utf-8"), b"\n".join(lines[1:3]).decode("utf-8", errors="replace")
    except UnicodeDecodeError as error:
        raise InputError("header is not UTF-8 text", file=file, line=1) from error
    raw = _header_names(file, header, sample)
    names = [name.strip() for name in raw]

    def read(wanted: Sequence[str]) -> Table:
        columns = _read(file, raw, [raw[names.index(name)] for name in wanted])
        return Table(file, dict(zip(wanted, columns, strict=True)), lambda row: _line_of(file, row))

    return LogFile(file, tuple(names), read)


def _header_names(file: Path, header: str, sample: str) -> list[str]:
    for mark, name in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars")):
        if mark in header and "," not in header:
            comma = " and decimal points" if _DECIMAL_COMMA.search(sample) else ""
            raise InputError(f"columns are separated by {name}; expected commas{comma}", file=file, line=1)
    try:
        raw = next(csv.reader([header], strict=True))
    except csv.Error as error:
        raise InputError(f"header cannot be split: {error}", file=file, line=1) from error
    names = [name.strip() for name in raw]
    if all(_NUMBER.fullmatch(name) for name in names):
        raise InputError(f"has no header: the first row is numbers ({names[0]}, …)", file=file, line=1)
    if (twice := doubled(names)) is not None:
        what = f"column '{twice}' is doubled" if twice else "two columns have no name"
        raise InputError(what, file=file, line=1)
    return raw


def _read(file: Path, raw: Sequence[str], wanted: Sequence[str]) -> list[Array]:
    import pyarrow as pa
    import pyarrow.csv

    options = pyarrow.csv.ConvertOptions(
        include_columns=list(wanted),
        column_types={name: pa.float64() for name in wanted},
        null_values=MISSING,
        check_utf8=False,
    )
    if _is_header_only(file):  # the fast reader takes that for a fault
        return [np.empty(0) for _ in wanted]
    try:
        table = pyarrow.csv.read_csv(file, convert_options=options)
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        raise _located(file, raw, wanted, error) from error
    columns = []
    for name in wanted:  # column by column, so that Arrow's copy and ours overlap by one column only
        columns.append(float_array(table[name]))
        table = table.drop_columns(name)
    return columns


def _is_header_only(file: Path) -> bool:
    try:
        return next(_records(file), None) is None
    except (UnicodeDecodeError, csv.Error):
        return False


def _located(file: Path, raw: Sequence[str], wanted: Sequence[str], error: Exception) -> InputError:
    """Where the fault is: reads again, slowly, up to the first row that does not fit."""
    places = [list(raw).index(name) for name in wanted]
    try:
        for line, fields in _records(file):
            if len(fields) != len(raw):
                comma = "; are there decimal commas?" if len(fields) > len(raw) else "; is the file cut off?"
                hint = comma if len(fields) >= 2 * len(raw) - 1 or len(fields) < len(raw) else ""
                return InputError(
                    f"row has {len(fields)} fields, the header {len(raw)} columns{hint}", file=file, line=line
                )
            for place in places:
                text = fields[place].strip()
                if text not in MISSING and not _is_number(text):
                    return InputError(
                        f"{text[:40]!r} is not a number{_hint(text)}", file=file, line=line, place=raw[place].strip()
                    )
    except UnicodeDecodeError as fault:
        return InputError(f"byte 0x{fault.object[fault.start]:02x} is not UTF-8 text", file=file)
    except csv.Error as fault:
        return InputError(f"is not comma-separated text: {fault}", file=file)
    first = (str(error).splitlines() or [type(error).__name__])[0]
    return InputError(f"is not comma-separated text: {first[:200]}", file=file)


def _is_number(text: str) -> bool:
    return _NUMBER.fullmatch(text) is not None or text.lower().lstrip("+-") in ("inf", "infinity", "nan")


def _hint(text: str) -> str:
    if re.fullmatch(r"[-+]?\d+,\d+", text):
        return "; write decimal points"
    return "; put the unit into the column's name" if re.match(r"[-+]?\d[\d.]*\s*[a-zA-Z]", text) else ""


def _records(file: Path) -> Iterator[tuple[int, list[str]]]:
    """(line, fields) of each data row; blank lines are skipped, as the fast reader does."""
    with file.open(encoding="utf-8-sig", newline="") as stream:
        rows = csv.reader(stream)
        header = False
        for fields in rows:
            if not fields:
                continue
            if header:
                yield rows.line_num, fields
            header = True


def _line_of(file: Path, row: int) -> str:
    """The line a data row stands on; blank lines make it differ from row + 2."""
    try:
        for number, (line, _) in enumerate(_records(file)):
            if number == row:
                return f"line {line}"
    except (UnicodeDecodeError, csv.Error):
        pass  # a column nobody asked for may hold what this slow reader refuses
    return f"row {row + 1}"
