"""From a run's record to the columns of an axis' log: what sensors and logger make of the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from benchmarks.campaigns.axis.kernel import FORCE, POSITION, RECORD_S, SPEED
from benchmarks.campaigns.sensors import dead_band

Array = npt.NDArray[np.float64]
Columns = dict[str, tuple[Array, int]]


@dataclass(frozen=True)
class Sensors:
    """Of one axis; force stands for torque where it is rotary. Noise: one standard deviation a sample.

    late_s: by how much the motion's channels are sampled behind the force's: channels of one log rarely agree.
    speed_turn: the speed at which the gain of the two directions has turned over.
    """

    force_noise: float
    speed_noise: float
    count: float
    speed_turn: float
    late_s: float = 0.0
    gain: float = 1.0
    offset: float = 0.0
    filter_s: float = 0.0
    delay_s: float = 0.0
    gain_forward: float = 0.0
    walk_per_sqrt_s: float = 0.0
    dead_band: float = 0.0
    bend: float = 0.0


def shown_force(record: Array, s: Sensors, walk: np.random.Generator, wander: float) -> tuple[Array, float]:
    """Force (torque) as the sensor shows it, before noise, and where it has wandered to from `wander`."""
    true = record[:, FORCE]
    shown: Array = s.gain * true + s.offset
    shown = shown * (1.0 + s.gain_forward * np.tanh(record[:, SPEED] / s.speed_turn)) + s.bend * true * np.abs(true)
    if s.walk_per_sqrt_s > 0.0:
        wandering = wander + np.cumsum(walk.normal(scale=s.walk_per_sqrt_s * math.sqrt(RECORD_S), size=len(true)))
        shown, wander = shown + wandering, float(wandering[-1])
    if s.filter_s > 0.0:  # first order, exact for an input held between samples; long settled at the start
        left = math.exp(-RECORD_S / s.filter_s)
        shown = np.asarray(lfilter([1.0 - left], [1.0, -left], shown, zi=[left * shown[0]])[0])
    return shown, wander


def logged_rows(n: int, rate_hz: float, irregular: bool, rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Rows of the record that the log has; irregular: up to a fifth of a step early or late."""
    every = round(1.0 / rate_hz / RECORD_S)
    rows = np.arange(0, n, every)
    if irregular:
        rows[1:-1] += rng.integers(-(every // 5), every // 5 + 1, size=len(rows) - 2)
    return rows


def log_columns(
    record: Array,
    reference: Array,
    sensors: Sensors,
    rng: np.random.Generator,
    walk: np.random.Generator,
    *,
    linear: bool,
    rate_hz: float,
    logs: tuple[str, ...],
    irregular: bool = False,
    wander: float = 0.0,
) -> tuple[Columns, float]:
    """Columns by signal name, each with its number of digits, and where the force sensor has wandered to.

    reference: (n,) position. logs: of position, speed, reference those that are logged.
    """
    n_, m_, x_, v_ = (
        ("force_n", "position", "m", "velocity_m_s") if linear else ("torque_nm", "angle", "rad", "speed_rad_s")
    )
    time = np.arange(len(record), dtype=np.float64) * RECORD_S
    rows = logged_rows(len(record), rate_hz, irregular, rng)
    force, wander = shown_force(record, sensors, walk, wander)
    force = dead_band(force[rows], sensors.dead_band) + rng.normal(scale=sensors.force_noise, size=len(rows))
    late = sensors.late_s + sensors.delay_s
    position, speed = (np.interp(time[rows] - late, time, record[:, column]) for column in (POSITION, SPEED))
    columns: Columns = {"time_s": (time[rows], 4), n_: (force, _digits(sensors.force_noise / 10.0))}
    fine = _digits(sensors.count / 10.0)
    if "position" in logs:
        columns[f"{m_}_{x_}"] = (sensors.count * np.floor(position / sensors.count), fine)
    if "speed" in logs:
        noise = rng.normal(scale=sensors.speed_noise, size=len(rows))
        columns[v_] = (speed + noise, _digits(sensors.speed_noise / 10.0))
    if "reference" in logs:
        columns[f"{m_}_reference_{x_}"] = (reference[rows], fine)
    return columns, wander


def _digits(smallest: float) -> int:
    """Behind the point, so that `smallest` is still written."""
    return max(0, math.ceil(-math.log10(smallest)))
