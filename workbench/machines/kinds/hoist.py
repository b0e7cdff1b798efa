"""`kind: hoist`: motors, gearbox, drum, a wire over a sheave on a guided carriage with a payload.

First machine.yaml's blocks (docs/formats.md), then the equations, then what the workbench asks of the kind.
Source: the paper's equations 1-17 and its table of parameters, derived anew in docs/model.md, which says where
the code departs from the print. Up and hoisting are positive throughout.

States: motor angle and speed, sheave angle and speed, carriage height and speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from workbench.core import record
from workbench.core.record import Record, by_name
from workbench.core.run import Array, Run
from workbench.core.yaml_strict import load, validate
from workbench.machines import declare
from workbench.machines.arm import Arm
from workbench.machines.correction import MeasuredCorrection, Numbers
from workbench.machines.declare import Kind, Limits, Load, NuisancePrior, Sizes, Table, Value
from workbench.machines.plant import NO_EFFECTS, Effects, Output, Plant
from workbench.symbolic.derive import derivative
from workbench.symbolic.expr import Expr, Scalar, Scalars, Signals, absolute, atan, clip, maximum, where


class Motor(Record):
    """`count` equal motors on one gearbox; inertia and nominal torque are one motor's."""

    count: Annotated[int, Field(ge=1, le=100, strict=True)]
    rotor_inertia_kg_m2: record.Inertia
    nominal_torque_nm: record.Force
    nominal_speed_rad_s: record.Speed


class Gearbox(Record):
    """`ratio` is motor speed over drum speed."""

    ratio: record.Ratio


class Winch(Record):
    """The drum with what turns with it."""

    drum_diameter_m: record.Length
    pin_diameter_m: record.Length
    inertia_kg_m2: record.Inertia
    mass_kg: record.Mass

    @model_validator(mode="after")
    def _pin_fits(self) -> Winch:
        if self.pin_diameter_m >= self.drum_diameter_m:
            said = f"pin_diameter_m {self.pin_diameter_m}, expected less than drum_diameter_m {self.drum_diameter_m}"
            raise ValueError(said)
        return self


class Sheave(Record):
    """The sheave on the carriage."""

    diameter_m: record.Length
    pin_diameter_m: record.Length
    inertia_kg_m2: record.Inertia
    mass_kg: record.Mass

    @model_validator(mode="after")
    def _pin_fits(self) -> Sheave:
        if self.pin_diameter_m >= self.diameter_m:
            raise ValueError(f"pin_diameter_m {self.pin_diameter_m}, expected less than diameter_m {self.diameter_m}")
        return self


class Bearing(Record):
    pin_friction_coefficient: Annotated[float, Field(ge=0.0, lt=1.0, strict=True, allow_inf_nan=False)]


class Wire(Record):
    """Stiffness of one fall is E·A over its free length; `damping_time_s` is c/k."""

    youngs_modulus_pa: record.Modulus
    effective_area_m2: record.Area
    segment_length_m: record.Length
    damping_time_s: record.Lag
    breaking_load_n: record.Force | None = None


class Carriage(Record):
    mass_kg: record.Mass


class Guide(Record):
    """Friction force level(direction) · (2/π)·atan(slope · speed); levels are magnitudes."""

    coulomb_hoisting_n: record.Level
    coulomb_lowering_n: record.Level
    atan_slope_s_per_m: record.Sharpness


class HoistTolerances(Record):
    """One standard deviation of each nominal value, relative unless the name carries a unit."""

    rotor_inertia: record.Tolerance = 0.01
    carriage_mass: record.Tolerance = 0.004
    payload: record.Tolerance = 0.005
    coulomb: record.Tolerance = 0.15
    pin_friction: record.Tolerance = 0.1
    wire_stiffness: record.Tolerance = 0.05
    torque_gain: record.Tolerance = 0.005
    torque_offset_nm: record.Level = 3.0
    # Of what every machine has a little of: loss of the gearbox; guide friction over the payload's weight; viscous
    # friction at nominal speed and Stribeck's peak, of the friction level; eccentricity of the drum, of its radius;
    # ripple of the torque, of the motors' nominal torque together.
    gearbox_loss: record.Tolerance = 0.002
    load_friction: record.Tolerance = 0.002
    viscous: record.Tolerance = 0.03
    stribeck: record.Tolerance = 0.1
    eccentricity: record.Tolerance = 0.0003
    ripple: record.Tolerance = 0.002


