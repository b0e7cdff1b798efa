"""The references that are planned from moves and limits: trapezoid, jerk-limited, jerk-limited in equal time."""

from __future__ import annotations

import math

from workbench.references.kind import Move, Ramp, planned
from workbench.references.shape import Shape
from workbench.references.time_optimal import shortest_move, shortest_move_s, shortest_ramp, shortest_ramp_s


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
    definition="the jerk-limited move with acceleration times s and jerk times s², s such that each move (each jog's "
    "ramp) takes as long as the trapezoid's",
    ramp=_equal_time_ramp,
    same_time_as="trapezoid",
    usual=True,
    colour="#009E73",
    dash="6px,3px",
)
def ruckig_equal_time(move: Move) -> Shape:
    """The jerk-limited move with acceleration and jerk raised until it takes as long as the trapezoid.

    Speed ramps run s times faster when a → s·a and j → s²·j: the same change of speed,
    in 1/s of the time. The speed limit stays, so T(s) falls steadily from T(1), which is no less
    than the trapezoid's time, towards |d|/v, which is below it: one s fits. Where both moves
    reach full speed and the acceleration limit,

        |d|/v + (v/a + a/j)/s = |d|/v + v/a   →   s = 1 + a²/(v·j),

    whatever the distance. For the others s is found by bisection, which serves all of them.
    """
    distance_m, limits = move.distance_m, move.limits
    low, high = 1.0, 2.0
    while shortest_move_s(distance_m, limits.ramps_faster(high)) > move.time_s:
        low, high = high, 2.0 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        if shortest_move_s(distance_m, limits.ramps_faster(middle)) > move.time_s:
            low = middle
        else:
            high = middle
    return shortest_move(distance_m, limits.ramps_faster(high))
