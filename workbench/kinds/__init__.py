"""The kinds of machine there are, and which one a machine is of.

A new kind is a machine record, a plant and a module here that makes its `Kind`, each named in its table.
"""

from __future__ import annotations

from typing import Any, cast

from workbench.kinds.axis import LINEAR, ROTARY
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
from workbench.machine import Hoist
from workbench.plants import plant_of

KINDS = {kind.name: kind for kind in (HOIST, LINEAR, ROTARY, TWO_INERTIA)}


def kind_of(machine: Any) -> Kind:
    """The kind that a machine record is of."""
    return KINDS[plant_of(machine).kind]


def load_of(machine: Any, payload_kg: float) -> Load | None:
    """The load as references that know their machine take it; None for a kind without one."""
    load = kind_of(machine).load
    return None if load is None else load(machine, payload_kg)


STUDIED = " or ".join(f"kind '{kind.plant.kind}'" for kind in KINDS.values() if kind.studies)


def studied(machine: Any) -> Hoist | None:
    """The machine, where studies, loop, tune and the drawing are for its kind; else None."""
    return cast(Hoist, machine) if kind_of(machine).studies else None


def of_kind(machine: Any) -> str:
    """a machine of kind 'axis', for messages."""
    return f"a machine of kind '{machine.kind}'"


__all__ = [
    "HOIST",
    "KINDS",
    "LINEAR",
    "ROTARY",
    "STANDSTILL_LOG_STD",
    "STUDIED",
    "TIME",
    "TWO_INERTIA",
    "BaseValue",
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
    "Trace",
    "kind_of",
    "of_kind",
    "studied",
]
