"""The shortest moves and ramps within limits of speed, acceleration and jerk, by ruckig.

Ruckig gives the time-optimal motion as a piecewise cubic, which is read out once. With an infinite jerk it is the exact
trapezoid. (L. Berscheid and T. Kröger, "Jerk-limited real-time trajectory generation with arbitrary target states",
Robotics: Science and Systems, 2021.)
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from workbench.core.errors import InputError
from workbench.references.limits import Limits
from workbench.references.shape import Pieces, Shape


def shortest_move(distance_m: float, limits: Limits) -> Shape:
    """The shortest move from rest to rest. InputError for a move of 0 m and for limits of very unlike sizes."""
    if not math.isfinite(distance_m) or distance_m == 0.0:
        raise InputError(f"a move of {distance_m:g} m is no move, expected another distance than 0")
    trajectory = _move(distance_m, limits)
    profile = trajectory.profiles[0][0]
    return Shape(
        distance_m=distance_m,
        duration_s=float(trajectory.duration),
        limits=limits,
        motion=_pieces(profile),
    )


def shortest_move_s(distance_m: float, limits: Limits) -> float:
    """What `shortest_move` takes (s), without its shape."""
    return float(_move(distance_m, limits).duration)


def shortest_ramp(speed_m_s: float, next_speed_m_s: float, limits: Limits) -> Shape:
    """The shortest change from one steady speed to another, at any distance; it ends at the second speed."""
    trajectory = _ramp(speed_m_s, next_speed_m_s, limits)
    profile = trajectory.profiles[0][0]
    return Shape(
        distance_m=float(profile.p[7]),
        duration_s=float(trajectory.duration),
        limits=limits,
        motion=_pieces(profile),
        end_speed_m_s=next_speed_m_s,
    )


def _pieces(profile: Any) -> Pieces:
    """Ruckig's seven phases."""
    start_s = np.concatenate(([0.0], np.cumsum(np.asarray(profile.t))[:-1]))
    return Pieces.of_even_jerk(start_s, *(np.asarray(x[:7]) for x in (profile.p, profile.v, profile.a, profile.j)))


def shortest_ramp_s(speed_m_s: float, next_speed_m_s: float, limits: Limits) -> float:
    """What `shortest_ramp` takes (s), without its shape."""
    return float(_ramp(speed_m_s, next_speed_m_s, limits).duration)


def _ramp(speed_m_s: float, next_speed_m_s: float, limits: Limits) -> Any:
    """Ruckig's trajectory from one steady speed to another, by its velocity interface; it has no types of its own."""
    from ruckig import ControlInterface, InputParameter, Ruckig, RuckigError, Trajectory

    wanted = InputParameter(1)
    wanted.control_interface = ControlInterface.Velocity
    wanted.current_velocity, wanted.target_velocity = [speed_m_s], [next_speed_m_s]
    wanted.max_acceleration, wanted.max_jerk = [limits.acceleration_m_s2], [limits.jerk_m_s3]
    trajectory = Trajectory(1)
    try:
        Ruckig(1).calculate(wanted, trajectory)
    except RuckigError as error:
        raise InputError(
            f"no way from {speed_m_s:g} m/s to {next_speed_m_s:g} m/s within {limits.acceleration_m_s2:g} m/s² and "
            f"{limits.jerk_m_s3:g} m/s³ was found; expected limits of a like size"
        ) from error
    return trajectory


def _move(distance_m: float, limits: Limits) -> Any:
    """Ruckig's trajectory; it has no types of its own.

    Where a move just reaches two limits at once, ruckig can fall between its own cases and raise.
    A speed or acceleration limit smaller by 1e-12 and more takes it off that point.
    """
    from ruckig import InputParameter, Ruckig, RuckigError, Trajectory

    for less_speed, less_acceleration in ((0.0, 0.0), (1e-12, 0.0), (0.0, 1e-12), (1e-11, 1e-12), (1e-10, 1e-11)):
        wanted = InputParameter(1)
        wanted.current_position, wanted.target_position = [0.0], [distance_m]
        # Ruckig's default max_velocity is 0, so every limit is set.
        wanted.max_velocity = [limits.speed_m_s * (1.0 - less_speed)]
        wanted.max_acceleration = [limits.acceleration_m_s2 * (1.0 - less_acceleration)]
        wanted.max_jerk = [limits.jerk_m_s3]
        trajectory = Trajectory(1)
        try:
            Ruckig(1).calculate(wanted, trajectory)
        except RuckigError:
            continue
        return trajectory
    raise InputError(
        f"no move of {distance_m:g} m within {limits.speed_m_s:g} m/s, {limits.acceleration_m_s2:g} m/s², "
        f"{limits.jerk_m_s3:g} m/s³ was found; expected limits of a like size"
    )
