"""Where nobody says otherwise: a controller by rule, and the heights at which a loop is looked at."""

from __future__ import annotations

import math

from workbench.control import PiSettings
from workbench.machine import Hoist

USUAL_CROSSOVER_HZ = 2.5


def usual_controller(machine: Hoist) -> PiSettings:
    """kp = J w, ki = kp w/4 with w = 2 pi 2.5 Hz and J of drive and empty carriage, seen from the motor."""
    J = machine.motor.count * machine.motor.rotor_inertia_kg_m2 + machine.winch.inertia_kg_m2 / machine.gearbox.ratio**2
    J += machine.carriage.mass_kg * machine.lift_m_per_rad**2
    w = 2.0 * math.pi * USUAL_CROSSOVER_HZ
    kp = float(f"{J * w:.4g}")
    return PiSettings(kp_nm_s_per_rad=kp, ki_nm_per_rad=float(f"{kp * w / 4.0:.4g}"))


def usual_heights(machine: Hoist) -> tuple[float, ...]:
    """Near the bottom, in the middle, near the top of the rail, where a tenth of the wire is still free."""
    low = machine.rail.lowest_position_m
    high = min(machine.highest_position_m, 0.9 * machine.wire.segment_length_m)
    return low, 0.5 * (low + high), high
