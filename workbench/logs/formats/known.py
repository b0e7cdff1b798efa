"""The log formats that are read."""

from __future__ import annotations

from pathlib import Path

from workbench.core.errors import InputError
from workbench.logs.formats.csv_file import CSV
from workbench.logs.formats.declared import LogFormat
from workbench.logs.formats.mat_file import MAT
from workbench.logs.formats.mdf_file import MDF
from workbench.logs.formats.parquet_file import PARQUET
from workbench.logs.formats.tdms_file import TDMS

FORMATS: list[LogFormat] = [CSV, PARQUET, MAT, MDF, TDMS]

# What people also keep logs in. It is not read, and the error says what it is.
_NOT_YET = {
    ".dat": "MDF3", ".xlsx": "Excel", ".xls": "Excel", ".gz": "gzip",
    ".zip": "zip", ".h5": "HDF5", ".hdf5": "HDF5", ".feather": "Feather",
}  # fmt: skip


def formats() -> tuple[LogFormat, ...]:
    return tuple(FORMATS)


def suffixes() -> tuple[str, ...]:
    """The endings of all log files that are read, such as ".csv"."""
    return tuple(suffix for log_format in FORMATS for suffix in log_format.suffixes)


def listed(word: str = "or") -> str:
    """The first ending of each format as a sentence has them: ".csv, .parquet or .mat"."""
    first = [log_format.suffixes[0] for log_format in FORMATS]
    return f" {word} ".join([", ".join(first[:-1]), first[-1]]) if len(first) > 1 else first[0]


def format_of(file: Path) -> LogFormat:
    """The format of a file by its ending. InputError for one that is not read."""
    suffix = file.suffix.lower()
    for log_format in FORMATS:
        if suffix in log_format.suffixes:
            return log_format
    what = f"{_NOT_YET[suffix]} files are" if suffix in _NOT_YET else f"a file that ends in '{suffix}' is"
    raise InputError(f"{what} not read by this version; save the log as {listed()}", file=file)
