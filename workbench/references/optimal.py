"""The motion of least torque peak in a given time, on a load that hangs on a wire: a linear programme.

The drive's acceleration is linear between nodes; stretch, speed and force at the nodes are then linear in its values,
by the exact response of the wire. Peak and bounds are linear, so the least peak is that of a linear programme, which
HiGHS solves (Q. Huangfu, J. A. J. Hall, "Parallelizing the dual revised simplex method", Mathematical Programming
Computation 10, 2018; in scipy.optimize.linprog). Limits of acceleration and jerk do not bind it: torque, speed and
wire do.

The peak is that of a drive that follows the reference exactly. A loop adds its errors: the more, the faster the torque
changes. Of the motions within 1 % of the least peak the gentlest is taken, for the least itself brakes in jumps that no
loop follows.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from workbench.errors import InputError
from workbench.kinds import Load
from workbench.references.limits import Limits
from workbench.references.shape import Shape
from workbench.run import Array

NODES = 48  # in the ramp at either end
TAUT = 0.1  # of the weight: the wire carries at least that
GIVEN_AWAY = 0.01  # of the least peak, for a gentler motion at nearly the same peak
SMOOTH = 0.1  # a change of the acceleration by 1 m/s², beside the braking peak in weights of the load


@lru_cache(maxsize=256)  # a study asks for each of its moves, and its neighbours' studies for many of them again
def least_peak_move(distance_m: float, speed_m_s: float, time_s: float, load: Load) -> Shape:
    """From rest to rest, the wire still at the end. InputError where torque, speed and wire do not allow the time."""
    direction, d = math.copysign(1.0, distance_m), abs(distance_m)
    steps = _steps(d, speed_m_s, time_s, load)
    position, speed, stretch, rate = _responses(steps, load)
    n = len(steps) + 1
    eye = np.eye(n)
    carried = eye if load.rigid else load.angular_frequency_rad_s**2 * (stretch + load.damping_time_s * rate)
    force = load.drive_kg * eye + load.mass_kg * carried  # beside the steady one
    steady = load.steady_force_n(direction)
    scale = load.hold_n + load.friction_up_n + load.mass_kg
    # Unknowns: accelerations at the nodes, peak, largest braking force, total change of the acceleration.
    rows: list[Array] = []
    most: list[Array] = []

    def bound(matrix: Array, beside: tuple[float, float, float], upper: float | Array) -> None:
        rows.append(np.hstack([matrix, np.tile(beside, (len(matrix), 1)), np.zeros((len(matrix), n - 1))]))
        most.append(np.broadcast_to(upper, len(matrix)))

    bound(force / scale, (-1.0, 0.0, 0.0), -steady / scale)
    bound(-force / scale, (-1.0, 0.0, 0.0), steady / scale)
    bound(-force / scale, (0.0, -1.0, 0.0), 0.0)
    if math.isfinite(load.force_limit_n):
        bound(force / scale, (0.0, 0.0, 0.0), (load.force_limit_n - steady) / scale)
        bound(-force / scale, (0.0, 0.0, 0.0), (load.force_limit_n + steady) / scale)
    bound(speed, (0.0, 0.0, 0.0), speed_m_s)
    bound(-speed, (0.0, 0.0, 0.0), 0.0)
    midway = speed[:-1] + steps[:, None] * (3.0 * eye[:-1] + eye[1:]) / 8.0
    bound(midway, (0.0, 0.0, 0.0), speed_m_s)
    if load.hangs and load.hold_n > 0.0 and not load.rigid:
        room = (1.0 - TAUT) * load.hold_n
        bound(-direction * load.mass_kg * carried / scale, (0.0, 0.0, 0.0), room / scale)
    change = np.diff(eye, axis=0)
    for sign in (1.0, -1.0):  # |change of a| at most its own bound, whose sum is the third unknown
        rows.append(np.hstack([sign * change, np.zeros((n - 1, 3)), -np.eye(n - 1)]))
        most.append(np.zeros(n - 1))
    cruise = np.flatnonzero(steps > 1.5 * steps[0])  # there the speed is even, and seen at its ends only
    still = [*eye[cruise], *eye[cruise + 1], eye[0], eye[-1]]
    ends = [position[-1], speed[-1], *still]
    right = [d] + [0.0] * (len(ends) - 1)
    if not load.rigid:
        ends, right = [*ends, stretch[-1], rate[-1]], [*right, 0.0, 0.0]
    equal = np.hstack([np.array(ends), np.zeros((len(ends), n + 2))])
    equal = np.vstack([equal, np.concatenate([np.zeros(n), [0.0, 0.0, -1.0], np.ones(n - 1)])])
    a = _lexicographic(n, np.vstack(rows), np.concatenate(most), equal, np.array([*right, 0.0]))
    if a is None:
        raise InputError(
            f"no motion of {distance_m:g} m in {time_s:.3g} s keeps to torque, speed and a taut wire; expected slower "
            "limits or a lighter load",
            place="references",
        )
    return _shape(direction, distance_m, a, steps)


def _lexicographic(n: int, A: Array, b: Array, equal: Array, right: Array) -> Array | None:
    """Accelerations (n,): first the least peak, then at nearly that peak the gentlest braking, smoothest by the way."""
    from scipy.optimize import linprog

    bounds = [(None, None)] * n + [(0.0, None)] * (n + 2)
    cost = np.zeros(A.shape[1])
    cost[n] = 1.0
    first = linprog(cost, A_ub=A, b_ub=b, A_eq=equal, b_eq=right, bounds=bounds, method="highs")
    if first.x is None:
        return None
    bounds[n] = (0.0, first.x[n] * (1.0 + GIVEN_AWAY))
    cost[n : n + 3] = 0.0, 1.0, SMOOTH
    second = linprog(cost, A_ub=A, b_ub=b, A_eq=equal, b_eq=right, bounds=bounds, method="highs")
    chosen = first.x if second.x is None else second.x
    return np.asarray(chosen[:n])


def _steps(distance_m: float, speed_m_s: float, time_s: float, load: Load) -> Array:
    """Between nodes (s): fine in a window at either end, in which all changes of speed lie, one step of cruise between.

    What the time leaves beyond the distance at full speed is all that both ramps together may lose, and one that has
    it alone lasts twice as long.
    """
    spare = time_s - distance_m / speed_m_s
    swing = 0.0 if load.rigid else 2.0 * math.pi / load.angular_frequency_rad_s
    window = min(2.2 * max(spare, 0.0) + swing, 0.5 * time_s)
    fine = np.full(NODES, window / NODES)
    cruise = time_s - 2.0 * window
    return (
        np.concatenate([fine, [cruise], fine]) if cruise > 1e-3 * time_s else np.full(2 * NODES, time_s / (2 * NODES))
    )


def _responses(steps: Array, load: Load) -> tuple[Array, Array, Array, Array]:
    """(n, n) each: position, speed, stretch and its rate at the nodes for each node's acceleration alone."""
    from scipy.linalg import expm

    n = len(steps) + 1
    w, zeta = (0.0, 0.0) if load.rigid else (load.angular_frequency_rad_s, load.damping)
    A = np.zeros((6, 6))  # position, speed, stretch, its rate; the acceleration and its slope
    A[0, 1] = A[1, 4] = A[2, 3] = A[4, 5] = 1.0
    if not load.rigid:
        A[3] = [0.0, 0.0, -w * w, -2.0 * zeta * w, 1.0, 0.0]
    state = np.zeros((4, n))
    nodes = [state]
    known: dict[float, Array] = {}
    for k, h in enumerate(steps):
        if h not in known:
            known[h] = expm(A * h)
        E = known[h]
        now, then = np.zeros(n), np.zeros(n)
        now[k], then[k + 1] = 1.0, 1.0
        state = E[:4, :4] @ state + np.outer(E[:4, 4], now) + np.outer(E[:4, 5], (then - now) / h)
        nodes.append(state)
    position, speed, stretch, rate = np.array(nodes).transpose(1, 0, 2)
    return position, speed, stretch, rate


def _shape(direction: float, distance_m: float, a: Array, steps: Array) -> Shape:
    h = steps
    jerk = np.diff(a) / h
    v = np.concatenate([[0.0], np.cumsum(h * (a[:-1] + a[1:]) / 2.0)])
    p = np.concatenate([[0.0], np.cumsum(h * (v[:-1] + h * (a[:-1] / 2.0 + h * jerk / 6.0)))])
    used = Limits(float(np.max(v)), float(np.max(np.abs(a))), float(np.max(np.abs(jerk))))
    return Shape(
        distance_m=distance_m,
        duration_s=float(h.sum()),
        limits=used,
        phase_start_s=np.concatenate([[0.0], np.cumsum(h)[:-1]]),
        position_m=direction * p[:-1],
        speed_m_s=direction * v[:-1],
        acceleration_m_s2=direction * a[:-1],
        jerk_m_s3=direction * jerk,
    )
