"""The hoist: motors, gearbox, drum, wire over a sheave on a guided carriage.

Source: the paper's equations 1-17, derived anew in docs/model.md, which says where
the code departs from the print. Up and hoisting are positive throughout.

States: motor angle and speed, sheave angle and speed, carriage height and speed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.plants.base import NO_EFFECTS, Effects, Output, Plant
from workbench.trace.derive import derivative
from workbench.trace.expr import Expr, Scalar, absolute, atan, clip, maximum, where

WIRE_DENSITY = 7850.0  # kg/m^3, steel; the bare wire hangs in every machine
PIN_SPEED = 0.01  # rad/s, where the pin friction of Eq. 13 is fully developed

PARAMETERS = {
    "n_m": "motor.count",
    "J_m": "motor.rotor_inertia_kg_m2",
    "ratio": "gearbox.ratio",
    "D_w": "winch.drum_diameter_m",
    "Dp_w": "winch.pin_diameter_m",
    "J_w": "winch.inertia_kg_m2",
    "m_w": "winch.mass_kg",
    "D_s": "sheave.diameter_m",
    "Dp_s": "sheave.pin_diameter_m",
    "J_s": "sheave.inertia_kg_m2",
    "m_s": "sheave.mass_kg",
    "mu": "bearing.pin_friction_coefficient",
    "E": "wire.youngs_modulus_pa",
    "A": "wire.effective_area_m2",
    "L": "wire.segment_length_m",
    "tau": "wire.damping_time_s",
    "m_c": "carriage.mass_kg",
    "m_p": "payload_kg",
    "s_p": "sensors.payload_scale",
    "F_up": "guide.coulomb_hoisting_n",
    "F_dn": "guide.coulomb_lowering_n",
    "slope": "guide.atan_slope_s_per_m",
    "g": "gravity_m_s2",
}


PLACES = {
    "guide_force_n": "force on the carriage along the rail, up positive",
    "carriage_mass_kg": "mass moving with the carriage",
    "payload_kg": "payload beyond the stated one",
    "wound_length_m": "wire taken in by the drum beyond radius times angle",
    "motor_torque_nm": "torque on the motor shaft, hoisting positive",
    "motor_inertia_kg_m2": "inertia turning with the motor shaft",
    "platform_acceleration_m_s2": "acceleration of the platform, up positive",
    "wire_compliance_m_per_n": "compliance of one fall of wire beyond the nominal",
    "line_mass_kg_per_m": "mass per metre of each fall beyond the bare wire",
}


def pin_switch(speed_rad_s: Scalar) -> Scalar:
    """Eq. 13: the sign of a speed, linear within +-0.01 rad/s."""
    return clip(speed_rad_s / PIN_SPEED, -1.0, 1.0)


def guide_switch(v: Scalar, p: Any) -> Scalar:
    """Eq. 17: the sign of a speed in m/s; the slope sets how it turns over at standstill."""
    return atan(p.slope * v) * (2.0 / math.pi)


def guide_friction(v: Scalar, p: Any) -> Scalar:
    """Eq. 17: Coulomb friction of the rollers in the rails, N, along v; m/s, up positive.

    Two positive levels, one for each way.
    """
    return where(v > 0.0, p.F_up, p.F_dn) * guide_switch(v, p)


def tension(delta: Scalar, rate: Scalar, k: Scalar, c: Scalar) -> Scalar:
    """Eq. 1, 2: W = k delta + c rate, N. A wire pulls and never pushes; slack carries nothing."""
    W = k * delta + c * rate
    return where((delta > 0.0) & (W > 0.0), W, 0.0)


def _state(t: Scalar, q: Sequence[Scalar], y: Sequence[Scalar], u: Scalar, p: Any, effects: Effects) -> SimpleNamespace:
    """Everything between the states and the equations of motion: lengths, tensions, masses."""
    th, th_s, x = q
    w, w_s, v = y
    i, R, r = 1.0 / p.ratio, p.D_w / 2.0, p.D_s / 2.0  # i: drum speed over motor speed
    th_w = i * th
    # Wire taken in by the drum and its derivative by the drum angle, the arm of the wire force.
    extra = effects.at("wound_length_m", p, t=t, theta_w=th_w)
    arm = R + _slope_of(extra, th) / i
    d1 = R * th_w + extra + r * th_s - x  # Eq. 3
    d2 = -(r * th_s) - x  # Eq. 4
    d1_rate = arm * (i * w) + r * w_s - v  # Eq. 5
    d2_rate = -(r * w_s) - v  # Eq. 6
    k = p.E * p.A / p.L  # Eq. 7
    soft = effects.at("wire_compliance_m_per_n", p, t=t, x=x, k=k)
    k = k / (1.0 + k * soft)
    if not isinstance(th, Expr) and (np.any(extra) or np.any(soft)):
        raise TypeError("an uneven drum and a wire that stiffens need derivatives: trace the plant")
    # A stiffness that grows with the height pulls the carriage down: the strain energy's own derivative.
    pull = _slope_of(k, x) * (_squared(d1) + _squared(d2)) / 2.0
    c = p.tau * k
    W1, W2 = tension(d1, d1_rate, k, c), tension(d2, d2_rate, k, c)
    g = p.g + effects.at("platform_acceleration_m_s2", p, t=t)
    line = WIRE_DENSITY * p.A + effects.at("line_mass_kg_per_m", p, t=t)
    hang_drum = line * g * (p.L - x) / 2.0  # half of fall 1 hangs from the drum,
    hang_carriage = line * g * (2.0 * p.L - R * th_w - extra) / 2.0  # half of both from the carriage
    m_p = p.s_p * p.m_p
    m_p = m_p + effects.at("payload_kg", p, t=t, payload_kg=m_p)
    m = p.m_c + m_p + effects.at("carriage_mass_kg", p, t=t, payload_kg=m_p)
    return SimpleNamespace(
        t=t, u=u, w=w, w_s=w_s, v=v, x=x, th=th, th_w=th_w, i=i, arm=arm, r=r, k=k, c=c, g=g, m=m, m_p=m_p,
        d1=d1, d2=d2, d1_rate=d1_rate, d2_rate=d2_rate, W1=W1, W2=W2, pull=pull,
        hang_drum=hang_drum, hang_carriage=hang_carriage, W1_top=W1 + hang_drum, W2_top=W2 + hang_drum,
    )  # fmt: skip


def _slope_of(value: Scalar, by: Scalar) -> Scalar:
    """d(value)/d(by) as far as `value` was computed from `by` itself; zero for what is a plain number."""
    return derivative(value, by) if isinstance(by, Expr) else 0.0


def _squared(elongation: Scalar) -> Scalar:
    taut = maximum(elongation, 0.0)
    return taut * taut


def _forces(s: SimpleNamespace, p: Any, effects: Effects) -> SimpleNamespace:
    """The friction forces and torques, and the accelerations of carriage and sheave on the way."""
    F_guide = guide_friction(s.v, p)
    F_extra = effects.at(
        "guide_force_n", p, t=s.t, v=s.v, x=s.x, w=s.w, angle=s.th,
        switch=guide_switch(s.v, p), friction=F_guide, load=s.m_p * s.g,
    )  # fmt: skip
    a = (s.W1 + s.W2 - s.hang_carriage - s.m * s.g - F_guide - s.pull + F_extra) / s.m  # Eq. 16
    N_s = absolute(s.W1 + s.W2 - s.hang_carriage - p.m_s * s.g - p.m_s * a)  # Eq. 9
    T_pin_s = p.mu * N_s * (p.Dp_s / 2.0) * pin_switch(s.w_s)  # Eq. 10, 11, 13
    N_w = absolute(p.m_w * s.g + s.W1_top)  # Eq. 8
    T_pin_w = p.mu * N_w * (p.Dp_w / 2.0) * pin_switch(s.i * s.w)  # Eq. 10, 12, 13; at the drum
    return SimpleNamespace(F_guide=F_guide, F_extra=F_extra, a=a, T_pin_s=T_pin_s, T_pin_w=T_pin_w)


def accelerations(
    t: Scalar, q: Sequence[Scalar], y: Sequence[Scalar], u: Scalar, p: Any, effects: Effects = NO_EFFECTS
) -> list[Scalar]:
    """Eq. 14-16: motor rad/s^2, sheave rad/s^2, carriage m/s^2 under the torque u of both motors, N m."""
    s = _state(t, q, y, u, p, effects)
    f = _forces(s, p, effects)
    a_s = (s.r * (s.W2 - s.W1) - f.T_pin_s) / p.J_s  # Eq. 14
    J = p.n_m * p.J_m + p.J_w * (s.i * s.i) + effects.at("motor_inertia_kg_m2", p)
    T_load = s.i * (s.arm * s.W1_top + f.T_pin_w)
    T_extra = effects.at(
        "motor_torque_nm", p, t=t, w=s.w, angle=s.th, v=s.v, x=s.x,
        switch=pin_switch(s.i * s.w), load=T_load, slack=-s.d1,
    )  # fmt: skip
    a_m = (u - T_load + T_extra) / J  # Eq. 15, the wire force opposing a hoisting torque
    return [a_m, a_s, f.a]


SIGNALS = (
    Output("speed_motor_rad_s", "motor speed"),
    Output("angle_motor_rad", "motor angle"),
    Output("position_carriage_m", "carriage height"),
    Output("speed_carriage_m_s", "carriage speed"),
    Output("acceleration_carriage_m_s2", "carriage acceleration"),
    Output("tension_drum_n", "wire tension at the drum, the top of the fall that is wound"),
    Output("tension_dead_line_n", "wire tension at the dead anchor"),
    Output("tension_min_n", "the smaller of the two falls' elastic tensions; zero is slack"),
    Output("force_guide_n", "friction force of the guide, against an upward motion positive"),
)


def outputs(
    t: Scalar, q: Sequence[Scalar], y: Sequence[Scalar], u: Scalar, p: Any, effects: Effects = NO_EFFECTS
) -> Mapping[str, Scalar]:
    """The signals that the hoist shows; names and units as in SIGNALS."""
    s = _state(t, q, y, u, p, effects)
    f = _forces(s, p, effects)
    return {
        "speed_motor_rad_s": s.w,
        "angle_motor_rad": s.th,
        "position_carriage_m": s.x,
        "speed_carriage_m_s": s.v,
        "acceleration_carriage_m_s2": f.a,
        "tension_drum_n": s.W1_top,
        "tension_dead_line_n": s.W2_top,
        "tension_min_n": where(s.W1 < s.W2, s.W1, s.W2),
        "force_guide_n": f.F_guide - f.F_extra,
    }


def dead_line_tension(
    t: Scalar, th_s: Scalar, x: Scalar, w_s: Scalar, v: Scalar, p: Any, effects: Effects = NO_EFFECTS
) -> Any:
    """Eq. 2 and the fall's own weight: tension at the dead anchor, N; of numbers or of arrays alike.

    t s; th_s, w_s: sheave, rad and rad/s; x, v: carriage, m and m/s.
    """
    k = p.E * p.A / p.L
    k = k / (1.0 + k * effects.at("wire_compliance_m_per_n", p, t=t, x=x, k=k))
    r = p.D_s / 2.0
    W2 = tension(-(r * th_s) - x, -(r * w_s) - v, k, p.tau * k)
    g = p.g + effects.at("platform_acceleration_m_s2", p, t=t)
    line = WIRE_DENSITY * p.A + effects.at("line_mass_kg_per_m", p, t=t)
    return W2 + line * g * (p.L - x) / 2.0


def equilibrium(height_m: float, p: Any) -> tuple[list[float], float]:
    """Hanging still at a height: (motor angle, sheave angle, height), and the torque that holds it, N m.

    Both falls carry half of the weight: k d = (m g + hang_carriage)/2 with
    d = R th_w/2 - x, where hang_carriage falls with R th_w; so d is solved for.
    """
    i, R, r = 1.0 / p.ratio, p.D_w / 2.0, p.D_s / 2.0
    k = p.E * p.A / p.L
    line = WIRE_DENSITY * p.A * p.g
    # 2 k d = m g + line (2 L - R th_w)/2 and R th_w = 2 (x + d)
    d = ((p.m_c + p.s_p * p.m_p) * p.g + line * (p.L - height_m)) / (2.0 * k + line)
    wound = 2.0 * (height_m + d)
    hold = i * R * (k * d + line * (p.L - height_m) / 2.0)
    return [wound / (R * i), -wound / (2.0 * r), height_m], hold


def start_of(height_m: float, speed_motor_rad_s: float, p: Any) -> tuple[list[float], list[float], float]:
    """Positions, speeds and torque of a load that hangs at a height and moves evenly with the motor."""
    q, hold = equilibrium(height_m, p)
    v = speed_motor_rad_s / p.ratio * p.D_w / 4.0  # two falls: half the wire's speed
    return q, [speed_motor_rad_s, -2.0 * v / p.D_s, v], hold


def energy(q: Sequence[Scalar], y: Sequence[Scalar], p: Any) -> Scalar:
    """Kinetic, elastic and weight energy, J; the wire's weight included, its inertia not."""
    s = _state(0.0, q, y, 0.0, p, NO_EFFECTS)
    R = p.D_w / 2.0
    J = p.n_m * p.J_m + p.J_w * (s.i * s.i)
    kinetic = (J * (s.w * s.w) + p.J_s * (s.w_s * s.w_s) + s.m * (s.v * s.v)) / 2.0
    t1, t2 = maximum(s.d1, 0.0), maximum(s.d2, 0.0)
    elastic = s.k * (t1 * t1 + t2 * t2) / 2.0
    line = WIRE_DENSITY * p.A * p.g
    wire = line * ((2.0 * p.L - R * s.th_w) * (p.L + s.x) / 2.0 + p.L * (R * s.th_w))
    return kinetic + elastic + s.m * p.g * s.x + wire