class Drive(Record):
    """The drive of the motors, as the speed loop meets it. A missing key has what makers of such drives state;
    docs/formats.md cites them.

    overload: largest torque of a motor over its nominal one, which the drive bears for overload_time_s out of every
    overload_period_s, at nominal torque for the rest. field_weakening: above nominal speed the limit falls as
    nominal speed over speed. torque_lag_s: first-order lag of the torque loop; 2 ms rise in 4.4 ms from a tenth to
    nine tenths. speed_filter_s: first-order filter of the measured speed. speed_delay_s: transport delay of the
    measured speed; 1 ms is one sample, the computing delay of a controller that acts at its next sample.
    encoder_counts_per_turn: the speed is counted with that resolution, 0 is ideal; 2048 periods of a sine-cosine
    encoder, each divided by 512. torque_share: the first of two motors' share of the torque.
    """

    overload: record.Overload = 1.6
    overload_time_s: record.Cycle = 10.0
    overload_period_s: record.Cycle = 300.0
    field_weakening: bool = True
    torque_lag_s: record.Lag = 0.002
    speed_filter_s: record.Lag = 0.003
    speed_delay_s: record.Delay = 0.001
    encoder_counts_per_turn: Annotated[int, Field(ge=0, le=100_000_000, strict=True)] = 1_048_576
    torque_share: Annotated[float, Field(ge=0.0, le=1.0, strict=True, allow_inf_nan=False)] = 0.5

    @model_validator(mode="after")
    def _cycle(self) -> Drive:
        if self.overload_time_s > self.overload_period_s:
            raise ValueError(
                f"overload_time_s: {self.overload_time_s:g} s, expected at most overload_period_s, "
                f"{self.overload_period_s:g} s"
            )
        return self

    @property
    def ideal(self) -> bool:
        """Whether nothing stands between the wanted torque and the measured speed."""
        return not (self.torque_lag_s or self.speed_filter_s or self.speed_delay_s or self.encoder_counts_per_turn)


# What `drive:` may be by name, in place of a block.
DRIVES: dict[str, Drive] = {
    "standard": Drive(),
    "ideal": Drive(torque_lag_s=0.0, speed_filter_s=0.0, speed_delay_s=0.0, encoder_counts_per_turn=0),
}


BY_NAME = by_name(DRIVES)


class Rail(Record):
    """Carriage heights between which the machine may move. No highest position means segment_length_m."""

    lowest_position_m: record.Position = 0.0
    highest_position_m: record.Position | None = None


class HoistSensors(Record):
    """Logged torque = gain · true torque + offset, both of the motors' sum; true payload = scale · stated payload."""

    torque_gain: record.Gain = 1.0
    torque_offset_nm: record.Offset = 0.0
    payload_scale: record.Gain = 1.0


class HoistCorrection(MeasuredCorrection):
    """acts_on guide: a force on the carriage, N; motor: a torque at the motor shaft, N m. Hoisting is forward."""

    over: Literal[
        "speed_carriage_m_s",
        "position_carriage_m",
        "speed_motor_rad_s",
        "angle_motor_rad",
        "angle_drum_rad",
        "payload_kg",
        "torque_load_nm",
        "time_s",
        "campaign_time_s",
    ]
    acts_on: Literal["guide", "motor"]
    forward_n: Numbers | None = None
    backward_n: Numbers | None = None
    forward_nm: Numbers | None = None
    backward_nm: Numbers | None = None

    PERIODIC: ClassVar[tuple[str, ...]] = ("angle_motor_rad", "angle_drum_rad")
    MAGNITUDES: ClassVar[tuple[str, ...]] = ("speed_carriage_m_s", "speed_motor_rad_s", "payload_kg")
    UNITS: ClassVar[Mapping[str, str]] = {"guide": "n", "motor": "nm"}

    @model_validator(mode="before")
    @classmethod
    def _right_unit(cls, data: object) -> object:
        """Before the other checks, which could not say as much."""
        if isinstance(data, dict) and data.get("acts_on") in ("guide", "motor"):
            if data.get("over") == "torque_load_nm" and data["acts_on"] == "guide":
                raise ValueError("over torque_load_nm goes with acts_on motor, where that torque passes; got guide")
            unit, other = ("n", "nm") if data["acts_on"] == "guide" else ("nm", "n")
            for way in ("forward", "backward"):
                if data.get(f"{way}_{other}") is not None:
                    raise ValueError(f"{way}_{other} does not go with acts_on {data['acts_on']}; expected {way}_{unit}")
                if data.get(f"{way}_{unit}") is None:
                    raise ValueError(f"{way}_{unit} is missing; acts_on {data['acts_on']} expects it")
        return data


