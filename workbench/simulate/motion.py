"""The motion of the driven coordinate, as a log shows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.plants import Plant
from workbench.run import Array, Run
from workbench.simulate.lowpass import lowpass


@dataclass(frozen=True)
class Motion:
    """position, speed, acceleration: (n,) of the driven coordinate at the log's samples.

    A motor's position counts from the run's first sample; an axis' is the measured one.
    """

    position: Array
    speed: Array
    acceleration: Array


def motion_of(run: Run, plant: Plant, band_hz: float) -> Motion:
    """Speed as measured where it is logged, else the derivative of the low-passed position.

    The position is low-passed an octave above `band_hz` first: twice differentiated
    encoder noise grows with the square of frequency. The acceleration is the central
    difference of the speed; its noise goes with the later low-pass of the residual.
    """
    t = run.time_s
    position_name, speed_name = plant.positions[0], plant.speeds[0]
    if speed_name in run:
        speed = run[speed_name]
        travelled = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))])
        position = run[position_name] if position_name in run else travelled
    else:
        position = lowpass(t, run[position_name], 2.0 * band_hz)
        speed = np.gradient(position, t)
    return Motion(position, speed, np.gradient(speed, t))


def moving(time_s: Array, speed: Array, scale: float, band_hz: float, threshold: float = 0.01) -> np.ndarray:
    """(n,) bool: where the machine moves, and has done so for as long as the low-pass remembers.

    A machine at rest may stick anywhere within its friction: a held load says nothing
    about friction, and the low-pass smears that over half a period of its band.
    """
    still = np.abs(lowpass(time_s, speed, band_hz)) < threshold * scale
    guard = 0.5 / band_hz
    count = np.concatenate([[0], np.cumsum(still)])
    first = np.searchsorted(time_s, time_s - guard, side="left")
    last = np.searchsorted(time_s, time_s + guard, side="right")
    return (count[last] - count[first]) == 0
