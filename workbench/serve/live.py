"""A machine, one compiled step at a time, with numbers that may be set between two steps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace

import numpy as np

from workbench.control import lag_step
from workbench.effects import Active, Effect, alone, find, joined, sizes_of
from workbench.engine.source import LAG
from workbench.engine.stepped import LiveStep
from workbench.errors import InputError, nearest
from workbench.kinds import kind_of
from workbench.machine import Axis, Hoist
from workbench.plants import Effects
from workbench.simulate.loop import BOUNDLESS
from workbench.simulate.plant_model import PlantModel


class LiveMachine:
    """A machine that stands still until it is stepped. All numbers SI; hoisting, or forward, positive.

    The machine's own effects are at work; those named in `ready` are in the compiled step too, at the values where they
    vanish, and may be set while it runs. hold: the input that holds it at the start without friction's help; at_work:
    the input behind limits and lag; both in the input's unit. A drive's lag is at work where `lag_s` is more than 0.
    """

    has_brake = False
    carries = False  # a payload, which may change

    def __init__(
        self,
        machine: Hoist | Axis,
        step_s: float,
        payload_kg: float,
        start: float,
        ready: Sequence[str],
        *,
        longest_step_s: float,
        faults: Effects,
        lag_s: float = 0.0,
    ) -> None:
        """longest_step_s: of the integration. faults: effects that are no part of the library. InputError for what
        cannot be."""
        self.machine, self.kind = machine, kind_of(machine)
        self.plant = self.kind.plant
        self._start, self._start_payload_kg, self._lag_s = start, payload_kg, lag_s
        self._dt, self._substeps = step_s, max(1, math.ceil(step_s / longest_step_s - 1e-9))
        made = alone(machine, self._vanished(ready))
        active = Active(self.plant.kind, made.effects, made.values)
        self.effects: Mapping[str, Effect] = {effect.id: effect for effect in made.chosen}
        self.left_out = made.sensors_left_out
        self._effects = joined(active.effects, faults)
        self._model = PlantModel(self.plant, active)
        self._starts = active.values_of(0.0)
        names = (*self.plant.parameters, *self._effects.parameters)
        self._place = {name: i for i, name in enumerate(names)}
        self.shown = tuple(signal.name for signal in self.plant.signals)
        self._step = LiveStep(self.plant, self._effects, names, self.shown)
        self.reset()

    def _vanished(self, names: Sequence[str]) -> dict[str, dict[str, float]]:
        """Effects that the machine does not have, at the values where they vanish."""
        ready = {}
        for name in names:
            effect = find(name, self.plant.kind)
            if effect.on_sensor:
                raise InputError(f"'{name}' acts on the log's sensors, not on the plant", place="ready")
            if name not in self.machine.effects:
                ranges = effect.ranges(sizes_of(self.machine))
                ready[name] = {amount.name: amount.vanishes_at for amount in ranges if amount.vanishes_at is not None}
        return ready

    def _more_values(self) -> dict[str, float]:
        """Of the faults, at the start."""
        return {}

    def reset(self) -> None:
        """Standing still at the start, no fault, time 0."""
        values: dict[str, float] = {**vars(self.plant.values(self.machine, self._start_payload_kg)), **self._starts}
        state, hold = self._model.starts([self._start], [0.0], [0.0], [SimpleNamespace(**values)])
        self.hold = float(hold[0])
        lag = lag_step(self._lag_s, self._dt / self._substeps)
        values |= dict(zip(LAG, (lag.left, lag.start, lag.slope_per_s), strict=True)) | self._more_values()
        self._values = np.array([values[name] for name in self._place])
        self._state = np.ascontiguousarray(state[:, 0])
        self._steps = 0
        self.motor_lost = False
        self.at_work = self.hold
        self.limited = False
        self._changed = True
        # What is seen before the first step: a step of hardly any length.
        self._step.numbers(self._values)
        self._step.step(0.0, 1e-9, 1, self.hold, self._state.copy(), self.hold)
        self._signals = self._step.shown.copy()

    @property
    def hold_nm(self) -> float:
        """Of a hoist: the torque of all motors that holds the load at the start, N m."""
        return self.hold

    @property
    def torque_nm(self) -> float:
        """Of a hoist: the torque of all motors at work, N m."""
        return self.at_work

    @property
    def time_s(self) -> float:
        return self._steps * self._dt

    @property
    def signals(self) -> Mapping[str, float]:
        """The plant's signals by name, as of the last step."""
        return dict(zip(self.shown, self._signals.tolist(), strict=True))

    @property
    def slack(self) -> bool:
        return False

    @property
    def off_rail(self) -> bool:
        return False

    @property
    def bounded(self) -> bool:
        return bool(np.all(np.abs(self._state) < BOUNDLESS))

    def limit(self) -> float:
        """The largest input that the drive gives now."""
        return math.inf

    def step(self, asked: float) -> None:
        """One step under an input, as far as the drive can give it."""
        if self._changed:
            self._step.numbers(self._values)
            self._changed = False
        limit = self.limit()
        held = min(max(asked, -limit), limit)
        self.limited = held != asked
        self.at_work = self._step.step(self.time_s, self._dt, self._substeps, held, self._state, self.at_work)
        self._signals[:] = self._step.shown
        self._steps += 1

    # What may be set, from the next step on.

    def lose_motor(self, lost: bool) -> None:
        """One motor gives no torque, or gives it again."""
        self.motor_lost = lost

    def close_brake(self, closed: bool) -> None:
        """Nothing, where there is no brake."""

    @property
    def brake_closed(self) -> bool:
        return False

    @property
    def payload_kg(self) -> float:
        return 0.0

    def effect_value(self, name: str, parameter: str) -> float:
        return float(self._values[self._place[self._symbol(name, parameter)]])

    def set_effect(self, name: str, parameter: str, value: float) -> None:
        """InputError for an unknown name, with the nearest, and for an impossible value."""
        symbol = self._symbol(name, parameter)
        self.effects[name].check(parameter, value, self.plant.kind)
        self._put(symbol, value)

    def effect_parameters(self, name: str) -> tuple[str, ...]:
        return tuple(amount.name for amount in self.effects[name].ranges(sizes_of(self.machine)))

    def _symbol(self, name: str, parameter: str) -> str:
        if name not in self.effects:
            raise InputError(f"unknown effect '{name}'; {nearest(name, self.effects)}")
        ranges = {amount.name: amount.symbol for amount in self.effects[name].ranges(sizes_of(self.machine))}
        if parameter not in ranges:
            raise InputError(f"effect '{name}' has no parameter '{parameter}'; {nearest(parameter, ranges)}")
        return ranges[parameter]

    def _put(self, name: str, value: float) -> None:
        self._values[self._place[name]] = value
        self._changed = True
