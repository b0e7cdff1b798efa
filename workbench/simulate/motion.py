"""The motion of the driven coordinate, as a log shows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array, Run
from workbench.machines import Plant
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
        position = run.signals.get(position_name, travelled)
    else:
        position = lowpass(t, run[position_name], 2.0 * band_hz)
        speed = np.gradient(position, t)
    return Motion(position, speed, np.gradient(speed, t))


def moving(time_s: Array, speed: Array, scale: float, band_hz: float, threshold: float = 0.01) -> np.ndarray:
    """(n,) bool: False where the machine rests, and within half a period of the band around that.

    A machine at rest may stick anywhere within its friction: a held load says nothing
    about friction, and the low-pass smears that. It rests when it is slower than
    `threshold` of the speed scale for a period of the band or longer; a quick reversal is no
    rest, the overshoot of a stop belongs to it.
    """
    still = np.abs(lowpass(time_s, speed, band_hz)) < threshold * scale
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
    keep = np.ones(len(time_s), dtype=bool)
    guard = 0.5 / band_hz
    spans: list[list[float]] = []
    for begin, end in edges.reshape(-1, 2):
        if spans and time_s[begin] - spans[-1][1] < 1.0 / band_hz:
            spans[-1][1] = time_s[end - 1]
        else:
            spans.append([time_s[begin], time_s[end - 1]])
    for since, until in spans:
        if until - since >= 1.0 / band_hz:
            keep &= (time_s < since - guard) | (time_s > until + guard)
    return keep
