"""The served machines, one compiled step at a time: an axis, and the hoist behind its drive, brake and faults."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import cast

import numpy as np

from workbench.control import lag_step
from workbench.control.events import BRAKE_TORQUES, SWITCHED_BRAKE
from workbench.core.errors import InputError, check_known
from workbench.effects import Effect, find, sizes_of
from workbench.effects.active import Active, alone, joined, longest_step_s
from workbench.engine.source import LAG
from workbench.engine.stepped import LiveStep
from workbench.machines import HOIST, Effects, Hoist, Machine, kind_of, of_kind
from workbench.simulate.loop import BOUNDLESS, RAIL_PLAY, PlantModel, kept_by_others, torque_limits

HOIST_STEP_S, AXIS_STEP_S = 0.001, 0.0002  # of the integration: an axis' friction turns over more sharply
# What is taken from a client, of what the machine can bear; more is no order but a fault of the line.
MOST_INPUT, MOST_PAYLOAD, MOST_EFFECT = 100.0, 3.0, 10.0
STRONGEST = 1e9  # N or N m, where machine.yaml states no limit: docs/bounds.md


class LiveMachine:
    """A machine that stands still until it is stepped. All numbers SI; hoisting, or forward, positive.

    The machine's own effects are at work; those named in `ready` are compiled in too, at the values where they vanish,
    and may be set between two steps. hold: the input that holds it at the start without friction's help; at_work: the
    input behind limits and lag; both in the input's unit. A state that is not finite is never shown: the machine stays
    where it was and is no longer `bounded`. An axis has no drive, brake or payload: its input is at work as it is.
    """

    carries = has_brake = False
    slack = off_rail = overloaded = False
    longest_step_s, faults, lag_s = AXIS_STEP_S, Effects(parameters=LAG), 0.0

    def __init__(
        self, machine: Machine, step_s: float, payload_kg: float = 0.0, start: float | None = None,
        ready: Sequence[str] = (),
    ) -> None:  # fmt: skip
        """start: m or rad. InputError for what cannot be."""
        self.machine, self.kind = machine, kind_of(machine)
        self.plant = self.kind.plant
        self._start, self._start_payload_kg = self._begins_at(start, payload_kg), payload_kg
        self._sizes = sizes_of(machine)
        settable = self._vanished(ready)
        longest_s = min(self.longest_step_s, longest_step_s(machine, settable))
        self._dt, self._substeps = step_s, max(1, math.ceil(step_s / longest_s - 1e-9))
        made = alone(machine, settable)
        active = Active(self.plant.kind, made.effects, made.values)
        self.effects: Mapping[str, Effect] = {effect.id: effect for effect in made.chosen}
        self.left_out = made.sensors_left_out
        effects = joined(active.effects, self.faults)
        self._model, self._starts = PlantModel(self.plant, active), active.values_of(0.0)
        names = (*self.plant.parameters, *effects.parameters)
        self._place = {name: i for i, name in enumerate(names)}
        self.shown = tuple(signal.name for signal in self.plant.signals)
        self._step = LiveStep(self.plant, effects, names, self.shown)
        self.reset()

    def _begins_at(self, start: float | None, payload_kg: float) -> float:
        if payload_kg != 0.0:
            raise InputError(f"{payload_kg:g} kg; {of_kind(self.machine)} carries no payload", place="payload_kg")
        if start is not None and not math.isfinite(start):
            raise InputError(f"{start:g}, expected a finite number", place="start_position_m")
        return start or 0.0

    def _vanished(self, names: Sequence[str]) -> dict[str, dict[str, float]]:
        """Effects that the machine does not have, at the values where they vanish."""
        ready = {}
        for name in names:
            effect = find(name, self.plant.kind)
            if effect.on_sensor:
                raise InputError(f"'{name}' acts on the log's sensors, not on the plant", place="ready")
            if name not in self.machine.effects:
                ranges = effect.ranges(self._sizes)
                ready[name] = {amount.name: amount.vanishes_at for amount in ranges if amount.vanishes_at is not None}
        return ready

    def _fault_values(self) -> dict[str, float]:
        """Of the faults, at the start."""
        return {}

    def reset(self) -> None:
        """Standing still at the start, no fault, time 0."""
        values = {**vars(self.plant.values(self.machine, self._start_payload_kg)), **self._starts}
        state, hold = self._model.starts([self._start], [0.0], [0.0], [SimpleNamespace(**values)])
        self.hold = float(hold[0])
        lag = lag_step(self.lag_s, self._dt / self._substeps)
        values |= dict(zip(LAG, (lag.left, lag.start, lag.slope_per_s), strict=True)) | self._fault_values()
        self._values = np.array([values[name] for name in self._place])
        self._state = np.ascontiguousarray(state[:, 0])
        self._steps = 0
        self.at_work = self.hold
        self.motor_lost = self.limited = self.overloaded = False
        self.bounded = self._changed = True
        # What is seen before the first step: a step of hardly any length.
        self._step.numbers(self._values)
        self._step.step(0.0, 1e-9, 1, self.hold, self._state.copy(), self.hold)
        self._signals = self._step.shown.copy()

    @property
    def time_s(self) -> float:
        return self._steps * self._dt

    @property
    def signals(self) -> Mapping[str, float]:
        """The plant's signals by name, as of the last step."""
        return dict(zip(self.shown, self._signals.tolist(), strict=True))

    def signal(self, name: str) -> float:
        return float(self._signals[self.shown.index(name)])

    def limit(self) -> float:
        """The largest input that the drive gives now."""
        return math.inf

    def most_input(self) -> float:
        """The largest input that is taken as one."""
        return STRONGEST

    def step(self, asked: float) -> None:
        """One step under an input, as far as the drive can give it."""
        if self._changed:
            self._step.numbers(self._values)
            self._changed = False
        limit = self.limit()
        held = min(max(asked, -limit), limit)
        before = self._state.copy()
        at_work = self._step.step(self.time_s, self._dt, self._substeps, held, self._state, self.at_work)
        if not (np.all(np.abs(self._state) < BOUNDLESS) and np.isfinite(self._step.shown).all()):
            self._state[:] = before
            self.bounded = False
            return
        self.limited, self.at_work = held != asked, at_work
        self._signals[:] = self._step.shown
        self._steps += 1

    # What may be set, from the next step on.

    def value(self, symbol: str) -> float:
        """A number of the equations; 0 for one that they do not have."""
        return float(self._values[self._place[symbol]]) if symbol in self._place else 0.0

    def put(self, symbol: str, value: float) -> None:
        """Sets a number of the equations; one that they do not have is left alone."""
        if symbol in self._place:
            self._values[self._place[symbol]] = value
            self._changed = True

    def lose_motor(self, lost: bool) -> None:
        """One motor gives no torque, or gives it again."""
        if lost and not self.motor_lost and self.lag_s > 0.0:  # its torque is gone at once, the others' rises
            self.at_work *= kept_by_others(cast(Hoist, self.machine))
        self.motor_lost = lost

    def effect_parameters(self, name: str) -> dict[str, tuple[str, float, float]]:
        """The parameters of an effect: symbol, and the range that is taken from a client: MOST_EFFECT times what the
        library searches, and whatever value the machine has. InputError for an unknown effect, with the nearest."""
        check_known("unknown effect", name, self.effects)
        ranges = {}
        for amount in self.effects[name].ranges(self._sizes):
            known = (self.value(amount.symbol), amount.lowest, amount.highest)
            least, most = float(min(known)), float(max(known))
            ranges[amount.name] = (amount.symbol, min(least, MOST_EFFECT * least), max(most, MOST_EFFECT * most))
        return ranges


