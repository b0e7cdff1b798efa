"""The simulators of hoists and axes as a source of campaigns."""

from __future__ import annotations

from workbench.blind.sources.simulator.families import FAMILIES
from workbench.blind.sources.simulator.kinds import kind_of
from workbench.blind.sources.source import Source

SOURCE = Source("simulator", tuple(FAMILIES), kind_of, lambda content: content)
