"""The machine: records of machine.yaml, their files, their physics by kind, the machines that ship."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from pydantic import BaseModel

from workbench.core.errors import InputError, nearest
from workbench.core.whole_folder import replace_text
from workbench.core.yaml_strict import Document, checked, dumps, load, put, validate
from workbench.machines.declare import TIME, ClosedLoop, Kind, Limits, Load, RigidBody, Sizes, Table
from workbench.machines.kinds import (
    HOIST,
    KINDS,
    LINEAR,
    LOOPED,
    PLACES,
    PLANTS,
    ROTARY,
    STUDIED,
    AnyMachine,
    Machine,
    kind_of,
    load_of,
    looped,
    of_kind,
    plant_of,
    studied,
)
from workbench.machines.kinds.axis import Axis, LinearAxis, RotaryAxis
from workbench.machines.kinds.hoist import DRIVES, Drive, Hoist
from workbench.machines.kinds.two_inertia import TwoInertia
from workbench.machines.plant import NO_EFFECTS, Effects, Memory, Plant

# What machine.yaml may describe. A kind of several motions has a record for each.
RECORDS: tuple[type[Hoist] | type[Axis], ...] = tuple(kind.record for kind in KINDS.values())
T = TypeVar("T")

CheckEffects = Callable[[Machine], None]
Curve = Iterable[float]
_NOT_VALUES = ("format", "identified", "measured_correction", "log")
_HEAD = ("format", "kind", "motion", "name")
_TAIL = ("sensors", "tolerances", "effects", "allowances", "measured_correction", "log", "identified")


def load_machine(path: str | os.PathLike[str], *, check_effects: CheckEffects | None = None) -> Machine:
    """The machine a machine.yaml describes.

    check_effects: called with the machine (`workbench.effects.check`); raises InputError for an
    effect or parameter it does not know, to which file and line are added here.
    InputError names file, line, place, value and what was expected.
    """
    return machine_from(load(path), check_effects=check_effects)


def machine_from(document: Document, *, check_effects: CheckEffects | None = None) -> Machine:
    """The machine a document describes; see `load_machine`."""
    machine = validate(_record_for(document), document)
    if check_effects is not None:
        try:
            check_effects(machine)
        except InputError as error:
            place = tuple((error.place or "effects").split("."))
            raise InputError(
                error.problem, file=document.file, line=document.line(place), place=error.place or "effects"
            ) from error
    return machine


def _record_for(document: Document) -> type[Hoist] | type[Axis]:
    """The record that `kind`, and `motion` where a kind has several, ask for."""
    data = document.data
    if not isinstance(data, dict):
        raise InputError("is not a block of keys; expected a machine", file=document.file, line=document.line(()))
    if (version := data.get("format", 1)) != 1:  # first: a newer form may have other keys throughout
        line = document.line(("format",))
        raise InputError(f"{version!r}, this version reads format 1", file=document.file, line=line, place="format")
    by_kind: dict[str, list[type[Hoist] | type[Axis]]] = {}
    for record in RECORDS:
        by_kind.setdefault(record.model_fields["kind"].default, []).append(record)
    records = _choice(document, "kind", by_kind, "hoist")
    if len(records) == 1:
        return records[0]
    return _choice(document, "motion", {record.model_fields["motion"].default: record for record in records}, None)


def _choice(document: Document, key: str, valid: Mapping[str, T], default: str | None) -> T:
    assert isinstance(document.data, dict)
    name = document.data.get(key, default)
    if isinstance(name, str) and name in valid:
        return valid[name]
    problem = "is missing" if key not in document.data else f"unknown {key} {name!r}"
    said = f"{problem}; {nearest(str(name), valid)}"
    raise InputError(said, file=document.file, line=document.line((key,)), place=key)


def machine_text(machine: Machine) -> str:
    """A machine as complete YAML: every value, defaults included; what is not set is left out."""
    free = machine.model_dump(include={"effects", "identified"})  # not ours: kept with whatever nulls it holds
    data = machine.model_dump(exclude_none=True) | free
    data["log"] = machine.log.model_dump(exclude_defaults=True)  # nothing where the log says all
    order = [*_HEAD, *(key for key in data if key not in (*_HEAD, *_TAIL)), *_TAIL]
    return dumps({key: data[key] for key in order if key in data and data[key] != {}})


def save_machine(machine: Machine, path: str | os.PathLike[str]) -> None:
    """Writes machine.yaml whole or not at all, over what is there. InputError when it cannot be written."""
    replace_text(Path(path), machine_text(machine))


# Machines that ship with the package, as scenarios name them.
SHIPPED = {
    "default": "default_hoist.yaml",
    "lightly_damped": "lightly_damped_hoist.yaml",
    "emps_axis": "emps_axis.yaml",
}


@cache
def shipped(name: str) -> Machine:
    """A machine that ships with the package. KeyError for another name."""
    return machine_from(load(Path(__file__).with_name(SHIPPED[name])))


@cache
def shipped_hoist(name: str) -> Hoist:
    """A hoist that ships with the package. KeyError for another name."""
    return validate(Hoist, load(Path(__file__).with_name(SHIPPED[name])))


def default_hoist() -> Hoist:
    """Engineering estimates of a pipe racker's winch."""
    return shipped_hoist("default")


