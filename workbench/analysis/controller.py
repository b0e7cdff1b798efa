"""The controller as a sampled linear system: the derivative of the very step that is compiled."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.analysis.discrete import Late, Sampled
from workbench.control import PiSettings, full_pi, loop_values
from workbench.errors import InputError
from workbench.machine import Hoist
from workbench.plants import HOIST
from workbench.run import Array
from workbench.trace.derive import jacobian
from workbench.trace.expr import symbol

FAR = 1e30
MOST_LATE = 200  # samples, each a state: the poles of many more take tens of seconds


def linear_controller(
    settings: PiSettings, machine: Hoist, payload_kg: float = 0.0, *, gains: tuple[float, float] | None = None
) -> Sampled:
    """Inputs: speed reference, speed of the motor (rad/s); output: torque wanted of the drive (N m).

    Speed filter and delay of the drive are in it, for they are in the step. Limits and rate limit are away from it;
    that the encoder counts over a sample is in the plant, its resolution is not. gains: (kp, ki) in place of the
    settings' own; zero is allowed. InputError for a delay of too many samples.
    """
    dt, drive = settings.sample_time_s, machine.drive
    if not drive.speed_delay_s <= MOST_LATE * dt:
        raise InputError(
            f"{drive.speed_delay_s:g} s are {drive.speed_delay_s / dt:.0f} samples of the controller; the design of "
            f"a loop takes at most {MOST_LATE}", place="drive.speed_delay_s",
        )  # fmt: skip
    controller = full_pi(True, settings.feed_forward.through_the_wire)
    assert controller.sensed is not None
    numbers: dict[str, Any] = {**vars(HOIST.values(machine, payload_kg)), **loop_values(settings, drive, 0.0)}
    numbers |= {"counts": 0.0, "rate": FAR, "u_all": FAR, "u_one": FAR, "t_fail": FAR, "w_weak": FAR, "track": 0.0}
    if gains is not None:
        numbers |= {"kp": gains[0], "ki": gains[1]}
    p = SimpleNamespace(**numbers)
    memory = [symbol(f"x{i}") for i in range(len(controller.memory))]
    r, w, late = symbol("r"), symbol("w"), symbol("late")
    measured = SimpleNamespace(speed_motor_rad_s=w, angle_motor_rad=0.0, t=0.0, late=late)
    torque, after = controller.step(p, memory, SimpleNamespace(speed_reference_rad_s=r), measured, dt)
    sensed = controller.sensed(p, memory, measured, dt)
    by = [*memory, r, w, late]
    J = jacobian([*after, torque, sensed], by, np.zeros(len(by)))
    n = len(memory)
    kept = _in_use(J, n)
    step = Sampled(J[np.ix_(kept, kept)], J[kept][:, n:], J[n:][:, kept], J[n:][:, n:], dt)
    return Late.of(step, p.late)


def _in_use(J: Array, n: int) -> list[int]:
    """Memory that something moves and that moves something; what is switched off drops out."""
    kept = list(range(n))
    outputs, inputs = range(n, J.shape[0]), range(n, J.shape[1])
    while True:
        rows = [*kept, *outputs]
        used = [
            i for i in kept
            if np.any(J[[j for j in rows if j != i], i]) and np.any(J[i, [j for j in (*kept, *inputs) if j != i]])
        ]  # fmt: skip
        if used == kept:
            return kept
        kept = used
