"""The kinds of machine there are, and which one a machine is of.

A new kind is a machine record, a plant and a module here that makes its `Kind`, each named in its table.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, TypeVar, cast

from workbench.kinds.axis import LINEAR, ROTARY
from workbench.kinds.closed_loop import ClosedLoop, TopSpeed
from workbench.kinds.hoist import KIND as HOIST
from workbench.kinds.load import Load
from workbench.kinds.record import (
    STANDSTILL_LOG_STD,
    TIME,
    BaseValue,
    CrossCheck,
    DeadLine,
    Discrepancy,
    Kind,
    Limits,
    Port,
    RigidBody,
    SignalSet,
    Table,
    Trace,
)
from workbench.kinds.sizes import Sizes
from workbench.kinds.two_inertia import KIND as TWO_INERTIA
from workbench.machine import Axis, Hoist
from workbench.plants import plant_of

AnyMachine = TypeVar("AnyMachine", bound=Hoist | Axis)
KINDS = {kind.name: kind for kind in (HOIST, LINEAR, ROTARY, TWO_INERTIA)}


def kind_of(machine: Any) -> Kind:
    """The kind that a machine record is of."""
    return KINDS[plant_of(machine).kind]


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


def of_kind(machine: Any) -> str:
    """a machine of kind 'axis', for messages."""
    return f"a machine of kind '{machine.kind}'"


__all__ = [
    "HOIST",
    "KINDS",
    "LINEAR",
    "LOOPED",
    "ROTARY",
    "STANDSTILL_LOG_STD",
    "STUDIED",
    "TIME",
    "TWO_INERTIA",
    "BaseValue",
    "ClosedLoop",
    "CrossCheck",
    "DeadLine",
    "Discrepancy",
    "Kind",
    "Limits",
    "Port",
    "RigidBody",
    "SignalSet",
    "Sizes",
    "Table",
    "TopSpeed",
    "Trace",
    "kind_of",
    "looped",
    "of_kind",
    "studied",
]
