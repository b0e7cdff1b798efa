"""Parquet logs: flat columns of numbers; Arrow's columns as our own arrays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from workbench.core.errors import InputError
from workbench.core.run import Array, float_array
from workbench.logs.formats.declared import Limits, LogFormat, Opened

_ROWS = 65_536  # of a batch


def open_parquet(file: Path) -> Opened:
    """Reads the schema. InputError for an empty file; anything where it is no Parquet file."""
    import pyarrow.parquet

    if not file.stat().st_size:
        raise InputError("is empty")
    # One file, no data set around it: neither its folder's name nor a neighbour can add columns.
    log = pyarrow.parquet.ParquetFile(file)
    return Opened(log.schema_arrow.names, lambda wanted, limits: _pieces(log, wanted, limits))


def _pieces(log: Any, wanted: Sequence[str], limits: Limits) -> Iterator[tuple[int, Array]]:
    """Batch by batch. The footer is believed where it says too much; what it says too little of is counted."""
    import pyarrow as pa

    for group in map(log.metadata.row_group, range(log.metadata.num_row_groups)):
        for column in map(group.column, range(group.num_columns)):
            if column.file_path:
                problem = "keeps its samples in another file; expected them in the file itself"
                raise InputError(problem, place=column.path_in_schema)
    rows = int(log.metadata.num_rows)
    limits.check(rows, rows * len(wanted))
    for index, name in enumerate(wanted):
        kind = log.schema_arrow.field(name).type
        if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)):
            raise InputError(f"holds {kind}, expected numbers", place=name)
        for batch in log.iter_batches(batch_size=_ROWS, columns=[name], use_threads=False):
            yield index, float_array(batch.column(0))


PARQUET = LogFormat(
    name="Parquet",
    suffixes=(".parquet", ".pq"),
    open=open_parquet,
    about="flat columns of numbers; null is a missing sample.",
    imports=("pyarrow.parquet",),
)
