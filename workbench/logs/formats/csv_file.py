"""CSV logs: comma-separated, one header row, decimal points, UTF-8."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from workbench.core.errors import InputError
from workbench.core.run import Array, float_array
from workbench.logs.formats.declared import LogFormat, Opened

MISSING = ["", "nan", "NaN", "NAN", "NA", "n/a", "null", "NULL", "None", "-nan", "#N/A"]
_HEADER_BYTES = 1_000_000
_BLOCK_BYTES = 4_000_000
_NUMBER = re.compile(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*")
_DECIMAL_COMMA = re.compile(r"\d,\d")


def open_csv(file: Path) -> Opened:
    """Reads the header. InputError when there is none, a name is doubled, or commas do not separate it."""
    with file.open("rb") as stream:
        start = stream.read(_HEADER_BYTES)
    if not start:
        raise InputError("is empty")
    if b"\0" in start:
        raise InputError("holds binary data; expected comma-separated text in UTF-8")
    lines = [line for line in start.removeprefix(b"\xef\xbb\xbf").splitlines()[:20] if line.strip()]
    if not lines:
        raise InputError("is empty")
    try:
        header, sample = lines[0].decode("utf-8"), b"\n".join(lines[1:3]).decode("utf-8", errors="replace")
    except UnicodeDecodeError as error:
        raise InputError("header is not UTF-8 text", line=1) from error
    raw = _header_names(header, sample)
    names = [name.strip() for name in raw]
    return Opened(names, lambda wanted, limits: _pieces(file, raw, [raw[names.index(name)] for name in wanted]))


def _header_names(header: str, sample: str) -> list[str]:
    for mark, name in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars")):
        if mark in header and "," not in header:
            comma = " and decimal points" if _DECIMAL_COMMA.search(sample) else ""
            raise InputError(f"columns are separated by {name}; expected commas{comma}", line=1)
    try:
        raw = next(csv.reader([header], strict=True))
    except csv.Error as error:
        raise InputError(f"header cannot be split: {error}", line=1) from error
    names = [name.strip() for name in raw]
    if all(_NUMBER.fullmatch(name) for name in names):
        raise InputError(f"has no header: the first row is numbers ({names[0]}, …)", line=1)
    if names.count("") > 1:
        raise InputError("two columns have no name", line=1)
    return raw


def _pieces(file: Path, raw: Sequence[str], wanted: Sequence[str]) -> Iterator[tuple[int, Array]]:
    import pyarrow as pa
    import pyarrow.csv

    if _is_header_only(file):  # the fast reader takes that for a fault
        return
    options = pyarrow.csv.ConvertOptions(
        include_columns=list(wanted),
        column_types={name: pa.float64() for name in wanted},
        null_values=MISSING,
        check_utf8=False,
    )
    blocks = pyarrow.csv.ReadOptions(block_size=_BLOCK_BYTES)
    try:
        # Block by block: what the rows come to is known before the next ones are read.
        for batch in pyarrow.csv.open_csv(file, read_options=blocks, convert_options=options):
            for index, column in enumerate(batch.columns):
                yield index, float_array(column)
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        raise _located(file, raw, wanted, error) from error


def _is_header_only(file: Path) -> bool:
    try:
        return next(_records(file), None) is None
    except (UnicodeDecodeError, csv.Error):
        return False


def _located(file: Path, raw: Sequence[str], wanted: Sequence[str], error: Exception) -> InputError:
    """The place of the fault, by a slow second reading up to the first row that does not fit."""
    places = [list(raw).index(name) for name in wanted]
    try:
        for line, fields in _records(file):
            if len(fields) != len(raw):
                comma = "; are there decimal commas?" if len(fields) > len(raw) else "; is the file cut off?"
                hint = comma if len(fields) >= 2 * len(raw) - 1 or len(fields) < len(raw) else ""
                return InputError(f"row has {len(fields)} fields, the header {len(raw)} columns{hint}", line=line)
            for at in places:
                text = fields[at].strip()
                if text not in MISSING and not _is_number(text):
                    return InputError(f"{text[:40]!r} is not a number{_hint(text)}", line=line, place=raw[at].strip())
    except UnicodeDecodeError as fault:
        return InputError(f"byte 0x{fault.object[fault.start]:02x} is not UTF-8 text")
    except csv.Error as fault:
        return InputError(f"is not comma-separated text: {fault}")
    first = (str(error).splitlines() or [type(error).__name__])[0]
    return InputError(f"is not comma-separated text: {first[:200]}")


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


def line_of(file: Path, row: int) -> str:
    """The line number of a data row; blank lines make it differ from row + 2."""
    try:
        for number, (line, _) in enumerate(_records(file)):
            if number == row:
                return f"line {line}"
    except (UnicodeDecodeError, csv.Error):
        pass  # a column nobody asked for may hold what this slow reader refuses
    return f"row {row + 1}"


CSV = LogFormat(
    name="CSV",
    suffixes=(".csv",),
    open=open_csv,
    about=(
        "UTF-8, one header row, commas between columns, decimal points. An empty cell, `nan`, `NA` or `null` is a "
        "missing sample. Semicolons, tabs, decimal commas, a row of units and compressed files are refused by name."
    ),
    isolated=False,
    imports=("pyarrow.csv",),
    row_name=line_of,
)