class Hoist(Record):
    """A hoist, whole. Raises pydantic's ValidationError; `load_machine` turns that into an InputError."""

    format: Literal[1] = 1
    kind: Literal["hoist"] = "hoist"
    name: str = "hoist"
    motor: Motor
    gearbox: Gearbox
    winch: Winch
    sheave: Sheave
    bearing: Bearing
    wire: Wire
    carriage: Carriage
    guide: Guide
    gravity_m_s2: record.Gravity = 9.81
    drive: Annotated[Drive, *BY_NAME] = Drive()
    rail: Rail = Rail()
    arm: Arm = Arm()
    sensors: HoistSensors = HoistSensors()
    tolerances: HoistTolerances = HoistTolerances()
    effects: record.EffectValues = Field(default_factory=dict)
    # The small amounts of effects that every machine of the kind has: at work as effects are, and no causes.
    allowances: record.EffectValues = Field(default_factory=dict)
    log: record.LogTraits = record.LogTraits()
    measured_correction: HoistCorrection | None = None
    identified: record.Identified = Field(default_factory=dict)

    CORRECTION: ClassVar[type[MeasuredCorrection]] = HoistCorrection

    @model_validator(mode="after")
    def _rail_lies_below_the_anchor(self) -> Hoist:
        low, high, top = self.rail.lowest_position_m, self.highest_position_m, self.wire.segment_length_m
        if not low < high <= top:
            raise ValueError(
                f"rail from {low} to {high} m, expected lowest_position_m < highest_position_m <= "
                f"wire.segment_length_m, which is {top}"
            )
        return self

    @property
    def highest_position_m(self) -> float:
        high = self.rail.highest_position_m
        return self.wire.segment_length_m if high is None else high

    @property
    def turning_inertia_kg_m2(self) -> float:
        """Rotors and drum at the motor shaft."""
        return self.motor.count * self.motor.rotor_inertia_kg_m2 + self.winch.inertia_kg_m2 / self.gearbox.ratio**2

    @property
    def torque_share(self) -> float:
        """Of the torque of all motors, the share of the harder-worked one."""
        share = self.drive.torque_share
        return max(share, 1.0 - share) if self.motor.count == 2 else 1.0 / self.motor.count

    @property
    def lift_m_per_rad(self) -> float:
        """Carriage travel per motor angle on a stiff wire: two falls, so half of what the drum takes up."""
        return self.winch.drum_diameter_m / (4.0 * self.gearbox.ratio)


WIRE_DENSITY = 7850.0  # kg/m^3, steel; the bare wire hangs in every machine
PIN_SPEED = 0.01  # rad/s, where the pin friction of Eq. 13 is fully developed

