"""A hoist's signals against its machine: units, dead channels, sizes that cannot be."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from workbench.logs.channels import is_constant
from workbench.logs.faults import Fault, seconds
from workbench.machine import Hoist
from workbench.run import Array

TOO_FAST = 2.0  # times nominal speed
TOO_STRONG = 4.0  # times the motors' nominal torque together
MOVING = 0.05  # of nominal speed: faster than that counts as moving
HEAVY_PAYLOAD = 20.0  # times the carriage's mass
OFF_RAIL = 0.1  # of the segment length that the integrated speed may leave the rail by
TORQUE_RATIO = (0.2, 5.0)  # mean torque while moving over what holds the load: outside, the unit is wrong
TORQUE_RATIO_NOTE = (0.6, 1.6)
_SPEED_UNITS = (("rpm", 2.0 * math.pi / 60.0), ("degrees per second", math.pi / 180.0))


def check_hoist(
    machine: Hoist,
    payload_kg: float,
    start_position_m: float,
    time_s: Array,
    values: Mapping[str, Array],
    label: Callable[[str], str],
    fault: Fault,
) -> list[str]:
    """Notes on what is odd. InputError for what cannot be this machine in these units."""
    notes = []
    if payload_kg > HEAVY_PAYLOAD * machine.carriage.mass_kg:
        notes.append(
            f"payload {payload_kg:g} kg is more than {HEAVY_PAYLOAD:g} times the carriage's mass; is it in kg?"
        )
    speed = values["speed_motor_rad_s"]
    for name in ("torque_motor1_nm", "torque_motor2_nm", "torque_motor_nm"):
        if name in values and not values[name].any():
            raise fault(f"{label(name)} is zero throughout; a hoist's motors hold its load")
    frozen = is_constant(speed), is_constant(values["torque_motor_nm"])
    if all(frozen) or (frozen[0] and not speed.any()):
        notes.append("the machine stands still throughout; this run says nothing of friction or inertia")
    elif any(frozen):
        name = "speed_motor_rad_s" if frozen[0] else "torque_motor_nm"
        raise fault(f"{label(name)} is {values[name][0]:g} throughout; is the channel frozen?")
    notes += _speed(machine, time_s, speed, label, fault)
    notes += _rail(machine, start_position_m, time_s, speed, label, fault)
    notes += _torque(machine, payload_kg, time_s, speed, values["torque_motor_nm"], label, fault)
    return notes


def _speed(machine: Hoist, time_s: Array, speed: Array, label: Callable[[str], str], fault: Fault) -> list[str]:
    limit = TOO_FAST * machine.motor.nominal_speed_rad_s
    fast = np.abs(speed) > limit
    if not fast.any():
        return []
    typical = float(np.percentile(np.abs(speed), 99.0))
    if typical <= limit:
        count = int(np.count_nonzero(fast))
        return [
            f"{label('speed_motor_rad_s')}: {count} sample{'s' if count > 1 else ''} beyond twice the nominal speed, "
            f"first at {seconds(time_s[int(np.argmax(fast))])}"
        ]
    hint = next(
        (
            f"; is it in {unit}? Then give the column a scale of {scale:.6g}"
            for unit, scale in _SPEED_UNITS
            if typical * scale <= limit
        ),
        "; is it in another unit?",
    )
    raise fault(
        f"{label('speed_motor_rad_s')} reaches {typical:.4g} rad/s, the machine's nominal speed is "
        f"{machine.motor.nominal_speed_rad_s:g} rad/s{hint}"
    )


def _rail(
    machine: Hoist, start_m: float, time_s: Array, speed: Array, label: Callable[[str], str], fault: Fault
) -> list[str]:
    """The integrated speed must keep the carriage on the rail: that finds a wrong unit in slow runs, too."""
    steps = np.diff(time_s)
    height = start_m + machine.lift_m_per_rad * np.cumsum(0.5 * (speed[1:] + speed[:-1]) * steps)
    low, high, length = machine.rail.lowest_position_m, machine.highest_position_m, machine.wire.segment_length_m
    beyond = max(low - float(height.min()), float(height.max()) - high, 0.0)
    if beyond == 0.0:
        return []
    row = int(np.argmax(np.maximum(low - height, height - high)))
    text = (
        f"{label('speed_motor_rad_s')}, integrated from {start_m:g} m, takes the carriage to {height[row]:.4g} m "
        f"at {seconds(time_s[row + 1])}; the rail goes from {low:g} to {high:g} m"
    )
    if beyond > OFF_RAIL * length:
        raise fault(f"{text}; is the speed in rpm, its sign flipped, or start_position_m wrong?")
    return [text]


def _torque(
    machine: Hoist,
    payload_kg: float,
    time_s: Array,
    speed: Array,
    torque: Array,
    label: Callable[[str], str],
    fault: Fault,
) -> list[str]:
    notes = []
    nominal = machine.motor.count * machine.motor.nominal_torque_nm
    strong = np.abs(torque) > TOO_STRONG * nominal
    if strong.any() and float(np.percentile(np.abs(torque), 99.0)) <= TOO_STRONG * nominal:
        count = int(np.count_nonzero(strong))
        notes.append(
            f"torque_motor_nm: {count} sample{'s' if count > 1 else ''} beyond {TOO_STRONG:g} times the motors' "
            f"nominal torque, first at {seconds(time_s[int(np.argmax(strong))])}"
        )
    elif strong.any():
        raise fault(
            f"{label('torque_motor_nm')} reaches {np.percentile(np.abs(torque), 99.0):.4g} N m, the motors' nominal "
            f"torque together is {nominal:g} N m; is it the drum's torque, or in another unit?"
        )
    moving = np.abs(speed) > MOVING * machine.motor.nominal_speed_rad_s
    if np.count_nonzero(moving) < 0.1 * len(speed):
        return notes
    holding = (machine.carriage.mass_kg + payload_kg) * machine.gravity_m_s2 * machine.lift_m_per_rad
    mean = float(np.mean(torque[moving]))
    text = (
        f"{label('torque_motor_nm')} is {mean:.4g} N m on average while moving; "
        f"holding carriage and payload takes {holding:.4g} N m"
    )
    if not TORQUE_RATIO[0] <= abs(mean) / holding <= TORQUE_RATIO[1]:
        raise fault(f"{text}; is it in kN m or per cent, or is the payload wrong?")
    if mean < 0.0:
        notes.append(f"{text}; is its sign flipped?")
    elif not TORQUE_RATIO_NOTE[0] <= mean / holding <= TORQUE_RATIO_NOTE[1]:
        half = "; is it one motor's only?" if machine.motor.count > 1 and mean < holding else ""
        notes.append(f"{text}{half}")
    return notes
