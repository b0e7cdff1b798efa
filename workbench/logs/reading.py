"""One run, from its file to checked and repaired signals. This module has the order of the steps, which matters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from workbench.core.errors import InputError, nearest
from workbench.core.input_file import readable_file
from workbench.core.run import Array, Run
from workbench.logs.channels import bridge_spikes, clipped, drop_dead, is_constant, refuse_infinite
from workbench.logs.clock import check_time, merge_repeated, time_notes
from workbench.logs.dropouts import drop_frozen, whole_part
from workbench.logs.faults import Fault, fault_of, seconds
from workbench.logs.formats.opening import LogFile, Table, open_log
from workbench.logs.gaps import fill_gaps, whole_stretches
from workbench.logs.plausible import check_plausible, driven_signals
from workbench.logs.runs_file import Column, Entry
from workbench.logs.units import check_sizes, drop_wrong_scale
from workbench.machines import TIME, Axis, Hoist, Kind, SignalSet, kind_of


@dataclass(frozen=True)
class Raw:
    """One run's signals as logged, in SI: not yet checked, time not yet known to rise."""

    table: Table
    columns: Mapping[str, str]  # signal -> column of the file
    values: dict[str, Array]
    ignored: tuple[str, ...]

    def label(self, signal: str) -> str:
        """The signal's name, with the column's where that is another one."""
        column = self.columns.get(signal, signal)
        return signal if column == signal else f"{signal} (column '{column}')"


def read_signals(log: LogFile, wanted: SignalSet, mapping: Mapping[str, Column], run: str) -> Raw:
    """The signals of one log. InputError when a needed one has no column, with the columns there are."""
    columns = {
        signal: mapping[signal].column if signal in mapping else signal
        for signal in wanted.names
        if signal in mapping or signal in log.names
    }
    for signal, column in columns.items():
        if column not in log.names:
            raise _missing(log, f"column '{column}' for {signal}", column, run)
    for group in wanted.needed:
        if not any(all(name in columns for name in alternative) for alternative in group):
            words = " or ".join(" and ".join(alternative) for alternative in group)
            first = next((name for alternative in group for name in alternative if name not in columns), TIME)
            raise _missing(log, f"column {words}", first, run)
    table = log.read(list(dict.fromkeys(columns.values())))
    values: dict[str, Array] = {}
    for signal, column in columns.items():
        rule = mapping.get(signal)
        plain = rule is None or (rule.scale == 1.0 and rule.offset == 0.0)
        values[signal] = (
            table.columns[column] if plain or rule is None else rule.scale * table.columns[column] + rule.offset
        )
    used = set(columns.values())
    return Raw(table, columns, values, tuple(name for name in log.names if name not in used))


def _missing(log: LogFile, what: str, name: str, run: str) -> InputError:
    if not log.names:
        return InputError(f"no {what}: the file holds no columns of numbers", file=log.file, place=run)
    hint = nearest(name, log.names)
    if hint.startswith("did you mean"):
        hint += f" The file has: {_listed(log.names)}"
    else:
        hint = f"the file has: {_listed(log.names)}"
    return InputError(f"no {what}; {hint}", file=log.file, place=run)


def _listed(names: tuple[str, ...], most: int = 30) -> str:
    shown = [repr(name)[1:-1] for name in names[:most]]
    return ", ".join(shown) + (f" and {len(names) - most} more" if len(names) > most else "")


def read_run(
    entry: Entry,
    file: Path,
    machine: Hoist | Axis,
    wanted: SignalSet,
    columns: Mapping[str, Column],
    line: int | None,
    runs_yaml: Path,
    *,
    uploaded: bool = False,
    whole: bool = False,
) -> tuple[list[Run], tuple[str, ...]]:
    """The run, and the columns of its file that were not used. A run with holes is several, one each stretch between
    them; whole: then it is refused.

    InputError names file and run. A file that is not there is a fault of runs.yaml,
    so that file and line are named, with the path that was tried. uploaded: see `open_log`.
    """
    try:
        readable_file(file)
    except InputError as error:
        raise InputError(f"{entry.file}: {error.problem}", file=runs_yaml, line=line, place=entry.name) from error
    fault = fault_of(file, entry.name)
    try:
        with open_log(file, uploaded=uploaded) as log:
            raw = read_signals(log, wanted, columns, entry.name)
    except InputError as error:
        if error.place is not None and error.place.startswith(entry.name):
            raise
        place = entry.name if error.place is None else f"{entry.name}: {error.place}"
        raise InputError(error.problem, file=error.file, line=error.line, place=place) from error
    except OSError as error:
        raise fault(f"cannot be read: {error.strerror}") from error

    # Numbers near the largest a float holds overflow to infinite here and are refused as such.
    with np.errstate(over="ignore", invalid="ignore"):
        time_s, values, notes = _risen(raw, fault)
        parts = [] if whole else whole_stretches(time_s, values, _needed(values, wanted))
        if not parts:
            return [_checked(entry, file, machine, wanted, raw, fault, time_s, values, notes)], raw.ignored
        return _stretched(entry, file, machine, wanted, raw, fault, time_s, values, notes, parts), raw.ignored


