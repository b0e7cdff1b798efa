"""The controller and its reference in the parameters of drives that have a speed controller of their own.

What was read in a manual has its page as `source`: ABB's gain (a gain of 1 makes of an error of 10 % of the motor's
synchronous speed 10 % of torque), its integral time (in which a constant error at gain 1 adds as much again; 0 is
none), its acceleration compensation; Siemens' ramp, in the manual of an older drive: ramp-up takes
(v2 - v1)/p1082 p1120 + (p1130 + p1131)/2. The other numbers, names and units were not compared with the manuals named
in `DRIVES`, and every file says so (`UNCHECKED`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType, SimpleNamespace

from workbench.control import PiSettings, feed_forward
from workbench.machines import HOIST, Hoist

UNCHECKED = (
    "Numbers, names and units of parameters without a source were not compared with the drive's manual; compare each "
    "before it is entered."
)
MM440 = "MICROMASTER 440 Operating Instructions 10/06, p. 183, section 3.12.2, the ramp of an older Siemens drive"
GAIN = "ACS880-104 firmware manual, p. 269: 0.00 to 250.00; an error of 10 % of synchronous speed gives 10 %"
INTEGRAL = "ACS880-x04 firmware manual, p. 233: 0.00 to 1000.00 s; 0 disables the integral part"
DERIVATIVE = "ACS880 ESP firmware manual, p. 271: at 0 the controller works as a PI"
ACCELERATION = "ACS880 firmware manual, p. 329: 0.00 to 1000.00 s; 50 to 100 % of the mechanical time constant"
RPM = 60.0 / (2.0 * math.pi)


@dataclass(frozen=True)
class RampLimits:
    """Of the carriage: m/s, m/s^2, m/s^3; jerk None: a trapezoid."""

    speed_m_s: float
    acceleration_m_s2: float
    jerk_m_s3: float | None = None


@dataclass(frozen=True)
class Setting:
    """One parameter of a drive: number and name as its manual has them, the value in the manual's unit, and why.
    source: where the manual was read, "" where it was not."""

    number: str
    name: str
    value: float
    unit: str
    why: str
    source: str = ""


@dataclass(frozen=True)
class DriveSettings:
    """For one of `drives` equal drives. differs: what that drive's controller does not do as the exported one."""

    drive: str
    manual: str
    drives: int
    settings: tuple[Setting, ...]
    differs: tuple[str, ...]


@dataclass(frozen=True)
class _Case:
    """What every drive is asked for, of one of the motors. inertia: kg m^2 fed forward; lowering a motor: its share."""

    settings: PiSettings
    machine: Hoist
    ramp: RampLimits | None
    kp: float
    inertia: float

    @property
    def integral_time_s(self) -> float:
        """Tn = kp/ki; 0 where there is no integral part."""
        ki = self.settings.ki_nm_per_rad
        return self.settings.kp_nm_s_per_rad / ki if ki > 0.0 else 0.0

    @property
    def top_rad_s(self) -> float:
        return self.machine.motor.nominal_speed_rad_s

    @property
    def ramp_time_s(self) -> float:
        """From standstill to nominal speed at the acceleration's limit."""
        assert self.ramp is not None
        return self.top_rad_s * self.machine.lift_m_per_rad / self.ramp.acceleration_m_s2

    @property
    def rounding_time_s(self) -> float:
        """In which the acceleration comes up at the jerk's limit: a/j."""
        assert self.ramp is not None
        return 0.0 if self.ramp.jerk_m_s3 is None else self.ramp.acceleration_m_s2 / self.ramp.jerk_m_s3


def drive_settings(
    drive: str, settings: PiSettings, machine: Hoist, payload_kg: float = 0.0, ramp: RampLimits | None = None
) -> DriveSettings:
    """The parameters of one drive, each motor on its own: gains and inertia are divided by the number of motors.

    KeyError for a drive that is not among DRIVES.
    """
    n = machine.motor.count
    p = {**vars(HOIST.plant.values(machine, payload_kg)), "ff_J": 1.0, "ff_w": 0.0, "ff_F": 0.0, "T_hold": 0.0}
    inertia = float(feed_forward(SimpleNamespace(**p), 0.0, 1.0))
    case = _Case(settings, machine, ramp, settings.kp_nm_s_per_rad / n, inertia / n)
    manual, made = DRIVES[drive]
    return DriveSettings(drive, manual, n, tuple(made(case)), tuple(_differences(drive, case)))


