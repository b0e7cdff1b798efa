"""The hoist, one compiled step at a time, with faults that may be set between two steps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.control import lag_step
from workbench.control.events import BRAKE_SPEED
from workbench.effects import Active, Effect, alone, find, joined, sizes_of
from workbench.engine.live import LiveStep
from workbench.engine.source import LAG
from workbench.errors import InputError, nearest
from workbench.kinds import STUDIED, of_kind, studied
from workbench.machine import Axis, Hoist
from workbench.plants import HOIST, Effects
from workbench.simulate.loop import BOUNDLESS, RAIL_PLAY, torque_limits
from workbench.simulate.plant_model import PlantModel
from workbench.trace.expr import Scalar, clip

LONGEST_STEP_S = 0.001
BRAKE_TORQUES = 2.0  # of all motors' nominal torque together: what the brake holds where nothing else is said

SIGNALS = tuple(signal.name for signal in HOIST.signals)


def _brake(s: Any, p: Any) -> Scalar:
    """Friction of the closed brake on the motor shaft, against its motion, linear around standstill."""
    return -(p.brake_closed * p.T_brake * clip(s.w / BRAKE_SPEED, -1.0, 1.0))


def _slack(s: Any, p: Any) -> Scalar:
    """Wire that came off the drum: the drum has taken in that much less."""
    return -p.slack_m


_FAULTS = Effects(
    {"motor_torque_nm": [_brake], "wound_length_m": [_slack]}, ("brake_closed", "T_brake", "slack_m", *LAG)
)


def _vanished(machine: Hoist, names: Sequence[str]) -> dict[str, dict[str, float]]:
    """Effects that the machine does not have, at the values where they vanish."""
    ready = {}
    for name in names:
        effect = find(name, HOIST.kind)
        if effect.on_sensor:
            raise InputError(f"'{name}' acts on the log's sensors, not on the plant", place="ready")
        if name not in machine.effects:
            ranges = effect.ranges(sizes_of(machine))
            ready[name] = {amount.name: amount.vanishes_at for amount in ranges if amount.vanishes_at is not None}
    return ready


class LivePlant:
    """A hoist that hangs still until it is stepped. All numbers SI; hoisting positive.

    The machine's own effects are at work; those named in `ready` are in the compiled step too, at the values where they
    vanish, and may be set while the plant runs. InputError for what cannot be.
    """

    def __init__(
        self,
        machine: Hoist | Axis,
        step_s: float,
        payload_kg: float = 0.0,
        start_position_m: float | None = None,
        ready: Sequence[str] = (),
    ) -> None:
        hoist = studied(machine)
        if hoist is None:
            raise InputError(f"is {of_kind(machine)}; {STUDIED} is served", place="kind")
        self.machine = machine = hoist
        low, high = machine.rail.lowest_position_m, machine.highest_position_m
        at = 0.5 * (low + high) if start_position_m is None else start_position_m
        if not low <= at <= high:
            raise InputError(f"{at:g} m, expected {low:g} to {high:g} m, the rail", place="start_position_m")
        if not (math.isfinite(payload_kg) and payload_kg >= 0.0):
            raise InputError(f"{payload_kg:g} kg, expected 0 or more", place="payload_kg")
        self._start, self._start_payload_kg = at, payload_kg
        self._dt, self._substeps = step_s, max(1, math.ceil(step_s / LONGEST_STEP_S - 1e-9))
        made = alone(machine, _vanished(machine, ready))
        active = Active(HOIST.kind, made.effects, made.values)
        self.effects: Mapping[str, Effect] = {effect.id: effect for effect in made.chosen}
        self.left_out = made.sensors_left_out
        self._effects = joined(active.effects, _FAULTS)
        self._model = PlantModel(HOIST, active)
        self._starts = active.values_of(0.0)
        self._limits = torque_limits(machine)
        names = (*HOIST.parameters, *self._effects.parameters)
        self._place = {name: i for i, name in enumerate(names)}
        self._step = LiveStep(HOIST, self._effects, names, SIGNALS)
        self.reset()

    def reset(self) -> None:
        """Hanging still at the start, no fault, time 0."""
        machine = self.machine
        values: dict[str, float] = {**vars(HOIST.values(machine, self._start_payload_kg)), **self._starts}
        state, hold = self._model.starts([self._start], [0.0], [0.0], [SimpleNamespace(**values)])
        self.hold_nm = float(hold[0])
        lag = lag_step(machine.drive.torque_lag_s, self._dt / self._substeps)
        strong = BRAKE_TORQUES * machine.motor.count * machine.motor.nominal_torque_nm
        values |= {"lag_left": lag.left, "lag_start": lag.start, "lag_slope": lag.slope_per_s}
        values |= {"brake_closed": 0.0, "T_brake": strong, "slack_m": 0.0}
        self._values = np.array([values[name] for name in self._place])
        self._state = np.ascontiguousarray(state[:, 0])
        self._steps = 0
        self.motor_lost = False
        self.torque_nm = self.hold_nm
        self.limited = False
        self._changed = True
        # What is seen before the first step: a step of hardly any length.
        self._step.numbers(self._values)
        self._step.step(0.0, 1e-9, 1, self.hold_nm, self._state.copy(), self.hold_nm)
        self._signals = self._step.shown.copy()

    @property
    def time_s(self) -> float:
        return self._steps * self._dt

    @property
    def signals(self) -> Mapping[str, float]:
        """The plant's signals by name, as of the last step."""
        return dict(zip(SIGNALS, self._signals.tolist(), strict=True))

    @property
    def slack(self) -> bool:
        return float(self._signals[SIGNALS.index("tension_min_n")]) <= 0.0

    @property
    def off_rail(self) -> bool:
        height = float(self._signals[SIGNALS.index("position_carriage_m")])
        return (
            not self.machine.rail.lowest_position_m - RAIL_PLAY
            <= height
            <= (self.machine.highest_position_m + RAIL_PLAY)
        )

    @property
    def bounded(self) -> bool:
        return bool(np.all(np.abs(self._state) < BOUNDLESS))

    def step(self, torque_nm: float) -> None:
        """One step under a torque of all motors, as far as the drive can give it; see `torque_limits`."""
        if self._changed:
            self._step.numbers(self._values)
            self._changed = False
        speed = abs(float(self._signals[0]))
        limit = self._limits["u_one" if self.motor_lost else "u_all"]
        if speed > self._limits["w_weak"]:
            limit *= self._limits["w_weak"] / speed
        held = min(max(torque_nm, -limit), limit)
        self.limited = held != torque_nm
        self.torque_nm = self._step.step(self.time_s, self._dt, self._substeps, held, self._state, self.torque_nm)
        self._signals[:] = self._step.shown
        self._steps += 1

    # Faults, from the next step on.

    def close_brake(self, closed: bool) -> None:
        self._put("brake_closed", 1.0 if closed else 0.0)

    @property
    def brake_closed(self) -> bool:
        return bool(self._values[self._place["brake_closed"]] > 0.5)

    @property
    def payload_kg(self) -> float:
        return float(self._values[self._place["m_p"]])

    def carry(self, payload_kg: float) -> None:
        self._put("m_p", payload_kg)

    @property
    def slack_m(self) -> float:
        return float(self._values[self._place["slack_m"]])

    def let_out(self, slack_m: float) -> None:
        self._put("slack_m", slack_m)

    def effect_value(self, name: str, parameter: str) -> float:
        return float(self._values[self._place[self._symbol(name, parameter)]])

    def set_effect(self, name: str, parameter: str, value: float) -> None:
        """InputError for an unknown name, with the nearest, and for an impossible value."""
        symbol = self._symbol(name, parameter)
        self.effects[name].check(parameter, value, HOIST.kind)
        self._put(symbol, value)

    def effect_parameters(self, name: str) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.effects[name].ranges(sizes_of(self.machine)))

    def _symbol(self, name: str, parameter: str) -> str:
        if name not in self.effects:
            raise InputError(f"unknown effect '{name}'; {nearest(name, self.effects)}")
        ranges = {known.name: known.symbol for known in self.effects[name].ranges(sizes_of(self.machine))}
        if parameter not in ranges:
            raise InputError(f"effect '{name}' has no parameter '{parameter}'; {nearest(parameter, ranges)}")
        return ranges[parameter]

    def _put(self, name: str, value: float) -> None:
        self._values[self._place[name]] = value
        self._changed = True
