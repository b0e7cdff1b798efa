"""Speed references of the kinds that recorded campaigns show: fast, slow and in steps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

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
