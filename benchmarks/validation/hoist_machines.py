"""Hoists of campaigns: nominal machines drawn within a family, and the references that they follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.validation.families import Family
from benchmarks.validation.kind import about
from workbench.machines import Hoist

_PRACTICE = (
    {
        "name": "vertical pipe racker gripper-arm winch",
        "motor": {"count": 2, "rotor_inertia_kg_m2": 0.8, "nominal_torque_nm": 480.0, "nominal_speed_rad_s": 157.1},
        "gearbox": {"ratio": 31.0},
        "winch": {"drum_diameter_m": 0.6, "pin_diameter_m": 0.16, "inertia_kg_m2": 55.0, "mass_kg": 900.0},
        "sheave": {"diameter_m": 0.5, "pin_diameter_m": 0.1, "inertia_kg_m2": 3.0, "mass_kg": 60.0},
        "bearing": {"pin_friction_coefficient": 0.02},
        "wire": {
            "youngs_modulus_pa": 1e11,
            "effective_area_m2": 0.00034,
            "segment_length_m": 25.0,
            "damping_time_s": 0.1,
        },
        "carriage": {"mass_kg": 8000.0},
        "guide": {"coulomb_hoisting_n": 6000.0, "coulomb_lowering_n": 4500.0, "atan_slope_s_per_m": 200.0},
    },
    {
        "name": "vertical pipe racker gripper-arm winch",
        "motor": {"count": 2, "rotor_inertia_kg_m2": 0.42, "nominal_torque_nm": 250.0, "nominal_speed_rad_s": 209.0},
        "gearbox": {"ratio": 38.0},
        "winch": {"drum_diameter_m": 0.48, "pin_diameter_m": 0.12, "inertia_kg_m2": 26.0, "mass_kg": 520.0},
        "sheave": {"diameter_m": 0.4, "pin_diameter_m": 0.08, "inertia_kg_m2": 1.6, "mass_kg": 35.0},
        "bearing": {"pin_friction_coefficient": 0.03},
        "wire": {
            "youngs_modulus_pa": 1e11,
            "effective_area_m2": 0.00022,
            "segment_length_m": 21.0,
            "damping_time_s": 0.1,
        },
        "carriage": {"mass_kg": 5200.0},
        "guide": {"coulomb_hoisting_n": 3300.0, "coulomb_lowering_n": 3900.0, "atan_slope_s_per_m": 200.0},
    },
    {
        "name": "vertical pipe racker gripper-arm winch",
        "motor": {"count": 2, "rotor_inertia_kg_m2": 1.9, "nominal_torque_nm": 1150.0, "nominal_speed_rad_s": 130.0},
        "gearbox": {"ratio": 24.0},
        "winch": {"drum_diameter_m": 0.76, "pin_diameter_m": 0.2, "inertia_kg_m2": 130.0, "mass_kg": 1600.0},
        "sheave": {"diameter_m": 0.62, "pin_diameter_m": 0.13, "inertia_kg_m2": 6.5, "mass_kg": 110.0},
        "bearing": {"pin_friction_coefficient": 0.015},
        "wire": {
            "youngs_modulus_pa": 1e11,
            "effective_area_m2": 0.00052,
            "segment_length_m": 28.0,
            "damping_time_s": 0.1,
        },
        "carriage": {"mass_kg": 13500.0},
        "guide": {"coulomb_hoisting_n": 8800.0, "coulomb_lowering_n": 7400.0, "atan_slope_s_per_m": 200.0},
    },
)
_FULL_KG = (9000.0, 4950.0, 13500.0)


@dataclass(frozen=True)
class Drawn:
    """A nominal hoist, and its full payload."""

    machine: Hoist
    full_kg: float

    @property
    def travel_m(self) -> float:
        """How far down a long move goes at most."""
        return 0.24 * self.machine.wire.segment_length_m


def rebuilt(machine: Mapping[str, Any], own: Mapping[str, Any]) -> Drawn:
    return Drawn(Hoist.model_validate(dict(machine)), **own)


def drawn_hoist(rng: np.random.Generator, family: Family) -> Drawn:
    """One of the family's given machines, or one of its sizes."""
    if family.machines:
        return practice_machine(int(rng.choice(family.machines)))
    return sized_machine(rng, about(rng, *family.sizes))