def _stretched(
    entry: Entry, file: Path, machine: Hoist | Axis, wanted: SignalSet, raw: Raw, fault: Fault,
    time_s: Array, values: dict[str, Array], notes: list[str], parts: list[tuple[int, int]],
) -> list[Run]:  # fmt: skip
    """Each stretch between holes as a run of its own, which begins where the motion has taken the machine."""
    logged = {name: ~np.isnan(column) for name, column in values.items()}
    known = {
        name: np.interp(time_s, time_s[there], values[name][there]) for name, there in logged.items() if there.any()
    }
    holes = [seconds(time_s[b]) + " to " + seconds(time_s[a - 1]) for (_, b), (a, _) in pairwise(parts)]
    holes = ([f"the start to {seconds(time_s[parts[0][0] - 1])}"] if parts[0][0] else []) + holes
    holes += [f"{seconds(time_s[parts[-1][1]])} to the end"] if parts[-1][1] < len(time_s) else []
    said = f"samples are missing from {', '.join(holes)}; the stretches before and behind are used, each as a run"
    runs: list[Run] = []
    refused: list[InputError] = []
    for number, (first, end) in enumerate(parts, 1):
        part = _entry_of(first, entry, kind_of(machine), machine, time_s, known)
        part = part.model_copy(update={"name": entry.name if number == 1 else f"{entry.name}_{number}"})
        cut = {name: column[first:end] for name, column in values.items()}
        try:
            runs.append(_checked(part, file, machine, wanted, raw, fault, time_s[first:end], cut, [said, *notes]))
        except InputError as error:
            refused.append(error)
    if not runs:
        raise refused[0]
    return runs


def _checked(
    entry: Entry, file: Path, machine: Hoist | Axis, wanted: SignalSet, raw: Raw, fault: Fault,
    time_s: Array, values: dict[str, Array], notes: list[str],
) -> Run:  # fmt: skip
    kind = kind_of(machine)
    time_s, values, more = _repaired(time_s, values, raw, wanted, fault)
    notes = [*notes, *more]
    values, more = _with_sum(kind, values, raw)
    notes += more
    part = whole_part(time_s, values, kind, machine, raw.label, fault)
    entry = _entry_of(part.first, entry, kind, machine, time_s, values)
    time_s, values = time_s[part.first : part.end], {n: column[part.first : part.end] for n, column in values.items()}
    notes += part.notes
    values, more = _without_dead_motion(kind, values, raw)
    notes += more
    start_m = _start(kind, entry, values)
    notes += check_plausible(machine, entry.payload_kg or 0.0, start_m, time_s, values, raw.label, fault)
    values, more = drop_dead(values, wanted.optional, _true_zeros(kind, values), raw.label)
    notes += more
    values, more = drop_frozen(time_s, values, _can_freeze(kind, wanted), raw.label)
    notes += more
    values, more = drop_wrong_scale(kind, machine, entry.payload_kg or 0.0, time_s, values, raw.label)
    notes += more
    for name in kind.can_clip:
        if name in raw.values and name in values and (sentence := clipped(time_s, values[name])):
            notes.append(f"{raw.label(name)} {sentence}")
    return Run(
        name=entry.name,
        time_s=time_s,
        signals=values,
        payload_kg=entry.payload_kg or 0.0,
        start_position_m=start_m,
        start_time_s=entry.start_time_s or 0.0,
        source=str(file),
        notes=tuple(notes),
    )