def dissipation(t: Scalar, q: Sequence[Scalar], y: Sequence[Scalar], u: Scalar, p: Any) -> Scalar:
    """Power lost in wire, pins and guide, W; never negative."""
    s = _state(t, q, y, u, p, NO_EFFECTS)
    f = _forces(s, p, NO_EFFECTS)
    wire = (s.W1 - s.k * maximum(s.d1, 0.0)) * s.d1_rate + (s.W2 - s.k * maximum(s.d2, 0.0)) * s.d2_rate
    return wire + f.F_guide * s.v + f.T_pin_s * s.w_s + f.T_pin_w * (s.i * s.w)


def band_hz(p: Any) -> float:
    """0.85 of the frequency of the carriage on its two falls, Hz.

    Below it the torque that a motion takes hardly depends on the wire's stiffness and damping.
    """
    return float(0.85 * math.sqrt(2.0 * p.E * p.A / p.L / (p.m_c + p.s_p * p.m_p)) / (2.0 * math.pi))


HOIST = Plant(
    kind="hoist",
    positions=("angle_motor_rad", "angle_sheave_rad", "position_carriage_m"),
    speeds=("speed_motor_rad_s", "speed_sheave_rad_s", "speed_carriage_m_s"),
    input="torque_motor_nm",
    parameters=PARAMETERS,
    places=PLACES,
    signals=SIGNALS,
    accelerations=accelerations,
    outputs=outputs,
    equilibrium=equilibrium,
    energy=energy,
    dissipation=dissipation,
    start_of=start_of,
    band_hz=band_hz,
    placed=2,
)
