"""The kinds of machine there are, and which one a machine is of.

A new kind is one module here: machine.yaml's record, the equations, and what the workbench asks of the kind. It is
found by its `Kind`; nothing else has to be edited.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, TypeVar, cast

from workbench.core.declared import library
from workbench.machines.declare import Kind, Load
from workbench.machines.kinds.axis import LINEAR, ROTARY, Axis
from workbench.machines.kinds.hoist import KIND as HOIST
from workbench.machines.kinds.hoist import Hoist
from workbench.machines.plant import Plant

Machine = Hoist | Axis
AnyMachine = TypeVar("AnyMachine", bound=Machine)


# Those of full studies first.
KINDS = {kind.name: kind for kind in sorted(library(__name__, Kind), key=lambda kind: not kind.studies)}
PLANTS = {name: kind.plant for name, kind in KINDS.items()}
PLACES = {place: meaning for plant in PLANTS.values() for place, meaning in plant.places.items()}


def kind_of(machine: Any) -> Kind:
    """The kind that a machine record is of."""
    return KINDS[machine.kind if machine.kind in KINDS else f"{machine.kind}-{machine.motion}"]


def plant_of(machine: Any) -> Plant:
    """The plant that a machine record describes."""
    return kind_of(machine).plant


def load_of(machine: Any, payload_kg: float) -> Load | None:
    """The load as references that know their machine take it; None for a kind without one."""
    kind = kind_of(machine)
    load = None if kind.load is None else kind.load(machine, payload_kg)
    top = math.inf if kind.closed_loop is None else kind.looped.top_speed(machine).speed
    return load if load is None or math.isinf(top) else replace(load, top_speed_m_s=top)


LOOPED = " or ".join(f"kind '{kind.plant.kind}'" for kind in KINDS.values() if kind.closed_loop is not None)
STUDIED = " or ".join(f"kind '{kind.plant.kind}'" for kind in KINDS.values() if kind.studies)


def studied(machine: Any) -> Hoist | None:
    """The machine, where the drawing, the multi-body model, the served plant and exported controllers are for its kind;
    else None."""
    return cast(Hoist, machine) if kind_of(machine).studies else None


def looped(machine: AnyMachine) -> AnyMachine | None:
    """The machine, where studies, loop and tune are for its kind; else None."""
    return machine if kind_of(machine).closed_loop is not None else None


def kind_named(name: str) -> Kind:
    """What a pickle of a kind holds is its name."""
    return KINDS[name]


def of_kind(machine: Any) -> str:
    """a machine of kind 'axis', for messages."""
    return f"a machine of kind '{machine.kind}'"
