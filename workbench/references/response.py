"""What a motion asks of the motors on a load that hangs on a wire: its forces, and the pair of limits of least peak."""

from __future__ import annotations

import numpy as np

from workbench.kinds import Load
from workbench.references.limits import Limits
from workbench.references.shape import Shape
from workbench.references.time_optimal import shortest_move, shortest_move_s
from workbench.run import Array

STEP_S = 0.004
MOST_ACCELERATION = 6.0  # times the trapezoid's


def peak_force_n(shape: Shape, load: Load) -> float:
    """The largest force, either way, of the motors in a move, the drive following it exactly: at the load, N.

    With a the drive's acceleration and z the stretch beyond that of rest: z'' = a - w² z - 2 zeta w z', and the
    load's own acceleration w² z + 2 zeta w z'.
    """
    return float(np.max(np.abs(forces_n(shape, load)[1])))


def forces_n(shape: Shape, load: Load) -> tuple[Array, Array]:
    """(times s, forces along the motion N), (n,): inertia of drive and load, weight, friction."""
    from scipy.signal import cont2discrete, lfilter

    after = 0.0 if load.rigid else 3.0 * np.pi / load.angular_frequency_rad_s
    time = np.arange(0.0, shape.duration_s + after, STEP_S)
    direction = np.sign(shape.distance_m)
    a = direction * shape.at(time)[2]
    carried = a
    if not load.rigid:
        w, zeta = load.angular_frequency_rad_s, load.damping
        passed_on = [2.0 * zeta * w, w * w] if zeta > 0.0 else [w * w]  # a leading 0 is no polynomial to scipy
        b, c, _ = cont2discrete((passed_on, [1.0, 2.0 * zeta * w, w * w]), STEP_S, method="foh")
        carried = lfilter(b.ravel(), c, a)
    return time, load.drive_kg * a + load.mass_kg * carried + load.steady_force_n(direction)


def least_peak_limits(distance_m: float, limits: Limits, time_s: float, load: Load) -> Limits:
    """Of the pairs of acceleration and jerk with which the move takes `time_s`, the one of the least peak force.

    One pair is free: each acceleration above the trapezoid's has one jerk that gives the time. The search is over
    the logarithm of the acceleration, first even, then around the best.
    """
    low, high = limits.acceleration_m_s2 * 1.01, limits.acceleration_m_s2 * MOST_ACCELERATION
    tried: dict[Limits, float] = {}
    for _ in range(3):
        values = np.geomspace(low, high, 13)
        pairs = (_in_time(distance_m, limits, time_s, float(a)) for a in values)
        tried |= {pair: peak_force_n(shortest_move(distance_m, pair), load) for pair in pairs if pair is not None}
        best = min(tried, key=tried.__getitem__)  # a large enough acceleration always has its jerk
        step = values[1] / values[0]
        low = max(best.acceleration_m_s2 / step, limits.acceleration_m_s2 * 1.001)
        high = best.acceleration_m_s2 * step
    return best


def _in_time(distance_m: float, limits: Limits, time_s: float, acceleration_m_s2: float) -> Limits | None:
    """The jerk with which the move at this acceleration takes the time; None where none is quick enough."""
    low, high = 1e-3, 1e5

    def late(jerk: float) -> bool:
        return shortest_move_s(distance_m, Limits(limits.speed_m_s, acceleration_m_s2, jerk)) > time_s

    if late(high):
        return None
    for _ in range(50):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if late(middle) else (low, middle)
    return Limits(limits.speed_m_s, acceleration_m_s2, high)
