"""Words for the variables and the levels of an unknown cause's force."""

from __future__ import annotations

import math
from collections.abc import Mapping

# What a measured correction may be over: what it is called, and its unit.
OVER: Mapping[str, tuple[str, str]] = {
    "speed_carriage_m_s": ("speed of the carriage", "m/s"),
    "speed_motor_rad_s": ("speed of the motors", "rad/s"),
    "position_carriage_m": ("height of the carriage", "m"),
    "angle_motor_rad": ("motor's angle", "rad"),
    "angle_drum_rad": ("drum's angle", "rad"),
    "payload_kg": ("payload", "kg"),
    "torque_load_nm": ("torque that goes through the gearbox", "N m"),
    "velocity_m_s": ("speed of the axis", "m/s"),
    "speed_rad_s": ("speed of the axis", "rad/s"),
    "position_m": ("position of the axis", "m"),
    "angle_rad": ("angle of the axis", "rad"),
    "angle_in_turn_rad": ("angle within a turn", "rad"),
    "time_s": ("time since the run's start", "s"),
    "campaign_time_s": ("time since the campaign began", "s"),
}
MINUS = "\N{MINUS SIGN}"


def over_what(over: str) -> str:
    """In words, with its article."""
    return f"the {OVER[over][0]}" if over in OVER else over


def span(low: float, high: float, unit: str) -> str:
    """Two levels of one unit, as far as the larger one's second digit: −0.8 to 2.4 kN, 3.1 to 9.8 N."""
    largest = max(abs(low), abs(high))
    scale, prefix = (1000.0, "k") if largest >= 1000.0 and unit in ("N", "N m") else (1.0, "")
    decimals = 0 if largest == 0.0 else max(1 - math.floor(math.log10(largest / scale)), 0)
    return f"{_plain(low / scale, decimals)} to {_plain(high / scale, decimals)} {prefix}{unit}"


def _plain(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0.0 else text.replace("-", MINUS)
