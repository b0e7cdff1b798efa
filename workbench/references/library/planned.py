"""The references that are planned from moves and limits, and those that follow a campaign's run."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np

from workbench.core.run import Array
from workbench.references.kind import Move, Ramp, RecordedKind, planned
from workbench.references.least_peak import equal_time_limits
from workbench.references.shape import Limits, Shape, shortest_move, shortest_move_s, shortest_ramp, shortest_ramp_s


def _trapezoid_s(move: Move) -> float:
    """|d|/v + v/a, or 2·sqrt(|d|/a) where the move never reaches the speed limit."""
    d, v, a = abs(move.distance_m), move.limits.speed_m_s, move.limits.acceleration_m_s2
    return d / v + v / a if d >= v * v / a else 2.0 * math.sqrt(d / a)


def _trapezoid_ramp(ramp: Ramp) -> Shape:
    """Constant acceleration: takes |Δv|/a."""
    return shortest_ramp(ramp.speed_m_s, ramp.next_speed_m_s, ramp.limits.without_jerk_limit())


@planned(
    label="trapezoid",
    words="the trapezoid",
    definition="constant acceleration, constant speed, constant deceleration; the jerk limit is not used",
    ramp=_trapezoid_ramp,
    duration=_trapezoid_s,
    needs_jerk=False,
    usual=True,
    colour="#D55E00",
)
def trapezoid(move: Move) -> Shape:
    """Constant acceleration, constant speed, constant deceleration; the jerk limit is not used.

    Takes |d|/v + v/a, or 2·sqrt(|d|/a) when it never reaches the speed limit.
    """
    return shortest_move(move.distance_m, move.limits.without_jerk_limit())


@planned(
    label="ruckig, same limits",
    words="ruckig with the same limits",
    definition="the shortest move within the speed, acceleration and jerk limits (ruckig); takes longer than the "
    "trapezoid",
    ramp=lambda ramp: shortest_ramp(ramp.speed_m_s, ramp.next_speed_m_s, ramp.limits),
    duration=lambda move: shortest_move_s(move.distance_m, move.limits),
    usual=True,
    colour="#0072B2",
)
def ruckig(move: Move) -> Shape:
    """The shortest move within speed, acceleration and jerk limits.

    Takes |d|/v + v/a + a/j when it reaches both the speed and the acceleration limit.
    """
    return shortest_move(move.distance_m, move.limits)


def _equal_time_ramp(ramp: Ramp) -> Shape:
    """The jerk-limited ramp s times as fast, with a → s·a and j → s²·j, so that it takes `time_s`."""
    limits = ramp.limits
    if ramp.time_s > 0.0:
        limits = limits.ramps_faster(shortest_ramp_s(ramp.speed_m_s, ramp.next_speed_m_s, limits) / ramp.time_s)
    return shortest_ramp(ramp.speed_m_s, ramp.next_speed_m_s, limits)


@planned(
    label="ruckig in the trapezoid's time",
    words="ruckig",
    definition="the jerk-limited move that takes as long as the trapezoid's. It exceeds what is cheapest for the "
    "machine: the speed alone, as far as the motors allow; at their top speed the jerk, up to ten times; then the "
    "acceleration. Of the ways that exceed no more than that it is the one with the lowest torque peak on this machine "
    "and payload, followed exactly. Each jog's ramp takes as long as the trapezoid's, with acceleration times s and "
    "jerk times s²",
    ramp=_equal_time_ramp,
    same_time_as="trapezoid",
    uses_load=True,
    usual=True,
    colour="#009E73",
    dash="6px,3px",
)
def ruckig_equal_time(move: Move) -> Shape:
    """The jerk-limited move that takes as long as the trapezoid, see `equal_time_limits`.

    Without a known load the ramps run s times faster, a → s·a, j → s²·j, so that T(s) falls steadily towards |d|/v.
    """
    d, limits, load = move.distance_m, move.limits, move.load
    if load is not None:
        return shortest_move(d, equal_time_limits(d, limits, move.time_s, load))
    low, high = 1.0, 2.0
    while shortest_move_s(d, limits.ramps_faster(high)) > move.time_s:
        low, high = high, 2.0 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        late = shortest_move_s(d, limits.ramps_faster(middle)) > move.time_s
        low, high = (middle, high) if late else (low, middle)
    return shortest_move(d, limits.ramps_faster(high))


def _smooth(speed: float, next_speed: float, ramp_s: float, t: Array) -> tuple[Array, Array, Array]:
    """Way, speed and acceleration of a change of speed along s(τ) = 35τ⁴ - 84τ⁵ + 70τ⁶ - 20τ⁷, τ = t/ramp_s."""
    x, change = t / ramp_s, next_speed - speed
    area = x**5 * (7.0 - 14.0 * x + 10.0 * x**2 - 2.5 * x**3)
    part = x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)
    rise = 140.0 * (x * (1.0 - x)) ** 3
    return speed * t + change * ramp_s * area, speed + change * part, change / ramp_s * rise


def _smooth_ramp_s(change: float, limits: Limits) -> float:
    """s' is 35/16 at most, s'' 84/(5 sqrt 5)."""
    by_acceleration = STEEPEST * abs(change) / limits.acceleration_m_s2
    return max(by_acceleration, math.sqrt(MOST_BENT * abs(change) / limits.jerk_m_s3))


