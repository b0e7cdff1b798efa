"""A campaign folder: machine.yaml, runs.yaml and the logs, read into one record."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.core.errors import InputError, nearest
from workbench.core.run import Run
from workbench.core.shown import Shown
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
    runs: list[Run] = []
    ignored: dict[str, list[str]] = {}
    faults: dict[str, InputError] = {}
    for entry in entries:
        line = document.line(("runs", runs_file.runs.index(entry), "file"))
        file = folder / entry.file
        try:
            if confined and not _inside(file, folder):
                problem = f"'{entry.file}' lies outside the campaign's folder"
                raise InputError(problem, file=document.file, line=line, place=entry.name)
            read, unused = read_run(entry, file, machine, runs_file.columns, line, runs_yaml, uploaded=uploaded)
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
    notes = (*_notes(entries, folder, runs), *_ignored_notes(ignored, len(runs)))
    return Campaign(folder.resolve().name, folder, machine, tuple(runs), notes)


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


def _inside(file: Path, folder: Path) -> bool:
    try:
        return file.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError):
        return False


def _notes(entries: Sequence[Entry], folder: Path, runs: Sequence[Run]) -> Iterator[str]:
    """The same file, or the very same samples, under two names; runs that do not say when they began."""
    first: dict[str, str] = {}
    for entry in entries:
        file = os.path.normpath(folder / entry.file)
        if file in first:
            yield f"runs '{first[file]}' and '{entry.name}' are the same file, {entry.file}"
        first.setdefault(file, entry.name)
    silent = [entry.name for entry in entries if entry.start_time_s is None]
    if silent and len(entries) > 1:
        who = "no run says" if len(silent) == len(entries) else f"{', '.join(silent)} do not say"
        yield f"{who} when it began (start_time_s); taken as 0 s, so warming up over the campaign cannot be seen"
    known: dict[str, Run] = {}
    for run in runs:
        content = hashlib.sha256(str(sorted(run.signals)).encode())
        for name in sorted(run.signals):
            content.update(np.ascontiguousarray(run[name]).data)
        same = known.setdefault(content.hexdigest(), run)
        if same.source != run.source:
            yield f"runs '{same.name}' and '{run.name}' hold the same samples"


def _ignored_notes(ignored: Mapping[str, Sequence[str]], runs: int) -> list[str]:
    """Columns that are no signals, grouped by the runs that have them."""
    groups: dict[str, list[str]] = {}
    for column, names in ignored.items():
        groups.setdefault("all runs" if len(names) == runs else ", ".join(names), []).append(column)
    return [f"ignored columns in {where}: {', '.join(columns)}" for where, columns in groups.items()]
