"""The machines' physics by kind: pure functions on scalars, no files, no clock."""

from __future__ import annotations

from typing import Any

from workbench.kinds import KINDS, kind_of
from workbench.kinds.hoist import HOIST
from workbench.kinds.plant import NO_EFFECTS, Effects, Memory, Output, Plant
from workbench.kinds.two_inertia import TWO_INERTIA

PLANTS = {name: kind.plant for name, kind in KINDS.items()}
PLACES = {place: meaning for plant in PLANTS.values() for place, meaning in plant.places.items()}


def plant_of(machine: Any) -> Plant:
    """The plant that a machine record describes."""
    return kind_of(machine).plant


__all__ = ["HOIST", "NO_EFFECTS", "PLACES", "PLANTS", "TWO_INERTIA", "Effects", "Memory", "Output", "Plant", "plant_of"]
