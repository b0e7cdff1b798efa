"""`kind: two_inertia`: a motor that turns a load through a compliant coupling, with play or without.

    M   θ̈   = u − F(θ̇) − T                       motor
    M_l θ̈_l = T − F_l(θ̇_l) − G sin θ_l − C        load
    T = k δ + c δ̇,  δ = θ − θ_l                    coupling without play

F, F_l: Coulomb friction with a level for each way, linear within a standstill speed, and viscous friction.
Forward is positive for both sides; T drives the load and holds the motor back; a positive constant load C
opposes forward motion. Source: Newton's law for each side; W. Leonhard, Control of Electrical Drives, 2001,
section 10.1.

With play b > 0, from flank to flank, the coupling is M. Nordin's and P.-O. Gutman's dead zone (Controlling
mechanical systems with backlash: a survey, Automatica 38, 2002, section 3):

    δ_e = δ − clip(δ, −b/2, b/2)
    T = k δ_e + c δ̇ in contact, where a flank pushes and never pulls; 0 within the play

but for a millionth of k within the play, such as grease has, so that every load has a place where it rests.
Seen from the motor the axis resonates at √(k (1/M + 1/M_l)) and hardly moves at √(k/M_l), rad/s.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, ClassVar, Literal

from workbench.core import record
from workbench.core.record import Record
from workbench.core.run import Array, Run
from workbench.machines.declare import CrossCheck, Load, RigidBody, Value, parameters_of
from workbench.machines.kinds import axis
from workbench.machines.plant import NO_EFFECTS, Effects, Output, Plant
from workbench.symbolic.expr import Scalar, Scalars, Signals, clip, cos, maximum, minimum, sin, where


class MotorSide(Record):
    """What turns with the motor's encoder."""

    inertia_kg_m2: record.Inertia
    friction: axis.RotaryFriction


class Coupling(Record):
    """Between motor and load. `backlash_rad`: from flank to flank, at the motor."""

    stiffness_nm_per_rad: record.Stiffness
    damping_nm_s_per_rad: record.Slope = 0.0
    backlash_rad: record.Backlash = 0.0


class LoadSide(Record):
    """What hangs on the coupling, as the motor feels it: a gear's ratio is taken into the values."""

    inertia_kg_m2: record.Inertia
    friction: axis.RotaryFriction = axis.RotaryFriction(
        coulomb_forward_nm=0.0, coulomb_backward_nm=0.0, viscous_nm_s_per_rad=0.0
    )
    gravity: axis.RotaryGravity = axis.RotaryGravity()


class TwoInertiaTolerances(axis.RotaryTolerances):
    """As an axis', for the friction of the motor and the load's gravity; `inertia` is the motor's."""

    load_inertia: record.Tolerance = 0.05
    stiffness: record.Tolerance = 0.1
    damping: record.Tolerance = 0.5


class TwoInertia(axis.Rotary):
    """`kind: two_inertia`: kg m², N m, rad."""

    kind: Literal["two_inertia"] = "two_inertia"
    name: str = "two-inertia axis"
    motor: MotorSide
    coupling: Coupling
    load: LoadSide
    tolerances: TwoInertiaTolerances = TwoInertiaTolerances()

    value_of: ClassVar[dict[str, str]] = {
        role: dotted if role in ("gain", "offset") else f"{'load' if 'gravity' in role else 'motor'}.{dotted}"
        for role, dotted in axis.Rotary.value_of.items()
    }


GREASE = 1e-6  # of the stiffness, within the play
ROUNDS = 50  # of the fixed point of the equilibrium
FAR = "friction of the load shows at the motor as the motor's own does"

MOTOR, *OTHERS = axis.axis_values(TwoInertia)
VALUES = (
    # What the runs show of the motor's inertia and of the load's is their sum first: the motor's is known best.
    replace(MOTOR, in_fit=True),
    *OTHERS,
    Value("load.inertia_kg_m2", "M_l", "load_inertia", in_fit=False, free=True),
    Value("coupling.stiffness_nm_per_rad", "k", "stiffness", in_fit=False, free=True),
    Value("coupling.damping_nm_s_per_rad", "c", "damping"),
    Value("coupling.backlash_rad", "b", exact="play shows by its effect", scale=0.01),
    Value("load.friction.coulomb_forward_nm", "F_lf", exact=FAR),
    Value("load.friction.coulomb_backward_nm", "F_lb", exact=FAR),
    Value("load.friction.viscous_nm_s_per_rad", "B_l", exact=FAR),
    Value("load.friction.standstill_speed_rad_s", "v_ls", exact=FAR),
)
PLACES = {
    "axis_force": "torque on the motor, forward positive",
    "axis_inertia": "inertia of the motor",
    "axis_switch": "what the motor's dry friction follows beyond the sign of the speed, -1 to 1",
    "load_inertia_kg_m2": "inertia of the load",
    "coupling_compliance": "compliance of the coupling over the nominal one",
    "coupling_torque_nm": "torque in the coupling, driving the load forward positive",
}


