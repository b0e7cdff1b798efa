"""Arrow columns from plain values and back, by way of their buffers.

`pyarrow.array` and `to_numpy` would do, but they import pandas wherever that is installed, which costs a study
a quarter of its two seconds.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.errors import InputError, nearest
from workbench.core.input_file import open_input, read_input, readable_file
from workbench.core.run import Array, float_array
from workbench.metrics import MetricSet, set_with


def numbers(values: Sequence[float | None] | Array) -> Any:
    """A float64 column; None becomes a null."""
    import pyarrow as pa

    if isinstance(values, np.ndarray):
        return pa.Array.from_buffers(
            pa.float64(), len(values), [None, pa.py_buffer(np.ascontiguousarray(values, dtype=np.float64))]
        )
    known = np.array([value is not None for value in values], dtype=bool)
    data = np.array([0.0 if value is None else value for value in values], dtype=np.float64)
    bits = None if known.all() else pa.py_buffer(np.packbits(known, bitorder="little"))
    return pa.Array.from_buffers(pa.float64(), len(data), [bits, pa.py_buffer(data)])


def texts(values: Sequence[str]) -> Any:
    """A string column."""
    import pyarrow as pa

    encoded = [value.encode() for value in values]
    ends = np.cumsum([0, *(len(value) for value in encoded)], dtype=np.int32)
    return pa.StringArray.from_buffers(len(values), pa.py_buffer(ends), pa.py_buffer(b"".join(encoded)))


def arrow_table(columns: Mapping[str, Any]) -> Any:
    """A table of such columns."""
    import pyarrow as pa

    return pa.Table.from_arrays(list(columns.values()), names=list(columns))


def columns_of(table: Any) -> dict[str, Array]:
    """The float64 columns of a table as arrays, by name."""
    return {name: float_array(table[name]) for name in table.column_names}


def parquet_bytes(table: Any, **how: Any) -> bytes:
    """The table as the bytes of a Parquet file; `how` is Arrow's own way of writing it."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    stream = pa.BufferOutputStream()
    pq.write_table(table, stream, **how)
    data: bytes = stream.getvalue().to_pybytes()
    return data


@dataclass(frozen=True)
class Row:
    """What a run was, how it went, its metrics by column name.

    `row["peak_torque_percent"]` is a metric's value, NaN where the run has none; InputError with the nearest
    name for a metric that the row does not have. assigned: what a sweep or a sample has set in this run, by
    the field's place in the scenario.
    """

    run_id: str
    scenario: str
    status: str
    reason: str
    payload_kg: float
    reference: str
    metrics: Mapping[str, float | None]
    assigned: Mapping[str, float | str] = field(default_factory=dict)

    def __getitem__(self, metric: str) -> float:
        try:
            value = self.metrics[metric]
        except KeyError:
            raise InputError(f"no metric '{metric}'; {nearest(metric, self.metrics)}", place=self.run_id) from None
        return float("nan") if value is None else value

    def get(self, metric: str) -> float:
        """A metric's value, NaN where the run or an older version of the program has none."""
        value = self.metrics.get(metric)
        return float("nan") if value is None else value

    @property
    def ok(self) -> bool:
        return self.status == "ok"


def metrics_of(rows: Sequence[Row]) -> MetricSet:
    """The metrics of the kind of machine that the rows are of."""
    return set_with(rows[0].metrics if rows else ())


def with_payload(row: Row) -> bool:
    """Whether the row's machine carries payloads."""
    return metrics_of([row]).payload


MANIFEST = "manifest.json"
HASHED = ("index.parquet", "scenario.yaml", "machine.yaml")


def read_manifest(folder: Path) -> dict[str, Any] | None:
    """What a folder's manifest says; None where there is none, half of one, or one of another form."""
    try:
        said = json.loads(read_input(folder / MANIFEST, "json"))
    except (InputError, ValueError, RecursionError):
        return None
    if not isinstance(said, dict) or not isinstance(said.get("study", ""), str):
        return None
    blocks = (said.get(name) or {} for name in ("runs", "versions", "files", "effects"))
    return said if all(isinstance(block, dict) for block in blocks) else None


