"""A scenario that stands alone: read without touching any other file, written without needing one.

For scenarios that come from elsewhere, such as an upload: what they name is not looked for on this computer.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from workbench.errors import InputError
from workbench.machine import SHIPPED, Axis, Hoist, default_hoist, shipped
from workbench.study.scenario.layers import layer_of, read_layers, together
from workbench.study.scenario.load import planned, scenario_of
from workbench.study.scenario.record import Scenario
from workbench.yaml_strict import Document, dotted, dumps, problem_lines

_NOT_VALUES = ("format", "kind", "drive", "effects", "identified")


def read_standalone(
    document: Document, machine: Hoist | Axis | None = None, known: Mapping[str, Path] | None = None
) -> Scenario:
    """The scenario of a document, checked on its machine as `workbench study` checks it.

    machine: stands for the machine that the scenario names. known: file name -> scenario that it may extend, those
    that ship. InputError, with the line, for whatever is wrong with it, and for what it takes from other files:
    `extends`, recorded references, a machine where none is given.
    """
    layers = layer_of(document)
    if (extended := layers.data.pop("extends", None)) is not None:
        base = (known or {}).get(str(extended).rpartition("/")[2])
        if base is None:
            there = f"one that stands alone or extends one of {', '.join(known)}" if known else "one that stands alone"
            raise layers.error(f"another file, which is not here; expected a scenario, {there}", ("extends",))
        layers = together(layers.file, [layers, read_layers(base)])
    scenario = scenario_of(layers)
    for number, reference in enumerate(scenario.references):
        if not isinstance(reference, str):
            raise layers.error("a recorded campaign, which is not here", ("references", number))
    if scenario.machine not in SHIPPED and machine is None:
        said = f"{scenario.machine!r} is another file, which is not here; choose that machine first, or write 'default'"
        raise layers.error(said, ("machine",))
    planned(scenario, machine or shipped(scenario.machine), {}, layers)
    return scenario


def changed(scenario: Scenario, changes: Mapping[str, Any]) -> Scenario:
    """The scenario with other values at its top level, checked like a file. InputError names the key."""
    data = scenario.model_dump() | dict(changes)
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        place, problem = problem_lines(Scenario, error, data)[0]
        raise InputError(problem, place=dotted(place) or None) from error


def standalone_text(scenario: Scenario, machine: Hoist) -> str:
    """The scenario on this machine as YAML that needs no other file: the machine's own values are overrides.

    Reading it gives the same runs. What an empty block or a missing value says is left out.
    """
    data = scenario.model_dump(mode="json", exclude={"extends"}, exclude_none=True)
    data["machine"] = "default"
    data["machine_overrides"] = _differing(machine) | dict(scenario.machine_overrides)
    drive = {key: value for key, value in machine.drive.model_dump().items() if value != _default_drive()[key]}
    data["drive"] = drive | (data.get("drive") or {})
    data["effects"] = {name: dict(values) for name, values in machine.effects.items()} | scenario.effects
    data["limits"] = {key: value for key, value in data["limits"].items() if value != {}}
    return dumps({key: value for key, value in data.items() if value not in ({}, "")})


def _default_drive() -> dict[str, Any]:
    return default_hoist().drive.model_dump()


def _differing(machine: Hoist) -> dict[str, Any]:
    """Dotted name -> value of what is not as in the default machine; drive and effects have blocks of their own."""
    default = _leaves(default_hoist().model_dump(exclude=set(_NOT_VALUES)))
    own = _leaves(machine.model_dump(exclude=set(_NOT_VALUES)))
    return {name: value for name, value in own.items() if value != default[name]}


def _leaves(data: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    leaves: dict[str, Any] = {}
    for key, value in data.items():
        leaves |= _leaves(value, f"{prefix}{key}.") if isinstance(value, Mapping) else {f"{prefix}{key}": value}
    return leaves