STEEPEST, MOST_BENT = 35.0 / 16.0, 84.0 / (5.0 * math.sqrt(5.0))


def _seventh_order_ramp(ramp: Ramp) -> Shape:
    change = ramp.next_speed_m_s - ramp.speed_m_s
    ramp_s = _smooth_ramp_s(change, ramp.limits)
    return Shape(
        0.5 * (ramp.speed_m_s + ramp.next_speed_m_s) * ramp_s, ramp_s, ramp.limits,
        partial(_smooth, ramp.speed_m_s, ramp.next_speed_m_s, ramp_s), ramp.next_speed_m_s,
    )  # fmt: skip


def _top_and_ramp(move: Move) -> tuple[float, float]:
    """(speed m/s, ramp s): the speed limit, or what the distance leaves time for, 2·ramp·speed/2 = |d|."""
    d, limits = abs(move.distance_m), move.limits
    speed = min(
        limits.speed_m_s,
        math.sqrt(d * limits.acceleration_m_s2 / STEEPEST),
        (d * d * limits.jerk_m_s3 / MOST_BENT) ** (1.0 / 3.0),
    )
    return speed, _smooth_ramp_s(speed, limits)


def _seventh_order_s(move: Move) -> float:
    """|d|/v + ramp."""
    speed, ramp_s = _top_and_ramp(move)
    return abs(move.distance_m) / speed + ramp_s


@planned(
    label="seventh-order polynomial",
    words="the seventh-order polynomial",
    definition="speed ramps along 35τ⁴ - 84τ⁵ + 70τ⁶ - 20τ⁷, with an even stretch between where the move is long "
    "enough: acceleration, jerk and snap are continuous and 0 at both ends of a ramp, within the limits of speed, "
    "acceleration and jerk; takes longer than ruckig",
    ramp=_seventh_order_ramp,
    duration=_seventh_order_s,
    colour="#9A5FA6",
    dash="6px,2px",
)
def seventh_order(move: Move) -> Shape:
    """Up to speed and down again along the seventh-order polynomial, in |d|/v + ramp.

    L. Biagiotti, C. Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, section 2.1.5.
    """
    speed, ramp_s = _top_and_ramp(move)
    direction, d = math.copysign(1.0, move.distance_m), abs(move.distance_m)
    time_s = d / speed + ramp_s

    def motion(t: Array) -> tuple[Array, Array, Array]:
        rising = t < 0.5 * time_s
        since = np.where(rising, t, time_s - t)  # the second half is the first one, backwards
        way, v, a = _smooth(0.0, speed, ramp_s, np.minimum(since, ramp_s))
        way = way + speed * np.maximum(since - ramp_s, 0.0)
        return direction * np.where(rising, way, d - way), direction * v, direction * np.where(rising, a, -a)

    used = replace(move.limits, speed_m_s=speed)
    return Shape(move.distance_m, time_s, used, motion)


# `workbench.references.plan` plans them.
RECORDED = RecordedKind(
    name="recorded",
    label="recorded",
    definition="the logged set-point of a run (`speed_reference_rad_s`, or the measured speed where none was logged), "
    "from that run's start position",
)
S_CURVE = RecordedKind(
    name="s_curve",
    label="recorded, smoothed",
    definition="the same as a moving average over `smoothing_s`, which turns ramps into S-curves",
    smoothed=True,
)
