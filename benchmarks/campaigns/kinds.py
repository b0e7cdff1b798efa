"""The kinds of machine that campaigns are made of."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.campaigns.axis.record import AXIS
from benchmarks.campaigns.families import Family
from benchmarks.campaigns.hoist.record import HOIST
from benchmarks.campaigns.kind import Kind

KINDS: Mapping[str, Kind] = {kind.name: kind for kind in (HOIST, AXIS)}


def kind_of(family: Family) -> Kind:
    return KINDS[family.kind]