DRAWING = "read from the drawing"
VALUES = (
    # Each friction level is held by its own tolerance: motion shows their sum well and their difference only
    # together with weight and offset, and that is where a hold is needed.
    Value("guide.coulomb_hoisting_n", "F_up", "coulomb", free=True),
    Value("guide.coulomb_lowering_n", "F_dn", "coulomb", free=True),
    Value("guide.atan_slope_s_per_m", "slope", spread="factor", free=True),
    Value("motor.rotor_inertia_kg_m2", "J_m", "rotor_inertia", free=True),
    Value("carriage.mass_kg", "m_c", "carriage_mass", free=True),
    Value("sensors.payload_scale", "s_p", "payload", free=True, with_payload=True),
    Value("bearing.pin_friction_coefficient", "mu", "pin_friction", free=True),
    Value("wire.youngs_modulus_pa", "E", "wire_stiffness", free=True),
    Value("sensors.torque_gain", "", "torque_gain", free=True),
    Value("sensors.torque_offset_nm", "", "torque_offset_nm", "absolute", free=True, signed=True),
    Value("motor.count", "n_m", exact="it is counted"),
    Value("gearbox.ratio", "ratio", exact="teeth are counted"),
    Value("winch.drum_diameter_m", "D_w", exact=DRAWING),
    Value("winch.pin_diameter_m", "Dp_w", exact=DRAWING),
    Value("winch.inertia_kg_m2", "J_w", exact="its error shows as the rotors' inertia does"),
    Value("winch.mass_kg", "m_w", exact="it loads the drum's pin only"),
    Value("sheave.diameter_m", "D_s", exact=DRAWING),
    Value("sheave.pin_diameter_m", "Dp_s", exact=DRAWING),
    Value("sheave.inertia_kg_m2", "J_s", exact="a few thousandths of what the motors turn"),
    Value("sheave.mass_kg", "m_s", exact="it loads the sheave's pin only"),
    Value("wire.effective_area_m2", "A", exact="its error shows as the modulus does"),
    Value("wire.segment_length_m", "L", exact=DRAWING),
    Value("wire.damping_time_s", "tau", exact="it damps a swing beyond the band of the balance"),
    Value("gravity_m_s2", "g", exact="it is known to a thousandth anywhere"),
)


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


def _state(t: Scalar, q: Scalars, y: Scalars, u: Scalar, p: Any, effects: Effects) -> SimpleNamespace:
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


def accelerations(t: Scalar, q: Scalars, y: Scalars, u: Scalar, p: Any, effects: Effects = NO_EFFECTS) -> list[Scalar]:
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


def outputs(t: Scalar, q: Scalars, y: Scalars, u: Scalar, p: Any, effects: Effects = NO_EFFECTS) -> Signals:
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


def dead_line_tension(t: Scalar, th_s: Scalar, x: Scalar, w_s: Scalar, v: Scalar, p: Any, effects: Effects) -> Any:
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


def energy(q: Scalars, y: Scalars, p: Any) -> Scalar:
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


def dissipation(t: Scalar, q: Scalars, y: Scalars, u: Scalar, p: Any) -> Scalar:
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
    parameters=declare.parameters_of(VALUES, m_p="payload_kg"),
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


EXAMPLE = Path(__file__).parents[1] / "default_hoist.yaml"  # engineering estimates of a pipe racker's winch
SPEED, TORQUE = "speed_motor_rad_s", "torque_motor_nm"
MOTORS = ("torque_motor1_nm", "torque_motor2_nm")
SPEED_REFERENCE, HEIGHT, TENSION = "speed_reference_rad_s", "position_carriage_m", "tension_dead_line_n"


def _sizes(m: Hoist, runs: Sequence[Run]) -> Sizes:
    radius, length = m.winch.drum_diameter_m / 2.0, m.wire.segment_length_m
    return Sizes(
        kind=HOIST.kind,
        force=m.carriage.mass_kg * m.gravity_m_s2,
        torque=m.motor.count * m.motor.nominal_torque_nm,
        speed=m.motor.nominal_speed_rad_s * m.lift_m_per_rad,
        motor_speed=m.motor.nominal_speed_rad_s,
        length=length,
        radius=radius,
        drum_angle=2.0 * length / radius,
        mass=m.carriage.mass_kg,
        inertia=m.turning_inertia_kg_m2,
    )


def _mass(m: Hoist, payload_kg: float) -> float:
    """Carriage and a stated payload as the machine has it, kg."""
    return m.carriage.mass_kg + m.sensors.payload_scale * payload_kg


def _rigid(m: Hoist, payload_kg: float) -> declare.RigidBody:
    """On a stiff wire: rotors, drum, sheave, carriage and payload at the motor shaft."""
    mass, lift = _mass(m, payload_kg), m.lift_m_per_rad
    sheave = m.sheave.inertia_kg_m2 * (2.0 * lift / m.sheave.diameter_m) ** 2
    return declare.RigidBody(m.turning_inertia_kg_m2 + sheave + mass * lift**2, mass * m.gravity_m_s2 * lift)