LiveAxis = LiveMachine


class LivePlant(LiveMachine):
    """A hoist that hangs still until it is stepped, behind its drive: limits, lag, brake."""

    has_brake = carries = True
    longest_step_s = HOIST_STEP_S
    # slack_m: wire that came off the drum, which has taken in that much less.
    faults = joined(SWITCHED_BRAKE, Effects({"wound_length_m": [lambda s, p: -p.slack_m]}, ("slack_m", *LAG)))

    def _begins_at(self, start: float | None, payload_kg: float) -> float:
        self._hoist = cast(Hoist, self.machine)
        self._limits, self.lag_s = torque_limits(self._hoist), self._hoist.drive.torque_lag_s
        # Some times what the motors at their limit hold: T = m g dx/dphi.
        held = self._limits["u_all"] / (self._hoist.gravity_m_s2 * self._hoist.lift_m_per_rad)
        self.most_payload_kg = MOST_PAYLOAD * held
        self.most_slack_m = 2.0 * self._hoist.wire.segment_length_m  # both falls from the top to the bottom
        low, high = self._hoist.rail.lowest_position_m, self._hoist.highest_position_m
        at = 0.5 * (low + high) if start is None else start
        if not low <= at <= high:
            raise InputError(f"{at:g} m, expected {low:g} to {high:g} m, the rail", place="start_position_m")
        if not 0.0 <= payload_kg <= self.most_payload_kg:
            expected = f"expected 0 to {self.most_payload_kg:.6g}"
            raise InputError(f"{payload_kg:g} kg, {expected}", place="payload_kg")
        return at

    def _fault_values(self) -> dict[str, float]:
        motor = self._hoist.motor
        strong = BRAKE_TORQUES * motor.count * motor.nominal_torque_nm
        return {"brake_closed": 0.0, "T_brake": strong, "slack_m": 0.0}

    @property
    def slack(self) -> bool:  # type: ignore[override]
        return self.signal("tension_min_n") <= 0.0

    @property
    def off_rail(self) -> bool:  # type: ignore[override]
        rail, height = self._hoist.rail, self.signal("position_carriage_m")
        return not rail.lowest_position_m - RAIL_PLAY <= height <= self._hoist.highest_position_m + RAIL_PLAY

    def step(self, asked: float) -> None:
        """As any machine; the wire is overloaded once a fall has carried more than its breaking load."""
        super().step(asked)
        breaks_at = self._hoist.wire.breaking_load_n
        if breaks_at is not None and not self.overloaded:
            self.overloaded = max(self.signal("tension_drum_n"), self.signal("tension_dead_line_n")) > breaks_at

    def limit(self) -> float:
        """Of all motors' torque, N m; see `torque_limits`."""
        speed = abs(float(self._signals[0]))
        limit = self._limits["u_one" if self.motor_lost else "u_all"]
        return limit * self._limits["w_weak"] / speed if speed > self._limits["w_weak"] else limit

    def most_input(self) -> float:
        return MOST_INPUT * self._limits["u_all"]


def live_machine(
    machine: Machine, step_s: float, payload_kg: float, start: float | None, ready: Sequence[str]
) -> LiveMachine:
    """The machine as it is served. start: m or rad, None for mid rail or zero. InputError for what cannot be."""
    make = LivePlant if kind_of(machine).plant.kind == HOIST.plant.kind else LiveAxis
    return make(machine, step_s, payload_kg, start, ready)