def practice_machine(which: int) -> Drawn:
    """One of the three machines of the practice campaigns."""
    return Drawn(Hoist.model_validate(_PRACTICE[which]), _FULL_KG[which])


def sized_machine(rng: np.random.Generator, carriage_kg: float) -> Drawn:
    """Another hoist, with a carriage of about that mass.

    Its motors lift the full payload at 60 to 90 % of their nominal torque; drum, sheave and wire are
    scaled from the practice machines by strength and geometry.
    """
    carriage = _digits(carriage_kg, 2)
    full = _digits(carriage * rng.uniform(0.8, 1.3), 2)
    weight = (carriage + full) * 9.81
    speed = rng.uniform(0.45, 1.0)
    motor_speed = float(rng.choice([104.7, 125.7, 157.1, 209.0]))
    diameter = round(0.6 * (carriage / 8000.0) ** 0.35 * rng.uniform(0.88, 1.15), 2)
    ratio = _digits(motor_speed * diameter / (4.0 * speed), 3)
    holding = weight * diameter / (4.0 * ratio)
    nominal = _digits(holding / rng.uniform(0.6, 0.9) / 2.0, 2)
    drum_mass = _digits(900.0 * carriage / 8000.0 * rng.uniform(0.8, 1.2), 2)
    sheave = round(diameter * rng.uniform(0.78, 0.9), 2)
    sheave_mass = _digits(60.0 * carriage / 8000.0 * rng.uniform(0.8, 1.2), 2)
    levels = carriage * 9.81 * rng.uniform(0.045, 0.085, size=2)
    data = {
        "name": f"hoist of {carriage / 1000.0:g} t",
        "motor": {
            "count": 2,
            "rotor_inertia_kg_m2": _digits(0.8 * (nominal / 480.0) ** 1.05 * rng.uniform(0.8, 1.25), 2),
            "nominal_torque_nm": nominal,
            "nominal_speed_rad_s": motor_speed,
        },
        "gearbox": {"ratio": ratio},
        "winch": {
            "drum_diameter_m": diameter,
            "pin_diameter_m": round(diameter * rng.uniform(0.23, 0.29), 2),
            "inertia_kg_m2": _digits(drum_mass * (diameter / 2.0) ** 2 * rng.uniform(0.65, 0.9), 2),
            "mass_kg": drum_mass,
        },
        "sheave": {
            "diameter_m": sheave,
            "pin_diameter_m": round(sheave * rng.uniform(0.18, 0.22), 3),
            "inertia_kg_m2": _digits(sheave_mass * (sheave / 2.0) ** 2 * rng.uniform(0.65, 0.9), 2),
            "mass_kg": sheave_mass,
        },
        "bearing": {"pin_friction_coefficient": round(rng.uniform(0.012, 0.03), 3)},
        "wire": {
            "youngs_modulus_pa": 1e11,
            "effective_area_m2": _digits(0.00034 * weight / (17000.0 * 9.81) * rng.uniform(0.85, 1.25), 2),
            "segment_length_m": round(rng.uniform(16.0, 32.0), 1),
            "damping_time_s": round(rng.uniform(0.07, 0.13), 2),
        },
        "carriage": {"mass_kg": carriage},
        "tolerances": {"torque_offset_nm": _digits(min(3.0, 0.012 * nominal), 2)},
        "guide": {
            "coulomb_hoisting_n": _digits(levels[0], 2),
            "coulomb_lowering_n": _digits(levels[1], 2),
            "atan_slope_s_per_m": float(rng.choice([100.0, 200.0, 300.0])),
        },
    }
    return Drawn(Hoist.model_validate(data), full)


