"""What goes wrong, or is done, at a moment of a run: a motor fails, the brake holds, lets go late, or closes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pydantic import model_validator

from workbench.control.pi import NEVER
from workbench.core.record import Acceleration, Force, Length, Moment, Positive, Record
from workbench.machines import Effects
from workbench.symbolic.expr import Scalar, clip, where

BRAKE_SPEED = 0.05  # rad/s at the motor, where the brake's friction is fully developed


class Events(Record):
    """Moments counted from the run's start; what is not given does not happen.

    motor_fails_s: one motor gives no torque from then on. brake_release_s: the brake holds until
    then; brake_close_s: it closes then. brake_torque_nm: its friction at the motor shaft.
    emergency_stop_s: the reference is brought to rest from then on with emergency_deceleration_m_s2
    of the carriage, and stays at rest. arm_moves_s: from then on the cylinders of the multi-body machine take the arm
    from its reach to arm_reach_m, in arm_takes_s, along half a cosine.
    """

    motor_fails_s: Moment | None = None
    brake_release_s: Moment | None = None
    brake_close_s: Moment | None = None
    brake_torque_nm: Force | None = None
    emergency_stop_s: Moment | None = None
    emergency_deceleration_m_s2: Acceleration | None = None
    arm_moves_s: Moment | None = None
    arm_reach_m: Length | None = None
    arm_takes_s: Positive | None = None

    @model_validator(mode="after")
    def _whole(self) -> Events:
        if self.brakes and self.brake_torque_nm is None:
            raise ValueError("brake_torque_nm is missing; a brake that holds or closes has a torque")
        if self.emergency_stop_s is not None and self.emergency_deceleration_m_s2 is None:
            raise ValueError("emergency_deceleration_m_s2 is missing; an emergency stop has a deceleration")
        arm = (self.arm_moves_s, self.arm_reach_m, self.arm_takes_s)
        if None in arm and any(value is not None for value in arm):
            raise ValueError("an arm that moves has arm_moves_s, arm_reach_m and arm_takes_s, all three")
        return self

    def reach_m(self, at_first_m: float) -> Callable[[float], float] | None:
        """The arm's reach over time (s); None where it stays."""
        begins, reach, takes = self.arm_moves_s, self.arm_reach_m, self.arm_takes_s
        if begins is None or reach is None or takes is None:
            return None

        def at(time_s: float) -> float:
            part = min(max((time_s - begins) / takes, 0.0), 1.0)
            return at_first_m + (reach - at_first_m) * 0.5 * (1.0 - math.cos(math.pi * part))

        return at

    @property
    def brakes(self) -> bool:
        return self.brake_release_s is not None or self.brake_close_s is not None

    def values(self) -> dict[str, float]:
        """The brake's numbers by symbol."""
        return {
            "T_brake": self.brake_torque_nm or 0.0,
            "t_release": -NEVER if self.brake_release_s is None else self.brake_release_s,
            "t_close": NEVER if self.brake_close_s is None else self.brake_close_s,
        }


def brake_torque(s: Any, p: Any) -> Scalar:
    """Friction of a closed brake on the motor shaft, against its motion; nothing while it is open."""
    closed = where(s.t < p.t_release, 1.0, where(s.t >= p.t_close, 1.0, 0.0))
    return -(closed * p.T_brake * clip(s.w / BRAKE_SPEED, -1.0, 1.0))


BRAKE = Effects({"motor_torque_nm": [brake_torque]}, ("T_brake", "t_release", "t_close"))


def switched_brake_torque(s: Any, p: Any) -> Scalar:
    """As `brake_torque`, of a brake that somebody closes (1) and opens (0) while the plant runs."""
    return -(p.brake_closed * p.T_brake * clip(s.w / BRAKE_SPEED, -1.0, 1.0))


SWITCHED_BRAKE = Effects({"motor_torque_nm": [switched_brake_torque]}, ("brake_closed", "T_brake"))
BRAKE_TORQUES = 2.0  # of all motors' nominal torque together, where nothing says how strong the brake is
