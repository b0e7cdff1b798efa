"""Parquet logs: flat columns of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from workbench.errors import InputError
from workbench.logs.table import LogFile, Table, doubled, float_array, row_number
from workbench.run import Array


def open_parquet(file: Path) -> LogFile:
    """Reads the schema. InputError when it is no Parquet file or a name is doubled."""
    import pyarrow as pa
    import pyarrow.parquet

    try:
        # One file, no data set around it: neither its folder's name nor a neighbour can add columns.
        schema = pyarrow.parquet.ParquetFile(file).schema_arrow
    except (pa.ArrowException, OSError, ValueError, MemoryError, OverflowError) as error:
        raise _broken(file, error) from error
    if (name := doubled(schema.names)) is not None:
        raise InputError(f"column '{name}' is doubled", file=file)

    def read(wanted: Sequence[str]) -> Table:
        return Table(file, _read(file, wanted), row_number)

    return LogFile(file, tuple(schema.names), read)


def _read(file: Path, wanted: Sequence[str]) -> dict[str, Array]:
    import pyarrow as pa
    import pyarrow.parquet

    columns: dict[str, Array] = {}
    try:
        log = pyarrow.parquet.ParquetFile(file)
        for name in wanted:
            column = log.read(columns=[name]).column(name)
            if not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type) or _decimal(column.type)):
                raise InputError(f"holds {column.type}, expected numbers", file=file, place=name)
            columns[name] = float_array(column.cast(pa.float64(), safe=False))
    except (pa.ArrowException, OSError, ValueError, KeyError, MemoryError, OverflowError) as error:
        raise _broken(file, error) from error
    return columns


def _decimal(kind: object) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_decimal(kind))


def _broken(file: Path, error: BaseException) -> InputError:
    first = (str(error).splitlines() or [type(error).__name__])[0]
    return InputError(f"is not a readable Parquet file: {first[:200]}", file=file)
