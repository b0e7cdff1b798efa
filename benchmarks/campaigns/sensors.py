"""From a run's record to the columns of its log: what sensors and logger make of the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchmarks.campaigns.kernel import HEIGHT, RECORD_S, SPEED, TENSION, TORQUE

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Sensors:
    """A machine's sensors. Noise, one standard deviation a sample: as measured on the practice logs."""

    gain: float = 1.0
    offset_nm: float = 0.0
    filter_s: float = 0.0
    delay_s: float = 0.0
    gain_hoisting: float = 0.0
    walk_nm_per_sqrt_s: float = 0.0
    dead_band_nm: float = 0.0
    bend_per_nm: float = 0.0
    torque_noise_nm: float = 1.95  # of one motor; scaled with small and with large motors
    speed_noise_rad_s: float = 0.029
    position_noise_m: float = 0.0005
    tension_noise_n: float = 117.0
    tension_step_n: float = 10.0
    share_std: float = 0.008  # by which a motor's share of the torque is off one half, drawn each run


def log_columns(
    record: Array,
    reference: Array,
    sensors: Sensors,
    rng: np.random.Generator,
    walk: np.random.Generator,
    *,
    rate_hz: float,
    wander_nm: float = 0.0,
    full: bool = False,
    sum_only: bool = False,
    with_reference: bool = True,
) -> tuple[dict[str, tuple[Array, int]], float]:
    """Columns by signal name, each with its number of digits, and where the torque sensor has wandered to.

    record: (n, COLUMNS) of the kernel, a row each millisecond. walk: the stream that the torque sensor wanders
    by. wander_nm: where it stood before.
    """
    every = round(1.0 / rate_hz / RECORD_S)
    time = np.arange(len(record), dtype=np.float64) * RECORD_S
    torque, wander_nm = shown_torque(record, sensors, walk, wander_nm)
    speed = np.interp(time - sensors.delay_s, time, record[:, SPEED])
    rows = slice(None, None, every)
    n = len(record[rows])
    torque = dead_band(torque[rows], sensors.dead_band_nm)
    share = 0.5 + sensors.share_std * rng.normal()
    noise = rng.normal(scale=sensors.torque_noise_nm, size=(2, n))
    first, second = share * torque + noise[0], (1.0 - share) * torque + noise[1]
    columns: dict[str, tuple[Array, int]] = {"time_s": (time[rows], 3 if every % 10 else 2)}
    if sum_only:
        columns["torque_motor_nm"] = (first + second, 1)
    else:
        columns |= {"torque_motor1_nm": (first, 1), "torque_motor2_nm": (second, 1)}
    columns["speed_motor_rad_s"] = (speed[rows] + rng.normal(scale=sensors.speed_noise_rad_s, size=n), 2)
    if with_reference:
        columns["speed_reference_rad_s"] = (reference[rows], 3)
    if full:
        height = record[rows, HEIGHT] + rng.normal(scale=sensors.position_noise_m, size=n)
        tension = record[rows, TENSION] + rng.normal(scale=sensors.tension_noise_n, size=n)
        columns["position_carriage_m"] = (height, 4)
        columns["tension_dead_line_n"] = (sensors.tension_step_n * np.round(tension / sensors.tension_step_n), 0)
    return columns, wander_nm


def shown_torque(record: Array, s: Sensors, walk: np.random.Generator, wander_nm: float) -> tuple[Array, float]:
    """The sum of torques as the sensor shows it, before noise."""
    true = record[:, TORQUE]
    shown: Array = s.gain * true + s.offset_nm
    shown = shown * (1.0 + s.gain_hoisting * np.tanh(record[:, SPEED])) + s.bend_per_nm * true * np.abs(true)
    if s.walk_nm_per_sqrt_s > 0.0:
        steps = walk.normal(scale=s.walk_nm_per_sqrt_s * np.sqrt(RECORD_S), size=len(true))
        wandering = wander_nm + np.cumsum(steps)
        shown, wander_nm = shown + wandering, float(wandering[-1])
    if s.filter_s > 0.0:
        shown = _low_passed(shown, s.filter_s)
    return shown, wander_nm


def _low_passed(values: Array, tau_s: float) -> Array:
    """First order, exact for an input held between samples; long settled at the start."""
    left = np.exp(-RECORD_S / tau_s)
    out = np.empty_like(values)
    state = values[0]
    for k, value in enumerate(values):
        state = value + left * (state - value)
        out[k] = state
    return out


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
