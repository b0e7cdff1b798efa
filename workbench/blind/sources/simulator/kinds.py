"""The kinds of machine that campaigns are made of."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.blind.sources.simulator.axis.record import AXIS
from workbench.blind.sources.simulator.families import Family
from workbench.blind.sources.simulator.hoist.record import HOIST
from workbench.blind.sources.simulator.kind import Kind

KINDS: Mapping[str, Kind] = {kind.name: kind for kind in (HOIST, AXIS)}


def kind_of(family: Family) -> Kind:
    return KINDS[family.kind]
