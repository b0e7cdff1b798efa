"""A machine's plant together with its active effects, as the kernels take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from types import SimpleNamespace

import numpy as np

from workbench.core.run import Array
from workbench.effects import Active, of
from workbench.engine.statics import hang_still
from workbench.machines import Axis, Effects, Hoist, Plant, plant_of


@dataclass(frozen=True, eq=False)
class PlantModel:
    """plant: without effects; active: the effects. Without effects the results are bit for bit the plant's own."""

    plant: Plant
    active: Active

    @property
    def effects(self) -> Effects:
        return self.active.effects

    @property
    def names(self) -> tuple[str, ...]:
        """The rows of the kernels' parameters."""
        return (*self.plant.parameters, *self.effects.parameters)

    def values(self, machine: Hoist | Axis, payload_kg: float, start_time_s: float, run: str = "") -> SimpleNamespace:
        """One run's numbers by symbol: the plant's, the effects'. start_time_s: what the campaign's clock
        shows at the run's time 0; run: its name, for what is its own."""
        plain = self.plant.values(machine, payload_kg)
        return SimpleNamespace(**vars(plain), **self.active.values_of(start_time_s, run))

    def table(self, values: Sequence[SimpleNamespace]) -> Array:
        """(names, scenarios)"""
        return np.array(list(map(attrgetter(*self.names), values)), dtype=float).T

    def starts(
        self,
        at: Sequence[float],
        speeds: Sequence[float],
        times: Sequence[float],
        values: Sequence[SimpleNamespace],
    ) -> tuple[Array, Array]:
        """(states, scenarios) of loads that hang at rest or move evenly, memory last; and the inputs that hold them.

        at: heights (or positions); speeds: of the driven coordinate; times: what the run's clock shows.
        """
        q, hold = hang_still(self.plant, self.effects, values, at, times)
        y = np.array([self.plant.start_of(x, w, p)[1] for x, w, p in zip(at, speeds, values, strict=True)]).T
        kept = [[m.start(p) for p in values] for m in self.effects.memory]
        return _stacked(q, y, kept), hold

    def scales(self, speed: float, values: Sequence[SimpleNamespace]) -> Array:
        """(speeds and memory, scenarios): what the integration's tolerance is relative to; speed: the driven one's."""
        y = np.array([np.abs(self.plant.start_of(0.0, speed, p)[1]) for p in values]).T
        return _stacked(y, [[m.scale(p) for p in values] for m in self.effects.memory])


def _stacked(*parts: Array | list[list[float]]) -> Array:
    return np.concatenate([np.asarray(part, dtype=float) for part in parts if len(part)])


def plant_model(machine: Hoist | Axis, active: Active | None = None) -> PlantModel:
    """The machine's plant with its effects, or with `active` in place of them. InputError as `effects.of`."""
    return PlantModel(plant_of(machine), of(machine) if active is None else active)
