"""Input shapers: a move sent off in parts, each swing of the load put out by the next part's.

N. C. Singer, W. P. Seering, "Preshaping command inputs to reduce system vibration", Journal of Dynamic Systems,
Measurement, and Control 112 (1990), for ZV and ZVD; W. Singhose, W. Seering, N. Singer, "Residual vibration reduction
using vector diagrams to generate shaped inputs", Journal of Mechanical Design 116 (1994), for EI.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.kinds import Load
from workbench.references.shape import Shape
from workbench.run import Array

EI_VIBRATION = 0.05  # of an unshaped step's, that the EI shaper leaves at its own frequency
OVERSHOOT = 0.01  # of a step; a load that swings less far is not shaped

# Of an undamped load, half a period apart.
ZV = (0.5, 0.5)
ZVD = (0.25, 0.5, 0.25)
EI = ((1.0 + EI_VIBRATION) / 4.0, (1.0 - EI_VIBRATION) / 2.0, (1.0 + EI_VIBRATION) / 4.0)


def impulses(undamped: Sequence[float], load: Load) -> tuple[tuple[float, float], ...]:
    """(time s, amplitude) of a shaper for a load. A damped swing has shrunk by K = exp(-pi zeta/sqrt(1 - zeta²)) in
    each half period, so the later parts do, too. A load that does not swing gets one impulse: no shaper."""
    zeta = load.damping
    if load.rigid or zeta >= 1.0 or (K := math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta * zeta))) < OVERSHOOT:
        return ((0.0, 1.0),)
    half = math.pi / (load.angular_frequency_rad_s * math.sqrt(1.0 - zeta * zeta))
    parts = [amplitude * K**i for i, amplitude in enumerate(undamped)]
    return tuple((i * half, part / sum(parts)) for i, part in enumerate(parts))


def shaped(shape: Shape, parts: Sequence[tuple[float, float]]) -> Shape:
    """The sum of the shape's copies at these times with these amplitudes."""
    last_s = parts[-1][0]

    def motion(time_s: Array) -> tuple[Array, Array, Array]:
        copies = [amplitude * np.array(shape.going_on(time_s - delay)) for delay, amplitude in parts]
        position, speed, acceleration = sum(copies[1:], copies[0])
        return position, speed, acceleration

    held = shape.end_speed_m_s * sum(amplitude * (last_s - delay) for delay, amplitude in parts)
    return replace(shape, distance_m=shape.distance_m + held, duration_s=shape.duration_s + last_s, motion=motion)