def _digits(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")


Array = npt.NDArray[np.float64]
STEP_S = 0.001
KINDS = ("fast", "slow", "steps")
USUAL_S = 49.76


def reference(kind: str, rng: np.random.Generator, *, duration_s: float, speed_rad_s: float, room_rad: float) -> Array:
    """Motor speed reference, rad/s, a value each millisecond; it comes back to where it began, or a little short.

    speed_rad_s: the motors' nominal speed. room_rad: motor angle that it may go down (or up, for the last
    move of a slow run) from the start.
    """
    brisk = min(1.0, duration_s / 30.0)  # short runs wait less
    lead = brisk * rng.uniform(1.7, 2.0)
    long_s, duration_s = duration_s, min(duration_s, 1.2 * USUAL_S)
    if kind == "fast":
        top = speed_rad_s * rng.uniform(0.70, 1.0)
        down = min(room_rad, top * duration_s * rng.uniform(0.17, 0.19))
        moves = [(-top, down), (0.8 * top, 0.58 * down), (top, 0.38 * down)]
        pauses = [rng.uniform(2.2, 3.2), rng.uniform(1.6, 2.2)]
        ramps = [speed_rad_s / rng.uniform(1.7, 2.2)] * 3
    elif kind == "slow":
        top = speed_rad_s * rng.uniform(0.18, 0.30)
        down = min(room_rad, top * duration_s * rng.uniform(0.26, 0.29))
        moves = [(-top, down), (top / 3.0, 0.3 * down), (top, 0.55 * down)]
        pauses = [rng.uniform(1.4, 2.0), rng.uniform(1.8, 2.2)]
        ramps = [speed_rad_s * rng.uniform(0.15, 0.30)] * 3
    else:
        top = speed_rad_s * rng.uniform(0.75, 0.95)
        stretch = min(1.0, room_rad / (top * duration_s * 0.19)) * duration_s / 49.76
        levels = [(-top / 6.0, 3.7), (-top * 7.0 / 12.0, 3.8), (-top, 3.6)]
        levels += [(top * 7.0 / 12.0, 3.3), (top / 6.0, 2.6), (top, 3.3)]
        moves = [(level, abs(level) * time * stretch * rng.uniform(0.8, 1.2)) for level, time in levels]
        pauses = [rng.uniform(0.9, 1.3) for _ in moves]
        ramps = [speed_rad_s / rng.uniform(1.7, 3.5) for _ in moves]
    pauses = [brisk * pause for pause in pauses]
    round_s = rng.uniform(0.45, 0.6)
    if long_s > 1.5 * USUAL_S:  # the same again and again, back to where it began each time
        down, up = (sum(way for speed, way in moves if (speed > 0.0) == hoisting) for hoisting in (False, True))
        moves = [(speed, way * down / up if speed > 0.0 else way) for speed, way in moves]
        pauses = [*pauses, *[1.5] * (len(moves) - len(pauses))]
        times = int(long_s / 30.0)
        moves, pauses, ramps = moves * times, pauses * times, ramps * times
    return _joined(lead, moves, pauses, ramps, round_s, long_s)


def _joined(
    lead: float,
    moves: Sequence[tuple[float, float]],
    pauses: Sequence[float],
    ramps: Sequence[float],
    round_s: float,
    duration_s: float,
) -> Array:
    """Moves (speed, distance) with standing between them; what no longer fits before the end is left out."""
    n = round(duration_s / STEP_S)
    out, at = np.zeros(n), round(lead / STEP_S)
    for k, ((speed, distance), ramp) in enumerate(zip(moves, ramps, strict=True)):
        part = _move(speed, distance, ramp, min(round_s, 0.9 * abs(speed) / ramp + 0.25))
        if at + len(part) > n - round(min(1.0, 0.03 * duration_s) / STEP_S):
            break
        out[at : at + len(part)] = part
        at += len(part) + (round(pauses[k] / STEP_S) if k < len(pauses) else 0)
    return out


def _move(speed: float, distance: float, ramp: float, round_s: float) -> Array:
    """A trapezoid of speed whose corners are rounded over `round_s`: limited acceleration and jerk."""
    top = min(abs(speed), np.sqrt(distance * ramp))
    rise = max(1, round(top / ramp / STEP_S))
    flat = max(0, round(distance / top / STEP_S) - rise)
    trapezoid = np.concatenate([np.arange(rise) / rise, np.ones(flat), 1.0 - np.arange(rise) / rise])
    width = max(1, round(round_s / STEP_S))
    rounded = np.convolve(trapezoid, np.full(width, 1.0 / width))
    out: Array = np.sign(speed) * top * rounded
    out[np.abs(out) < 5e-4] = 0.0  # the log's last digit: at rest is at rest
    return out
