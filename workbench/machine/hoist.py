"""`kind: hoist`: a winch, a wire over a sheave on the carriage, a guided carriage.

Key names and order are those of machine.yaml; units stand in the names. Sources of
the symbols: the paper's Table of parameters; see docs/formats.md for every key.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from workbench.machine.arm import Arm
from workbench.machine.correction import HoistCorrection, MeasuredCorrection
from workbench.machine.named import by_name
from workbench.machine.quantities import (
    Area,
    Cycle,
    Delay,
    Force,
    Gain,
    Gravity,
    Inertia,
    Lag,
    Length,
    Level,
    Mass,
    Modulus,
    Offset,
    Overload,
    Position,
    Ratio,
    Sharpness,
    Speed,
    Tolerance,
)
from workbench.machine.record import EffectValues, Identified, Record


class Motor(Record):
    """`count` equal motors on one gearbox; inertia and nominal torque are one motor's."""

    count: Annotated[int, Field(ge=1, le=100, strict=True)]
    rotor_inertia_kg_m2: Inertia
    nominal_torque_nm: Force
    nominal_speed_rad_s: Speed


class Gearbox(Record):
    """`ratio` is motor speed over drum speed."""

    ratio: Ratio


class Winch(Record):
    """The drum with what turns with it."""

    drum_diameter_m: Length
    pin_diameter_m: Length
    inertia_kg_m2: Inertia
    mass_kg: Mass

    @model_validator(mode="after")
    def _pin_fits(self) -> Winch:
        if self.pin_diameter_m >= self.drum_diameter_m:
            raise ValueError(
                f"pin_diameter_m {self.pin_diameter_m}, expected less than drum_diameter_m {self.drum_diameter_m}"
            )
        return self


class Sheave(Record):
    """The sheave on the carriage."""

    diameter_m: Length
    pin_diameter_m: Length
    inertia_kg_m2: Inertia
    mass_kg: Mass

    @model_validator(mode="after")
    def _pin_fits(self) -> Sheave:
        if self.pin_diameter_m >= self.diameter_m:
            raise ValueError(f"pin_diameter_m {self.pin_diameter_m}, expected less than diameter_m {self.diameter_m}")
        return self


class Bearing(Record):
    pin_friction_coefficient: Annotated[float, Field(ge=0.0, lt=1.0, strict=True, allow_inf_nan=False)]


class Wire(Record):
    """Stiffness of one fall is E·A over its free length; `damping_time_s` is c/k."""

    youngs_modulus_pa: Modulus
    effective_area_m2: Area
    segment_length_m: Length
    damping_time_s: Lag
    breaking_load_n: Force | None = None


class Carriage(Record):
    mass_kg: Mass


class Guide(Record):
    """Friction force level(direction) · (2/π)·atan(slope · speed); levels are magnitudes."""

    coulomb_hoisting_n: Level
    coulomb_lowering_n: Level
    atan_slope_s_per_m: Sharpness


class HoistTolerances(Record):
    """One standard deviation of each nominal value, relative unless the name carries a unit."""

    rotor_inertia: Tolerance = 0.01
    carriage_mass: Tolerance = 0.004
    payload: Tolerance = 0.005
    coulomb: Tolerance = 0.15
    pin_friction: Tolerance = 0.1
    wire_stiffness: Tolerance = 0.05
    torque_gain: Tolerance = 0.005
    torque_offset_nm: Level = 3.0
    # Of what every machine has a little of: loss of the gearbox; guide friction over the payload's weight; viscous
    # friction at nominal speed and Stribeck's peak, of the friction level; eccentricity of the drum, of its radius;
    # ripple of the torque, of the motors' nominal torque together.
    gearbox_loss: Tolerance = 0.002
    load_friction: Tolerance = 0.002
    viscous: Tolerance = 0.03
    stribeck: Tolerance = 0.1
    eccentricity: Tolerance = 0.0003
    ripple: Tolerance = 0.002


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

    overload: Overload = 1.6
    overload_time_s: Cycle = 10.0
    overload_period_s: Cycle = 300.0
    field_weakening: bool = True
    torque_lag_s: Lag = 0.002
    speed_filter_s: Lag = 0.003
    speed_delay_s: Delay = 0.001
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

    lowest_position_m: Position = 0.0
    highest_position_m: Position | None = None


class HoistSensors(Record):
    """Logged torque = gain · true torque + offset, both of the motors' sum; true payload = scale · stated payload."""

    torque_gain: Gain = 1.0
    torque_offset_nm: Offset = 0.0
    payload_scale: Gain = 1.0


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
    gravity_m_s2: Gravity = 9.81
    drive: Annotated[Drive, *BY_NAME] = Drive()
    rail: Rail = Rail()
    arm: Arm = Arm()
    sensors: HoistSensors = HoistSensors()
    tolerances: HoistTolerances = HoistTolerances()
    effects: EffectValues = Field(default_factory=dict)
    measured_correction: HoistCorrection | None = None
    identified: Identified = Field(default_factory=dict)

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
    def lift_m_per_rad(self) -> float:
        """Carriage travel per motor angle on a stiff wire: two falls, so half of what the drum takes up."""
        return self.winch.drum_diameter_m / (4.0 * self.gearbox.ratio)
