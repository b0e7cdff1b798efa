"""The rotary axis of two inertias: motor and load on a coupling, with play or without."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from workbench.kinds.axis import axis_kind, cross_checks
from workbench.kinds.load import Load
from workbench.kinds.record import BaseValue, CrossCheck, Drive, Friction, Kind, Moved, RigidBody, Turning
from workbench.machine.two_inertia import TwoInertia
from workbench.plants.two_inertia import TWO_INERTIA, motor_friction
from workbench.run import Array, Run
from workbench.trace.expr import where

LOAD_ANGLE, LOAD_SPEED = "angle_load_rad", "speed_load_rad_s"


def _rigid(m: TwoInertia, payload_kg: float) -> RigidBody:
    """On a stiff coupling."""
    return RigidBody(m.motor.inertia_kg_m2 + m.load.inertia_kg_m2, 0.0, wave=m.load.gravity.sine_nm != 0.0)


def _transmitted(p: Any, s: Any, torque: Array, acceleration: Array, payload_kg: float) -> tuple[Array, float]:
    """The coupling's torque but for the motor's friction."""
    return torque - p.M * acceleration, float(p.M + p.M_l)


def _cross_checks(
    m: TwoInertia, run: Run, position: Array, smooth: Callable[[Array], Array], slope: Callable[[Array, Array], float]
) -> Iterator[CrossCheck]:
    """As an axis', and the load's side against the motor's: on a stiff coupling they turn alike."""
    yield from cross_checks(m, run, position, smooth, slope)
    for load, motor in ((LOAD_ANGLE, m.position_signal), (LOAD_SPEED, m.speed_signal)):
        if load in run and motor in run:
            ratio = slope(smooth(run[motor]), smooth(run[load]))
            yield CrossCheck(
                ratio,
                f"{load} goes {ratio:.3g} times the way of {motor}; is its sign flipped, in another unit, or "
                "before a gear? The load's side is as the motor feels it",
            )


def _friction(p: Any, v: Any) -> Any:
    """Of motor and load at a reference's speed."""
    levels = where(v > 0.0, p.F_f + p.F_lf, where(v < 0.0, -p.F_b - p.F_lb, 0.0))
    return levels + (p.B + p.B_l) * v


def _load(m: TwoInertia, payload_kg: float) -> Load:
    """The load on its coupling, without the play; a load that goes with the angle is left out."""
    own, far = m.motor.friction, m.load.friction
    return Load(
        drive_kg=m.motor.inertia_kg_m2,
        mass_kg=m.load.inertia_kg_m2,
        stiffness_n_per_m=m.coupling.stiffness_nm_per_rad,
        damping_time_s=m.coupling.damping_nm_s_per_rad / m.coupling.stiffness_nm_per_rad,
        hold_n=m.load.gravity.constant_nm,
        friction_up_n=own.coulomb_forward_nm + far.coulomb_forward_nm,
        friction_down_n=own.coulomb_backward_nm + far.coulomb_backward_nm,
        force_limit_n=m.drive.limit,
        hangs=False,
    )


def _kind() -> Kind:
    own = axis_kind(
        TwoInertia,
        TWO_INERTIA,
        family=("two_inertia", "axis-rotary", "axis"),
        drive=Drive("torque", "N m", "nm"),
        moved=Moved("motor", "rad", "angle of the motor", placed_by_log=True),
        standstill="motor.friction.standstill_speed_rad_s",
        turning=(Turning("axis", lambda m: 1.0 / (2.0 * math.pi), ("angle", "motor's angle within a turn")),),
    )
    more: dict[str, Any] = {
        "signals": replace(own.signals, optional=(*own.signals.optional, LOAD_ANGLE, LOAD_SPEED)),
        "friction": Friction(
            own.friction.levels, own.friction.off, own.friction.speed, motor_friction, viscous=True, unit="N m"
        ),
        # What the runs show of the motor's inertia and of the load's is their sum first: the motor's is known best.
        "base": (
            replace(own.base[0], in_fit=True),
            *own.base[1:],
            BaseValue("load.inertia_kg_m2", "load_inertia", in_fit=False),
            BaseValue("coupling.stiffness_nm_per_rad", "stiffness", in_fit=False),
            BaseValue("coupling.damping_nm_s_per_rad", "damping"),
        ),
        "free": (*own.free, "load.inertia_kg_m2", "coupling.stiffness_nm_per_rad"),
        "rigid": _rigid,
        "transmitted": _transmitted,
        "sized_by_runs": {**own.sized_by_runs, "coupling.backlash_rad": 0.01},
        "cross_checks": _cross_checks,
        "load": _load,
        "closed_loop": replace(
            own.looped,
            drawn=(*own.looped.drawn, "load.inertia_kg_m2", "coupling.stiffness_nm_per_rad"),
            total_inertia=lambda m, payload_kg: m.motor.inertia_kg_m2 + m.load.inertia_kg_m2,
            inertia=lambda p: p.M + p.M_l,
            friction=_friction,
        ),
    }
    return replace(own, **more)


KIND = _kind()
