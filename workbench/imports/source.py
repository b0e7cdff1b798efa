"""The channels of a log file, whatever its format, each with its unit and its own time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.log_formats.drive_csv import TIME_UNITS, read_drive_csv, split_unit
from workbench.log_formats.opening import open_log
from workbench.log_formats.rates import TIME, Channel

TEXT = (".csv", ".txt", ".tsv", ".asc")
_TIMES = ("time", "t", "zeit", "timestamp", TIME)


def read_channels(file: Path) -> list[Channel]:
    """InputError for a file that is not there, not read, or holds no channels over a time."""
    channels = read_drive_csv(file) if file.suffix.lower() in TEXT else _by_format(file)
    if any(len(channel.time_s) and np.isnan(channel.time_s).all() for channel in channels):
        raise InputError(f"no column is a time; expected one named {', '.join(_TIMES)}", file=file)
    return channels


def _by_format(file: Path) -> list[Channel]:
    with open_log(file) as log:
        table = log.read(log.names)
    titles = {name: split_unit(name) for name in log.names}
    times = [name for name, (plain, _) in titles.items() if plain.lower() in _TIMES]
    if not times:
        raise InputError(f"no column is a time; expected one named {', '.join(_TIMES)}", file=file)
    time_s = TIME_UNITS.get(titles[times[0]][1].lower(), 1.0) * table.columns[times[0]]
    return [
        Channel(plain, unit, time_s, table.columns[name]) for name, (plain, unit) in titles.items() if name != times[0]
    ]
