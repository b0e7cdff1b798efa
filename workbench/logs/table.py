"""A log file as columns of numbers, whatever its format."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workbench.errors import InputError
from workbench.run import Array

if TYPE_CHECKING:
    import pyarrow

NOT_YET = {
    ".mf4": "MDF4", ".mdf": "MDF4", ".dat": "MDF4", ".tdms": "TDMS", ".xlsx": "Excel", ".xls": "Excel", ".gz": "gzip",
    ".zip": "zip", ".h5": "HDF5", ".hdf5": "HDF5", ".feather": "Feather",
}  # fmt: skip


@dataclass(frozen=True)
class Table:
    """The columns asked for, each (n,) float64 with NaN for an empty cell, and where each row stands in the file.

    `row_name(i)` names data row i (from 0) as the user finds it: "line 12" or "row 11".
    """

    file: Path
    columns: Mapping[str, Array]
    row_name: Callable[[int], str]


@dataclass(frozen=True)
class LogFile:
    """A log that is open for choice: its column names, and a reader for those one wants."""

    file: Path
    names: tuple[str, ...]
    read: Callable[[Sequence[str]], Table]


def open_log(file: Path) -> LogFile:
    """Looks into a log file without reading its samples. InputError for a format that is not read."""
    suffix = file.suffix.lower()
    if suffix == ".csv":
        from workbench.logs.csv_log import open_csv

        return open_csv(file)
    if suffix in (".parquet", ".pq"):
        from workbench.logs.parquet_log import open_parquet

        return open_parquet(file)
    if suffix == ".mat":
        from workbench.logs.mat_log import open_mat

        return open_mat(file)
    what = f"{NOT_YET[suffix]} files are" if suffix in NOT_YET else f"a file that ends in '{suffix}' is"
    raise InputError(f"{what} not read by this version; save the log as .csv, .parquet or .mat", file=file)


def float_array(column: pyarrow.ChunkedArray) -> Array:
    """An Arrow column of float64 as our own array, null as NaN. Arrow's to_numpy would load pandas."""
    if column.null_count:
        column = column.fill_null(float("nan"))
    chunks = [np.from_dlpack(chunk) for chunk in column.chunks if len(chunk)]
    return np.concatenate(chunks) if chunks else np.empty(0)


def row_number(row: int) -> str:
    return f"row {row + 1}"


def doubled(names: Sequence[str]) -> str | None:
    """The first name that occurs twice."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None
