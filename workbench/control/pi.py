"""The sampled PI speed loop.

    error  = reference - speed
    torque = clip(kp (b reference - speed) + integral, +-limit)
    integral += ki Ts error + Ts/Tt (torque - torque before the clip)

Back-calculation (the last term) runs the integral back while the drive is at its
limit, with the tracking time Tt = kp/ki: K. J. Astrom, T. Hagglund, "Advanced PID
Control", ISA 2006, section 3.5. Torque is that of both motors together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.trace.expr import Scalar, clip


@dataclass(frozen=True, eq=False)
class Controller:
    """A sampled controller: its numbers, its memory, what it is given, and its step.

    step(p, memory, reference, measured, dt) -> (input of the plant, new memory).
    """

    parameters: tuple[str, ...]
    memory: tuple[str, ...]
    references: tuple[str, ...]
    step: Callable[..., tuple[Scalar, list[Scalar]]]


def pi_step(p: Any, memory: Sequence[Scalar], reference: Any, measured: Any, dt: Scalar) -> tuple[Scalar, list[Scalar]]:
    """One sample of the loop; p: kp, ki (N m s/rad, N m/rad), b_set, t_track (s), u_max (N m)."""
    (integral,) = memory
    r, w = reference.speed_reference_rad_s, measured.speed_motor_rad_s
    wanted = p.kp * (p.b_set * r - w) + integral
    torque = clip(wanted, -p.u_max, p.u_max)
    integral = integral + dt * (p.ki * (r - w) + (torque - wanted) / p.t_track)
    return torque, [integral]


PI = Controller(
    parameters=("kp", "ki", "b_set", "t_track", "u_max"),
    memory=("integral",),
    references=("speed_reference_rad_s",),
    step=pi_step,
)


@dataclass(frozen=True)
class PiSettings:
    """The numbers of a PI speed loop on the motor shaft, for the torque of both motors."""

    kp_nm_s_per_rad: float
    ki_nm_per_rad: float
    sample_time_s: float = 0.001
    set_point_weight: float = 1.0

    @property
    def tracking_time_s(self) -> float:
        return self.kp_nm_s_per_rad / self.ki_nm_per_rad if self.ki_nm_per_rad > 0 else 1e9

    def values(self, limit_nm: float) -> dict[str, float]:
        """The controller's parameters by symbol, under a torque limit for both motors."""
        return {
            "kp": self.kp_nm_s_per_rad,
            "ki": self.ki_nm_per_rad,
            "b_set": self.set_point_weight,
            "t_track": self.tracking_time_s,
            "u_max": limit_nm,
        }
