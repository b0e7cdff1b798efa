"""A campaign of imported logs: each as Parquet over one time, and runs.yaml with the mapping."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.imports.propose import Proposal, Proposed
from workbench.kinds import TIME
from workbench.log_formats.rates import Channel, at_times, distinct, fastest, titled
from workbench.logs import Campaign, read_campaign
from workbench.run import Array
from workbench.whole_folder import check_free, whole_folder
from workbench.yaml_strict import dumps


@dataclass(frozen=True)
class Imported:
    """One file with what is said of its run."""

    file: Path
    channels: tuple[Channel, ...]
    payload_kg: float | None = None
    start_position_m: float | None = None

    @property
    def name(self) -> str:
        return self.file.stem

    def columns(self) -> dict[str, Array]:
        """All channels by title, at the times of the fastest; `time_s` counts from its first sample."""
        time_s = fastest(self.channels)
        titles = distinct([titled(channel.name, channel.unit) for channel in self.channels])
        columns = {title: at_times(c, time_s) for title, c in zip(titles, self.channels, strict=True)}
        return {TIME: time_s - time_s[0], **columns}


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
        if log.start_position_m is not None:
            entry["start_position_m"] = float(log.start_position_m)
        runs.append(entry)
    return dumps({"columns": columns, "runs": runs})


def _write_parquet(columns: dict[str, Array], file: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet

    arrays = {name: pa.array(values, mask=np.isnan(values)) for name, values in columns.items()}
    pyarrow.parquet.write_table(pa.table(arrays), file)