def _entry_of(
    first: int, entry: Entry, kind: Kind, machine: Hoist | Axis, time_s: Array, values: Mapping[str, Array]
) -> Entry:
    """The entry of a run that begins at sample `first` only: it starts later, and where the motion has taken it."""
    if first == 0:
        return entry
    position, speed = driven_signals(kind)
    start = entry.start_position_m
    if start is not None or position not in values:
        if position in values:
            way = float(values[position][first] - values[position][0])
        else:
            v = values[speed][: first + 1]
            way = float(np.sum(0.5 * (v[1:] + v[:-1]) * np.diff(time_s[: first + 1])))
        start = (start or 0.0) + kind.lever_of(machine) * way
    began = (entry.start_time_s or 0.0) + float(time_s[first] - time_s[0])
    return entry.model_copy(update={"start_position_m": start, "start_time_s": began})


def _can_freeze(kind: Kind, wanted: SignalSet) -> tuple[str, ...]:
    """Optional signals that measure something: a reference may well rest."""
    return tuple(name for name in wanted.optional if name != kind.reference[0])


def _risen(raw: Raw, fault: Fault) -> tuple[Array, dict[str, Array], list[str]]:
    """The signals over a time that rises strictly."""
    time_s = raw.values[TIME]
    values = {name: column for name, column in raw.values.items() if name != TIME}
    check_time(time_s, raw.table.row_name, raw.label(TIME), fault)
    refuse_infinite(time_s, values, raw.label, fault)
    return merge_repeated(time_s, values, fault)


def _repaired(
    time_s: Array, values: dict[str, Array], raw: Raw, wanted: SignalSet, fault: Fault
) -> tuple[Array, dict[str, Array], list[str]]:
    needed = _needed(values, wanted)
    time_s, values, notes = fill_gaps(time_s, values, needed, raw.label, fault)
    values, more = bridge_spikes(time_s, values, raw.label)
    notes += more
    values, more = check_sizes(values, tuple(needed), raw.label, fault)
    check_time(time_s, raw.table.row_name, raw.label(TIME), fault)  # again: repairs may have shortened the run
    return time_s, values, notes + more + time_notes(time_s)


def _needed(values: Mapping[str, Array], wanted: SignalSet) -> list[str]:
    """The signals this run cannot do without: of each group the first alternative that is whole."""
    needed: list[str] = []
    for group in wanted.needed:
        whole = (alternative for alternative in group if all(name in values for name in alternative))
        needed += next(whole, ())
    return needed


def _with_sum(kind: Kind, values: dict[str, Array], raw: Raw) -> tuple[dict[str, Array], list[str]]:
    """The input as the sum of its parts, such as both motors' torque; the parts stay beside it when all are logged."""
    parts, total = kind.drive.parts, kind.plant.input
    if parts and all(name in values for name in parts):
        notes = [f"{raw.label(total)} is not used: both motors are logged for themselves"] if total in values else []
        return values | {total: np.sum([values[name] for name in parts], axis=0)}, notes
    alone = [name for name in parts if name in values]
    kept = {name: column for name, column in values.items() if name not in alone}
    return kept, [f"{raw.label(name)} is not used: the other motor is not logged, the sum is" for name in alone]


def _without_dead_motion(kind: Kind, values: dict[str, Array], raw: Raw) -> tuple[dict[str, Array], list[str]]:
    """The signals without a position (or speed) that is zero throughout, if both are logged."""
    motion = [name for name in driven_signals(kind) if name in values]
    zero = [name for name in motion if not values[name].any()]
    if len(motion) < 2 or len(zero) != 1:
        return values, []
    kept = {name: column for name, column in values.items() if name != zero[0]}
    return kept, [f"{raw.label(zero[0])} dropped: it is zero throughout"]


def _start(kind: Kind, entry: Entry, values: Mapping[str, Array]) -> float:
    """The start position: from runs.yaml, else the first logged position."""
    if entry.start_position_m is not None:
        return entry.start_position_m
    position = values.get(kind.plant.positions[0]) if kind.moved.placed_by_log else None
    return 0.0 if position is None else float(position[0])


def _true_zeros(kind: Kind, values: Mapping[str, Array]) -> tuple[str, ...]:
    """References that may be zero throughout: those of a machine at rest."""
    reference, signal = kind.reference
    if signal not in values:
        return ()
    still = is_constant(values[signal]) if signal in kind.plant.positions else not values[signal].any()
    return (reference,) if still else ()
