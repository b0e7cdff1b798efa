"""The least torque peak of a move in a given time, from above and from below, and a motion that comes near it.

Two masses and the wire between them (`Load`), measured from rest, with φ = ω² z + 2ζω z' the load's acceleration:

    M p'' = u - m φ,   z'' = p'' - φ,   0 <= p' <= speed limit,   hold + m φ >= TAUT hold (up; down with -m φ),
    |u + s| <= P at all times, s the steady force:   the least P that moves the drive by d in T, from rest to rest.

*From above.* With u linear between nodes (first-order hold) and the states carried on by the exact response, the least
P is that of a linear programme, solved by HiGHS (Q. Huangfu, J. A. J. Hall, Mathematical Programming Computation 10,
2018). Its solution is a motion, and has this peak.

*From below.* Let x' = A x + B u. For any vector λ, any densities η(t) on the states and any force,

    λ·x(T) + ∫ η·x dt = ∫ q u dt,   q(t) = w(t)·B,   w' = -Aᵀ w - η,   w(T) = λ.

Let η weigh the limits of speed and wire, each with the sign of its limit. The left side is then at least D, what the
limits leave of it; the right side is at most P ∫|q| dt - s ∫q dt. So every motion, in continuous time, has

    P >= (D + s ∫q dt) / ∫|q| dt.

λ and η are the multipliers of the linear programme with its limits averaged over the steps; any others would give a
bound too, a lower one. ∫|q| is rounded up: the trapezoidal rule errs by at most h³ max|q''|/12 a step, which is added
twice. (Weak duality: D. G. Luenberger, Optimization by Vector Space Methods, 1969, section 8.6.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.machines import Load
from workbench.references.shape import Limits, Pieces, Shape, shortest_move, shortest_move_s

STEP_S = 0.004
MOST_ACCELERATION = 6.0  # times the trapezoid's
LEAST_ACCELERATION, MOST_JERK = 0.25, 10.0  # times the limits, at equal time


def peak_force_n(shape: Shape, load: Load) -> float:
    """The largest force, either way, of the motors in a move, the drive following it exactly: at the load, N.

    With a the drive's acceleration and z the stretch beyond that of rest: z'' = a - w² z - 2 zeta w z', and the
    load's own acceleration w² z + 2 zeta w z'.
    """
    return float(np.max(np.abs(forces_n(shape, load)[1])))


def forces_n(shape: Shape, load: Load) -> tuple[Array, Array]:
    """(times s, forces along the motion N), (n,): inertia of drive and load, weight, friction."""
    after = 0.0 if load.rigid else 3.0 * np.pi / load.angular_frequency_rad_s
    time = np.arange(0.0, shape.duration_s + after, STEP_S)
    direction, a = np.sign(shape.distance_m), np.zeros(len(time))
    shape.add_alone(2, time, a)
    a *= direction
    carried = a if load.rigid else _carried(a, *_ratio(load.angular_frequency_rad_s, load.damping))
    return time, load.drive_kg * a + load.mass_kg * carried + load.steady_force_n(direction)


@lru_cache(maxsize=512)
def _ratio(w: float, zeta: float) -> tuple[Array, Array]:
    """Numerator b and denominator c in the shift operator of the load's acceleration over the drive's, which is linear
    between samples: with the states z and z' and the response E, f, g to a force and its slope, the output is
    (w², 2 zeta w) · x."""
    A, given = np.array([[0.0, 1.0], [-w * w, -2.0 * zeta * w]]), np.array([0.0, 1.0])
    E, first, ramp = _after(A, given, STEP_S)
    ramp = ramp / STEP_S
    passed_on, before = -A[1], first - ramp  # x[k+1] = E x[k] + before a[k] + ramp a[k+1]
    c = np.array([1.0, -np.trace(E), np.linalg.det(E)])
    steps = [passed_on @ ramp, passed_on @ (E @ ramp + before), passed_on @ (E @ (E @ ramp + before))]
    return np.convolve(c, steps)[:3], c


def _carried(a: Array, b: Array, c: Array) -> Array:
    """c y = b a in the shift operator, by forward substitution."""
    from scipy.linalg.lapack import dtbtrs

    y, _ = dtbtrs(np.repeat(c[:, None], len(a), 1), np.convolve(a, b)[: len(a), None], uplo="L", diag="U")
    return np.asarray(y[:, 0])


def least_peak_limits(distance_m: float, limits: Limits, time_s: float, load: Load) -> Limits:
    """Of the pairs of acceleration and jerk with which the move takes `time_s`, the one of the least peak force."""
    a = limits.acceleration_m_s2
    best = _least_peak_pair(distance_m, limits, time_s, load, (1.001 * a, MOST_ACCELERATION * a), math.inf, 1.01 * a)
    assert best is not None  # a large enough acceleration always has its jerk
    return best


@lru_cache(maxsize=512)
def equal_time_limits(distance_m: float, limits: Limits, time_s: float, load: Load) -> Limits:
    """Those with which a jerk-limited move takes `time_s` though it cannot within its own, by what is cheapest: the
    speed alone, up to the motors'; at that speed a jerk up to MOST_JERK times the limit; then the acceleration.

    Of the ways that exceed no more than that, the one of the least peak force.
    """
    a, j = limits.acceleration_m_s2, limits.jerk_m_s3
    top = replace(limits, speed_m_s=max(load.top_speed_m_s, limits.speed_m_s))
    least, most = LEAST_ACCELERATION * a, MOST_ACCELERATION * a
    ways = [_least_peak_pair(distance_m, top, time_s, load, (least, a), j)]
    if shortest_move_s(distance_m, top) <= time_s:
        low, high = limits.speed_m_s, top.speed_m_s
        for _ in range(60):
            v = 0.5 * (low + high)
            late = shortest_move_s(distance_m, replace(limits, speed_m_s=v)) > time_s
            low, high = (v, high) if late else (low, v)
        ways.append(replace(limits, speed_m_s=high))
    for accelerations, jerk in (((least, a), MOST_JERK * j), ((a, most), MOST_JERK * j), ((a, most), math.inf)):
        if not any(ways):
            ways = [_least_peak_pair(distance_m, top, time_s, load, accelerations, jerk)]
    known = [way for way in ways if way is not None]
    best = min(known, key=lambda way: peak_force_n(shortest_move(distance_m, way), load))
    reached = abs(float(shortest_move(distance_m, best).at(np.array([0.5 * time_s]))[1][0]))  # half-way it is fastest
    return replace(best, speed_m_s=max(limits.speed_m_s, min(best.speed_m_s, reached)))


def _least_peak_pair(
    distance_m: float, limits: Limits, time_s: float, load: Load, accelerations: tuple[float, float], most_jerk: float,
    first: float | None = None,
) -> Limits | None:  # fmt: skip
    """The same at one speed, between two accelerations and up to a jerk; None where there is none.

    One pair is free: each acceleration above the trapezoid's has one jerk that gives the time. The search is over
    the logarithm of the acceleration, first even, from `first` on, then around the best.
    """
    low, high = first or accelerations[0], accelerations[1]
    tried: dict[Limits, float] = {}
    best: Limits | None = None
    for _ in range(3):
        values = np.geomspace(low, high, 13)
        pairs = (_in_time(distance_m, limits, time_s, float(a)) for a in values)
        fit = [pair for pair in pairs if pair is not None and pair.jerk_m_s3 <= most_jerk * (1.0 + 1e-9)]
        tried |= {pair: peak_force_n(shortest_move(distance_m, pair), load) for pair in fit}
        if not tried:
            break
        best = min(tried, key=tried.__getitem__)
        step = values[1] / values[0]
        low, high = (min(max(best.acceleration_m_s2 * x, accelerations[0]), accelerations[1]) for x in (1 / step, step))
    return best


def _in_time(distance_m: float, limits: Limits, time_s: float, acceleration_m_s2: float) -> Limits | None:
    """The jerk with which the move at this acceleration takes the time; None where none is quick enough."""
    v, a = limits.speed_m_s, acceleration_m_s2

    def late(jerk: float) -> bool:
        return shortest_move_s(distance_m, Limits(v, a, jerk)) > time_s

    spare = time_s - abs(distance_m) / v - v / a  # of a move that reaches both limits: a/j
    if spare > 0.0 and abs(shortest_move_s(distance_m, Limits(v, a, a / spare)) - time_s) < 1e-12 * time_s:
        return Limits(v, a, a / spare)
    low, high = 1e-3, 1e5
    if late(high):
        return None
    for _ in range(50):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if late(middle) else (low, middle)
    return Limits(v, a, high)


GRIDS = ((48, 1.0), (96, 1.0), (192, 2.0), (384, 4.0))  # (steps in the window at either end, swings it is longer)
TOWARDS_THE_END = (0.85, 0.1, 0.05)  # of the last window, with a third of its steps each: there the wire comes to rest
GAP = 0.0048  # of the bound: the grid is refined until primal and dual are that near
TAUT = 0.1  # of the weight: the wire carries at least that
A_SWING = 60  # places in the swing after the end
FINE_S = 5e-4  # longest step of the rule that rounds ∫|q| up

GIVEN_AWAY = 0.02  # of the least peak, for a gentler motion at nearly the same peak
STILL_PAYS = 0.95  # of the trapezoid's peak: the wire is brought to rest where the peak stays below
GENTLE = 0.15  # price of a change of the acceleration by 1 m/s², in weights of the load


@dataclass(frozen=True, eq=False)
class LeastPeak:
    """The peak of a motion that exists, primal_n, and what no motion is below, dual_n: forces of all motors, N.

    time_s, force_n: (n,) that motion's nodes, the force linear between them, along the motion, steady force included.
    state: (n, 4) its drive's position and speed, the wire's stretch beyond rest and its rate; (n, 2) of a rigid load.
    cruise: the node that begins the stretch of even speed, -1 without one; the force there is what keeps the speed.
    """

    primal_n: float
    dual_n: float
    time_s: Array
    force_n: Array
    state: Array
    cruise: int


@lru_cache(maxsize=512)  # a study asks for each of its moves, and its neighbours' studies for many of them again
def least_peak(distance_m: float, speed_m_s: float, time_s: float, load: Load, still: bool = True) -> LeastPeak:
    """Over all motions that never turn back and bring the drive from rest to rest.

    still: the wire is at rest at the end, too. Otherwise the load may swing on under a drive that stands, and what
    holds the drive counts. InputError where torque, speed and wire do not allow the time.
    """
    for grid in GRIDS:
        problem = MoveProblem(distance_m, speed_m_s, time_s, load, still, *grid)
        found = problem.least()
        if found.primal_n > load.force_limit_n:
            raise _impossible(distance_m, time_s)
        if found.primal_n <= (1.0 + GAP) * found.dual_n:
            break
    return found


@lru_cache(maxsize=512)
def gentle_move(distance_m: float, speed_m_s: float, time_s: float, load: Load, trapezoid_n: float) -> Shape:
    """Of the motions within GIVEN_AWAY of the least peak the one for a loop: with the least peak that a controller asks
    for which takes the load as rigid, and few changes of the acceleration.

    The wire is still at the end where that pays beside the trapezoid's peak, trapezoid_n; on a short move of a well
    damped load it does not, and the load settles under the drive's hold.
    """
    still = MoveProblem(distance_m, speed_m_s, time_s, load, True, *GRIDS[0])
    try:
        return still.gentle(min(load.force_limit_n, STILL_PAYS * trapezoid_n))
    except InputError:
        return MoveProblem(distance_m, speed_m_s, time_s, load, False, *GRIDS[0]).gentle(load.force_limit_n)


class MoveProblem:
    """The linear programme on a grid. Unknowns: the states x at its n nodes, the forces u there, the peak P.

    Forces are in parts of `scale_n`. The grid is fine in a window at either end, where the speed changes; `cruise` is
    the number of the one step of even speed between them, -1 where the windows meet.
    """

    def __init__(
        self, distance_m: float, speed_m_s: float, time_s: float, load: Load, still: bool, nodes: int, swings: float
    ) -> None:
        self.distance_m, self.speed_m_s, self.load, self.still = distance_m, speed_m_s, load, still
        self.direction, self.duration_s = math.copysign(1.0, distance_m), time_s
        self.scale_n = abs(load.hold_n) + load.friction_up_n + load.mass_kg + load.drive_kg
        self.steady = load.steady_force_n(self.direction) / self.scale_n
        self.taut = load.hangs and load.hold_n > 0.0 and not load.rigid
        self.room = (1.0 - TAUT) * load.hold_n / self.scale_n  # that the wire's force may fall by
        # What the time leaves beyond the distance at full speed is all that both ramps together may lose, and one that
        # has it alone lasts twice as long.
        spare = max(time_s - abs(distance_m) / speed_m_s, 0.0)
        window = 2.0 * spare + (0.0 if load.rigid else swings * 2.0 * math.pi / load.angular_frequency_rad_s)
        meet = 2.0 * window > 0.95 * time_s
        window = 0.5 * time_s if meet else window
        start = np.full(nodes, window / nodes)
        parts = len(TOWARDS_THE_END)
        end = np.repeat([parts * part * window / nodes for part in TOWARDS_THE_END], nodes // parts)
        between = [] if meet else [time_s - 2.0 * window]
        self.steps, self.cruise = np.concatenate([start, between, end]), -1 if meet else nodes
        self.n = len(self.steps) + 1
        self.ramping = np.flatnonzero(np.arange(self.n - 1) != self.cruise)  # steps
        self._set_plant(load)

    def _set_plant(self, load: Load) -> None:
        """A, B of x' = A x + B u, and the row of φ: with x = (p, p', z, z'), or (p, p') of a rigid load."""
        M, m = load.drive_kg, load.mass_kg
        self.order = 2 if load.rigid else 4
        self.A, self.phi = np.zeros((self.order, self.order)), np.zeros(self.order)
        self.A[0, 1] = 1.0
        if load.rigid:
            self.B = np.array([0.0, self.scale_n / (M + m)])
            return
        w2 = load.angular_frequency_rad_s**2
        self.phi[2:] = w2, load.damping_time_s * w2
        self.A[1] = -m / M * self.phi
        self.A[2, 3] = 1.0
        self.A[3] = -(1.0 + m / M) * self.phi
        self.B = self.scale_n / M * np.array([0.0, 1.0, 0.0, 1.0])

    @cached_property
    def pull(self) -> Array:
        """(order,) the row of the load's m φ, in parts of the scale."""
        return self.load.mass_kg / self.scale_n * self.phi

    def after(self, step_s: float) -> tuple[Array, Array, Array]:
        """E, a, b of x(t + step) = E x + a u + b u', for a force that goes on with the slope u': exact."""
        return _after(self.A, self.B, step_s)

    def at_even_speed(self, step_s: float) -> Array:
        """E of x(t + step) = E x, where the drive keeps its speed or stands, and the load swings on."""
        generator = np.zeros((self.order, self.order))
        generator[0, 1] = 1.0
        if self.order == 4:
            generator[2, 3] = 1.0
            generator[3] = -self.phi
        return _exponential(generator * step_s)

    @cached_property
    def swinging_on(self) -> Array:
        """(k, order) rows: m φ over a swing after the end, from the state there; (0, order) where the
        wire is still."""
        if self.still or self.load.rigid:
            return np.zeros((0, self.order))
        step, rows = 2.0 * math.pi / self.load.angular_frequency_rad_s / A_SWING, [self.pull]
        E = self.at_even_speed(step)
        for _ in range(A_SWING):
            rows.append(rows[-1] @ E)
        return np.array(rows)

    def least(self) -> LeastPeak:
        """The least peak from above and from below, on this grid."""
        programme = _Programme(self, averaged=False)
        programme.solve()
        state, force = programme.motion()
        force_n = (force + self.steady) * self.scale_n
        time_s = np.concatenate([[0.0], np.cumsum(self.steps)])
        return LeastPeak(self._peak_n(force_n, state), self._bound_n(), time_s, force_n, state, self.cruise)

    def _peak_n(self, force_n: Array, state: Array) -> float:
        """Of a motion: at its nodes, on its even stretch and after its end."""
        pulls = [self.swinging_on @ state[-1]]
        if self.cruise >= 0:
            times = np.linspace(0.0, self.steps[self.cruise], 65)
            pulls.append(np.array([self.pull @ self.at_even_speed(t) @ state[self.cruise] for t in times]))
        beside = (np.concatenate(pulls) + self.steady) * self.scale_n
        return float(np.max(np.abs(np.concatenate([force_n, beside]))))

    def gentle(self, most_n: float) -> Shape:
        """See `gentle_move`: a second programme, with the first one's peak as a limit; InputError where that is above
        most_n."""
        from scipy import sparse

        n = self.n
        programme = _Programme(
            self, averaged=False, extra=n
        )  # the rigid load's peak, n - 1 changes of the acceleration
        programme.solve()
        if programme.solution.fun * self.scale_n > most_n:
            raise _impossible(self.distance_m, self.duration_s)
        programme.high[programme.peak] = (1.0 + GIVEN_AWAY) * programme.solution.fun
        rigid, changes = sparse.csr_matrix(np.ones((n, 1))) @ programme.unknowns[-n], programme.unknowns[1 - n :]
        acceleration = programme.acceleration
        change = sparse.diags([-1.0, 1.0], [0, 1], shape=(n - 1, n)) @ acceleration
        inertia = (self.load.drive_kg + self.load.mass_kg) / self.scale_n
        for sign in (1.0, -1.0):
            programme.limit("rigid", sign * inertia * acceleration - rigid, -sign * self.steady)
            programme.limit("changes", sign * change - changes, 0.0)
        programme.cost[programme.peak], programme.cost[-n], programme.cost[1 - n :] = 0.0, 1.0, GENTLE
        programme.solve()
        state, _ = programme.motion()
        return self._shape(state, acceleration @ programme.solution.x)

    def _shape(self, state: Array, acceleration: Array) -> Shape:
        """Position, speed and acceleration as at the nodes, polynomials of fifth order between."""
        h, nodes = self.steps, np.column_stack([state[:, :2], acceleration])
        start, end = nodes[:-1].copy(), nodes[1:].copy()
        if self.cruise >= 0:
            start[self.cruise, 2] = end[self.cruise, 2] = 0.0
        pieces = Pieces.through(h, self.direction * start, self.direction * end)
        jerk = np.abs(end[:, 2] - start[:, 2]) / h
        used = Limits(float(np.max(state[:, 1])), float(np.max(np.abs(acceleration))), float(np.max(jerk)))
        return Shape(self.distance_m, self.duration_s, used, pieces)

    def _bound_n(self) -> float:
        """What no motion is below (module docstring)."""
        programme = _Programme(self, averaged=True)
        programme.solve()
        s, h, v = self.order, self.steps, self.speed_m_s
        fast, back, taut = (programme.weights(name) for name in ("fast", "back", "taut"))
        density = np.zeros((self.n - 1, s))  # η of each step
        density[self.ramping, 1] = back - fast
        D = -v * (fast @ h[self.ramping])
        if self.taut:
            density[self.ramping] += self.direction * np.outer(taut, self.pull)
            D -= self.room * (taut @ h[self.ramping])
        w = programme.at_the_end()
        D += w[0] * abs(self.distance_m)
        up, down, slack = (programme.weights(name) for name in ("holds", "holds back", "taut after"))
        if not self.still and not self.load.rigid:
            w = w + (down - up + (self.direction * slack if self.taut else 0.0)) @ self.swinging_on
            D += self.steady * (up - down).sum() - (self.room * slack.sum() if self.taut else 0.0)
        kernels = {step: self._kernel(float(step)) for step in set(h[self.ramping])}
        absolute, total = 0.0, 0.0  # ∫|q|, ∫q
        for k in range(self.n - 2, -1, -1):
            if k == self.cruise:
                w, lost = self._back_along_even_speed(w, programme.costate(k))
                D -= lost
                continue
            kernel = kernels[h[k]]
            q = np.abs(w @ kernel.force + density[k] @ kernel.through)
            bend = np.max(np.abs(w @ kernel.force_bend + density[k] @ kernel.through_bend))
            absolute += kernel.fine_s * (q.sum() - 0.5 * (q[0] + q[-1])) + h[k] * kernel.fine_s**2 / 6.0 * bend
            total += w @ kernel.force_sum + density[k] @ kernel.through_sum
            w = kernel.back @ w + kernel.back_sum @ density[k]
        return float(self.scale_n * (D + self.steady * total) / (absolute + (up + down).sum()))

    def _kernel(self, step_s: float) -> _Kernel:
        """Responses over a step of the grid, seen back from its end, at fine times."""
        s, count = self.order, math.ceil(step_s / FINE_S)
        fine_s = step_s / count
        generator = np.zeros((s + 1, s + 1))
        generator[:s, :s], generator[:s, s] = self.A, self.B
        one, force, through = _exponential(generator * fine_s), [self.B], [np.zeros(s)]
        for _ in range(count):
            force.append(one[:s, :s] @ force[-1])
            through.append(one[:s, :s] @ through[-1] + one[:s, s])
        back = np.zeros((2 * s, 2 * s))
        back[:s, :s], back[:s, s:] = self.A.T, np.eye(s)
        response = _exponential(back * step_s)
        _, force_sum, through_sum = self.after(step_s)
        G, J = np.array(force).T, np.array(through).T
        return _Kernel(
            fine_s, G, J, self.A @ self.A @ G, self.A @ G, force_sum, through_sum, response[:s, :s], response[:s, s:]
        )

    def _back_along_even_speed(self, w: Array, before: float) -> tuple[Array, float]:
        """(w at the start of the even stretch, what the speed limit costs along it), from w at its end.

        There q = 0 at all times: a weight of the speed limit that makes it so, a mass at either end and a density along
        it. With w_z' = -w_p' from q = 0 the adjoint is the load's own swing on a drive that is held, run backwards:
        w_p'' and w_z take the part of speed and place, and the density is w_p + w_z + 2ζω w_p'. Where that is negative
        the limit at standstill has the weight. before: the wanted w_p' before the stretch.
        """
        v, w = self.speed_m_s, w.copy()
        mass = -w[1] - (w[3] if self.order == 4 else 0.0)
        cost = -min(mass, 0.0) * v
        w[1] += mass
        length = float(self.steps[self.cruise])
        if self.order == 4:
            stiffness, damping = self.phi[2:]
            count = math.ceil(length / FINE_S)
            one = _exponential(np.array([[-damping, -1.0], [stiffness, 0.0]]) * (length / count))
            swing = w[None, 1:3]
            while len(swing) <= count:  # what is known so far is carried on by its own length
                swing, one = np.vstack([swing, swing @ one.T]), one @ one
            swing = swing[: count + 1]
            density = w[0] + swing[:, 1] + damping * swing[:, 0]
            negative = float(np.maximum(-density, 0.0).sum()) * length / count
            cost += v * (swing[0, 0] - swing[-1, 0] + w[0] * length + negative)
            w = np.array([w[0], swing[-1, 0], swing[-1, 1], -swing[-1, 0]])
        else:
            cost += v * max(w[0], 0.0) * length
        mass = min(before - w[1], 0.0)
        w[1] += mass
        return w, cost - mass * v


