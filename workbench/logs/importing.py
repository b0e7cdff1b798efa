"""A campaign of imported logs: each as Parquet over one time, and runs.yaml with the mapping."""

from __future__ import annotations

import csv
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.errors import InputError, nearest
from workbench.core.input_file import read_input
from workbench.core.run import Array
from workbench.core.whole_folder import check_free, whole_folder
from workbench.core.yaml_strict import dumps
from workbench.logs import Campaign, read_campaign
from workbench.logs.formats.declared import TIME, Channel, at_times, distinct, fastest, titled
from workbench.logs.formats.drive_csv import TIME_UNITS, read_drive_csv, split_unit
from workbench.logs.formats.opening import open_log
from workbench.logs.mapping import Proposal, Proposed

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
    time_s = TIME_UNITS.get(titles[times[0]][1].lower(), 1.0) * table[times[0]]
    return [Channel(plain, unit, time_s, table[name]) for name, (plain, unit) in titles.items() if name != times[0]]


@dataclass(frozen=True)
class Imported:
    """One file with what is said of its run."""

    file: Path
    channels: tuple[Channel, ...]
    payload_kg: float | None = None
    start_position_m: float | None = None
    start_time_s: float | None = None

    @property
    def name(self) -> str:
        return self.file.stem

    def columns(self) -> dict[str, Array]:
        """All channels by title, at the times of the fastest; `time_s` counts from its first sample."""
        time_s = fastest(self.channels)
        titles = distinct([titled(channel.name, channel.unit) for channel in self.channels])
        columns = {title: at_times(c, time_s) for title, c in zip(titles, self.channels, strict=True)}
        return {TIME: time_s - time_s[0], **columns}


SAID = ("payload_kg", "start_position_m", "start_time_s")


def with_table(logs: Sequence[Imported], file: Path) -> list[Imported]:
    """The logs with what a table says of each: a row a file, by its name with or without ending; empty cells say
    nothing. InputError names the line."""
    text = read_input(file, "settings").decode("utf-8-sig", errors="replace")
    rows = csv.DictReader(text.splitlines(), restkey="beyond the header")
    columns = [name.strip() for name in rows.fieldnames or ()]
    rows.fieldnames = columns
    if odd := [name for name in columns if name not in ("file", *SAID)] or (["file"] if "file" not in columns else []):
        raise InputError(f"column '{odd[0]}', expected file and any of {', '.join(SAID)}", file=file, line=1)
    said: dict[str, dict[str, Any]] = {}
    names = {name for log in logs for name in (log.file.name, log.name)}
    for row in rows:
        name = Path(row["file"] or "").name
        if name not in names:
            raise InputError(f"no log '{name}' is imported; {nearest(name, names)}", file=file, line=rows.line_num)
        try:
            said[Path(name).stem] = {key: float(row[key]) for key in SAID if (row.get(key) or "").strip()}
        except ValueError as error:
            raise InputError(f"{error}; expected numbers", file=file, line=rows.line_num) from error
    return [replace(log, **said.get(log.name, {})) for log in logs]


def in_si(proposal: Proposal, imported: Imported) -> tuple[Array, Array]:
    """Times (n,), s, and values (n,), SI, of a proposed signal at its own samples."""
    channel = next(c for c in imported.channels if c.name == proposal.column)
    return channel.time_s - fastest(imported.channels)[0], proposal.factor * channel.values


def write_campaign(machine: Path, logs: Sequence[Imported], proposed: Proposed, folder: Path) -> Campaign:
    """Writes the folder whole or not at all, and returns it as it is read back. InputError where it cannot be read as a
    campaign: then nothing is written."""
    names = [log.name for log in logs]
    if len(set(names)) < len(names):
        raise InputError(f"two files are called {next(n for n in names if names.count(n) > 1)}; rename one")
    check_free(folder)
    with whole_folder(folder) as hidden:
        (hidden / "runs").mkdir()
        shutil.copyfile(machine, hidden / "machine.yaml")
        for log in logs:
            _write_parquet(log.columns(), hidden / "runs" / f"{log.name}.parquet")
        (hidden / "runs.yaml").write_text(runs_yaml(logs, proposed), encoding="utf-8")
        try:
            campaign = read_campaign(hidden)
        except InputError as error:
            place = error.place or (Path(error.file).name if error.file else None)
            raise InputError(
                f"{error.problem} (the imported logs cannot be read as a campaign)", place=place
            ) from error
    return campaign


def runs_yaml(logs: Sequence[Imported], proposed: Proposed) -> str:
    """The text of runs.yaml."""
    columns: dict[str, object] = {TIME: TIME}
    for p in proposed.proposals:
        title = titled(p.column, p.unit)
        columns[p.signal] = title if p.factor == 1.0 else {"column": title, "scale": float(p.factor)}
    runs = []
    for log in logs:
        entry: dict[str, object] = {"name": log.name, "file": f"runs/{log.name}.parquet"}
        if log.payload_kg is not None:
            entry["payload_kg"] = float(log.payload_kg)
        for key in SAID[1:]:
            if (value := getattr(log, key)) is not None:
                entry[key] = float(value)
        runs.append(entry)
    return dumps({"columns": columns, "runs": runs})


def _write_parquet(columns: dict[str, Array], file: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet

    arrays = {name: pa.array(values, mask=np.isnan(values)) for name, values in columns.items()}
    pyarrow.parquet.write_table(pa.table(arrays), file)
