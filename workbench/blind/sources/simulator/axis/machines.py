"""Nominal axes, linear and rotary, from gram to tonne, each consistent in itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.blind.sources.simulator.causes import about
from workbench.machine import LinearAxis, RotaryAxis

G_M_S2 = 9.81
MOTIONS = ("linear", "rotary")


@dataclass(frozen=True)
class Drawn:
    """A nominal axis with what it does: SI, m and N or rad and N m.

    speed: the fastest moves' speed; ramp_s: in which they reach it; travel: the way they stay within, from
    `low` on. force: about the largest input. poles: waves of the motor's cogging within the travel.
    count: the encoder's step.
    """

    machine: LinearAxis | RotaryAxis
    low: float
    travel: float
    speed: float
    ramp_s: float
    force: float
    poles: float
    count: float

    @property
    def linear(self) -> bool:
        return self.machine.input_signal == "force_n"

    @property
    def loaded(self) -> bool:
        """Whether it works against gravity."""
        return any(self.machine.role(f"gravity_{part}") != 0.0 for part in ("constant", "sine"))


def rebuilt(machine: Mapping[str, Any], own: Mapping[str, Any]) -> Drawn:
    record = LinearAxis if machine.get("motion") == "linear" else RotaryAxis
    return Drawn(record.model_validate(dict(machine)), **own)


def drawn_axis(rng: np.random.Generator, motion: str, loaded: bool | None = None) -> Drawn:
    """An axis of `motion` (linear, rotary). loaded: with or without gravity, drawn where None."""
    linear = motion == "linear"
    inertia = _digits(about(rng, 0.02, 1500.0) if linear else about(rng, 2e-6, 500.0), 4)
    has_load = bool(rng.random() < 0.4)
    loaded = has_load if loaded is None else loaded
    travel = 0.35 * (inertia / 30.0) ** 0.22 * about(rng, 0.5, 2.0) if linear else about(rng, 1.2, 25.0)
    if not linear and loaded:
        travel = about(rng, 1.5, 9.0)
    speed = travel * about(rng, 0.8, 3.0)
    ramp_s = min(about(rng, 0.06, 0.35), 0.35 * travel / speed)
    accelerating = inertia * speed / ramp_s
    coulomb = accelerating * about(rng, 0.06, 0.5)
    levels = coulomb * rng.uniform(0.9, 1.1, size=2)
    viscous = coulomb / speed * about(rng, 0.15, 1.5)
    sine = constant = 0.0
    sign = float(rng.choice([-1.0, 1.0]))
    if loaded and linear:
        constant = sign * min(inertia * G_M_S2 * rng.uniform(0.15, 1.0), 2.0 * accelerating)
    elif loaded:
        sine, constant = accelerating * about(rng, 0.25, 1.5), accelerating * rng.choice([0.0, 0.0, 0.2 * sign])
    force = accelerating + coulomb + viscous * speed + abs(sine) + abs(constant)
    n, m = ("n", "m") if linear else ("nm", "rad")
    gravity = {f"constant_{n}": _digits(constant, 4)} | ({} if linear else {"sine_nm": _digits(sine, 4)})
    data = {
        "name": f"axis of {inertia:.2g} {'kg' if linear else 'kg m²'}",
        "mass_kg" if linear else "inertia_kg_m2": inertia,
        "gravity": gravity,
        "friction": {
            f"coulomb_forward_{n}": _digits(levels[0], 4),
            f"coulomb_backward_{n}": _digits(levels[1], 4),
            f"viscous_{n}_s_per_{m}": _digits(viscous, 4),
        },
        "tolerances": _tolerances(rng, force, linear),
    }
    return Drawn(
        machine=(LinearAxis if linear else RotaryAxis).model_validate(data),
        low=travel * rng.uniform(-1.0, 0.5),
        travel=travel,
        speed=speed,
        ramp_s=ramp_s,
        force=force,
        poles=float(rng.integers(6, 30)),
        count=_digits(travel * about(rng, 2e-7, 3e-6), 2),
    )


def _tolerances(rng: np.random.Generator, force: float, linear: bool) -> dict[str, float]:
    """What an engineer states; of three in ten machines nothing, then the defaults hold."""
    stated = {
        "inertia": round(about(rng, 0.008, 0.05), 3),
        "coulomb": round(about(rng, 0.03, 0.12), 3),
        "viscous": round(about(rng, 0.05, 0.2), 3),
        "gravity": round(about(rng, 0.01, 0.06), 3),
        "force_gain" if linear else "torque_gain": round(about(rng, 0.003, 0.015), 4),
        "force_offset_n" if linear else "torque_offset_nm": _digits(force * about(rng, 0.001, 0.004), 2),
    }
    return stated if rng.random() < 0.7 else {}


def _digits(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")