def _weight(m: Hoist, payload_kg: float) -> float:
    """Of carriage and payload, N."""
    return _mass(m, payload_kg) * m.gravity_m_s2


def _level(m: Hoist) -> float:
    """The guide's friction, both ways on average, N."""
    return 0.5 * (m.guide.coulomb_hoisting_n + m.guide.coulomb_lowering_n)


def _limits(m: Hoist) -> Limits:
    return Limits(
        nominal_speed=m.motor.nominal_speed_rad_s,
        nominal_input=m.motor.count * m.motor.nominal_torque_nm,
        lowest=m.rail.lowest_position_m,
        highest=m.highest_position_m,
        length=m.wire.segment_length_m,
        empty_mass_kg=m.carriage.mass_kg,
        motors=m.motor.count,
    )


def _torque_limit(m: Hoist) -> float:
    """Of all motors together at or below nominal speed, N m: the harder-worked one limits them all."""
    return m.motor.nominal_torque_nm * m.drive.overload / m.torque_share


def _load(m: Hoist, payload_kg: float) -> Load:
    """Two falls over the sheave: the carriage hangs on twice a fall's stiffness, at the height of the wire's middle."""
    return Load(
        drive_kg=m.turning_inertia_kg_m2 / m.lift_m_per_rad**2,
        mass_kg=_mass(m, payload_kg),
        stiffness_n_per_m=2.0 * m.wire.youngs_modulus_pa * m.wire.effective_area_m2 / m.wire.segment_length_m,
        damping_time_s=m.wire.damping_time_s,
        hold_n=_weight(m, payload_kg),
        friction_up_n=m.guide.coulomb_hoisting_n,
        friction_down_n=m.guide.coulomb_lowering_n,
        force_limit_n=_torque_limit(m) / m.lift_m_per_rad,
    )


def _tension(t: Array, states: Array, p: Any, effects: Any) -> Any:
    """At the dead anchor, N: `states` are sheave angle, height, sheave speed, carriage speed."""
    angle, height, turn, speed = states[:, :4].T
    return dead_line_tension(t, angle, height, turn, speed, p, effects)


def _cross_checks(
    m: Hoist, run: Run, position: Array, smooth: Callable[[Array], Array], slope: Callable[[Array, Array], float]
) -> Iterator[declare.CrossCheck]:
    """Height against the motors' way; the dead line against half of the weight."""
    if HEIGHT in run:
        ratio = slope(m.lift_m_per_rad * position, run[HEIGHT])
        yield declare.CrossCheck(
            ratio,
            f"{HEIGHT} goes {ratio:.3g} times the way that {SPEED} takes the carriage; "
            "is its sign flipped, or is it in another unit?",
            f"{HEIGHT} does not go the way that {SPEED} and machine.yaml's drum and gearbox say",
        )
    if TENSION in run:
        carried = _weight(m, run.payload_kg) / 2.0
        ratio = float(np.mean(run[TENSION])) / carried
        yield declare.CrossCheck(
            ratio,
            f"{TENSION} is {ratio * carried:.4g} N on average, half of carriage and payload weighs "
            f"{carried:.4g} N; is it in kN, of both falls, or its sign flipped?",
        )


def _transmitted(p: Any, s: Any, torque: Array, acceleration: Array, payload_kg: float) -> tuple[Array, float]:
    """What the rotors and the drum do not take, N m; carriage and stated payload, kg."""
    inertia = p.n_m * p.J_m + p.J_w / p.ratio**2
    return torque - inertia * acceleration, float(p.m_c + payload_kg)


def _guide_sign(s: Any, p: Any) -> Scalar:
    """Linear around standstill and exact beyond: the guide's own switch never quite ends."""
    return clip(p.slope * s.v, -1.0, 1.0)


def _guide_way(s: Any, p: Any) -> Array:
    return np.asarray(np.arctan(p.slope * s.v) * (2.0 / math.pi))


def _motor_way(s: Any, p: Any) -> Array:
    return np.clip(s.w / p.ratio / PIN_SPEED, -1.0, 1.0)