def digests(folder: Path) -> dict[str, str]:
    """File -> SHA-256 of those files of a result that a report and a comparison read."""
    return {name: _digest(folder / name) for name in HASHED if (folder / name).is_file()}


def check_whole(folder: Path, name: str) -> None:
    """InputError where a file is not what its manifest says; earlier versions said nothing."""
    said: Mapping[str, Any] = (read_manifest(folder) or {}).get("files") or {}
    file = folder / name
    if name not in said or not file.is_file():
        return
    if _digest(file) != said[name]:
        raise InputError(f"is not what was written, as {MANIFEST} says: the result is damaged", file=file)


def _digest(file: Path) -> str:
    with open_input(file, "table") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


INDEX = "index.parquet"
_OWN = ("run_id", "scenario", "status", "reason", "payload_kg", "reference")
_TEXTS = tuple(name for name in _OWN if name != "payload_kg")
_ALWAYS = ("move_time_s", "min_wire_tension_n", "max_wire_tension_n")  # where the kind of machine has them
_RUN_ID = re.compile(r"[A-Za-z0-9_=+-][A-Za-z0-9._=+-]{0,200}")
MOST_ROWS, MOST_COLUMNS = 1_100_000, 5_000
LARGEST = 1e30  # a loop that runs away is stopped far below
_ASSIGNED = b"assigned"  # the table's note of which columns a sweep or a sample has set


def index_table(rows: Sequence[Row]) -> Any:
    """Rows as an Arrow table: what a run was, what a sweep set, its metrics; the same rows, the same bytes."""
    columns: dict[str, Any] = {}
    for name in _OWN:
        values = [getattr(row, name) for row in rows]
        columns[name] = numbers(values) if name == "payload_kg" else texts(values)
    assigned = [name for name in _names(row.assigned for row in rows) if name not in columns]
    for name in assigned:
        values = [row.assigned.get(name) for row in rows]
        words = any(isinstance(value, str) for value in values)
        columns[name] = texts(["" if value is None else value for value in values]) if words else numbers(values)
    fixed = [metric.name for metric in metrics_of(rows).metrics if metric.fixed]
    for name in _names([dict.fromkeys(fixed), *(row.metrics for row in rows)]):
        columns[name] = numbers([row.metrics.get(name) for row in rows])
    return arrow_table(columns).replace_schema_metadata({_ASSIGNED: json.dumps(assigned)})


def joined(tables: Sequence[Any]) -> Any:
    """The tables of consecutive runs as one. What only some of them measured is empty in the others."""
    import pyarrow as pa

    assigned = list(_names(dict.fromkeys(_assigned_in(table)) for table in tables))
    whole = pa.concat_tables(tables, promote_options="default").combine_chunks()
    measured = [name for name in whole.column_names if name not in {*_OWN, *assigned}]
    return whole.select([*_OWN, *assigned, *measured]).replace_schema_metadata({_ASSIGNED: json.dumps(assigned)})


@contextmanager
def parquet_of(file: Path, unreadable: str) -> Iterator[Any]:
    """The Parquet file, opened. InputError, which begins with `unreadable`, for whatever the parser makes of damage."""
    import pyarrow.parquet as pq

    try:
        # ParquetFile, since read_table imports pandas and the datasets.
        with pq.ParquetFile(readable_file(file, "table")) as opened:
            yield opened
    except InputError:
        raise
    except Exception as error:
        said = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{unreadable}: {said[:200]}", file=file) from error


def read_table(file: Path) -> Any:
    """An index, or a part of one. InputError where it is not there or is damaged."""
    with parquet_of(file, "is no readable index of a study") as index:
        if index.metadata.num_rows > MOST_ROWS or index.metadata.num_columns > MOST_COLUMNS:
            raise InputError("is no index of a study: it has too many rows or columns", file=file)
        table = index.read(use_threads=False)
        table.validate(full=True)
    if missing := [name for name in _OWN if name not in table.column_names]:
        raise InputError(f"is no index of a study: it has no column '{missing[0]}'", file=file)
    if len(set(table.column_names)) < table.num_columns:
        raise InputError("is no index of a study: two columns have one name", file=file)
    return table


def check_folder(folder: Path) -> None:
    """InputError where there is no such folder."""
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "no such folder"
        raise InputError(f"{what}, expected a folder that `workbench study` made", file=folder)


