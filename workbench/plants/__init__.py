"""The machines' physics: pure functions on scalars, no files, no clock.

A new plant is one file that makes a `Plant`, and a line in the table below.
"""

from __future__ import annotations

from typing import Any

from workbench.plants.axis import AXIS_LINEAR, AXIS_ROTARY
from workbench.plants.base import NO_EFFECTS, Effects, Memory, Output, Plant
from workbench.plants.hoist import HOIST
from workbench.plants.two_inertia import TWO_INERTIA

PLANTS = {plant.kind: plant for plant in (HOIST, AXIS_LINEAR, AXIS_ROTARY, TWO_INERTIA)}
PLACES = {place: meaning for plant in PLANTS.values() for place, meaning in plant.places.items()}


def plant_of(machine: Any) -> Plant:
    """The plant that a machine record describes."""
    kind = machine.kind if machine.kind in PLANTS else f"{machine.kind}-{machine.motion}"
    return PLANTS[kind]


__all__ = ["NO_EFFECTS", "PLACES", "PLANTS", "Effects", "Memory", "Output", "Plant", "plant_of"]
