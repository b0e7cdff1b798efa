"""From what a machine does to what its log shows, and back."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from workbench.effects.active import Active
from workbench.effects.declare import Effect
from workbench.kinds import KINDS
from workbench.plants import PLANTS, Plant
from workbench.run import Array, Run


def logged_input(active: Active, time_s: Array, true: Array, values: Mapping[str, float] | None = None) -> Array:
    """The logged torque (force) for a true one, (n,); `values` by symbol where not the active ones."""
    return _through(_at(active, "torque_sensor"), active, time_s, true, values)


def true_input(active: Active, time_s: Array, logged: Array, values: Mapping[str, float] | None = None) -> Array:
    """The true torque (force) behind a logged one, (n,)."""
    return _back(reversed(_at(active, "torque_sensor")), active, time_s, logged, values)


def logged_motion(active: Active, time_s: Array, true: Array, values: Mapping[str, float] | None = None) -> Array:
    """The logged speed, angle or position of the driven coordinate for a true one, (n,)."""
    return _through(_at(active, "speed_sensor"), active, time_s, true, values)


def true_motion(active: Active, time_s: Array, logged: Array, values: Mapping[str, float] | None = None) -> Array:
    """The true speed, angle or position behind a logged one, (n,)."""
    return _back(reversed(_at(active, "speed_sensor")), active, time_s, logged, values)


def logged(run: Run, active: Active) -> Run:
    """The run as the machine's log shows it: its true signals through the sensors' effects."""
    return _changed(run, active, logged_input, logged_motion)


def true_run(run: Run, active: Active, values: Mapping[str, float] | None = None) -> Run:
    """The run behind its log: the inverse of `logged`, as far as there is one; `values` where not the active ones."""
    return _changed(run, active, true_input, true_motion, values)


def moved_by(active: Active) -> tuple[str, ...]:
    """The symbols of which the motion behind a log depends: those of the speed sensor's effects."""
    effects = _at(active, "speed_sensor")
    return tuple(effect.symbol(parameter, active.kind) for effect in effects for parameter in effect.parameters)


def _changed(run: Run, active: Active, of_input: Any, of_motion: Any, values: Mapping[str, float] | None = None) -> Run:
    if not active.sensors:
        return run
    plant = PLANTS[active.kind]
    signals = dict(run.signals)
    if plant.input in signals:
        before = signals[plant.input]
        after = signals[plant.input] = of_input(active, run.time_s, before, values)
        parts = [name for name in KINDS[active.kind].drive.parts if name in signals]
        for part in parts:  # the sum is what is off; it is shared evenly
            signals[part] = signals[part] + (after - before) / len(parts)
    for name in driven_signals(plant):
        if name in signals:
            signals[name] = of_motion(active, run.time_s, signals[name], values)
    return replace(run, signals=signals)


def driven_signals(plant: Plant) -> tuple[str, str]:
    """Position and speed of the driven coordinate."""
    return plant.positions[0], plant.speeds[0]


def _at(active: Active, place: str) -> list[Effect]:
    return [effect for effect in active.sensors if effect.place_on(active.kind) == place]


def _through(
    effects: Iterable[Effect], active: Active, time_s: Array, series: Array, values: Mapping[str, float] | None
) -> Array:
    p = SimpleNamespace(**(active.values if values is None else {**active.values, **values}))
    for effect in effects:
        series = effect.function(SimpleNamespace(time_s=time_s, value=series), effect.own(p, active.kind), p)
    return series


def _back(
    effects: Iterable[Effect], active: Active, time_s: Array, series: Array, values: Mapping[str, float] | None
) -> Array:
    p = SimpleNamespace(**(active.values if values is None else {**active.values, **values}))
    for effect in effects:
        assert effect.inverse is not None
        series = effect.inverse(SimpleNamespace(time_s=time_s, value=series), effect.own(p, active.kind), p)
    return series
