"""The log formats that are read, each declared in its module of this folder, and the docs' section on them."""

from __future__ import annotations

import importlib
import pkgutil
import textwrap
from pathlib import Path

import workbench.logs.formats as folder
from workbench.core.errors import InputError
from workbench.logs.formats.declared import MB, Limits, LogFormat

# Every LogFormat of a module NAME_file.py; CSV, which needs no extra, is named first.
FORMATS: list[LogFormat] = [
    declared
    for module in sorted(module.name for module in pkgutil.iter_modules(folder.__path__) if "_file" in module.name)
    for declared in vars(importlib.import_module(f"{folder.__name__}.{module}")).values()
    if isinstance(declared, LogFormat)
]
# What people also keep logs in. It is not read, and the error says what it is.
_NOT_YET = {
    ".dat": "MDF3", ".xlsx": "Excel", ".xls": "Excel", ".gz": "gzip",
    ".zip": "zip", ".h5": "HDF5", ".hdf5": "HDF5", ".feather": "Feather",
}  # fmt: skip


def suffixes() -> tuple[str, ...]:
    """The endings of all log files that are read, such as ".csv"."""
    return tuple(suffix for log_format in FORMATS for suffix in log_format.suffixes)


def listed() -> str:
    """The first ending of each format as a sentence has them: ".csv, .mat or .parquet"."""
    first = [log_format.suffixes[0] for log_format in FORMATS]
    return " or ".join([", ".join(first[:-1]), first[-1]])


def format_of(file: Path) -> LogFormat:
    """The format of a file by its ending. InputError for one that is not read."""
    suffix = file.suffix.lower()
    for log_format in FORMATS:
        if suffix in log_format.suffixes:
            return log_format
    what = f"{_NOT_YET[suffix]} files are" if suffix in _NOT_YET else f"a file that ends in '{suffix}' is"
    raise InputError(f"{what} not read by this version; save the log as {listed()}", file=file)


def section() -> str:
    """The formats with their endings and properties, and the limits, for the documentation."""
    lines = []
    for one in FORMATS:
        text = f"- **{one.name}** ({', '.join(f'`{suffix}`' for suffix in one.suffixes)}): {one.about}"
        lines.append(textwrap.fill(text, 116, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False))
    lines += ["", "Limits of one log, counted in what is produced from it:", ""]
    lines += ["| format | whose | rows | unpacked | processor time | memory of the reader | read in |"]
    lines += ["|---|---|---|---|---|---|---|"]
    for one in FORMATS:
        own = "a worker" if one.isolated else "this process"
        lines.append(f"| {one.name} | your own | {_cells(one.own)} | {own} |")
        lines.append(f"| {one.name} | uploaded | {_cells(one.uploaded)} | a worker |")
    return "\n".join(lines) + "\n"


def _cells(limits: Limits) -> str:
    memory = limits.memory_bytes / MB
    return f"{limits.rows / MB:g} million | {limits.bytes / MB:g} MB | {limits.seconds:g} s | {memory:g} MB"