def read_rows(folder: Path) -> list[Row]:
    """The rows of a finished result. InputError where the index is not there, not readable or not as it was written."""
    check_folder(folder)
    file = folder / INDEX
    check_whole(folder, INDEX)
    table = read_table(file)
    try:
        rows = rows_of(table)
    except (ValueError, TypeError) as error:
        raise _damaged("its note of swept fields is not readable", file) from error
    _check_rows(rows, table, file)
    return rows


def _check_rows(rows: Sequence[Row], table: Any, file: Path) -> None:
    """InputError where a column holds what no study writes."""
    for name in table.column_names:
        kind = str(table.schema.field(name).type)
        wanted = ("string",) if name in _TEXTS else ("double", "string") if name in _assigned_in(table) else ("double",)
        if kind not in wanted:
            raise _damaged(f"column '{name}' holds {kind}, expected {' or '.join(wanted)}", file)
    seen: set[str] = set()
    known = metrics_of(rows)
    always = [known.peak, *(name for name in _ALWAYS if name in known.by_name)]
    for row in rows:
        if not (isinstance(row.run_id, str) and _RUN_ID.fullmatch(row.run_id)) or row.run_id in seen:
            raise _damaged(f"run {row.run_id!r:.80} has no name of its own", file)
        seen.add(row.run_id)
        if row.status not in ("ok", "failed") or None in (row.scenario, row.reason, row.reference):
            raise _damaged(f"run {row.run_id} has the status {row.status!r:.80}", file)
        numbers = [("payload_kg", row.payload_kg), *row.metrics.items(), *row.assigned.items()]
        for name, value in numbers:
            if (isinstance(value, float) and not abs(value) <= LARGEST) or (name == "payload_kg" and value is None):
                raise _damaged(f"{name} of run {row.run_id} is {value}", file)
        if lacking := [name for name in always if row.ok and row.metrics.get(name) is None]:
            raise _damaged(f"run {row.run_id} has no {lacking[0]}", file)


def _damaged(what: str, file: Path) -> InputError:
    return InputError(f"{what}: the result is damaged", file=file)


def rows_of(table: Any) -> list[Row]:
    """The rows that an index holds."""
    assigned = _assigned_in(table)
    measured = [name for name in table.column_names if name not in {*_OWN, *assigned}]
    values = {name: table[name].to_pylist() for name in table.column_names}
    return [
        Row(
            **{name: values[name][i] for name in _OWN},
            metrics={name: values[name][i] for name in measured},
            assigned={name: values[name][i] for name in assigned if values[name][i] is not None},
        )
        for i in range(table.num_rows)
    ]


def _names(records: Iterable[Mapping[str, Any]]) -> dict[str, None]:
    """All names, in the order in which they first occur."""
    names: dict[str, None] = {}
    for record in records:
        if record.keys() - names.keys():
            names |= dict.fromkeys(record)
    return names


def _assigned_in(table: Any) -> list[str]:
    """ValueError where the note names what is no column beside a run's own."""
    names = json.loads((table.schema.metadata or {}).get(_ASSIGNED, b"[]"))
    if not isinstance(names, list) or any(name in _OWN or name not in table.column_names for name in names):
        raise ValueError("the note of swept fields names no columns")
    return names


ASTRAY_M = 0.05  # of a hoist
SWINGS_PER_S = 2.0  # of motion, each by more than nominal torque: no motion asks for that, a loop that hunts does
MOST_SWINGS = 10.0  # fewer may come of a single event, such as a wire that tightens with a jerk


def hunts(row: Row) -> bool:
    """Whether the torque swings to and fro as it does in a loop only that is not stable."""
    return (row.metrics.get("torque_swings") or 0.0) > MOST_SWINGS and swings_per_s(row) > SWINGS_PER_S


def swings_per_s(row: Row) -> float:
    """Torque swings a second of motion."""
    return row["torque_swings"] / max(row["move_time_s"], 1.0)


def is_astray(row: Row) -> bool:
    """Whether a run ends where its reference does not."""
    judged = metrics_of([row])
    return abs(row[judged.end]) > judged.astray * (row[judged.window] if judged.window else 1.0)
