"""A machine's numbers under dotted names: guide.coulomb_hoisting_n."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeVar, cast

from pydantic import BaseModel, ValidationError

from workbench.core.errors import InputError, nearest
from workbench.core.yaml_strict import dotted, problem_lines
from workbench.machines.kinds.axis import Axis
from workbench.machines.kinds.hoist import Hoist

AnyMachine = TypeVar("AnyMachine", bound=Hoist | Axis)
_NOT_VALUES = ("format", "identified", "measured_correction", "log")


def value_names(machine: Hoist | Axis) -> tuple[str, ...]:
    """Dotted names of all numbers a machine carries, tolerances and effects included, in file order."""
    return tuple(name for name, value in _leaves(machine, "") if isinstance(value, float | int))


def get_value(machine: Hoist | Axis, name: str) -> float:
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
        block, parts = data, name.split(".")
        for part in parts[:-1]:
            block = block[part]
        whole = isinstance(block[parts[-1]], int) and float(value).is_integer()
        block[parts[-1]] = int(value) if whole else float(value)
    return _checked(machine, data)


def with_correction(
    machine: AnyMachine,
    over: str,
    acts_on: str,
    at: Iterable[float],
    forward: Iterable[float],
    backward: Iterable[float],
) -> AnyMachine:
    """The machine with a measured correction in place of what it has; see `MeasuredCorrection`.

    forward, backward: in N where it acts on a guide or a linear axis, else in N m. InputError as for a file.
    """
    unit = type(machine).CORRECTION.UNITS.get(acts_on, "n")  # an impossible place is refused below
    table = {"at": at, f"forward_{unit}": forward, f"backward_{unit}": backward}
    numbers = {name: tuple(float(value) for value in values) for name, values in table.items()}
    data = machine.model_dump() | {"measured_correction": {"over": over, "acts_on": acts_on, **numbers}}
    return _checked(machine, data)


def _checked(machine: AnyMachine, data: dict[str, Any]) -> AnyMachine:
    try:
        return cast(AnyMachine, type(machine).model_validate(data))
    except ValidationError as error:
        place, problem = problem_lines(type(machine), error, data)[0]
        raise InputError(problem, place=dotted(place) or None) from error


def _unknown(machine: Hoist | Axis, name: str) -> InputError:
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