def load_friction(v: Scalar, p: Any) -> Scalar:
    """Coulomb and viscous friction of the load along v, N m; v in rad/s."""
    return axis.friction(v, SimpleNamespace(F_f=p.F_lf, F_b=p.F_lb, v_s=p.v_ls, B=p.B_l))


def coupling(twist: Scalar, rate: Scalar, k: Scalar, c: Scalar, b: Scalar) -> tuple[Scalar, Scalar]:
    """Torque of the coupling, N m, and the elastic energy in it, J. twist, rate: motor before load, rad, rad/s."""
    elastic = where(b > 0.0, twist - clip(twist, -0.5 * b, 0.5 * b), twist)
    T = k * elastic + c * rate
    pushed = where(elastic > 0.0, maximum(T, 0.0), where(elastic < 0.0, minimum(T, 0.0), 0.0))
    grease = GREASE * k
    energy = 0.5 * k * (elastic * elastic) + where(b > 0.0, 0.5 * grease * (twist * twist), 0.0)
    return where(b > 0.0, pushed + grease * twist, T), energy


def _state(t: Scalar, q: Scalars, y: Scalars, u: Scalar, p: Any, effects: Effects) -> SimpleNamespace:
    (x, x_l), (v, v_l) = q, y
    twist, rate = x - x_l, v - v_l
    soft = 1.0 + effects.at("coupling_compliance", p, t=t)
    k, c = p.k / soft, p.c / soft
    T, energy = coupling(twist, rate, k, c, p.b)
    T = T + effects.at("coupling_torque_nm", p, t=t, twist=twist, rate=rate, k=k, c=c, torque=T)
    return SimpleNamespace(t=t, u=u, x=x, x_l=x_l, v=v, v_l=v_l, rate=rate, T=T, elastic_energy=energy)


def accelerations(t: Scalar, q: Scalars, y: Scalars, u: Scalar, p: Any, effects: Effects = NO_EFFECTS) -> list[Scalar]:
    """Of motor and load, rad/s^2, under the input u, N m."""
    s = _state(t, q, y, u, p, effects)
    M = p.M + effects.at("axis_inertia", p, t=t, x=s.x)
    M_l = p.M_l + effects.at("load_inertia_kg_m2", p, t=t)
    sign = axis.switch_at(t, s.v, p, effects)
    own = axis.friction(s.v, p, sign)
    extra = effects.at("axis_force", p, t=t, v=s.v, x=s.x, angle=s.x, switch=sign, load=s.T, friction=own)
    a = (u - own - s.T + extra) / M
    a_l = (s.T - load_friction(s.v_l, p) - p.G * sin(s.x_l) - p.C) / M_l
    return [a, a_l]


SIGNALS = (
    Output("angle_rad", "motor angle"),
    Output("speed_rad_s", "motor speed"),
    Output("acceleration_rad_s2", "motor acceleration"),
    Output("angle_load_rad", "load angle"),
    Output("speed_load_rad_s", "load speed"),
    Output("torque_coupling_nm", "torque in the coupling, driving the load forward positive"),
)


def outputs(t: Scalar, q: Scalars, y: Scalars, u: Scalar, p: Any, effects: Effects = NO_EFFECTS) -> Signals:
    """The signals that the axis shows; names and units as in SIGNALS."""
    s = _state(t, q, y, u, p, effects)
    return {
        "angle_rad": s.x,
        "speed_rad_s": s.v,
        "acceleration_rad_s2": accelerations(t, q, y, u, p, effects)[0],
        "angle_load_rad": s.x_l,
        "speed_load_rad_s": s.v_l,
        "torque_coupling_nm": s.T,
    }


