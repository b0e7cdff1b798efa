"""One run: from its file to checked, repaired signals. The order of the steps matters and stands here."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.logs.channels import clipped, drop_dead, is_constant, refuse_infinite
from workbench.logs.clock import check_time, merge_repeated, time_notes
from workbench.logs.faults import Fault, fault_of
from workbench.logs.gaps import fill_gaps
from workbench.logs.plausible import check_hoist
from workbench.logs.runs_file import Column, Entry
from workbench.logs.signals import TIME, TORQUE, TORQUE_1, TORQUE_2, Raw, SignalSet, read_signals
from workbench.logs.table import open_log
from workbench.machine import Axis, Hoist
from workbench.run import Array, Run
from workbench.yaml_strict import readable_file

_CAN_CLIP = (TORQUE_1, TORQUE_2, TORQUE, "tension_dead_line_n", "force_n", "torque_nm")


def read_run(
    entry: Entry,
    file: Path,
    machine: Hoist | Axis,
    wanted: SignalSet,
    columns: Mapping[str, Column],
    line: int | None,
    runs_yaml: Path,
) -> tuple[Run, tuple[str, ...]]:
    """The run, and the columns of its file that were not used.

    InputError names file and run. A file that is not there is a fault of runs.yaml,
    so that file and line are named, with the path that was tried.
    """
    try:
        readable_file(file)
    except InputError as error:
        raise InputError(f"{entry.file}: {error.problem}", file=runs_yaml, line=line, place=entry.name) from error
    fault = fault_of(file, entry.name)
    try:
        raw = read_signals(open_log(file), wanted, columns, entry.name)
    except InputError as error:
        if error.place is not None and error.place.startswith(entry.name):
            raise
        place = entry.name if error.place is None else f"{entry.name}: {error.place}"
        raise InputError(error.problem, file=error.file, line=error.line, place=place) from error
    except OSError as error:
        raise fault(f"cannot be read: {error.strerror}") from error

    # Numbers near the largest a float holds overflow to infinite here and are refused as such.
    with np.errstate(over="ignore", invalid="ignore"):
        run = _checked(entry, file, machine, wanted, raw, fault)
    return run, raw.ignored


def _checked(entry: Entry, file: Path, machine: Hoist | Axis, wanted: SignalSet, raw: Raw, fault: Fault) -> Run:
    time_s, values, notes = _repaired(raw, wanted, fault)
    if isinstance(machine, Hoist):
        values, more = _with_sum(values, raw)
        notes += more
        start_m = entry.start_position_m if entry.start_position_m is not None else 0.0
        notes += check_hoist(machine, entry.payload_kg or 0.0, start_m, time_s, values, raw.label, fault)
    else:
        values, start_m, more = _axis(machine, entry, values, raw, fault)
        notes += more
    values, more = drop_dead(values, wanted.optional, _true_zeros(machine, values), raw.label)
    notes += more
    for name in _CAN_CLIP:
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


def _repaired(raw: Raw, wanted: SignalSet, fault: Fault) -> tuple[Array, dict[str, Array], list[str]]:
    time_s = raw.values[TIME]
    values = {name: column for name, column in raw.values.items() if name != TIME}
    check_time(time_s, raw.table.row_name, raw.label(TIME), fault)
    refuse_infinite(time_s, values, raw.label, fault)
    time_s, values, notes = merge_repeated(time_s, values, fault)
    time_s, values, more = fill_gaps(time_s, values, _needed(values, wanted), raw.label, fault)
    check_time(time_s, raw.table.row_name, raw.label(TIME), fault)  # again: repairs may have shortened the run
    return time_s, values, notes + more + time_notes(time_s)


def _needed(values: Mapping[str, Array], wanted: SignalSet) -> list[str]:
    """The signals this run cannot do without: of each group the first alternative that is whole."""
    needed: list[str] = []
    for group in wanted.needed:
        whole = (alternative for alternative in group if all(name in values for name in alternative))
        needed += next(whole, ())
    return needed


def _with_sum(values: dict[str, Array], raw: Raw) -> tuple[dict[str, Array], list[str]]:
    """Both motors' torque together; the two stay beside it when both are logged."""
    if TORQUE_1 in values and TORQUE_2 in values:
        notes = [f"{raw.label(TORQUE)} is not used: both motors are logged for themselves"] if TORQUE in values else []
        return values | {TORQUE: values[TORQUE_1] + values[TORQUE_2]}, notes
    alone = [name for name in (TORQUE_1, TORQUE_2) if name in values]
    kept = {name: column for name, column in values.items() if name not in alone}
    return kept, [f"{raw.label(name)} is not used: the other motor is not logged, the sum is" for name in alone]


def _axis(
    machine: Axis, entry: Entry, values: dict[str, Array], raw: Raw, fault: Fault
) -> tuple[dict[str, Array], float, list[str]]:
    """Dead channels of an axis, and where it starts: the first logged position unless runs.yaml says."""
    notes: list[str] = []
    force, motion = machine.input_signal, [machine.position_signal, machine.speed_signal]
    if not values[force].any():
        raise fault(f"{raw.label(force)} is zero throughout")
    present = [name for name in motion if name in values]
    zero = [name for name in present if not values[name].any()]
    if len(present) == 2 and len(zero) == 1:
        notes.append(f"{raw.label(zero[0])} dropped: it is zero throughout")
        values = {name: column for name, column in values.items() if name != zero[0]}
    elif all(is_constant(values[name]) for name in present):
        notes.append("the axis stands still throughout; this run says nothing of friction or inertia")
    first = float(values[machine.position_signal][0]) if machine.position_signal in values else 0.0
    return values, first if entry.start_position_m is None else entry.start_position_m, notes


def _true_zeros(machine: Hoist | Axis, values: Mapping[str, Array]) -> tuple[str, ...]:
    """References that may well be zero throughout: those of a machine that stands still."""
    if isinstance(machine, Hoist):
        still = not values["speed_motor_rad_s"].any()
        return ("speed_reference_rad_s",) if still else ()
    position = values.get(machine.position_signal)
    return (machine.reference_signal,) if position is not None and is_constant(position) else ()
