"""Motor, gearbox and brake."""

from __future__ import annotations

import math
from typing import Any

from workbench.effects.declare import EffectMemory, Parameter, amount, effect
from workbench.symbolic.expr import Scalar, absolute, sin, where

BRAKE_SETS_S = 0.2  # a brake closes within some tenths of a second of standstill
BRAKE_LEADS_S = 0.2  # as long before the motor turns it may begin to let go, which no torque at rest shows


@effect(
    place={"hoist": "motor_torque_nm", "axis": "axis_force"},
    subsystem={"hoist": "gearbox", "axis": "axis"}, regime="load",
    parameters=[amount("loss", "loss_fraction", "of the transmitted torque", "1", 3.0, 0.01, 0.03)],
    reads={
        "load": "a hoist: torque that wire and winch pin take at the motor, N m; an axis: its load, {n}",
        "switch": "sign of the speed, linear around standstill",
    },
    equation="T = −loss |T_load| S(ω)",
    reference="G. Niemann, H. Winter, Maschinenelemente II, 2003, chapter 21: load-dependent losses of gears",
    shows="friction at the motor that grows with the load, carriage and payload together",
    dissipative=True,
)  # fmt: skip
def gearbox_efficiency(s: Any, e: Any, p: Any) -> Scalar:
    """Gear losses in proportion to the transmitted torque, in both directions."""
    return -(e.loss * absolute(s.load) * s.switch)


@effect(
    place={"hoist": "motor_inertia_kg_m2"}, subsystem="gearbox", regime="acceleration",
    parameters=[
        Parameter("J", "inertia_kg_m2", "at the motor shaft", "inertia", -0.5, 2.0, 0.05, 0.1, vanishes_at=0.0),
    ],
    equation="J → J + J_g",
    reference="Eq. 15 of the paper, which has no gearbox inertia",
    shows="a residual in proportion to the motor's acceleration, at any payload",
)  # fmt: skip
def gearbox_inertia(s: Any, e: Any, p: Any) -> Scalar:
    """Inertia of the gearbox and what else turns with the motors, beyond the rotors."""
    return e.J


def _grip_rate(s: Any, e: Any, p: Any) -> Scalar:
    """The brake's torque falls while the motor turns and comes back at rest."""
    return where(absolute(s.speed_motor_rad_s) > e.w_0, -(e.z / e.tau), (e.T - e.z) / BRAKE_SETS_S)


@effect(
    place={"hoist": "motor_torque_nm"}, subsystem="brake", regime="start",
    parameters=[
        amount(
            "T", "torque_nm", "drag as the motion begins, at the motor", "torque", 1.0, 0.02, 0.05,
            simplified=lambda e: e.T * BRAKE_LEADS_S / e.tau,
        ),
        Parameter("tau", "time_constant_s", "of letting go", "1", 0.05, 5.0, 0.2, 0.6, domain="positive",
                  tries=(0.2, 0.5, 1.2)),
        Parameter(
            "w_0", "moving_rad_s", "motor speed above which the machine moves", "motor_speed",
            0.0002, 0.05, 0.0005, 0.001, domain="positive", tries=(0.001,),
        ),
    ],
    reads={"switch": "sign of the motor's speed, linear around standstill", "z": "its memory: the brake's torque, N m"},
    equation="T = −z S(ω);  z' = −z/τ in motion, (T − z)/0.2 s at rest",
    reference="a spring-applied brake whose magnet builds up its field with the time constant τ",
    shows="a burst against the motion at each start that dies away; none at stops",
    dissipative=True,
    memory=[EffectMemory("z", _grip_rate, start=lambda e, p: e.T, scale=lambda e, p: where(e.T > 0.0, e.T, 1.0))],
)  # fmt: skip
def brake_drag(s: Any, e: Any, p: Any) -> Scalar:
    """A brake that lets go late at each start."""
    return -(e.z * s.switch)


@effect(
    place={"hoist": "motor_torque_nm", "axis-rotary": "axis_force"},
    subsystem={"hoist": "motor", "axis-rotary": "axis"}, regime="periodic",
    parameters=[
        amount("A", "amplitude_nm", "of the torque", "torque", 0.3, 0.005, 0.02),
        Parameter("n", "order_per_turn", "waves per turn of the motor", "1", 0.1, 400.0, 0.02, 1.0, domain="positive",
                  scan="order", tries=(0.5, *(float(order) for order in range(1, 13)))),
        Parameter("phi", "phase_rad", "at motor angle 0", "1", 0.0, 2.0 * math.pi, 0.5, 0.0,
                  per_run=True, scan="phase"),  # a millimetre of a hoist's start height is a fifth of a radian here
    ],
    reads={"angle": "motor (axis) angle, rad"},
    equation="T = A sin(n θ + φ)",
    reference="J. Holtz, L. Springob, Identification and compensation of torque ripple, IEEE Trans. IE 43, 1996",
    shows="a ripple whose frequency follows the motor's speed",
)  # fmt: skip
def torque_ripple(s: Any, e: Any, p: Any) -> Scalar:
    """Ripple of the motor's torque over its angle, such as of a current sensor or of the slots."""
    return e.A * sin(e.n * s.angle + e.phi)


@effect(
    place={"hoist": "motor_torque_nm"}, subsystem="motor", regime="speed", listed=False,
    parameters=[
        amount("q", "drag_nm_s2", "over motor speed squared", "torque/motor_speed*motor_speed", 0.5, 0.01, 0.02),
    ],
    reads={"w": "motor speed, rad/s"},
    equation="T = −q ω |ω|",
    reference="R. Richter, Elektrische Maschinen I, 1951: ventilation losses grow with the cube of the speed",
    shows="a residual that grows with the square of the motor's speed, against it",
    dissipative=True,
)  # fmt: skip
def motor_fan(s: Any, e: Any, p: Any) -> Scalar:
    """Air drag of a fan on the motor shaft."""
    return -(e.q * s.w * absolute(s.w))


@effect(
    place={"hoist": "motor_torque_nm"}, subsystem="gearbox", regime="event",
    parameters=[amount("play", "play_rad", "at the drum, from flank to flank", "1", 0.2, 0.002, 0.01)],
    reads={"slack": "how slack the wound fall is, m; negative where it is taut", "load": "torque of wire and pin, N m"},
    equation="T = +T_load while 0 < slack < R · play",
    reference="M. Nordin, P.-O. Gutman, Controlling mechanical systems with backlash: a survey, Automatica 38, 2002",
    shows="nothing while a load hangs, for it keeps the teeth on one flank; the motor runs free as the wire goes slack",
)  # fmt: skip
def backlash(s: Any, e: Any, p: Any) -> Scalar:
    """Play between motor and drum: within it the motor does not feel the drum."""
    free = where(s.slack > 0.0, where(s.slack < e.play * (p.D_w / 2.0), 1.0, 0.0), 0.0)
    return free * s.load
