"""Gains of the PI speed loop by its closed form on a rigid drive, and back.

The motors turn one inertia J (kg m²) with everything on it. The loop is then of second order:
J s² + kp s + ki. kp = J w with w = 2 pi times the bandwidth (the crossover of the proportional part
alone), ki = kp² / (4 J damping²). At damping 1 that is ki = kp w / 4.
"""

from __future__ import annotations

import math

from workbench.machines import Hoist


def shaft_inertia_kg_m2(machine: Hoist, payload_kg: float = 0.0) -> float:
    """Rotors, drum, carriage and payload as the motor shaft feels them on a stiff wire."""
    turning = machine.motor.count * machine.motor.rotor_inertia_kg_m2
    turning += machine.winch.inertia_kg_m2 / machine.gearbox.ratio**2
    return turning + (machine.carriage.mass_kg + payload_kg) * machine.lift_m_per_rad**2


def rigid_gains(inertia_kg_m2: float, bandwidth_hz: float, damping: float) -> tuple[float, float]:
    """kp (N m s/rad) and ki (N m/rad), to four digits."""
    kp = inertia_kg_m2 * 2.0 * math.pi * bandwidth_hz
    ki = kp * kp / (4.0 * inertia_kg_m2 * damping * damping)
    return float(f"{kp:.4g}"), float(f"{ki:.4g}")


def bandwidth_and_damping(inertia_kg_m2: float, kp: float, ki: float) -> tuple[float, float]:
    """What gains mean on that inertia: bandwidth (Hz) and damping, infinite without an integral."""
    bandwidth_hz = kp / (2.0 * math.pi * inertia_kg_m2)
    return bandwidth_hz, kp / (2.0 * math.sqrt(inertia_kg_m2 * ki)) if ki > 0.0 else math.inf
