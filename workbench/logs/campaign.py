"""A campaign folder: machine.yaml, runs.yaml and the logs, read into one record."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.core.errors import InputError, nearest
from workbench.core.run import Run
from workbench.core.shown import Shown
from workbench.core.yaml_strict import Document
from workbench.logs.formats.opening import expect
from workbench.logs.reading import read_run
from workbench.logs.runs_file import Entry, read_runs
from workbench.machines import Axis, Hoist, kind_of, load_machine
from workbench.machines.files import CheckEffects


@dataclass(frozen=True, repr=False)
class Campaign(Shown):
    """Measured runs of one machine. `notes` concern the campaign; each run carries its own.

    doubts: that a run is what runs.yaml says, from physics and the other runs; see `doubts.py`. Commands look for them.
    """

    name: str
    path: Path
    machine: Hoist | Axis
    runs: tuple[Run, ...]
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def run(self, name: str) -> Run:
        """The run of that name; InputError with the nearest one when there is none."""
        for run in self.runs:
            if run.name == name:
                return run
        names = [run.name for run in self.runs]
        raise InputError(f"no run '{name}'; {nearest(name, names)}", file=self.path / "runs.yaml")

    @property
    def all_notes(self) -> tuple[str, ...]:
        """What is doubtful, the campaign's notes, then each run's under the run's name."""
        return (*self.doubts, *self.notes, *(f"{run.name}: {note}" for run in self.runs for note in run.notes))


def read_campaign(
    path: str | os.PathLike[str],
    *,
    select: Sequence[str] | str | None = None,
    confined: bool = False,
    uploaded: bool = False,
    check_effects: CheckEffects | None = None,
) -> Campaign:
    """Reads a campaign from its folder, or from its runs.yaml.

    select: names of the runs to read, as a sequence or separated by commas; all when None.
    confined: refuse logs outside the folder (for campaigns that strangers upload).
    uploaded: a stranger sent the logs: they are parsed apart from this process and may take less, see docs/formats.md.
    check_effects: see `load_machine`.
    InputError for everything that is wrong with the files, one line, naming file and place.
    """
    folder, runs_yaml = _places(path)
    machine = load_machine(folder / "machine.yaml", check_effects=check_effects)
    runs_file, document = read_runs(runs_yaml, machine, kind_of(machine).signals.names)
    entries = _selected(runs_file.runs, select, runs_yaml)
    expect((folder / entry.file for entry in entries), uploaded=uploaded)
    notes = _entry_notes(entries, folder)
    runs: list[Run] = []
    ignored: dict[str, list[str]] = {}
    faults: dict[str, InputError] = {}
    chosen = {entry.name for entry in entries}
    for index, entry in enumerate(runs_file.runs):
        if entry.name not in chosen:
            continue
        place = ("runs", index, "file")
        try:
            file = _log_path(folder, entry, document, place, confined=confined)
            read, unused = read_run(
                entry, file, machine, runs_file.columns, document.line(place), runs_yaml, uploaded=uploaded
            )
        except InputError as error:
            faults[entry.name] = error
            continue
        for column in unused:
            ignored.setdefault(column, []).append(entry.name)
        runs += read
    if faults:
        raise RunsError([*faults.values()], [entry.name for entry in entries if entry.name not in faults])
    if len({run.name for run in runs}) < len(runs):
        raise InputError("a run has the name of a stretch of another one, such as 'lift_2'; rename it", file=runs_yaml)
    notes += _ignored_notes(ignored, len(runs)) + _same_samples(runs)
    return Campaign(folder.resolve().name, folder, machine, tuple(runs), tuple(notes))


class RunsError(InputError):
    """The faults of all runs that cannot be read, in one line. sound: the runs that can be read without them."""

    def __init__(self, faults: Sequence[InputError], sound: Sequence[str]) -> None:
        first, *others = faults
        problem = "; ".join([first.problem, *map(str, others)])
        super().__init__(problem, file=first.file, line=first.line, place=first.place)
        self.sound = tuple(sound)


def _places(path: str | os.PathLike[str]) -> tuple[Path, Path]:
    """The campaign's folder and its list of runs."""
    given = Path(path)
    try:
        if given.is_dir():
            return given, given / "runs.yaml"
        if given.is_file() and given.name == "machine.yaml":
            raise InputError("is a machine; expected a campaign's folder or its runs.yaml", file=given)
        if given.is_file() and given.suffix.lower() not in (".yaml", ".yml"):
            raise InputError("is a file; expected a campaign's folder or its runs.yaml", file=given)
        if given.is_file():
            return given.parent, given
        others = sorted(entry.name for entry in given.parent.iterdir()) if given.parent.is_dir() else []
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {error}", file=repr(str(given))) from error
    hint = f"; {nearest(given.name, others[:50])}" if others else ""
    raise InputError(f"no such campaign{hint}", file=given)


def _selected(entries: Sequence[Entry], select: Sequence[str] | str | None, file: Path) -> list[Entry]:
    if select is None:
        return list(entries)
    names = [name.strip() for name in select.split(",")] if isinstance(select, str) else list(select)
    known = [entry.name for entry in entries]
    for name in names:
        if name not in known:
            raise InputError(f"no run '{name}'; {nearest(name, known)}", file=file)
    if not names:
        raise InputError("no run is selected", file=file)
    return [entry for entry in entries if entry.name in names]


def _log_path(folder: Path, entry: Entry, document: Document, place: tuple[str | int, ...], *, confined: bool) -> Path:
    file = folder / entry.file
    if confined:
        try:
            inside = file.resolve().is_relative_to(folder.resolve())
        except (OSError, ValueError):
            inside = False
        if not inside:
            line = document.line(place)
            raise InputError(
                f"'{entry.file}' lies outside the campaign's folder", file=document.file, line=line, place=entry.name
            )
    return file


def _entry_notes(entries: Sequence[Entry], folder: Path) -> list[str]:
    """The same file under two names; runs that do not say when they began."""
    notes = []
    first: dict[str, str] = {}
    for entry in entries:
        file = os.path.normpath(folder / entry.file)
        if file in first:
            notes.append(f"runs '{first[file]}' and '{entry.name}' are the same file, {entry.file}")
        first.setdefault(file, entry.name)
    silent = [entry.name for entry in entries if entry.start_time_s is None]
    if silent and len(entries) > 1:
        who = "no run says" if len(silent) == len(entries) else f"{', '.join(silent)} do not say"
        notes.append(
            f"{who} when it began (start_time_s); taken as 0 s, so warming up over the campaign cannot be seen"
        )
    return notes


def _ignored_notes(ignored: dict[str, list[str]], runs: int) -> list[str]:
    """Columns that are no signals, grouped by the runs that have them."""
    groups: dict[str, list[str]] = {}
    for column, names in ignored.items():
        groups.setdefault("all runs" if len(names) == runs else ", ".join(names), []).append(column)
    return [f"ignored columns in {where}: {', '.join(columns)}" for where, columns in groups.items()]


def _same_samples(runs: Sequence[Run]) -> list[str]:
    """Runs of different files that hold the very same samples."""
    notes = []
    for index, run in enumerate(runs):
        for other in runs[:index]:
            if run.source != other.source and _equal(run, other):
                notes.append(f"runs '{other.name}' and '{run.name}' hold the same samples")
                break
    return notes


def _equal(run: Run, other: Run) -> bool:
    return (
        len(run.time_s) == len(other.time_s)
        and run.signals.keys() == other.signals.keys()
        and all(np.array_equal(run[name], other[name]) for name in run.signals)
    )
