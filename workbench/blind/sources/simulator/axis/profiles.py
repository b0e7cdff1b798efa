"""Speed references of the kinds that axes are excited with: point to point, steps of speed, creeping, shuttling."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from workbench.blind.sources.simulator.axis.kernel import RECORD_S
from workbench.blind.sources.simulator.axis.machines import Drawn
from workbench.blind.sources.simulator.causes import TURN

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