def _top_speed(m: Hoist) -> declare.TopSpeed:
    nominal = m.motor.nominal_speed_rad_s
    allowed = nominal * (m.winch.drum_diameter_m / 2.0) / (2.0 * m.gearbox.ratio)
    return declare.TopSpeed(allowed, f"{{limit:g}} m/s turns the motor faster than its nominal {nominal:g} rad/s")


def _places(m: Hoist) -> tuple[float, ...]:
    """Near the bottom, in the middle, near the top of the rail, where a tenth of the wire is still free."""
    low = m.rail.lowest_position_m
    high = min(m.highest_position_m, 0.9 * m.wire.segment_length_m)
    return low, 0.5 * (low + high), high


def _drive_words(m: Hoist) -> str:
    motor, peak = m.motor, m.motor.nominal_torque_nm * m.drive.overload
    return (
        f"{motor.count} motors of {motor.nominal_torque_nm:g} N m nominal at {motor.nominal_speed_rad_s:g} rad/s, peak "
        f"{peak:g} N m each"
    )


CLOSED_LOOP = declare.ClosedLoop(
    position="angle_motor_rad",
    speed=SPEED,
    references=(SPEED_REFERENCE,),
    recorded=(
        TORQUE,
        SPEED,
        SPEED_REFERENCE,
        HEIGHT,
        "speed_carriage_m_s",
        "acceleration_carriage_m_s2",
        "tension_drum_n",
        TENSION,
        "tension_min_n",
    ),
    rail=lambda m: (m.rail.lowest_position_m, m.highest_position_m),
    top=lambda m: float(m.wire.segment_length_m),
    per_displacement=lambda m: 2.0 * m.gearbox.ratio / (m.winch.drum_diameter_m / 2.0),
    top_speed=_top_speed,
    speed_scale=lambda m: float(m.motor.nominal_speed_rad_s),
    input_scale=lambda m: float(m.motor.nominal_torque_nm),
    # Rotors, drum, carriage and payload as the motor shaft feels them on a stiff wire, kg m².
    total_inertia=lambda m, payload: m.turning_inertia_kg_m2 + (m.carriage.mass_kg + payload) * m.lift_m_per_rad**2,
    even_speed=lambda m: 0.5 * float(m.motor.nominal_speed_rad_s),
    places=_places,
    start="the carriage's height",
    input_limit=_torque_limit,
    peak_limit=lambda m: float(m.motor.nominal_torque_nm * m.drive.overload),
    nominal=lambda m: float(m.motor.nominal_torque_nm),
    drive_words=_drive_words,
    giver="the motors give",
    swing="the load swings on its wire while the motor stands",
    where=lambda payload_kg, place: f"{payload_kg:g} kg at {place:g} m",
    motion_words={word: word for word in ("hoisting", "lowering", "at_rest")},
    more_often=("at every payload", "payload"),
    drawn=(
        "motor.rotor_inertia_kg_m2",
        "carriage.mass_kg",
        "sensors.payload_scale",
        "guide.coulomb_hoisting_n",
        "guide.coulomb_lowering_n",
        "bearing.pin_friction_coefficient",
        "wire.youngs_modulus_pa",
    ),
)