def _siemens(c: _Case) -> list[Setting]:
    s, motor = c.settings, c.machine.motor
    most = motor.nominal_torque_nm * c.machine.drive.overload
    made = [
        Setting("p1082", "Maximum speed", c.top_rad_s * RPM, "rpm", "the motor's nominal speed; ramps refer to it"),
        Setting("p1460", "Speed controller P gain adaptation speed, lower", c.kp, "Nms/rad", "kp of one motor"),
        Setting("p1462", "Speed controller integral time adaptation speed, lower", 1e3 * c.integral_time_s, "ms",
                "Tn = kp/ki"),
        Setting("p1461", "Speed controller Kp adaptation speed, upper scaling", 100.0, "%", "no adaptation over speed"),
        Setting("p1463", "Speed controller Tn adaptation speed, upper scaling", 100.0, "%", "no adaptation over speed"),
        Setting("p1520", "Torque limit upper", most, "Nm", "nominal torque times overload"),
        Setting("p1521", "Torque limit lower", -most, "Nm", "nominal torque times overload"),
    ]  # fmt: skip
    if s.feed_forward.inertia > 0.0:
        made += [
            Setting("p0341", "Motor moment of inertia", motor.rotor_inertia_kg_m2, "kgm2", "of one rotor"),
            Setting("p0342", "Ratio between the total and motor moment of inertia",
                    c.inertia / motor.rotor_inertia_kg_m2, "", "one motor's share of all that moves, over its rotor"),
            Setting("p1496", "Acceleration precontrol scaling", 100.0 * s.feed_forward.inertia, "%",
                    "share of the inertia's torque that is fed forward"),
        ]  # fmt: skip
    if s.set_point_weight == 0.0 and c.integral_time_s > 0.0:
        made.append(Setting("p1416", "Speed setpoint filter 1 time constant", 1e3 * c.integral_time_s, "ms",
                            "a PT1 of Tn before a PI equals a set-point weight of 0"))  # fmt: skip
    if s.notch is not None:
        f, damping = s.notch.frequency_hz, s.notch.damping
        made += [
            Setting("p1657", "Current setpoint filter 1 type", 2.0, "", "general second-order filter"),
            Setting("p1658", "Current setpoint filter 1 denominator natural frequency", f, "Hz", "of the notch"),
            Setting("p1659", "Current setpoint filter 1 denominator damping", damping, "", "of the notch"),
            Setting("p1660", "Current setpoint filter 1 numerator natural frequency", f, "Hz", "of the notch"),
            Setting("p1661", "Current setpoint filter 1 numerator damping", s.notch.depth * damping, "",
                    "depth times damping"),
        ]  # fmt: skip
    if c.ramp is not None:
        for number, name in (("p1120", "Ramp-function generator ramp-up time"),
                             ("p1121", "Ramp-function generator ramp-down time")):  # fmt: skip
            made.append(
                Setting(number, name, c.ramp_time_s, "s", "from standstill to p1082 at the largest acceleration", MM440)
            )
        for number, name in (("p1130", "Ramp-function generator initial rounding-off time"),
                             ("p1131", "Ramp-function generator final rounding-off time")):  # fmt: skip
            made.append(Setting(number, name, c.rounding_time_s, "s", "acceleration over jerk", MM440))
    return made


def _abb(c: _Case) -> list[Setting]:
    s, motor = c.settings, c.machine.motor
    gain = c.kp * c.top_rad_s / motor.nominal_torque_nm
    made = [
        Setting("46.01", "Speed scaling", c.top_rad_s * RPM, "rpm", "the motor's nominal speed; ramps refer to it"),
        Setting(
            "25.02",
            "Speed proportional gain",
            gain,
            "",
            "kp of one motor times nominal speed over nominal torque",
            GAIN,
        ),
        Setting(
            "25.03",
            "Speed integration time",
            c.integral_time_s,
            "s",
            "kp/ki; 0 switches the integral part off",
            INTEGRAL,
        ),
        Setting("25.04", "Speed derivation time", 0.0, "s", "the controller is a PI", DERIVATIVE),
        Setting("30.19", "Minimum torque 1", -100.0 * c.machine.drive.overload, "%", "overload, of nominal torque"),
        Setting("30.20", "Maximum torque 1", 100.0 * c.machine.drive.overload, "%", "overload, of nominal torque"),
    ]
    if s.feed_forward.inertia > 0.0:
        time = s.feed_forward.inertia * c.inertia * c.top_rad_s / motor.nominal_torque_nm
        made.append(Setting("25.06", "Acc comp derivation time", time, "s",
                            "share fed forward of inertia times nominal speed over nominal torque",
                            ACCELERATION))  # fmt: skip
    if c.ramp is not None:
        made += [
            Setting(number, name, c.ramp_time_s, "s", "from standstill to 46.01 at the largest acceleration")
            for number, name in (("23.12", "Acceleration time 1"), ("23.13", "Deceleration time 1"))
        ]
        made += [
            Setting(number, name, c.rounding_time_s, "s", "acceleration over jerk")
            for number, name in (("23.16", "Shape time acc 1"), ("23.17", "Shape time acc 2"),
                                 ("23.18", "Shape time dec 1"), ("23.19", "Shape time dec 2"))
        ]  # fmt: skip
    return made


