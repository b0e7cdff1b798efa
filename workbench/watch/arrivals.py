"""Logs in a folder: which are complete, and what is said of them.

A log is described by its entry in the folder's runs.yaml, or by a file of its own beside it (`cycle_7.csv.yaml` for
`cycle_7.csv`) with `payload_kg`, `start_position_m` and, if it is known, `start_time_s`. `columns` of runs.yaml map
columns to signals for all of them. A log that is not described yet is waited for.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from workbench.core.errors import InputError
from workbench.core.record import Finite, Payload, Position, Record
from workbench.core.run import Run
from workbench.core.yaml_strict import load, validate
from workbench.logs.campaign import Column, read_run, read_runs
from workbench.logs.formats.opening import suffixes
from workbench.logs.raw_run import Entry, Name
from workbench.machines import Axis, Hoist, kind_of


class Beside(Record):
    """The file beside a log."""

    payload_kg: Payload | None = None
    start_position_m: Position | None = None
    start_time_s: Finite | None = None
    name: Name | None = None


@dataclass(frozen=True)
class Arrived:
    """A log that is complete. entry: its description; None: there is none yet, or a wrong one, with its problem."""

    file: Path
    entry: Entry | None
    problem: str = ""

    @property
    def described(self) -> str:
        """Changes when the description does."""
        return self.problem if self.entry is None else self.entry.model_dump_json()


class Arrivals:
    """Looks into a folder again and again. A log is complete when it has not changed for `settle_s`."""

    def __init__(self, folder: Path, machine: Hoist | Axis, settle_s: float) -> None:
        if not folder.is_dir():
            raise InputError("is no folder; expected one that logs come into", file=folder)
        self._folder, self._machine, self._settle_s = folder, machine, settle_s
        self._runs, self._kind = folder / "runs.yaml", kind_of(machine)
        self._seen: dict[Path, tuple[tuple[int, ...], float]] = {}
        self._done: dict[Path, tuple[int, ...]] = {}
        self.columns: Mapping[str, Column] = {}

    def look(self, now: float) -> tuple[list[Arrived], int]:
        """The logs that are complete and not yet `done`, in order of their names; how many still change.

        InputError where runs.yaml is wrong; it may be complete at the next look. What is wrong with the file beside a
        log is that log's problem alone.
        """
        entries: dict[str, Entry] = {}
        if self._runs.is_file():
            described, _ = read_runs(self._runs, self._machine, self._kind.signals.names)
            self.columns = described.columns
            entries = {Path(entry.file).name: entry for entry in described.runs}
        complete, waiting = [], 0
        for file in sorted(self._folder.iterdir()):
            if file.name.startswith(".") or file.suffix.lower() not in suffixes() or not file.is_file():
                continue
            # A log that was set aside for what stands beside it is looked at again when that changes.
            sign = (*_sign(file), *_sign(_beside(file)))
            if not sign or self._done.get(file) == sign:
                continue
            if self._seen.get(file, (None, 0.0))[0] != sign:
                self._seen[file] = sign, now
            if now - self._seen[file][1] < self._settle_s or sign[0] == 0:
                waiting += 1
                continue
            try:
                complete.append(Arrived(file, entries.get(file.name) or self._described(file)))
            except InputError as error:
                complete.append(Arrived(file, None, str(error)))
        return complete, waiting

    def done(self, file: Path) -> None:
        """Not to be looked at again unless it changes."""
        self._done[file] = self._seen[file][0]

    def _described(self, file: Path) -> Entry | None:
        """By the file beside it; None where there is none and one is needed."""
        kind, beside = self._kind, _beside(file)
        if not beside.is_file():
            return entry_of(file, file.stem) if not kind.payload and kind.start is None else None
        said = validate(Beside, load(beside))
        if kind.payload and said.payload_kg is None:
            raise InputError("needs payload_kg, in kg and at least 0", file=beside, place="payload_kg")
        if kind.start is not None and said.start_position_m is None:
            raise InputError(f"needs start_position_m, {kind.start.said}", file=beside, place="start_position_m")
        return entry_of(file, said.name or file.stem, **said.model_dump(exclude={"name"}))

    def read(self, arrived: Arrived) -> Run:
        """The log, checked and repaired as a campaign's. InputError for what is wrong with it."""
        assert arrived.entry is not None
        machine = self._machine
        (run,), _ = read_run(arrived.entry, arrived.file, machine, self.columns, None, self._runs, whole=True)
        return run


def _beside(file: Path) -> Path:
    return file.with_name(f"{file.name}.yaml")


def _sign(file: Path) -> tuple[int, ...]:
    """Changes when a file does; () where it is gone."""
    with contextlib.suppress(OSError):
        state = file.stat()
        return state.st_size, state.st_mtime_ns
    return ()


def entry_of(file: Path, name: str, **said: float | None) -> Entry:
    """InputError for what no entry of runs.yaml may be: a file's name may hold any sign."""
    try:
        return Entry.model_validate({"name": name, "file": file.name, **said})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        reason = f"cannot be a run's: {first['input']!r:.60}, {first['msg']}"
        raise InputError(reason, file=file, place=".".join(map(str, first["loc"]))) from error
