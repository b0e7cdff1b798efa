"""A run's signals compared with its machine: units, dead channels, impossible sizes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from workbench.core.run import Array
from workbench.logs.channels import is_constant
from workbench.logs.faults import Fault, seconds
from workbench.logs.units import check_axis_units
from workbench.machines import Axis, Hoist, Kind, Limits, kind_of

TOO_FAST = 2.0  # times nominal speed
TOO_STRONG = 4.0  # times the motors' nominal torque together
MOVING = 0.05  # of nominal speed: faster than that counts as moving
HEAVY_PAYLOAD = 20.0  # times the carriage's mass
OFF_RAIL = 0.1  # of the segment length that the integrated speed may leave the rail by
TORQUE_RATIO = (0.2, 5.0)  # mean torque while moving over what holds the load: outside, the unit is wrong
TORQUE_RATIO_NOTE = (0.6, 1.6)
_SPEED_UNITS = (("rpm", 2.0 * math.pi / 60.0), ("degrees per second", math.pi / 180.0))


def check_plausible(
    machine: Hoist | Axis,
    payload_kg: float,
    start_position: float,
    time_s: Array,
    values: Mapping[str, Array],
    label: Callable[[str], str],
    fault: Fault,
) -> list[str]:
    """Notes on unusual signals. InputError for signals that are impossible for this machine in these units.

    start_position: m or rad. Sizes are judged for kinds whose machine.yaml says what they are built for.
    """
    kind, notes = kind_of(machine), []
    limits = None if kind.limits is None else kind.limits(machine)
    if limits is not None and payload_kg > HEAVY_PAYLOAD * limits.empty_mass_kg:
        notes.append(
            f"payload {payload_kg:g} kg is more than {HEAVY_PAYLOAD:g} times the carriage's mass; is it in kg?"
        )
    for name in kind.inputs:
        if name in values and not values[name].any():
            raise fault(f"{label(name)} is zero throughout{'; ' if kind.zero_input else ''}{kind.zero_input}")
    check_axis_units(machine, time_s, values, label, fault)
    notes += _stands(kind, values, label, fault)
    if limits is not None:
        speed, torque = values[kind.plant.speeds[0]], values[kind.plant.input]
        notes += _speed(kind, limits, time_s, speed, label, fault)
        notes += _rail(kind, limits, machine, start_position, time_s, speed, label, fault)
        notes += _torque(kind, limits, kind.rigid(machine, payload_kg).hold, time_s, speed, torque, label, fault)
    return notes


def driven_signals(kind: Kind) -> tuple[str, str]:
    """Position and speed of the driven coordinate, as logs call them."""
    return kind.plant.positions[0], kind.plant.speeds[0]


def _stands(kind: Kind, values: Mapping[str, Array], label: Callable[[str], str], fault: Fault) -> list[str]:
    """A note on a run at rest. An input that always holds a load is never constant in motion, nor motion under it."""
    motion = [name for name in driven_signals(kind) if name in values]
    at_rest, steady = all(is_constant(values[name]) for name in motion), is_constant(values[kind.plant.input])
    if at_rest and (not kind.holds_load or steady or not any(values[name].any() for name in motion)):
        return ["the machine stands still throughout; this run says nothing of friction or inertia"]
    if kind.holds_load and (at_rest or steady):
        name = motion[0] if at_rest else kind.plant.input
        raise fault(f"{label(name)} is {values[name][0]:g} throughout; is the channel frozen?")
    return []


def _speed(
    kind: Kind, limits: Limits, time_s: Array, speed: Array, label: Callable[[str], str], fault: Fault
) -> list[str]:
    name, limit = kind.plant.speeds[0], TOO_FAST * limits.nominal_speed
    fast = np.abs(speed) > limit
    if not fast.any():
        return []
    typical = float(np.percentile(np.abs(speed), 99.0))
    if typical <= limit:
        count = int(np.count_nonzero(fast))
        return [
            f"{label(name)}: {count} sample{'s' if count > 1 else ''} beyond twice the nominal speed, "
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
        f"{label(name)} reaches {typical:.4g} rad/s, the machine's nominal speed is "
        f"{limits.nominal_speed:g} rad/s{hint}"
    )


def _rail(
    kind: Kind,
    limits: Limits,
    machine: Hoist | Axis,
    start_m: float,
    time_s: Array,
    speed: Array,
    label: Callable[[str], str],
    fault: Fault,
) -> list[str]:
    """The integrated speed must keep the carriage on the rail. This detects a wrong unit in slow runs too."""
    steps = np.diff(time_s)
    height = start_m + kind.lever_of(machine) * np.cumsum(0.5 * (speed[1:] + speed[:-1]) * steps)
    low, high, length = limits.lowest, limits.highest, limits.length
    beyond = max(low - float(height.min()), float(height.max()) - high, 0.0)
    if beyond == 0.0:
        return []
    row = int(np.argmax(np.maximum(low - height, height - high)))
    text = (
        f"{label(kind.plant.speeds[0])}, integrated from {start_m:g} m, takes the {kind.moved.noun} to "
        f"{height[row]:.4g} m "
        f"at {seconds(time_s[row + 1])}; the rail goes from {low:g} to {high:g} m"
    )
    if beyond > OFF_RAIL * length:
        raise fault(f"{text}; is the speed in rpm, its sign flipped, or start_position_m wrong?")
    return [text]


def _torque(
    kind: Kind,
    limits: Limits,
    holding: float,
    time_s: Array,
    speed: Array,
    torque: Array,
    label: Callable[[str], str],
    fault: Fault,
) -> list[str]:
    notes = []
    name, nominal = kind.plant.input, limits.nominal_input
    strong = np.abs(torque) > TOO_STRONG * nominal
    if strong.any() and float(np.percentile(np.abs(torque), 99.0)) <= TOO_STRONG * nominal:
        count = int(np.count_nonzero(strong))
        notes.append(
            f"{name}: {count} sample{'s' if count > 1 else ''} beyond {TOO_STRONG:g} times the motors' "
            f"nominal torque, first at {seconds(time_s[int(np.argmax(strong))])}"
        )
    elif strong.any():
        raise fault(
            f"{label(name)} reaches {np.percentile(np.abs(torque), 99.0):.4g} N m, the motors' nominal "
            f"torque together is {nominal:g} N m; is it the drum's torque, or in another unit?"
        )
    moving = np.abs(speed) > MOVING * limits.nominal_speed
    if np.count_nonzero(moving) < 0.1 * len(speed):
        return notes
    mean = float(np.mean(torque[moving]))
    text = (
        f"{label(name)} is {mean:.4g} N m on average while moving; holding carriage and payload takes {holding:.4g} N m"
    )
    # Compared as products: a machine whose load is nearly nothing has no ratio.
    if not TORQUE_RATIO[0] * holding <= abs(mean) <= TORQUE_RATIO[1] * holding:
        raise fault(f"{text}; is it in kN m or per cent, or is the payload wrong?")
    if mean < 0.0:
        notes.append(f"{text}; is its sign flipped?")
    elif not TORQUE_RATIO_NOTE[0] * holding <= mean <= TORQUE_RATIO_NOTE[1] * holding:
        half = "; is it one motor's only?" if limits.motors > 1 and mean < holding else ""
        notes.append(f"{text}{half}")
    return notes
