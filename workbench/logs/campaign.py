"""A campaign folder: machine.yaml, runs.yaml and the logs, read into one record."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, StringConstraints, field_validator, model_validator

from workbench.core.errors import InputError, check_known, nearest
from workbench.core.input_file import readable_file, similar
from workbench.core.record import Finite, Record, long_form
from workbench.core.run import Run
from workbench.core.shown import Shown
from workbench.core.yaml_strict import Document, dotted, load, validate
from workbench.logs.formats.opening import LogFile, expect, open_log
from workbench.logs.raw_run import Entry, RawRun
from workbench.logs.samples import checked_runs
from workbench.machines import TIME, CheckEffects, Machine, kind_of, load_machine


class Column(Record):
    """signal = scale · column + offset"""

    column: Annotated[str, StringConstraints(min_length=1)]
    scale: Finite = 1.0
    offset: Finite = 0.0

    @field_validator("scale")
    @classmethod
    def _not_zero(cls, value: float) -> float:
        if value == 0.0:
            raise ValueError("0.0, expected a number other than 0: it would erase the signal")
        return value


class RunsFile(Record):
    """The whole of runs.yaml."""

    format: Literal[1] = 1
    columns: dict[str, Column] = Field(default_factory=dict)
    runs: Annotated[list[Entry], Field(min_length=1)]

    @model_validator(mode="before")
    @classmethod
    def _short_columns(cls, data: object) -> object:
        return long_form(data, "columns", "column")


def read_runs(file: Path, machine: Machine) -> tuple[RunsFile, Document]:
    """runs.yaml, checked against its machine: signals that there are, and keys that runs of its kind need. InputError
    names file, line and place."""
    document = load(file)
    runs, kind, seen = validate(RunsFile, document), kind_of(machine), dict[str, int]()

    def fail(problem: str, *place: str | int) -> InputError:
        return InputError(problem, file=file, line=document.line(place), place=dotted(place))

    for signal in runs.columns:
        if signal not in kind.signals.names:
            raise fail(f"unknown signal '{signal}'; {nearest(signal, kind.signals.names)}", "columns", signal)
    for index, entry in enumerate(runs.runs):
        start, place = entry.start_position_m, ("runs", index, "start_position_m")
        if entry.name in seen:
            first = document.line(("runs", seen[entry.name], "name"))
            raise fail(f"'{entry.name}' is used twice; it names the run on line {first} too", "runs", index, "name")
        seen[entry.name] = index
        if kind.payload and entry.payload_kg is None:
            raise fail(f"run '{entry.name}' needs payload_kg, in kg and at least 0", "runs", index, "payload_kg")
        if kind.start is None:
            continue
        if start is None:
            raise fail(f"run '{entry.name}' needs start_position_m, {kind.start.said}", *place)
        low, high, top = kind.start.range(machine)
        if not low <= start <= high:
            raise fail(f"{start} m, expected {kind.start.noun} from {low:g} to {high} m, {top}", *place)
    return runs, document


# One run, from its file to checked and repaired signals. This module has the order of the checks, which matters.


def read_run(
    entry: Entry,
    file: Path,
    machine: Machine,
    columns: Mapping[str, Column],
    line: int | None,
    runs_yaml: Path,
    *,
    uploaded: bool = False,
    whole: bool = False,
) -> tuple[list[Run], list[str]]:
    """The run, and the columns of its file that were not used. A run with holes is several, one each stretch between
    them; whole: then it is refused.

    InputError names file and run. A file that is not there is a fault of runs.yaml,
    so that file and line are named, with the path that was tried. uploaded: see `open_log`.
    """
    try:
        readable_file(file)
    except InputError as error:
        raise InputError(f"{entry.file}: {error.problem}", file=runs_yaml, line=line, place=entry.name) from error
    try:
        with open_log(file, uploaded=uploaded) as log:
            raw = _raw_run(log, entry, machine, columns)
    except InputError as error:
        if error.place is not None and error.place.startswith(entry.name):
            raise
        place = entry.name if error.place is None else f"{entry.name}: {error.place}"
        raise InputError(error.problem, file=error.file, line=error.line, place=place) from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=file, place=entry.name) from error
    used = set(raw.columns.values())
    return checked_runs(raw, whole=whole), [name for name in log.names if name not in used]


def _raw_run(log: LogFile, entry: Entry, machine: Machine, mapping: Mapping[str, Column]) -> RawRun:
    """The signals of one log. InputError when a needed one has no column, with the columns there are."""
    wanted = kind_of(machine).signals
    columns = {
        signal: mapping[signal].column if signal in mapping else signal
        for signal in wanted.names
        if signal in mapping or signal in log.names
    }
    for signal, column in columns.items():
        if column not in log.names:
            raise _missing(log, f"column '{column}' for {signal}", column, entry.name)
    for group in wanted.needed:
        if not any(all(name in columns for name in alternative) for alternative in group):
            words = " or ".join(" and ".join(alternative) for alternative in group)
            first = next((name for alternative in group for name in alternative if name not in columns), TIME)
            raise _missing(log, f"column {words}", first, entry.name)
    read = log.read(list(dict.fromkeys(columns.values())))
    values = {}
    for signal, column in columns.items():
        rule = mapping.get(signal)
        plain = rule is None or (rule.scale == 1.0 and rule.offset == 0.0)
        values[signal] = read[column] if plain or rule is None else rule.scale * read[column] + rule.offset
    time_s = values.pop(TIME)
    return RawRun(entry, log.file, machine, columns, log.row_name, time_s, values)


def _missing(log: LogFile, what: str, name: str, run: str) -> InputError:
    if not log.names:
        return InputError(f"no {what}: the file holds no columns of numbers", file=log.file, place=run)
    most = 30
    shown = ", ".join(repr(name)[1:-1] for name in log.names[:most])
    shown += f" and {len(log.names) - most} more" if len(log.names) > most else ""
    hint = nearest(name, log.names)
    hint = f"{hint} The file has: {shown}" if hint.startswith("did you mean") else f"the file has: {shown}"
    return InputError(f"no {what}; {hint}", file=log.file, place=run)


@dataclass(frozen=True, repr=False)
class Campaign(Shown):
    """Measured runs of one machine. `notes` concern the campaign; each run carries its own.

    doubts: that a run is what runs.yaml says, from physics and the other runs; see `doubts.py`. Commands look for them.
    """

    name: str
    path: Path
    machine: Machine
    runs: tuple[Run, ...]
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def run(self, name: str) -> Run:
        """The run of that name; InputError with the nearest one when there is none."""
        runs = {run.name: run for run in self.runs}
        check_known("no run", name, runs, file=self.path / "runs.yaml")
        return runs[name]

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
    runs_file, document = read_runs(runs_yaml, machine)
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
        raise RunsError(faults, [entry.name for entry in entries if entry.name not in faults])
    driven = kind_of(machine).plant.input
    if runs and not any(run[driven].any() for run in runs):  # inertia and friction would show in proportion only
        raise InputError(f"{driven} is zero throughout in every run; one at least has to be driven", file=runs_yaml)
    if len({run.name for run in runs}) < len(runs):
        raise InputError("a run has the name of a stretch of another one, such as 'lift_2'; rename it", file=runs_yaml)
    notes = (*_notes(entries, folder, runs), *_ignored_notes(ignored, len(runs)))
    return Campaign(folder.resolve().name, folder, machine, tuple(runs), notes)


class RunsError(InputError):
    """The faults of all runs that cannot be read, in one line; one that several have, but for its numbers, once. sound:
    the runs that can be read without them."""

    def __init__(self, faults: Mapping[str, InputError], sound: Sequence[str]) -> None:
        runs_with: dict[str, list[str]] = {}
        for run, fault in faults.items():
            runs_with.setdefault(re.sub(r"\d[\d.e+-]*", "0", fault.problem), []).append(run)
        problems: list[str] = []
        for run, *others in runs_with.values():
            text = str(faults[run]) if problems else faults[run].problem
            problems.append(f"{text} (so in {', '.join(others)})" if others else text)
        first = next(iter(faults.values()))
        super().__init__("; ".join(problems), file=first.file, line=first.line, place=first.place)
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
        raise InputError(f"no such campaign{similar(given)}", file=given)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {error}", file=repr(str(given))) from error


def _selected(entries: Sequence[Entry], select: Sequence[str] | str | None, file: Path) -> list[Entry]:
    if select is None:
        return list(entries)
    names = [name.strip() for name in select.split(",")] if isinstance(select, str) else list(select)
    known = [entry.name for entry in entries]
    for name in names:
        check_known("no run", name, known, file=file)
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
