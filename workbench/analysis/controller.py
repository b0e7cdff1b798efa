"""The controller as a sampled linear system: the derivative of the very step that is compiled."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.analysis.discrete import Late, Sampled
from workbench.control import Controller, Settings, cascade, cascade_values, full_pi, loop_values
from workbench.errors import InputError
from workbench.kinds import HOIST, kind_of
from workbench.machine import Axis, Hoist
from workbench.run import Array
from workbench.trace.derive import jacobian
from workbench.trace.expr import symbol

FAR = 1e30
HOIST_SPEED = HOIST.looped.speed
MOST_LATE = 200  # samples, each a state: the poles of many more take tens of seconds


def linear_controller(
    settings: Settings,
    machine: Hoist | Axis,
    payload_kg: float = 0.0,
    *,
    gains: tuple[float, float] | None = None,
    at: float = 0.0,
) -> Sampled:
    """Inputs: the references (speed; of an axis position and speed), then what is measured (speed; of an axis speed
    and position); output: torque or force wanted of the drive. at: the axis' position, for the load's feed-forward.

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
    kind = kind_of(machine)
    make = _axis if kind.looped.position_loop else _hoist
    controller, numbers, references, measured = make(settings, machine, payload_kg, at)
    assert controller.sensed is not None
    numbers |= {"counts": 0.0, "rate": FAR, "track": 0.0}
    if gains is not None:
        numbers |= {"kp": gains[0], "ki": gains[1]}
    p = SimpleNamespace(**{**vars(kind.plant.values(machine, payload_kg)), **numbers})
    memory = [symbol(f"x{i}") for i in range(len(controller.memory))]
    asked, seen = ([symbol(f"{what}{i}") for i in range(len(of))] for what, of in (("r", references), ("w", measured)))
    late = symbol("late")
    reference = SimpleNamespace(**dict(zip(references, asked, strict=True)))
    signals = SimpleNamespace(**dict.fromkeys((kind.looped.position, kind.looped.speed), 0.0), t=0.0, late=late)
    vars(signals).update(zip(measured, seen, strict=True))
    torque, after = controller.step(p, memory, reference, signals, dt)
    sensed = controller.sensed(p, memory, signals, dt)
    by = [*memory, *asked, *seen, late]
    around = {**dict.fromkeys((*references, *measured), 0.0), kind.looped.position: at, references[0]: at}
    if not kind.looped.position_loop:
        around = dict.fromkeys(around, 0.0)
    values = [*np.zeros(len(memory)), *(around[name] for name in (*references, *measured)), 0.0]
    J = jacobian([*after, torque, sensed], by, np.array(values))
    n = len(memory)
    kept = _in_use(J, n)
    step = Sampled(J[np.ix_(kept, kept)], J[kept][:, n:], J[n:][:, kept], J[n:][:, n:], dt)
    return Late.of(step, p.late)


Made = tuple[Controller, dict[str, Any], tuple[str, ...], tuple[str, ...]]


def _hoist(settings: Any, machine: Any, payload_kg: float, at: float) -> Made:
    far = {"u_all": FAR, "u_one": FAR, "t_fail": FAR, "w_weak": FAR}
    controller = full_pi(True, settings.feed_forward.through_the_wire)
    return controller, {**loop_values(settings, machine.drive, 0.0), **far}, controller.references, (HOIST_SPEED,)


def _axis(settings: Any, machine: Any, payload_kg: float, at: float) -> Made:
    loop = kind_of(machine).looped
    controller = cascade(loop, True)
    numbers: dict[str, Any] = {**cascade_values(settings, machine.drive, at), "u_limit": FAR}
    return controller, numbers, controller.references, (loop.speed, loop.position)


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