KIND = Kind(
    record=Hoist,
    example=lambda: validate(Hoist, load(EXAMPLE)),
    name=HOIST.kind,
    noun="hoist",
    plant=HOIST,
    family=(HOIST.kind,),
    words={"n": "n", "m": "m", "input": "nm", "up": "hoisting", "dn": "lowering"},
    drive=declare.Input("torque", "N m", "nm", MOTORS),
    moved=declare.Moved("carriage", "m", "height of the carriage", placed_by_log=False),
    directions=declare.Directions(("hoisting", "lowering"), (("hoist", "lowering"), ("lower", "hoisting")), "Hoisting"),
    signals=declare.SignalSet(
        needed=(((declare.TIME,),), (MOTORS, (TORQUE,)), ((SPEED,),)), optional=(SPEED_REFERENCE, HEIGHT, TENSION)
    ),
    reference=(SPEED_REFERENCE, SPEED),
    speed_scale=("nominal motor speed", "nominal"),
    sensor=("sensors.torque_gain", "sensors.torque_offset_nm"),
    friction=declare.Friction(("F_up", "F_dn"), {}, "speed_carriage_m_s", guide_friction, viscous=False, unit="N"),
    values=VALUES,
    # Friction both ways, mass, inertia and offset: what wear, load and sensors change.
    watched=(
        "guide.coulomb_hoisting_n",
        "guide.coulomb_lowering_n",
        "carriage.mass_kg",
        "motor.rotor_inertia_kg_m2",
        "sensors.torque_offset_nm",
    ),
    sizes=_sizes,
    transmitted=_transmitted,
    rigid=_rigid,
    tables=(
        Table("position_carriage_m", "guide", lambda s, p: s.x),
        Table("speed_carriage_m_s", "guide", lambda s, p: absolute(s.v)),
        Table("speed_motor_rad_s", "motor", lambda s, p: absolute(s.w)),
        Table("angle_drum_rad", "motor", lambda s, p: s.angle / p.ratio, turn=True),
        Table("angle_motor_rad", "motor", lambda s, p: s.angle, turn=True),
        Table("payload_kg", "guide", lambda s, p: p.m_p),
        Table("torque_load_nm", "motor", lambda s, p: s.load),
        Table("time_s", "guide", lambda s, p: s.t),
        Table("campaign_time_s", "guide", lambda s, p: s.t + p.start_time_s),
    ),
    ports={
        # Two falls carry a force on the carriage, and nothing of a torque at the motor.
        "guide": declare.Port("guide_force_n", "N", "v", _guide_sign, _guide_way, on_moved=True, share=0.5),
        "motor": declare.Port("motor_torque_nm", "N m", "w", lambda s, p: s.switch, _motor_way, on_moved=False),
    },
    floor="sensors",
    nuisances=(
        NuisancePrior("gearbox_efficiency", lambda m, sizes: float(m.tolerances.gearbox_loss)),
        NuisancePrior("friction_load_dependent", lambda m, sizes: float(m.tolerances.load_friction)),
        NuisancePrior("friction_viscous", lambda m, sizes: float(m.tolerances.viscous) * _level(m) / sizes.speed),
        NuisancePrior("friction_stribeck", lambda m, sizes: float(m.tolerances.stribeck) * _level(m)),
        NuisancePrior("drum_eccentricity", lambda m, sizes: float(m.tolerances.eccentricity) * sizes.radius),
        NuisancePrior("torque_ripple", lambda m, sizes: float(m.tolerances.ripple) * sizes.torque, fitted=False),
    ),
    model_error=declare.ModelError(load=0.0002, inertia=0.003, standstill=0.02, slow=0.08, time_s=0.6),
    whole="",
    transmission=lambda m: float(m.lift_m_per_rad),
    nominal_speed=lambda m: float(m.motor.nominal_speed_rad_s),
    motor_torque=lambda m: float(m.motor.nominal_torque_nm),
    payload=True,
    studies=True,
    closed_loop=CLOSED_LOOP,
    start=declare.Start(
        "the carriage height at the first sample",
        "a height",
        lambda m: (0.0, m.wire.segment_length_m, "where the dead anchor is"),
    ),
    limits=_limits,
    load=_load,
    weight=_weight,
    gravity=lambda m: float(m.gravity_m_s2),
    dead_line=declare.DeadLine(
        TENSION,
        _tension,
        pull_per_input=lambda m: m.gearbox.ratio / (m.winch.drum_diameter_m / 2.0),
        at_rest=lambda m, payload_kg: 0.5 * _weight(m, payload_kg),
    ),
    turning=(
        declare.Turning("drum", lambda m: 2.0 / (np.pi * m.winch.drum_diameter_m), ("drum_angle", "drum's angle")),
        declare.Turning("motor", lambda m: 1.0 / (2.0 * np.pi * m.lift_m_per_rad)),
        declare.Turning("sheave", lambda m: 2.0 / (2.0 * np.pi * m.sheave.diameter_m)),
    ),
    to_log=(TENSION,),
    zero_input="a hoist's motors hold its load",
    cross_checks=_cross_checks,
)