# Values


def value_names(machine: Machine) -> tuple[str, ...]:
    """Dotted names of all numbers a machine carries, tolerances and effects included, in file order."""
    return tuple(name for name, value in _leaves(machine, "") if isinstance(value, float | int))


def get_value(machine: Machine, name: str) -> float:
    """One number. InputError for a name the machine does not have, with the nearest one."""
    for key, value in _leaves(machine, ""):
        if key == name:
            if value is None:
                raise InputError("has no value in this machine", place=name)
            return float(value)
    raise _unknown(machine, name)


def with_values(machine: AnyMachine, values: Mapping[str, float]) -> AnyMachine:
    """The machine with other numbers, checked like a file. InputError names the value that does not fit."""
    known = {name for name, _ in _leaves(machine, "")}
    data: dict[str, Any] = machine.model_dump()
    for name, value in values.items():
        if name not in known:
            raise _unknown(machine, name)
        put(data, tuple(name.split(".")), float(value))
    return checked(type(machine), data)


def with_correction(
    machine: AnyMachine, over: str, acts_on: str, at: Curve, forward: Curve, backward: Curve
) -> AnyMachine:
    """The machine with a measured correction in place of what it has; see `MeasuredCorrection`.

    forward, backward: in N where it acts on a guide or a linear axis, else in N m. InputError as for a file.
    """
    unit = type(machine).CORRECTION.UNITS.get(acts_on, "n")  # an impossible place is refused below
    table = {"at": at, f"forward_{unit}": forward, f"backward_{unit}": backward}
    numbers = {name: tuple(float(value) for value in values) for name, values in table.items()}
    data = machine.model_dump() | {"measured_correction": {"over": over, "acts_on": acts_on, **numbers}}
    return checked(type(machine), data)


def _unknown(machine: Machine, name: str) -> InputError:
    return InputError(f"the machine has no value '{name}'; {nearest(name, value_names(machine))}")


def _leaves(record: BaseModel, prefix: str) -> Iterator[tuple[str, float | None]]:
    """(dotted name, value) of numbers and of optional numbers that are not set."""
    for key in type(record).model_fields:
        value = getattr(record, key)
        if not prefix and key in _NOT_VALUES:
            continue
        if isinstance(value, BaseModel):
            yield from _leaves(value, f"{prefix}{key}.")
        elif key == "effects":
            for effect, parameters in value.items():
                for parameter, number in parameters.items():
                    yield f"effects.{effect}.{parameter}", number
        elif value is None or isinstance(value, float | int):
            yield f"{prefix}{key}", value


# A machine of any kind, where what is a kind's own is asked of its record or by that kind's code alone.
AnyKind: TypeAlias = Any
