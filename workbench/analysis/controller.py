"""The controller as a sampled linear system: the derivative of the very step that is compiled."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.analysis.discrete import Sampled
from workbench.analysis.jacobian import jacobian
from workbench.control import PiSettings, delay_taps, full_pi, loop_values
from workbench.machine import Hoist
from workbench.plants import HOIST
from workbench.run import Array
from workbench.trace.expr import symbol

FAR = 1e30


def linear_controller(
    settings: PiSettings, machine: Hoist, payload_kg: float = 0.0, *, gains: tuple[float, float] | None = None
) -> Sampled:
    """Inputs: speed reference, speed of the motor (rad/s); output: torque wanted of the drive (N m).

    Speed filter and delay of the drive are in it, for they are in the step. Limits and rate limit are
    away from it, the encoder is ideal. gains: (kp, ki) in place of the settings' own; zero is allowed.
    """
    dt, drive = settings.sample_time_s, machine.drive
    controller = full_pi(delay_taps(drive.speed_delay_s, dt))
    numbers: dict[str, Any] = {**vars(HOIST.values(machine, payload_kg)), **loop_values(settings, drive, 0.0)}
    numbers |= {"counts": 0.0, "rate": FAR, "u_all": FAR, "u_one": FAR, "t_fail": FAR, "w_weak": FAR, "track": 0.0}
    if gains is not None:
        numbers |= {"kp": gains[0], "ki": gains[1]}
    p = SimpleNamespace(**numbers)
    memory = [symbol(f"x{i}") for i in range(len(controller.memory))]
    r, w = symbol("r"), symbol("w")
    torque, after = controller.step(
        p,
        memory,
        SimpleNamespace(speed_reference_rad_s=r),
        SimpleNamespace(speed_motor_rad_s=w, angle_motor_rad=0.0, t=0.0),
        dt,
    )
    by = [*memory, r, w]
    J = jacobian([*after, torque], by, np.zeros(len(by)))
    n = len(memory)
    kept = _in_use(J, n)
    A, B = J[np.ix_(kept, kept)], J[np.ix_(kept, [n, n + 1])]
    return Sampled(A, B, J[[n]][:, kept], J[[n]][:, n:], dt)


def _in_use(J: Array, n: int) -> list[int]:
    """Memory that something moves and that moves something; what is switched off drops out."""
    kept = list(range(n))
    while True:
        rows = [*kept, n]
        used = [
            i for i in kept
            if np.any(J[[j for j in rows if j != i], i]) and np.any(J[i, [j for j in (*kept, n, n + 1) if j != i]])
        ]  # fmt: skip
        if used == kept:
            return kept
        kept = used
