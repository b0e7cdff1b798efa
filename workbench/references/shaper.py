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
    """The sum of the shape's copies at these times with these amplitudes, a cubic on each of its phases again."""
    starts = np.unique(
        np.concatenate([shape.phase_start_s + t for t, _ in parts] + [[shape.duration_s + t for t, _ in parts]])
    )
    end = shape.duration_s + parts[-1][0]
    # A ramp that goes on at its end speed has a last phase at just that.
    starts = starts[starts < end + (1e-12 if shape.end_speed_m_s else -1e-12)]
    at = np.zeros((4, len(starts)))
    for delay, amplitude in parts:
        at += amplitude * _derivatives(shape, starts - delay)
    held = sum(amplitude * (end - shape.duration_s - delay) for delay, amplitude in parts)
    return replace(
        shape,
        distance_m=shape.distance_m + shape.end_speed_m_s * held,
        duration_s=end,
        phase_start_s=starts,
        position_m=at[0],
        speed_m_s=at[1],
        acceleration_m_s2=at[2],
        jerk_m_s3=at[3],
    )


def _derivatives(shape: Shape, since_s: np.ndarray) -> np.ndarray:
    """(4, n): position, speed, acceleration, jerk from the right at times since the start; at rest before it, at the
    end speed after it."""
    # A sum of phase lengths may miss the next phase's start by rounding: a phase belongs to its start from just before.
    k = np.clip(np.searchsorted(shape.phase_start_s, since_s + 1e-12, side="right") - 1, 0, None)
    t = since_s - shape.phase_start_s[k]
    p, v, a, j = (x[k] for x in (shape.position_m, shape.speed_m_s, shape.acceleration_m_s2, shape.jerk_m_s3))
    inside = np.array([p + t * (v + t * (a / 2.0 + t * j / 6.0)), v + t * (a + t * j / 2.0), a + t * j, j])
    zero, late = np.zeros_like(since_s), since_s - shape.duration_s
    after = np.array([shape.distance_m + shape.end_speed_m_s * late, zero + shape.end_speed_m_s, zero, zero])
    return np.where(since_s < -1e-12, 0.0, np.where(late > -1e-12, after, inside))
