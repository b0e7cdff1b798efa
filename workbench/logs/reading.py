"""One run, from its file to checked and repaired signals. This module has the order of the checks, which matters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np

from workbench.core.errors import InputError, nearest
from workbench.core.input_file import readable_file
from workbench.core.run import Run
from workbench.logs.formats.opening import LogFile, open_log
from workbench.logs.plausible import check_plausible, drop_wrong_scale
from workbench.logs.raw_run import RawRun, seconds
from workbench.logs.runs_file import Column, Entry
from workbench.logs.samples import (
    bridge_spikes,
    check_sizes,
    check_time,
    cut_dropouts,
    drop_dead,
    drop_dead_motion,
    drop_frozen,
    fill_gaps,
    merge_repeated,
    note_clipped,
    note_time,
    refuse_infinite,
    whole_stretches,
)
from workbench.machines import TIME, Axis, Hoist, kind_of


def read_run(
    entry: Entry,
    file: Path,
    machine: Hoist | Axis,
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
    # Numbers near the largest a float holds overflow to infinite here and are refused as such.
    with np.errstate(over="ignore", invalid="ignore"):
        for check in (check_time, refuse_infinite, merge_repeated):
            check(raw)
        parts = [] if whole else whole_stretches(raw)
        runs = _stretched(raw, parts) if parts else [_checked(raw)]
    return runs, [name for name in log.names if name not in used]


def _raw_run(log: LogFile, entry: Entry, machine: Hoist | Axis, mapping: Mapping[str, Column]) -> RawRun:
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


def _stretched(raw: RawRun, parts: list[tuple[int, int]]) -> list[Run]:
    """Each stretch between holes as a run of its own, which begins where the motion has taken the machine."""
    time_s, known = raw.time_s, {}
    for name, column in raw.values.items():
        there = ~np.isnan(column)
        if there.any():
            known[name] = np.interp(time_s, time_s[there], column[there])
    holes = [f"{seconds(time_s[b])} to {seconds(time_s[a - 1])}" for (_, b), (a, _) in pairwise(parts)]
    holes = ([f"the start to {seconds(time_s[parts[0][0] - 1])}"] if parts[0][0] else []) + holes
    holes += [f"{seconds(time_s[parts[-1][1]])} to the end"] if parts[-1][1] < len(time_s) else []
    said = f"samples are missing from {', '.join(holes)}; the stretches before and behind are used, each as a run"
    runs: list[Run] = []
    refused: list[InputError] = []
    for number, (first, end) in enumerate(parts, 1):
        name = raw.entry.name if number == 1 else f"{raw.entry.name}_{number}"
        try:
            runs.append(_checked(raw.part(first, end, raw.begun_at(first, name, known), said)))
        except InputError as error:
            refused.append(error)
    if not runs:
        raise refused[0]
    return runs


# Each repairs the run, notes something, or raises; what a later one takes for granted, an earlier one has made sure of.
CHECKS: tuple[Callable[[RawRun], None], ...] = (
    fill_gaps, bridge_spikes, check_sizes,
    check_time,  # again: repairs may have shortened the run
    note_time,
    lambda run: _sum_inputs(run),
    cut_dropouts, drop_dead_motion,
    lambda run: _place(run),
    check_plausible, drop_dead, drop_frozen, drop_wrong_scale, note_clipped,
)  # fmt: skip


def _checked(raw: RawRun) -> Run:
    for check in CHECKS:
        check(raw)
    return Run(
        name=raw.entry.name,
        time_s=raw.time_s,
        signals=raw.values,
        payload_kg=raw.payload_kg,
        start_position_m=raw.entry.start_position_m or 0.0,
        start_time_s=raw.entry.start_time_s or 0.0,
        source=str(raw.file),
        notes=tuple(raw.notes),
    )


def _sum_inputs(run: RawRun) -> None:
    """The input as the sum of its parts, such as both motors' torque; the parts stay beside it when all are logged."""
    parts, total = run.kind.drive.parts, run.kind.plant.input
    if parts and all(name in run.values for name in parts):
        if total in run.values:
            run.notes.append(f"{run.label(total)} is not used: both motors are logged for themselves")
        run.values[total] = np.sum([run.values[name] for name in parts], axis=0)
        return
    for name in parts:
        if name in run.values:
            run.notes.append(f"{run.label(name)} is not used: the other motor is not logged, the sum is")
            del run.values[name]


def _place(run: RawRun) -> None:
    """The start position: from runs.yaml, else the first logged position of a kind that is placed by its log."""
    if run.entry.start_position_m is None and run.kind.moved.placed_by_log and run.position in run.values:
        start = float(run.values[run.position][0])
        run.entry = run.entry.model_copy(update={"start_position_m": start})
