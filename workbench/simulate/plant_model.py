"""A machine's plant together with its active effects, as the kernels take them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from types import SimpleNamespace

import numpy as np

from workbench.core.run import Array
from workbench.effects import Active, of
from workbench.engine.statics import hang_still, of_each
from workbench.machines import Effects, Machine, Plant, plant_of


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

    def values(self, machine: Machine, payload_kg: float, start_time_s: float, run: str = "") -> SimpleNamespace:
        """One run's numbers by symbol: the plant's, the effects'. start_time_s: what the campaign's clock
        shows at the run's time 0; run: its name, for what is its own."""
        plain = self.plant.values(machine, payload_kg)
        return SimpleNamespace(**vars(plain), **self.active.values_of(start_time_s, run))

    def table(self, values: Sequence[SimpleNamespace] | Array) -> Array:
        """(names, scenarios)"""
        if isinstance(values, np.ndarray):
            return values
        return np.array(list(map(attrgetter(*self.names), values)), dtype=float).T

    def starts(
        self,
        at: Sequence[float],
        speeds: Sequence[float],
        times: Sequence[float],
        values: Sequence[SimpleNamespace] | Array,
    ) -> tuple[Array, Array]:
        """(states, scenarios) of loads that hang at rest or move evenly, memory last; and the inputs that hold them.

        at: heights (or positions); speeds: of the driven coordinate; times: what the run's clock shows. values: by
        symbol for each scenario, or their `table`.
        """
        table = self.table(values)
        q, hold = hang_still(self.plant, self.effects, table, at, times)
        return np.concatenate([q, self._even(at, speeds, table, [m.start for m in self.effects.memory])]), hold

    def scales(self, speed: float, values: Sequence[SimpleNamespace] | Array) -> Array:
        """(speeds and memory, scenarios): what the integration's tolerance is relative to; speed: the driven one's."""
        table = self.table(values)
        none = np.zeros(table.shape[1])
        return np.abs(self._even(none, none + speed, table, [m.scale for m in self.effects.memory]))

    def _even(
        self,
        at: Sequence[float] | Array,
        speeds: Sequence[float] | Array,
        table: Array,
        kept: Sequence[Callable[..., float]],
    ) -> Array:
        """(speeds and more, scenarios): the speeds of an even motion, and what functions of the parameters give."""
        plant, names = self.plant, self.names
        found = of_each(plant.start_of, names, table, at, speeds, traced=plant.guess is None)
        y = found[len(plant.positions) :][: len(plant.speeds)]
        return np.concatenate([y, *(of_each(one, names, table) for one in kept)])


def plant_model(machine: Machine, active: Active | None = None) -> PlantModel:
    """The machine's plant with its effects, or with `active` in place of them. InputError as `effects.of`."""
    return PlantModel(plant_of(machine), of(machine) if active is None else active)
