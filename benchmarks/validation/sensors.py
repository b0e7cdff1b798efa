"""From a run's record to samples of its log: what sensors and logger of either kind make of the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Columns = dict[str, tuple[Array, int]]


@dataclass(frozen=True)
class Sensors:
    """Input: the motors' torque or the force. Noise: one standard deviation a sample.

    The log shows gain · true + offset, with gain_forward more of it forward and less backward (turned over within
    speed_turn), and bend · true · |true|; low-passed with filter_s, wandering by walk_per_sqrt_s, held within
    dead_band. While an event lasts, a glitch adds to it, and the encoder loses slip (relative) of the way. Motion is
    shown delay_s + late_s late: late_s for channels of one log that rarely agree. count: the encoder's step; encoder:
    the logged speed is the difference of its counts over the drive's step, averaged over window_s. jitter_s: samples
    are taken that much beside their stamps.
    """

    input_noise: float
    speed_noise: float
    speed_turn: float
    count: float
    encoder: bool = False
    window_s: float = 0.0
    jitter_s: float = 0.0
    late_s: float = 0.0
    gain: float = 1.0
    offset: float = 0.0
    filter_s: float = 0.0
    delay_s: float = 0.0
    gain_forward: float = 0.0
    walk_per_sqrt_s: float = 0.0
    dead_band: float = 0.0
    bend: float = 0.0
    glitch: float = 0.0
    slip: float = 0.0


@dataclass(frozen=True)
class Window:
    """When an event works in one run, s; nothing works outside."""

    from_s: float
    length_s: float

    def pulse(self, time_s: Array) -> Array:
        """A smooth rise and fall, 0 to 1, over the window."""
        u: Array = (time_s - self.from_s) / self.length_s
        out: Array = np.where((u > 0.0) & (u < 1.0), 0.5 * (1.0 - np.cos(2.0 * math.pi * u)), 0.0)
        return out


@dataclass(frozen=True)
class Sampled:
    """Samples of one run's log, (n,) each: stamps, s; the record's rows at the stamps; input before noise; speed; and
    position of the encoder before its steps."""

    time_s: Array
    rows: npt.NDArray[np.int64]
    input: Array
    speed: Array
    position: Array


def shown_input(
    true: Array, speed: Array, step_s: float, s: Sensors, walk: np.random.Generator, wander: float,
    window: Window | None = None,
) -> tuple[Array, float]:  # fmt: skip
    """Input as its sensor shows it, before noise, and where the sensor has wandered to from `wander`.

    true, speed: (n,), each step_s. walk: the stream that it wanders by.
    """
    shown: Array = s.gain * true + s.offset
    shown = shown * (1.0 + s.gain_forward * np.tanh(speed / s.speed_turn)) + s.bend * true * np.abs(true)
    if window is not None and s.glitch:
        shown = shown + s.glitch * window.pulse(np.arange(len(true), dtype=np.float64) * step_s)
    if s.walk_per_sqrt_s > 0.0:
        wandering = wander + np.cumsum(walk.normal(scale=s.walk_per_sqrt_s * math.sqrt(step_s), size=len(true)))
        shown, wander = shown + wandering, float(wandering[-1])
    if s.filter_s > 0.0:  # first order, exact for an input held between samples; long settled at the start
        left = math.exp(-step_s / s.filter_s)
        from scipy.signal import lfilter  # late: it takes 0.8 s

        shown = np.asarray(lfilter([1.0 - left], [1.0, -left], shown, zi=[left * shown[0]])[0])
    return shown, wander


def encoder_speed(position: Array, step_s: float, count: float, window_s: float) -> Array:
    """Speed as a drive has it: the difference of counted position over each step, averaged over the last window_s."""
    counted = count * np.floor(position / count)
    speed = np.diff(counted, prepend=counted[:1]) / step_s
    width = max(1, round(window_s / step_s))
    from scipy.signal import lfilter

    return np.asarray(lfilter(np.full(width, 1.0 / width), [1.0], speed))


def sampled(
    true: Array, speed: Array, position: Array, step_s: float, s: Sensors, rng: np.random.Generator,
    walk: np.random.Generator, *, rate_hz: float, uneven: bool = False, wander: float = 0.0,
    window: Window | None = None,
) -> tuple[Sampled, float]:  # fmt: skip
    """Samples of one run, and where the input's sensor has wandered to.

    true, speed, position: (n,) of input and motion, each step_s.
    """
    time = np.arange(len(true), dtype=np.float64) * step_s
    shown, wander = shown_input(true, speed, step_s, s, walk, wander, window)
    rows = logged_rows(len(true), rate_hz, step_s, uneven, rng)
    taken = time[rows] + (rng.normal(scale=s.jitter_s, size=len(rows)) if s.jitter_s > 0.0 else 0.0)
    motion_s = taken - s.late_s - s.delay_s
    if window is not None and s.slip:
        lost = s.slip * window.pulse(time) * speed
        speed, position = speed - lost, position - np.cumsum(lost) * step_s
    quick = encoder_speed(position, step_s, s.count, s.window_s) if s.encoder else speed
    seen = np.interp(motion_s, time, quick)
    if s.speed_noise > 0.0 and not s.encoder:
        seen = seen + rng.normal(scale=s.speed_noise, size=len(rows))
    held = dead_band(np.interp(taken, time, shown), s.dead_band)
    return Sampled(time[rows], rows, held, seen, np.interp(motion_s, time, position)), wander


def logged_rows(n: int, rate_hz: float, step_s: float, uneven: bool, rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Rows of the record that the log has; uneven: up to a fifth of a step early or late."""
    every = round(1.0 / rate_hz / step_s)
    rows = np.arange(0, n, every)
    if uneven:
        rows[1:-1] += rng.integers(-(every // 5), every // 5 + 1, size=len(rows) - 2)
    return rows


def dead_band(values: Array, band: float) -> Array:
    """The last value sent, until the true one is further off than the band."""
    if band <= 0.0:
        return values
    out = np.empty_like(values)
    held = values[0]
    for k, value in enumerate(values):
        if abs(value - held) > band:
            held = value
        out[k] = held
    return out


def digits(smallest: float) -> int:
    """Behind the point, so that `smallest` is still written."""
    return max(0, math.ceil(-math.log10(smallest)))