class _Programme:
    """The linear programme of a `MoveProblem`, with the limits of speed and wire at the nodes or, averaged, as means
    over the steps: a motion that keeps the limits keeps their means, so that this one's least peak is no higher."""

    def __init__(self, problem: MoveProblem, averaged: bool, extra: int = 0) -> None:
        from scipy import sparse

        s, n, h = problem.order, problem.n, problem.steps
        columns = s * n + n + 1 + extra
        self.problem, self.peak, self.unknowns = problem, s * n + n, sparse.identity(columns, format="csr")
        self.x, self.u = self.unknowns[: s * n], self.unknowns[s * n : self.peak]
        self.acceleration = (sparse.kron(sparse.identity(n), problem.A[1:2]) @ self.x + problem.B[1] * self.u).tocsr()
        self.low, self.high, self.cost = np.full(columns, -np.inf), np.full(columns, np.inf), np.zeros(columns)
        self.cost[self.peak] = 1.0
        self.rows: list[tuple[str, Any, Array]] = []
        self.equal = self._motion_from_node_to_node()
        peak = sparse.csr_matrix(np.ones((n, 1))) @ self.unknowns[self.peak]
        self.limit("peak", self.u - peak, -problem.steady)
        self.limit("peak back", -self.u - peak, problem.steady)
        each, pull = sparse.identity(n, format="csr"), problem.pull[None]
        if averaged:
            ramping = problem.ramping
            before, after = each[:-1][ramping], each[1:][ramping]
            way = sparse.kron(after - before, np.eye(s)[:1]) @ self.x
            self.limit("fast", way, problem.speed_m_s * h[ramping])
            self.limit("back", -way, 0.0)
            if problem.cruise >= 0:
                self.high[s * problem.cruise + 1] = problem.speed_m_s
            if problem.taut:  # the mean of φ, from z'' = u/M - (1 + m/M) φ
                gained = sparse.kron(after - before, np.eye(s)[3:]) @ self.x
                pushed = problem.B[3] * 0.5 * sparse.diags(h[ramping]) @ (before + after) @ self.u
                share = problem.load.mass_kg / problem.scale_n / (1.0 + problem.load.mass_kg / problem.load.drive_kg)
                self.limit("taut", -problem.direction * share * (pushed - gained), problem.room * h[ramping])
        else:
            self.low[1 : s * n : s], self.high[1 : s * n : s] = 0.0, problem.speed_m_s
            # Between nodes the speed is nearly a cubic: inside the limits where its two inner Bézier points are.
            speed, acceleration = self.x[1::s], self.acceleration
            ramping, third = problem.ramping, sparse.diags(h[problem.ramping] / 3.0)
            for inner in (
                speed[ramping] + third @ acceleration[ramping],
                speed[ramping + 1] - third @ acceleration[ramping + 1],
            ):
                self.limit("fast between", inner, problem.speed_m_s)
                self.limit("back between", -inner, 0.0)
            if problem.taut:
                self.limit("taut", -problem.direction * sparse.kron(each, pull) @ self.x, problem.room)
        if len(problem.swinging_on):
            held = sparse.csr_matrix(problem.swinging_on) @ self.x[-s:]
            peak = sparse.csr_matrix(np.ones((held.shape[0], 1))) @ self.unknowns[self.peak]
            self.limit("holds", held - peak, -problem.steady)
            self.limit("holds back", -held - peak, problem.steady)
            if problem.taut:
                self.limit("taut after", -problem.direction * held, problem.room)
        end = s * (n - 1)
        self.low[:s] = self.high[:s] = 0.0
        self.low[end : end + 2] = self.high[end : end + 2] = abs(problem.distance_m), 0.0
        if problem.still:
            self.low[end + 2 : end + s] = self.high[end + 2 : end + s] = 0.0

    def _motion_from_node_to_node(self) -> Any:
        """Rows that are 0: x[k+1] = E x[k] + a u[k] + b (u[k+1] - u[k])/h."""
        from scipy import sparse

        problem, s = self.problem, self.problem.order
        known = {h: problem.after(h) for h in set(problem.steps[problem.ramping])}
        states, first, second = [], [], []
        for k, h in enumerate(problem.steps):
            if k == problem.cruise:
                E, now, then = problem.at_even_speed(h), np.zeros(s), np.zeros(s)
            else:
                E, a, b = known[h]
                now, then = a - b / h, b / h
            states.append(E)
            first.append(now[:, None])
            second.append(then[:, None])
        from_state = sparse.block_diag(states, format="csr") @ self.x[:-s]
        from_force = sparse.block_diag(first) @ self.u[:-1] + sparse.block_diag(second) @ self.u[1:]
        return from_state + from_force - self.x[s:]

    def limit(self, name: str, matrix: Any, upper: float | Array) -> None:
        """matrix @ unknowns <= upper."""
        self.rows.append((name, matrix, np.broadcast_to(upper, matrix.shape[0])))

    def solve(self) -> None:
        """InputError where nothing keeps all limits."""
        from scipy import sparse
        from scipy.optimize import linprog

        self.solution = linprog(
            self.cost,
            A_ub=sparse.vstack([matrix for _, matrix, _ in self.rows]).tocsr(),
            b_ub=np.concatenate([upper for _, _, upper in self.rows]),
            A_eq=self.equal,
            b_eq=np.zeros(self.equal.shape[0]),
            bounds=np.column_stack([self.low, self.high]),
            method="highs-ds",
        )
        if self.solution.x is None:
            raise _impossible(self.problem.distance_m, self.problem.duration_s)

    def motion(self) -> tuple[Array, Array]:
        """State (n, order) and force (n,) at the nodes."""
        x = self.solution.x
        split = self.x.shape[0]
        return x[:split].reshape(-1, self.problem.order), x[split : self.peak]

    def weights(self, name: str) -> Array:
        """The limit's multipliers, none negative; none at all where the programme has no such limit."""
        at = 0
        for own, _, upper in self.rows:
            if own == name:
                return np.maximum(-self.solution.ineqlin.marginals[at : at + len(upper)], 0.0)
            at += len(upper)
        return np.zeros(0)

    def at_the_end(self) -> Array:
        """λ: the multipliers of the state that is asked for at the end."""
        s = self.problem.order
        end = slice(s * (self.problem.n - 1), s * self.problem.n)
        both = self.solution.lower.marginals[end] + self.solution.upper.marginals[end]
        return np.where(self.low[end] == self.high[end], both, 0.0)

    def costate(self, node: int) -> float:
        """Of the speed, just before a node."""
        return -float(self.solution.eqlin.marginals[self.problem.order * (node - 1) + 1])


@dataclass(frozen=True)
class _Kernel:
    """Over a step, at fine times back from its end: e^{At}B (force), its integral (through), their second derivatives,
    their integrals over the whole step, and w and η carried back through it."""

    fine_s: float
    force: Array
    through: Array
    force_bend: Array
    through_bend: Array
    force_sum: Array
    through_sum: Array
    back: Array
    back_sum: Array


def _impossible(distance_m: float, time_s: float) -> InputError:
    return InputError(
        f"no motion of {distance_m:g} m in {time_s:.3g} s keeps to torque, speed and a taut wire; expected slower "
        "limits or a lighter load",
        place="references",
    )


def _after(A: Array, B: Array, step_s: float) -> tuple[Array, Array, Array]:
    """E, a, b of x(t + step) = E x + a u + b u' under x' = A x + B u, for a force of slope u'."""
    s = len(B)
    generator = np.zeros((s + 2, s + 2))
    generator[:s, :s], generator[:s, s], generator[s, s + 1] = A, B, 1.0
    response = _exponential(generator * step_s)
    return response[:s, :s], response[:s, s], response[:s, s + 1]


def _exponential(matrix: Array) -> Array:
    from scipy.linalg import expm

    return np.asarray(expm(matrix))
