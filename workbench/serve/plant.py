"""The machines that are served: the hoist with its drive, brake and faults; an axis with its input alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from workbench.control.events import BRAKE_SPEED
from workbench.engine.source import LAG
from workbench.errors import InputError
from workbench.kinds import kind_of, of_kind
from workbench.machine import Axis, Hoist
from workbench.plants import HOIST, Effects
from workbench.serve.live import LiveMachine
from workbench.simulate.loop import RAIL_PLAY, kept_by_others, torque_limits
from workbench.trace.expr import Scalar, clip

HOIST_STEP_S, AXIS_STEP_S = 0.001, 0.0002  # of the integration: an axis' friction turns over more sharply
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
_NO_FAULTS = Effects(parameters=LAG)


class LivePlant(LiveMachine):
    """A hoist that hangs still until it is stepped, behind its drive: limits, lag, brake. InputError for what cannot
    be."""

    has_brake = True
    carries = True

    def __init__(
        self,
        machine: Hoist,
        step_s: float,
        payload_kg: float = 0.0,
        start_position_m: float | None = None,
        ready: Sequence[str] = (),
    ) -> None:
        low, high = machine.rail.lowest_position_m, machine.highest_position_m
        at = 0.5 * (low + high) if start_position_m is None else start_position_m
        if not low <= at <= high:
            raise InputError(f"{at:g} m, expected {low:g} to {high:g} m, the rail", place="start_position_m")
        if not (math.isfinite(payload_kg) and payload_kg >= 0.0):
            raise InputError(f"{payload_kg:g} kg, expected 0 or more", place="payload_kg")
        self._hoist, self._limits = machine, torque_limits(machine)
        super().__init__(
            machine, step_s, payload_kg, at, ready, longest_step_s=HOIST_STEP_S, faults=_FAULTS,
            lag_s=machine.drive.torque_lag_s,
        )  # fmt: skip

    def _more_values(self) -> dict[str, float]:
        motor = self._hoist.motor
        return {
            "brake_closed": 0.0, "T_brake": BRAKE_TORQUES * motor.count * motor.nominal_torque_nm, "slack_m": 0.0
        }  # fmt: skip

    @property
    def slack(self) -> bool:
        return float(self._signals[SIGNALS.index("tension_min_n")]) <= 0.0

    @property
    def off_rail(self) -> bool:
        height = float(self._signals[SIGNALS.index("position_carriage_m")])
        rail = self._hoist.rail
        return not rail.lowest_position_m - RAIL_PLAY <= height <= self._hoist.highest_position_m + RAIL_PLAY

    def limit(self) -> float:
        """Of all motors' torque, N m; see `torque_limits`."""
        speed = abs(float(self._signals[0]))
        limit = self._limits["u_one" if self.motor_lost else "u_all"]
        return limit * self._limits["w_weak"] / speed if speed > self._limits["w_weak"] else limit

    # Faults, from the next step on.

    def lose_motor(self, lost: bool) -> None:
        if lost and not self.motor_lost and self._lag_s > 0.0:  # its torque is gone at once, the others' rises
            self.at_work *= kept_by_others(self._hoist)
        super().lose_motor(lost)

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


class LiveAxis(LiveMachine):
    """An axis that stands still until it is stepped, under the input itself: machine.yaml of an axis has no drive.
    InputError for what cannot be."""

    def __init__(
        self, machine: Axis, step_s: float, payload_kg: float = 0.0, start: float | None = None,
        ready: Sequence[str] = (),
    ) -> None:  # fmt: skip
        """start: m or rad."""
        if payload_kg != 0.0:
            raise InputError(f"{payload_kg:g} kg; {of_kind(machine)} carries no payload", place="payload_kg")
        at = 0.0 if start is None else start
        if not math.isfinite(at):
            raise InputError(f"{at:g}, expected a finite number", place="start_position_m")
        super().__init__(machine, step_s, 0.0, at, ready, longest_step_s=AXIS_STEP_S, faults=_NO_FAULTS)


_WITH_A_DRIVE = {HOIST.kind: LivePlant}


def live_machine(
    machine: Hoist | Axis, step_s: float, payload_kg: float, start: float | None, ready: Sequence[str]
) -> LiveMachine:
    """The machine as it is served. start: m or rad, None for mid rail or zero. InputError for what cannot be."""
    make = _WITH_A_DRIVE.get(kind_of(machine).plant.kind, LiveAxis)
    return make(machine, step_s, payload_kg, start, ready)  # type: ignore[arg-type]