def _generic(c: _Case) -> list[Setting]:
    motor = c.machine.motor
    made = [
        Setting("kp", "proportional gain", c.kp, "Nms/rad", "of one motor, torque over motor speed"),
        Setting("kp_per_unit", "proportional gain per unit", c.kp * c.top_rad_s / motor.nominal_torque_nm, "",
                "nominal torque over nominal speed"),
        Setting("Tn", "integral time", c.integral_time_s, "s", "kp/ki"),
        Setting("ki", "integral gain", c.settings.ki_nm_per_rad / motor.count, "Nm/rad", "of one motor"),
        Setting("torque_limit", "torque limit", motor.nominal_torque_nm * c.machine.drive.overload, "Nm", ""),
        Setting("inertia", "inertia at the motor", c.inertia, "kgm2", "one motor's share of all that moves"),
    ]  # fmt: skip
    if c.ramp is not None:
        made += [
            Setting(
                "ramp_time", "time from standstill to nominal speed", c.ramp_time_s, "s", "at the largest acceleration"
            ),
            Setting(
                "rounding_time", "rounding at both ends of a ramp", c.rounding_time_s, "s", "acceleration over jerk"
            ),
        ]
    return made


def _differences(drive: str, c: _Case) -> list[str]:
    """What is not the same in the drive, in sentences."""
    s, said = c.settings, [] if drive == "generic" else [UNCHECKED]
    if c.machine.motor.count > 1:
        said.append(
            f"The values are for one of {c.machine.motor.count} drives. Let one of them control the speed and the "
            "others follow its torque, or their integral parts work against each other."
        )
    if s.set_point_weight not in (0.0, 1.0) or (drive != "siemens-s120" and s.set_point_weight == 0.0):
        said.append(
            f"The set-point weight {s.set_point_weight:g} is not among the parameters: the drive's PI takes the whole "
            "set point, so a jump of it gives a larger torque peak."
        )
    if drive == "siemens-s120":
        said.append(
            "The drive can follow a reference model (p1433 to p1435), which delays the set point of the integral part; "
            "it is to be off (p1400.3 = 0)."
        )
        if s.set_point_weight == 0.0:
            said.append("The set-point filter 1 has to be switched on (p1414.0 = 1) as a PT1 (p1415 = 0).")
        if s.notch is not None:
            said.append("The current set-point filter 1 has to be switched on (p1656.0 = 1).")
    elif s.notch is not None:
        said.append(f"The notch at {s.notch.frequency_hz:g} Hz is not among the parameters.")
    if s.low_pass_hz is not None:
        said.append(f"The first-order low-pass at {s.low_pass_hz:g} Hz of the torque is not among the parameters.")
    if s.torque_rate_limit_nm_per_s is not None:
        said.append("The rate limit of the torque is not among the parameters.")
    if s.feed_forward.through_the_wire:
        said.append("The drive's acceleration precontrol takes the load as rigid: it does not know the wire.")
    if s.feed_forward.weight > 0.0 or s.feed_forward.friction > 0.0:
        said.append(
            "Feed-forward of weight and friction needs an additional torque set point from the controller above."
        )
    filtered_s = c.machine.drive.speed_filter_s
    if filtered_s > 0.0:
        said.append(
            f"The gains were tuned behind a speed filter of {1e3 * filtered_s:g} ms; give the drive's own smoothing of "
            f"the actual speed{' (servo: p1441)' if drive == 'siemens-s120' else ''} the same time."
        )
    if s.anti_windup != "none":
        said.append(
            "The drive stops its integral part at a limit in its own way; back at the limit's end it may differ."
        )
    if s.ki_nm_per_rad == 0.0:
        said.append(
            "There is no integral part: an integral time of 0 stands for that; see the manual how it is switched off."
        )
    if drive == "abb-acs880":
        said.append(
            "25.02 counts the error in the motor's synchronous speed, which machine.yaml does not hold: its nominal "
            "speed stands for it. Multiply 25.02 by synchronous over nominal speed where they differ."
        )
        if s.feed_forward.inertia > 0.0:
            said.append("The drive filters its acceleration compensation (25.07, 8 ms unless it is set).")
        if c.ramp is not None:
            said.append(
                "The manual says what shape times do in words only; compare one recorded ramp with the reference."
            )
    said.append(
        f"The gains were tuned for samples of {1e3 * s.sample_time_s:g} ms; a drive samples faster, which leaves more "
        "phase."
    )
    if c.ramp is not None and c.ramp.jerk_m_s3 is not None:
        least = c.ramp.acceleration_m_s2**2 / c.ramp.jerk_m_s3
        said.append(
            f"The ramp is that of the reference for changes of speed above {least:.3g} m/s; smaller ones reach a "
            "smaller acceleration in the reference and are rounded as long as large ones in the drive."
        )
    return said


DRIVES: Mapping[str, tuple[str, Callable[[_Case], list[Setting]]]] = MappingProxyType(
    {
        "siemens-s120": ("SINAMICS S120/S150 List Manual 06/2020, 6SL3097-5AP00-0BP2", _siemens),
        "abb-acs880": ("ACS880 primary control program, Firmware manual, groups 23, 25, 30, 46", _abb),
        "generic": ("", _generic),
    }
)
