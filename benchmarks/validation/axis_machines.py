"""Axes of campaigns, linear and rotary, from gram to tonne, and the references that they follow."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.validation.axis_motion import RECORD_S
from benchmarks.validation.kind import TURN, about
from workbench.machines import LinearAxis, RotaryAxis

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


Array = npt.NDArray[np.float64]
KINDS = ("moves", "steps", "slow", "shuttle", "pulses", "sine", "middle")
STEPS = (1.0 / 8.0, 0.6, 1.0, 0.3, 0.8, 1.0 / 4.0)  # of the top speed, one after the other


@dataclass(frozen=True)
class Excitation:
    """speed: reference, (n,), m/s (rad/s). pulses: force added to the drive's own, (n,), N (N m)."""

    speed: Array
    pulses: Array


def excitation(kind: str, rng: np.random.Generator, axis: Drawn, duration_s: float) -> Excitation:
    """A value each RECORD_S; the way stays within the travel, upward from the start."""
    n = round(duration_s / RECORD_S)
    if kind == "sine":
        return Excitation(_sines(rng, axis, n), np.zeros(n))
    speed, at, place, k = np.zeros(n), round(rng.uniform(0.2, 0.5) / RECORD_S), 0.0, 0
    while True:
        part, way = _move(*_drawn_move(kind, rng, axis, place, k, duration_s))
        if at + len(part) > n - round(0.15 / RECORD_S):
            break
        speed[at : at + len(part)] = part
        at, place, k = at + len(part) + round(rng.uniform(0.1, 0.5) / RECORD_S), place + way, k + 1
    pulses = np.zeros(n)
    if kind == "pulses":
        for begin in np.arange(0.5, duration_s - 0.6, rng.uniform(0.4, 0.7)):
            first = round(begin / RECORD_S)
            length = round(rng.uniform(0.03, 0.12) / RECORD_S)
            pulses[first : first + length] = axis.force * rng.uniform(0.1, 0.25) * rng.choice([-1.0, 1.0])
        pulses[np.abs(speed) < 1e-9 * axis.speed] = 0.0
    return Excitation(speed, pulses)


def _drawn_move(
    kind: str, rng: np.random.Generator, axis: Drawn, place: float, k: int, duration_s: float
) -> tuple[float, float, float]:
    """Distance with its sign, speed, and the time of the ramp to it, of move k from `place`."""
    top, ramp_s = axis.speed * rng.uniform(0.75, 1.0), axis.ramp_s * rng.uniform(1.0, 1.4)
    longest = axis.travel - place if k % 2 == 0 else place
    if kind in ("moves", "middle"):
        top *= 0.4 if kind == "middle" else 1.0
        forward = rng.random() * axis.travel > place
        room = axis.travel - place if forward else place
        return (1.0 if forward else -1.0) * room * rng.uniform(0.5, 1.0), top * rng.uniform(0.6, 1.0), ramp_s
    if kind == "steps":
        speed = top * STEPS[(k // 2) % len(STEPS)]
        distance, ramp_s = min(longest, speed * duration_s / 7.0), ramp_s * max(0.3, speed / top)
    elif kind == "slow":
        speed, ramp_s = top * rng.uniform(0.04, 0.15), ramp_s * rng.uniform(1.5, 3.0)
        distance = min(longest, speed * duration_s * rng.uniform(0.12, 0.3))
    else:
        speed, distance = top, longest
    return (1.0 if k % 2 == 0 else -1.0) * distance, speed, ramp_s


def _move(distance: float, speed: float, ramp_s: float, *, round_share: float = 0.4) -> tuple[Array, float]:
    """A trapezoid of speed with rounded corners, and the way that it goes.

    ramp_s: from rest to `speed`. Shorter ways than two ramps take are gone at a lower speed.
    """
    size = max(abs(distance), 1e-6 * speed * ramp_s)
    top = min(speed, size / ramp_s)
    rise = max(1, round(ramp_s / RECORD_S))
    flat = max(0, round(size / top / RECORD_S) - rise)
    up = (np.arange(rise) + 0.5) / rise
    width = max(1, round(round_share * ramp_s / RECORD_S))
    rounded = np.convolve(np.concatenate([up, np.ones(flat), 1.0 - up]), np.full(width, 1.0 / width))
    out: Array = np.sign(distance) * top * rounded
    return out, float(np.sum(out)) * RECORD_S


def _sines(rng: np.random.Generator, axis: Drawn, n: int) -> Array:
    """Three waves about the middle of the travel that swell and ebb, at rest at both ends."""
    time: Array = (np.arange(n, dtype=np.float64) + 0.5) * RECORD_S
    slowest = axis.speed / (0.4 * axis.travel)  # rad/s at which a wave of the whole travel has the top speed
    position = np.zeros(n)
    for share in (0.5, 0.3, 0.2):
        w = slowest * rng.uniform(0.3, 1.0)
        position += share * 0.45 * axis.travel * np.sin(w * time + rng.uniform(0.0, TURN))
    swell = np.sin(math.pi * time / time[-1]) ** 2
    out: Array = np.gradient(position * swell + 0.48 * axis.travel * _eased(time), RECORD_S)
    return out


def _eased(time: Array) -> Array:
    """From 0 to 1 over the first and back over the last eighth, smooth."""
    u = np.clip(8.0 * np.minimum(time, time[-1] - time) / time[-1], 0.0, 1.0)
    out: Array = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)
    return out
