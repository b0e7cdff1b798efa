"""A machine and its runs as its owner has them, played by a source in place of drawn ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from benchmarks.validation.content import Content, kind_of
from benchmarks.validation.families import FAMILIES, Family
from benchmarks.validation.kind import Logging, RunPlan
from workbench.blind.seal import Order

YOURS = "yours"  # the family's name
_BASED_ON = {"hoist": "hoist_middle", "axis": "axis_std"}  # its nuisances
_LAWS = ("tanh", "smooth_peak", "dahl", "lugre", "creeping")


def family_of(kind: str) -> Family:
    """What the true machine of a nominal one of this kind is drawn with: a family's nuisances, any friction law."""
    text = "a machine of the user's own"
    return replace(FAMILIES[_BASED_ON[kind]], name=YOURS, text=text, laws=_LAWS, elastic=0.0, favoured=())


@dataclass(frozen=True)
class Rig:
    """kind: hoist or axis. drawn: the nominal machine and what it does. runs: with their references. sensors: noise as
    its logs show it. effects: those that can be drawn on it. unit: of its input."""

    kind: str
    drawn: Any
    runs: tuple[RunPlan, ...]
    logging: Logging
    sensors: Mapping[str, Any]
    effects: tuple[str, ...]
    unit: str

    @property
    def family(self) -> Family:
        return family_of(self.kind)

    def content(self, seeds: Sequence[int], order: Order) -> Content:
        """A campaign of this machine: what ails it is drawn, its runs are not."""
        kind = kind_of(self.family)
        rng = np.random.default_rng([*seeds, 3])
        scales = kind.scales(self.drawn, self.runs, self.logging)
        causes = tuple(kind.causes[name](rng, scales) for name in order.names)
        return Content(order.case, self.family, self.drawn, causes, self.runs, self.logging, self.sensors)

    def said(self) -> dict[str, Any]:
        """As plain data, which `rig_from` takes."""
        own = {field.name: getattr(self.drawn, field.name) for field in fields(self.drawn) if field.name != "machine"}
        return {
            "kind": self.kind,
            "machine": self.drawn.machine.model_dump(mode="json"),
            "drawn": own,
            "runs": [asdict(run) for run in self.runs],
            "logging": asdict(self.logging),
            "sensors": dict(self.sensors),
            "effects": list(self.effects),
            "unit": self.unit,
        }


def rig_from(said: Mapping[str, Any]) -> Rig:
    """The rig that `Rig.said` said."""
    kind = said["kind"]
    drawn = kind_of(family_of(kind)).rebuilt(said["machine"], said["drawn"])
    lists = [{"reference": run["reference"], "logs": run.get("logs", ())} for run in said["runs"]]
    own = [{key: None if values is None else tuple(values) for key, values in one.items()} for one in lists]
    runs = tuple(RunPlan(**{**run, **more}) for run, more in zip(said["runs"], own, strict=True))
    logging = Logging(**{**said["logging"], "logs": tuple(said["logging"]["logs"])})
    return Rig(kind, drawn, runs, logging, said["sensors"], tuple(said["effects"]), said["unit"])
