"""machine.yaml to a machine and back."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import TypeVar

from workbench.core.errors import InputError, nearest
from workbench.core.whole_folder import replace_text
from workbench.core.yaml_strict import Document, dumps, load, validate
from workbench.machines.kinds import KINDS
from workbench.machines.kinds.axis import Axis
from workbench.machines.kinds.hoist import Hoist

# What machine.yaml may describe. A kind of several motions has a record for each.
RECORDS: tuple[type[Hoist] | type[Axis], ...] = tuple(kind.record for kind in KINDS.values())
T = TypeVar("T")
CheckEffects = Callable[[Hoist | Axis], None]
_HEAD = ("format", "kind", "motion", "name")
_TAIL = ("sensors", "tolerances", "effects", "allowances", "measured_correction", "log", "identified")


def load_machine(path: str | os.PathLike[str], *, check_effects: CheckEffects | None = None) -> Hoist | Axis:
    """The machine a machine.yaml describes.

    check_effects: called with the machine (`workbench.effects.check`); raises InputError for an
    effect or parameter it does not know, to which file and line are added here.
    InputError names file, line, place, value and what was expected.
    """
    return machine_from(load(path), check_effects=check_effects)


def machine_from(document: Document, *, check_effects: CheckEffects | None = None) -> Hoist | Axis:
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
    of_kind: dict[str, list[type[Hoist] | type[Axis]]] = {}
    for record in RECORDS:
        of_kind.setdefault(record.model_fields["kind"].default, []).append(record)
    records = _choice(document, "kind", of_kind, "hoist")
    if len(records) == 1:
        return records[0]
    return _choice(document, "motion", {record.model_fields["motion"].default: record for record in records}, None)


def _choice(document: Document, key: str, valid: Mapping[str, T], default: str | None) -> T:
    assert isinstance(document.data, dict)
    name = document.data.get(key, default)
    if isinstance(name, str) and name in valid:
        return valid[name]
    problem = "is missing" if key not in document.data else f"unknown {key} {name!r}"
    raise InputError(
        f"{problem}; {nearest(str(name), valid)}", file=document.file, line=document.line((key,)), place=key
    )


def machine_text(machine: Hoist | Axis) -> str:
    """A machine as complete YAML: every value, defaults included; what is not set is left out."""
    free = machine.model_dump(include={"effects", "identified"})  # not ours: kept with whatever nulls it holds
    data = machine.model_dump(exclude_none=True) | free
    data["log"] = machine.log.model_dump(exclude_defaults=True)  # nothing where the log says all
    order = [*_HEAD, *(key for key in data if key not in (*_HEAD, *_TAIL)), *_TAIL]
    return dumps({key: data[key] for key in order if key in data and data[key] != {}})


def save_machine(machine: Hoist | Axis, path: str | os.PathLike[str]) -> None:
    """Writes machine.yaml whole or not at all, over what is there. InputError when it cannot be written."""
    replace_text(Path(path), machine_text(machine))


# Machines that ship with the package, as scenarios name them.
SHIPPED = {
    "default": "default_hoist.yaml",
    "lightly_damped": "lightly_damped_hoist.yaml",
    "emps_axis": "emps_axis.yaml",
}


@cache
def shipped(name: str) -> Hoist | Axis:
    """A machine that ships with the package. KeyError for another name."""
    return machine_from(load(Path(__file__).with_name(SHIPPED[name])))


@cache
def shipped_hoist(name: str) -> Hoist:
    """A hoist that ships with the package. KeyError for another name."""
    return validate(Hoist, load(Path(__file__).with_name(SHIPPED[name])))


def default_hoist() -> Hoist:
    """Engineering estimates of a pipe racker's winch."""
    return shipped_hoist("default")
