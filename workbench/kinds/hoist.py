"""The hoist: motors, gearbox, drum, a wire over a sheave on a guided carriage with a payload."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from workbench.kinds.closed_loop import ClosedLoop, TopSpeed
from workbench.kinds.load import Load
from workbench.kinds.record import (
    TIME,
    BaseValue,
    CrossCheck,
    DeadLine,
    Directions,
    Discrepancy,
    Drive,
    Friction,
    Kind,
    Limits,
    Moved,
    Port,
    RigidBody,
    SignalSet,
    Start,
    Table,
    Trace,
    Turning,
)
from workbench.kinds.sizes import Sizes
from workbench.machine import Hoist
from workbench.plants.hoist import HOIST, PIN_SPEED, dead_line_tension, guide_friction
from workbench.run import Array, Run
from workbench.trace.expr import Scalar, absolute, clip

SPEED, TORQUE = "speed_motor_rad_s", "torque_motor_nm"
MOTORS = ("torque_motor1_nm", "torque_motor2_nm")
SPEED_REFERENCE, HEIGHT, TENSION = "speed_reference_rad_s", "position_carriage_m", "tension_dead_line_n"


def lift(m: Hoist) -> float:
    return m.lift_m_per_rad


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
        inertia=m.motor.count * m.motor.rotor_inertia_kg_m2 + m.winch.inertia_kg_m2 / m.gearbox.ratio**2,
    )


def _mass(m: Hoist, payload_kg: float) -> float:
    """Carriage and a stated payload as the machine has it, kg."""
    return m.carriage.mass_kg + m.sensors.payload_scale * payload_kg


def _rigid(m: Hoist, payload_kg: float) -> RigidBody:
    """On a stiff wire: rotors, drum, sheave, carriage and payload at the motor shaft."""
    mass = _mass(m, payload_kg)
    sheave = m.sheave.inertia_kg_m2 * (2.0 * m.lift_m_per_rad / m.sheave.diameter_m) ** 2
    turning = m.motor.count * m.motor.rotor_inertia_kg_m2 + m.winch.inertia_kg_m2 / (m.gearbox.ratio**2)
    return RigidBody(turning + sheave + mass * m.lift_m_per_rad**2, mass * m.gravity_m_s2 * m.lift_m_per_rad)


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
    share = max(m.drive.torque_share, 1.0 - m.drive.torque_share) if m.motor.count == 2 else 1.0 / m.motor.count
    return m.motor.nominal_torque_nm * m.drive.overload / share


def _load(m: Hoist, payload_kg: float) -> Load:
    """Two falls over the sheave: the carriage hangs on twice a fall's stiffness, at the height of the wire's middle."""
    turning = m.motor.count * m.motor.rotor_inertia_kg_m2 + m.winch.inertia_kg_m2 / m.gearbox.ratio**2
    return Load(
        drive_kg=turning / m.lift_m_per_rad**2,
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
) -> Iterator[CrossCheck]:
    """Height against the motors' way; the dead line against half of the weight."""
    if HEIGHT in run:
        ratio = slope(m.lift_m_per_rad * position, run[HEIGHT])
        yield CrossCheck(
            ratio,
            f"{HEIGHT} goes {ratio:.3g} times the way that {SPEED} takes the carriage; "
            "is its sign flipped, or is it in another unit?",
            f"{HEIGHT} does not go the way that {SPEED} and machine.yaml's drum and gearbox say",
        )
    if TENSION in run:
        carried = _weight(m, run.payload_kg) / 2.0
        ratio = float(np.mean(run[TENSION])) / carried
        yield CrossCheck(
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


def _shaft_inertia(m: Hoist, payload_kg: float) -> float:
    """Rotors, drum, carriage and payload as the motor shaft feels them on a stiff wire, kg m²."""
    turning = m.motor.count * m.motor.rotor_inertia_kg_m2 + m.winch.inertia_kg_m2 / m.gearbox.ratio**2
    return turning + (m.carriage.mass_kg + payload_kg) * m.lift_m_per_rad**2


def _top_speed(m: Hoist) -> TopSpeed:
    nominal = m.motor.nominal_speed_rad_s
    allowed = nominal * (m.winch.drum_diameter_m / 2.0) / (2.0 * m.gearbox.ratio)
    return TopSpeed(allowed, f"{{limit:g}} m/s turns the motor faster than its nominal {nominal:g} rad/s")


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


CLOSED_LOOP = ClosedLoop(
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
    per_way=lambda m: 2.0 * m.gearbox.ratio / (m.winch.drum_diameter_m / 2.0),
    top_speed=_top_speed,
    speed_scale=lambda m: float(m.motor.nominal_speed_rad_s),
    input_scale=lambda m: float(m.motor.nominal_torque_nm),
    total_inertia=_shaft_inertia,
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
    name=HOIST.kind,
    noun="hoist",
    plant=HOIST,
    family=(HOIST.kind,),
    words={"n": "n", "m": "m", "input": "nm", "up": "hoisting", "dn": "lowering"},
    drive=Drive("torque", "N m", "nm", MOTORS),
    moved=Moved("carriage", "m", "height of the carriage", placed_by_log=False),
    directions=Directions(("hoisting", "lowering"), (("hoist", "lowering"), ("lower", "hoisting")), "Hoisting"),
    signals=SignalSet(
        needed=(((TIME,),), (MOTORS, (TORQUE,)), ((SPEED,),)),
        optional=(SPEED_REFERENCE, HEIGHT, TENSION),
    ),
    reference=(SPEED_REFERENCE, SPEED),
    speed_scale=("nominal motor speed", "nominal"),
    sensor=("sensors.torque_gain", "sensors.torque_offset_nm"),
    friction=Friction(("F_up", "F_dn"), {}, "speed_carriage_m_s", guide_friction, viscous=False, unit="N"),
    base=(
        # Each friction level is held by its own tolerance: motion shows their sum well and their difference only
        # together with weight and offset, and that is where a hold is needed.
        BaseValue("guide.coulomb_hoisting_n", "coulomb"),
        BaseValue("guide.coulomb_lowering_n", "coulomb"),
        BaseValue("guide.atan_slope_s_per_m", spread="factor"),
        BaseValue("motor.rotor_inertia_kg_m2", "rotor_inertia"),
        BaseValue("carriage.mass_kg", "carriage_mass"),
        BaseValue("sensors.payload_scale", "payload", with_payload=True),
        BaseValue("bearing.pin_friction_coefficient", "pin_friction"),
        BaseValue("wire.youngs_modulus_pa", "wire_stiffness"),
        BaseValue("sensors.torque_gain", "torque_gain"),
        BaseValue("sensors.torque_offset_nm", "torque_offset_nm", spread="absolute", signed=True),
    ),
    free=(
        "guide.coulomb_hoisting_n",
        "guide.coulomb_lowering_n",
        "guide.atan_slope_s_per_m",
        "motor.rotor_inertia_kg_m2",
        "carriage.mass_kg",
        "sensors.payload_scale",
        "bearing.pin_friction_coefficient",
        "wire.youngs_modulus_pa",
        "sensors.torque_gain",
        "sensors.torque_offset_nm",
    ),
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
        "guide": Port("guide_force_n", "N", "v", _guide_sign, _guide_way, levered=True, share=0.5),
        "motor": Port("motor_torque_nm", "N m", "w", lambda s, p: s.switch, _motor_way, levered=False),
    },
    floor="sensors",
    traces=(
        Trace("gearbox_efficiency", lambda m, sizes: float(m.tolerances.gearbox_loss)),
        Trace("friction_load_dependent", lambda m, sizes: float(m.tolerances.load_friction)),
        Trace("friction_viscous", lambda m, sizes: float(m.tolerances.viscous) * _level(m) / sizes.speed),
        Trace("friction_stribeck", lambda m, sizes: float(m.tolerances.stribeck) * _level(m)),
        Trace("drum_eccentricity", lambda m, sizes: float(m.tolerances.eccentricity) * sizes.radius),
        Trace("torque_ripple", lambda m, sizes: float(m.tolerances.ripple) * sizes.torque, fitted=False),
    ),
    discrepancy=Discrepancy(load=0.0002, inertia=0.003, standstill=0.02, slow=0.08, time_s=0.6),
    whole="",
    lever=lift,
    nominal_speed=lambda m: float(m.motor.nominal_speed_rad_s),
    motor_torque=lambda m: float(m.motor.nominal_torque_nm),
    log_timing=True,
    payload=True,
    studies=True,
    closed_loop=CLOSED_LOOP,
    start=Start(
        "the carriage height at the first sample",
        "a height",
        lambda m: (0.0, m.wire.segment_length_m, "where the dead anchor is"),
    ),
    limits=_limits,
    load=_load,
    weight=_weight,
    gravity=lambda m: float(m.gravity_m_s2),
    dead_line=DeadLine(
        TENSION,
        _tension,
        pull_per_input=lambda m: m.gearbox.ratio / (m.winch.drum_diameter_m / 2.0),
        at_rest=lambda m, payload_kg: 0.5 * _weight(m, payload_kg),
    ),
    turning=(
        Turning("drum", lambda m: 4.0 / (2.0 * np.pi * m.winch.drum_diameter_m), ("drum_angle", "drum's angle")),
        Turning("motor", lambda m: 1.0 / (2.0 * np.pi * m.lift_m_per_rad)),
        Turning("sheave", lambda m: 2.0 / (2.0 * np.pi * m.sheave.diameter_m)),
    ),
    to_log=(HEIGHT, TENSION),
    zero_input="a hoist's motors hold its load",
    cross_checks=_cross_checks,
)
