"""Machines: read with their effects checked, and given effects."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from workbench.effects import check
from workbench.face.logs import PathLike
from workbench.machines import Axis, Hoist, LinearAxis, RotaryAxis
from workbench.machines import load_machine as load

M = TypeVar("M", Hoist, LinearAxis, RotaryAxis)


def load_machine(path: PathLike) -> Hoist | Axis:
    """The machine of a machine.yaml, its effects among those that are known. InputError with file, line and remedy."""
    return load(path, check_effects=check)


def with_effects(machine: M, effects: Mapping[str, Mapping[str, float]]) -> M:
    """The machine with effects beside those that it has: name -> parameters, as the block `effects` of machine.yaml.

    InputError for an effect or a parameter that there is not, with the nearest name.
    """
    changed = machine.model_copy(update={"effects": {**machine.effects, **effects}})
    check(changed)
    return changed
