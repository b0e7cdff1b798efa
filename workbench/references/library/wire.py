"""References that know the load on its wire: input shapers, the limits of least peak, the least peak there is.

N. C. Singer, W. P. Seering, "Preshaping command inputs to reduce system vibration", Journal of Dynamic Systems,
Measurement, and Control 112 (1990), for ZV and ZVD; W. Singhose, W. Seering, N. Singer, "Residual vibration reduction
using vector diagrams to generate shaped inputs", Journal of Mechanical Design 116 (1994), for EI.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from workbench.core.run import Array
from workbench.machines import Load
from workbench.references.kind import Move, PlannedKind, Ramp, planned
from workbench.references.least_peak import gentle_move, least_peak_limits, peak_force_n
from workbench.references.library.planned import _equal_time_ramp, _trapezoid_ramp, _trapezoid_s
from workbench.references.shape import Shape, shortest_move

EI_VIBRATION = 0.05  # of an unshaped step's, that the EI shaper leaves at its own frequency
OVERSHOOT = 0.01  # of a step; a load that swings less far is not shaped

# Impulses for an undamped load, half a period apart: zero vibration; its derivative zero, too; extra insensitive, which
# leaves a little.
ZV = (0.5, 0.5)
ZVD = (0.25, 0.5, 0.25)
EI = ((1.0 + EI_VIBRATION) / 4.0, (1.0 - EI_VIBRATION) / 2.0, (1.0 + EI_VIBRATION) / 4.0)

SHAPERS = {"zv": ZV, "zvd": ZVD, "ei": EI}


def impulses(undamped: Sequence[float], load: Load) -> tuple[tuple[float, float], ...]:
    """(time s, amplitude) of a shaper for a load. A damped swing has shrunk by K = exp(-pi zeta/sqrt(1 - zeta²)) in
    each half period, so the later parts do, too. A load that does not swing gets one impulse: no shaper."""
    return ((0.0, 1.0),) if load.rigid else _impulses(undamped, load.angular_frequency_rad_s, load.damping)


def _impulses(undamped: Sequence[float], w: float, zeta: float) -> tuple[tuple[float, float], ...]:
    if zeta >= 1.0 or (K := math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta * zeta))) < OVERSHOOT:
        return ((0.0, 1.0),)
    half = math.pi / (w * math.sqrt(1.0 - zeta * zeta))
    parts = [amplitude * K**i for i, amplitude in enumerate(undamped)]
    return tuple((i * half, part / sum(parts)) for i, part in enumerate(parts))


def through_shaper(shaper: Any, references: Array, sample_time_s: float) -> Array:
    """References (rows, n) at a controller's samples, as its `InputShaper` passes them on; None passes them as they
    are. Straight lines between samples."""
    if shaper is None:
        return references
    parts = _impulses(SHAPERS[shaper.kind], 2.0 * math.pi * shaper.frequency_hz, shaper.damping)
    at = np.arange(references.shape[1]) * sample_time_s
    return np.array([sum(part * np.interp(at - late, at, row) for late, part in parts) for row in references])


def shaped(shape: Shape, parts: Sequence[tuple[float, float]]) -> Shape:
    """The sum of the shape's copies at these times with these amplitudes."""
    last_s = parts[-1][0]

    def motion(time_s: Array) -> tuple[Array, Array, Array]:
        copies = [amplitude * np.array(shape.going_on(time_s - delay)) for delay, amplitude in parts]
        position, speed, acceleration = sum(copies[1:], copies[0])
        return position, speed, acceleration

    held = shape.end_speed_m_s * sum(amplitude * (last_s - delay) for delay, amplitude in parts)
    return replace(shape, distance_m=shape.distance_m + held, duration_s=shape.duration_s + last_s, motion=motion)


@planned(
    label="ruckig, least peak in the same time",
    words="ruckig with its pair of limits of least peak",
    definition="the jerk-limited move that takes as long as the trapezoid's, with the pair of acceleration and jerk, "
    "which is free on one line, chosen for the least torque peak on this machine's wire and payload. The line begins "
    "at the trapezoid, and so the pair is nearly the trapezoid's unless the load weighs some three times what motors "
    "and drum do. A jog's ramp is that of ruckig_equal_time",
    ramp=_equal_time_ramp,
    same_time_as="trapezoid",
    needs_load=True,
    colour="#3390C6",
    dash="8px,3px,2px,3px",
)
def ruckig_least_peak(move: Move) -> Shape:
    """Ruckig in the trapezoid's own time; of all pairs (a, j) that take it, the one of the least torque peak."""
    pair = least_peak_limits(move.distance_m, move.limits, move.time_s, move.known_load)
    return shortest_move(move.distance_m, pair)


@planned(
    label="least torque peak",
    words="the motion of least torque peak",
    definition="a gentle motion within 2 % of the least torque peak that there is in the trapezoid's time on this "
    "machine's wire and payload, within torque, speed and a taut wire (a linear programme). The wire is still at the "
    "end, unless that takes less than 5 % off the trapezoid's peak, as on a short move of a well damped load. The "
    "peak is that of motors that follow exactly; feed-forward with `wire: 1` comes near it, a loop without adds its "
    "errors. Limits of acceleration and jerk do not bind it; a jog's ramp is the trapezoid's",
    ramp=_trapezoid_ramp,
    duration=_trapezoid_s,
    same_time_as="trapezoid",
    needs_jerk=False,
    needs_load=True,
    needs_following=True,
    colour="#000000",
    dash="2px,2px",
)
def optimal(move: Move) -> Shape:
    """Nearly the least torque peak in the trapezoid's time; see `workbench.references.least_peak`."""
    trapezoid_n = peak_force_n(shortest_move(move.distance_m, move.limits.without_jerk_limit()), move.known_load)
    return gentle_move(move.distance_m, move.limits.speed_m_s, move.time_s, move.known_load, trapezoid_n)


def _through(undamped: Sequence[float], **declared: Any) -> PlannedKind:
    """The trapezoid through a shaper, as a kind of reference."""

    def ramp_of(ramp: Ramp) -> Shape:
        assert ramp.load is not None
        return shaped(_trapezoid_ramp(ramp), impulses(undamped, ramp.load))

    def duration(move: Move) -> float:
        return _trapezoid_s(move) + impulses(undamped, move.known_load)[-1][0]

    def shape(move: Move) -> Shape:
        plain = shortest_move(move.distance_m, move.limits.without_jerk_limit())
        return shaped(plain, impulses(undamped, move.known_load))

    return planned(ramp=ramp_of, duration=duration, needs_jerk=False, needs_load=True, **declared)(shape)


zv = _through(
    ZV,
    name="zv",
    label="trapezoid, ZV shaper",
    words="the trapezoid through a ZV shaper",
    definition="the trapezoid in two parts, half a swing of the load apart: at the load's own frequency nothing is "
    "left to swing; half a period longer. The trapezoid itself where the wire's damping leaves less than 1 % overshoot",
    colour="#CC79A7",
)
zvd = _through(
    ZVD,
    name="zvd",
    label="trapezoid, ZVD shaper",
    words="the trapezoid through a ZVD shaper",
    definition="the same in three parts: what is left to swing grows with the square of an error of the frequency; a "
    "whole period longer",
    colour="#C07F00",
)
ei = _through(
    EI,
    name="ei",
    label="trapezoid, EI shaper",
    words="the trapezoid through an EI shaper",
    definition="the same with 5 % of the swing left at the load's own frequency, and less than that over the widest "
    "band around it (extra insensitive)",
    colour="#978600",
)
