"""From the carriage to the motor: speeds through two falls, drum and gearbox."""

from __future__ import annotations

import numpy as np

from workbench.run import Array

# The carriage hangs on a sheave, in the bight between drum and dead anchor.
FALLS = 2.0


def motor_speed_rad_s(carriage_speed_m_s: Array, ratio: float, drum_diameter_m: float) -> Array:
    """Motor speed on a wire that does not stretch: ω = 2·v·ratio / (D/2).

    The wire is reeled in twice as fast as the carriage rises; `ratio` is motor speed over drum speed.
    """
    return np.asarray(carriage_speed_m_s) * (FALLS * ratio / (drum_diameter_m / 2.0))


def allowed_carriage_speed_m_s(motor_speed_limit_rad_s: float, ratio: float, drum_diameter_m: float) -> float:
    """The carriage speed at which the motor reaches `motor_speed_limit_rad_s`."""
    return motor_speed_limit_rad_s * (drum_diameter_m / 2.0) / (FALLS * ratio)