def _load_angle(angle: float, p: Any) -> float:
    """Where the load rests, rad, with the motor at an angle: on the flank that it presses, else within the play."""

    def load(x: float) -> float:
        return float(p.G * math.sin(x) + p.C)

    def on_flank(side: float) -> float:
        x = angle
        for _ in range(ROUNDS):
            x = angle - (load(x) / p.k + 0.5 * side * p.b) / (1.0 + GREASE * (p.b > 0.0))
        return x

    grease = 0.5 * GREASE * p.k * p.b  # what it carries at the flanks
    forward = on_flank(1.0)
    if load(forward) >= grease:
        return forward
    backward = on_flank(-1.0)
    if load(backward) <= -grease:
        return backward
    low, high = forward, backward  # the load falls off either flank: the grease holds it where its torque is nearly 0
    for _ in range(ROUNDS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if load(middle) < GREASE * p.k * (angle - middle) else (low, middle)
    return 0.5 * (low + high)


def equilibrium(angle: float, p: Any) -> tuple[list[float], float]:
    """Standing still with the motor at an angle, and the input that holds the load without friction's help."""
    x_l = _load_angle(angle, p)
    return [angle, x_l], float(p.G * math.sin(x_l) + p.C)


def start_of(angle: float, speed: float, p: Any) -> tuple[list[float], list[float], float]:
    """Both sides at one speed, the load held; the coupling finds its twist under friction by itself."""
    q, hold = equilibrium(angle, p)
    return q, [speed, speed], hold


def guess(angle: Scalar, speed: Scalar, p: Any) -> tuple[list[Scalar], list[Scalar], Scalar]:
    """Near `start_of`, without branches: the load on the flank that it presses."""
    load = p.G * sin(angle) + p.C
    flank = where(load > 0.0, 0.5, where(load < 0.0, -0.5, 0.0)) * p.b
    return [angle, angle - load / p.k - flank], [speed, speed], load


def band_hz(p: Any) -> float:
    """0.85 of the frequency of the load on its coupling with the motor held, at most an axis' 90 Hz.

    Near it the motor hardly moves, whatever the torque; beyond it the load hardly does.
    """
    return float(min(90.0, 0.85 * math.sqrt(p.k / p.M_l) / (2.0 * math.pi)))


def energy(q: Scalars, y: Scalars, p: Any) -> Scalar:
    """Kinetic, elastic and load energy, J, the sine load's zero at load angle 0."""
    s = _state(0.0, q, y, 0.0, p, NO_EFFECTS)
    kinetic = (p.M * (s.v * s.v) + p.M_l * (s.v_l * s.v_l)) / 2.0
    return kinetic + s.elastic_energy + p.G * (1.0 - cos(s.x_l)) + p.C * s.x_l


def dissipation(t: Scalar, q: Scalars, y: Scalars, u: Scalar, p: Any) -> Scalar:
    """Power lost in both frictions and in the coupling, W; never negative."""
    s = _state(t, q, y, u, p, NO_EFFECTS)
    elastic = where(p.b > 0.0, s.x - s.x_l - clip(s.x - s.x_l, -0.5 * p.b, 0.5 * p.b), s.x - s.x_l)
    held = p.k * elastic + where(p.b > 0.0, GREASE * p.k * (s.x - s.x_l), 0.0)
    return axis.friction(s.v, p) * s.v + load_friction(s.v_l, p) * s.v_l + (s.T - held) * s.rate


TWO_INERTIA = Plant(
    kind="two_inertia",
    positions=("angle_rad", "angle_load_rad"),
    speeds=("speed_rad_s", "speed_load_rad_s"),
    input="torque_nm",
    parameters=parameters_of(VALUES),
    places=PLACES,
    signals=SIGNALS,
    accelerations=accelerations,
    outputs=outputs,
    equilibrium=equilibrium,
    energy=energy,
    dissipation=dissipation,
    start_of=start_of,
    band_hz=band_hz,
    guess=guess,
)


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
    yield from axis.cross_checks(m, run, position, smooth, slope)
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


_OWN = axis.axis_kind(
    TwoInertia,
    TWO_INERTIA,
    VALUES,
    {
        "motor": {
            "inertia_kg_m2": 0.02,
            "friction": {"coulomb_forward_nm": 0.6, "coulomb_backward_nm": 0.5, "viscous_nm_s_per_rad": 0.02},
        },
        "coupling": {"stiffness_nm_per_rad": 900.0, "damping_nm_s_per_rad": 1.5},
        "load": {
            "inertia_kg_m2": 0.05,
            "friction": {"coulomb_forward_nm": 0.8, "coulomb_backward_nm": 0.8, "viscous_nm_s_per_rad": 0.05},
            "gravity": {"sine_nm": 0.0, "constant_nm": 0.3},
        },
    },
    noun="motor",
)
KIND = replace(
    _OWN,
    signals=replace(_OWN.signals, optional=(*_OWN.signals.optional, LOAD_ANGLE, LOAD_SPEED)),
    rigid=_rigid,
    transmitted=_transmitted,
    cross_checks=_cross_checks,
    load=_load,
    closed_loop=replace(
        _OWN.looped,
        drawn=tuple(key for key in _OWN.looped.drawn if key != "coupling.damping_nm_s_per_rad"),
        total_inertia=lambda m, payload_kg: m.motor.inertia_kg_m2 + m.load.inertia_kg_m2,
        inertia=lambda p: p.M + p.M_l,
        friction=_friction,
    ),
)
