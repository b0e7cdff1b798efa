"""The sampled PI speed loop, as the pure step that is compiled and as it is analysed.

    error  = reference - speed
    wanted = filters(kp (b reference - speed) + integral) + feed-forward
    torque = rate limit(clip(wanted, +-limit))
    integral += Ts (ki error + (torque - wanted)/Tt)

Back-calculation (the last term) runs the integral back while the drive is at its
limit: K. J. Astrom, T. Hagglund, "Advanced PID Control", ISA 2006, section 3.5.
Torque is that of all motors together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from workbench.control.settings import PiSettings, lag_gain, low_pass_gain, notch_coefficients
from workbench.symbolic.expr import Scalar, absolute, clip, floor, maximum, where

_SERIES = 0.02  # below this step over time constant the closed forms lose digits


@dataclass(frozen=True)
class LagStep:
    """A torque that nears a held one, u(t) = held + (u0 - held) exp(-t/T), over a step h.

    left: of the difference at the step's end. start, slope_per_s: the straight line start + slope t, of the
    difference, that has the exponential's integral and first moment over the step, so that an inertia ends the step
    with the very speed and angle that the lag gives it, however short the lag. mean: of the difference over the step.
    Without a lag all are 0: the torque is the held one.
    """

    left: float
    start: float
    slope_per_s: float
    mean: float


def lag_step(time_constant_s: float, step_s: float) -> LagStep:
    """With x = h/T: integral m0 = (1 - exp(-x))/x, first moment m1 = (1 - (1 + x) exp(-x))/x², both over h."""
    if time_constant_s == 0.0:
        return LagStep(0.0, 0.0, 0.0, 0.0)
    x = step_s / time_constant_s
    left = math.exp(-x)
    if x < _SERIES:
        m0 = 1.0 - x / 2.0 + x**2 / 6.0 - x**3 / 24.0 + x**4 / 120.0
        m1 = 1.0 / 2.0 - x / 3.0 + x**2 / 8.0 - x**3 / 30.0 + x**4 / 144.0
    else:
        m0, m1 = (1.0 - left) / x, (1.0 - (1.0 + x) * left) / (x * x)
    return LagStep(left, 4.0 * m0 - 6.0 * m1, (12.0 * m1 - 6.0 * m0) / step_s, m0)


def weight_before(time_constant_s: float, sample_time_s: float) -> float:
    """The mean torque between two samples is w (torque then) + (1 - w) (torque now); this is w.

    Without a lag the torque seen at a sample is the one that is held from then on: w = 1. Behind a lag the torque is
    continuous, u1 = held + (u0 - held) L, and its mean held + (u0 - held) m0 holds both.
    """
    if time_constant_s == 0.0:
        return 1.0
    step = lag_step(time_constant_s, sample_time_s)
    if sample_time_s / time_constant_s < 1e-4:  # a straight line
        return 0.5
    return step.mean - step.left * (1.0 - step.mean) / (1.0 - step.left)


TURN = 2.0 * math.pi
NEVER = 1e30
_SAME = 1e-6  # of a sample: a moment that is a sample's but for rounding


@dataclass(frozen=True, eq=False)
class Controller:
    """A sampled controller: its numbers, its memory, what it is given, and its step.

    step(p, memory, reference, measured, dt) -> (torque wanted of the drive, new memory).
    start(p, hold, angle): the memory that holds `hold` (N m) at standstill without a bump.
    sensed(p, memory, measured, dt): the speed that reaches the step p.late samples later, as measured.late; who
    runs the step keeps it until then (`delay_weights`), zero before the start. None: nothing is late.
    left(p, t, dt): the share of the torque at work that is left from the sample at t on, where a motor may fail.
    """

    parameters: tuple[str, ...]
    memory: tuple[str, ...]
    references: tuple[str, ...]
    step: Callable[..., tuple[Scalar, list[Scalar]]]
    start: Callable[[Any, float, float], list[float]]
    sensed: Callable[..., Scalar] | None = None
    left: Callable[..., Scalar] | None = None


def torque_limit(p: Any, t: Scalar, w: Scalar) -> Scalar:
    """Largest torque of all motors, N m: each motor's own, less above nominal speed, less one motor once it failed."""
    weakening = where(absolute(w) > p.w_weak, p.w_weak / maximum(absolute(w), 1e-9), 1.0)
    return where(t >= p.t_fail, p.u_one, p.u_all) * weakening


def _torque_left(p: Any, t: Scalar, dt: Scalar) -> Scalar:
    """At the first sample after a motor failed, the share p.kept of the others; else all of it."""
    samples = (t - p.t_fail) / dt
    return where(samples > -_SAME, where(samples < 1.0 - _SAME, p.kept, 1.0), 1.0)


@cache
def losing_a_motor(controller: Controller) -> Controller:
    """The same loop where a motor fails: its torque is gone at once, and the others' rise behind their lag."""
    return replace(controller, parameters=(*controller.parameters, "kept"), left=_torque_left)


def _pi(p: Any, integral: Scalar, r: Scalar, w: Scalar) -> Scalar:
    return p.kp * (p.b_set * r - w) + integral


def _plain_step(
    p: Any, memory: Sequence[Scalar], reference: Any, measured: Any, dt: Scalar
) -> tuple[Scalar, list[Scalar]]:
    """A PI with limits and back-calculation on the ideal speed."""
    (integral,) = memory
    r, w = reference.speed_reference_rad_s, measured.speed_motor_rad_s
    limit = torque_limit(p, measured.t, w)
    wanted = _pi(p, integral, r, w)
    torque = clip(wanted, -limit, limit)
    return torque, [integral + dt * (p.ki * (r - w) + p.track * (torque - wanted))]


LOOP = ("kp", "ki", "b_set", "track", "u_all", "u_one", "t_fail", "w_weak")
REFERENCES = ("speed_reference_rad_s",)

PI = Controller(LOOP, ("integral",), REFERENCES, _plain_step, lambda p, hold, angle: [hold])

EXTRAS = (
    "conditional", "rate", "alpha_u", "b0", "b1", "b2", "a1", "a2", "ff_J", "ff_w", "ff_F",
    "counts", "alpha_w", "late", "T_hold",
)  # fmt: skip


@cache
def full_pi(late: bool = False, wire: bool = False) -> Controller:
    """The loop with everything; where it is `late`, so is the speed, by as many samples as p.late says.

    wire: the feed-forward knows the load's swing on the wire, p.ff_wire of it, in two more states.
    """
    names: tuple[str, ...] = ("integral", "z1", "z2", "smooth", "torque", "r", "counted", "w_f")
    names += ("stretch", "stretch_rate") if wire else ()
    parameters = (*LOOP, *EXTRAS, "ff_wire") if wire else (*LOOP, *EXTRAS)

    def seen(p: Any, memory: Sequence[Scalar], measured: Any, dt: Scalar) -> tuple[Scalar, Scalar]:
        """(marks counted, the speed counted and filtered): what the drive knows before the delay."""
        counted, w_f = memory[6:8]
        count = floor(measured.angle_motor_rad * p.counts / TURN)
        w = where(p.counts > 0.0, (count - counted) * TURN / (maximum(p.counts, 1.0) * dt), measured.speed_motor_rad_s)
        return count, w_f + p.alpha_w * (w - w_f)

    def step(
        p: Any, memory: Sequence[Scalar], reference: Any, measured: Any, dt: Scalar
    ) -> tuple[Scalar, list[Scalar]]:
        integral, z1, z2, smooth, before, r_before = memory[:6]
        r = reference.speed_reference_rad_s
        count, w_f = seen(p, memory, measured, dt)
        w = measured.late if late else w_f
        limit = torque_limit(p, measured.t, w)
        # Notch (direct form II, transposed) and low-pass in the output, then feed-forward.
        raw = _pi(p, integral, r, w)
        cut = p.b0 * raw + z1
        z1, z2 = p.b1 * raw - p.a1 * cut + z2, p.b2 * raw - p.a2 * cut
        smooth = smooth + p.alpha_u * (cut - smooth)
        acceleration = (r - r_before) / dt
        wanted = smooth + feed_forward(p, r, acceleration)
        swing: list[Scalar] = []
        if wire:
            carried, *swing = behind_the_wire(p, memory[8], memory[9], acceleration, dt)
            late_by = p.ff_wire * (acceleration - carried)  # the load's acceleration falls behind the shaft's by that
            wanted = wanted - p.ff_J * load_inertia(p) * late_by
        torque = clip(clip(wanted, -limit, limit), before - p.rate * dt, before + p.rate * dt)
        error = r - w
        deeper = (wanted - torque) * error > 0.0
        push = where(deeper, (1.0 - p.conditional) * error, error)
        integral = integral + dt * (p.ki * push + p.track * (torque - wanted))
        return torque, [integral, z1, z2, smooth, torque, r, count, w_f, *swing]

    def start(p: Any, hold: float, angle: float) -> list[float]:
        still = hold * (1.0 - p.ff_w)  # what the integral holds beside the feed-forward
        z2 = (p.b2 - p.a2) * still
        z1 = (p.b1 - p.a1) * still + z2
        swing = [0.0, 0.0] if wire else []
        return [still, z1, z2, still, hold, 0.0, floor(angle * p.counts / TURN), 0.0, *swing]

    def sensed(p: Any, memory: Sequence[Scalar], measured: Any, dt: Scalar) -> Scalar:
        return seen(p, memory, measured, dt)[1]

    return Controller(parameters, names, REFERENCES, step, start, sensed if late else None)


def feed_forward(p: Any, r: Scalar, acceleration: Scalar) -> Scalar:
    """Torque that the machine's own values ask of the reference on a stiff wire: inertia, weight, guide friction."""
    J = p.n_m * p.J_m + p.J_w / (p.ratio * p.ratio) + load_inertia(p)
    friction = where(r > 0.0, p.F_up, where(r < 0.0, -p.F_dn, 0.0)) * _lever(p)
    return p.ff_J * J * acceleration + p.ff_w * p.T_hold + p.ff_F * friction


def _lever(p: Any) -> Any:
    """Carriage speed over motor speed: two falls, drum and gear."""
    return p.D_w / (4.0 * p.ratio)


def load_inertia(p: Any) -> Any:
    """Carriage and payload at the motor shaft, kg m²."""
    return (p.m_c + p.s_p * p.m_p) * (_lever(p) * _lever(p))


def swing_of(p: Any) -> tuple[Any, Any]:
    """(w² 1/s², 2 zeta w 1/s) of carriage and payload on their two falls while the shaft moves as asked."""
    squared = 2.0 * p.E * p.A / p.L / (p.m_c + p.s_p * p.m_p)
    return squared, p.tau * squared


def behind_the_wire(
    p: Any, stretch: Scalar, rate: Scalar, acceleration: Scalar, dt: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """(the load's acceleration, stretch, its rate) one sample later, as motor angle; rad, rad/s, rad/s².

    z'' = acceleration - w² z - 2 zeta w z', by the implicit midpoint rule, which damps and drives nothing by itself;
    the load's acceleration is w² z + 2 zeta w z', here the mean over the sample, as the acceleration is.
    """
    squared, damping = swing_of(p)
    slow = 1.0 + dt * damping / 2.0 + dt * dt * squared / 4.0
    mean_rate = (rate + dt / 2.0 * (acceleration - squared * stretch)) / slow
    after, rate_after = stretch + dt * mean_rate, 2.0 * mean_rate - rate
    return squared * (stretch + after) / 2.0 + damping * mean_rate, after, rate_after


def delay_weights(late: float) -> tuple[int, float, float]:
    """(j, a, b): the speed `late` samples ago is a times that of j samples ago plus b times the one before."""
    whole = math.floor(late)
    return whole, 1.0 - (late - whole), late - whole


def loop_gains(settings: Any, drive: Any) -> dict[str, float]:
    """The numbers by symbol that every sampled loop has: gains, filters, encoder, delay."""
    dt = settings.sample_time_s
    b0, b1, b2, a1, a2 = notch_coefficients(settings.notch, dt)
    return {
        "kp": settings.kp,
        "ki": settings.ki,
        "b_set": settings.set_point_weight,
        "track": settings.tracking_rate_per_s,
        "conditional": 1.0 if settings.anti_windup == "conditional" else 0.0,
        "alpha_u": low_pass_gain(settings.low_pass_hz, dt),
        **dict(zip(("b0", "b1", "b2", "a1", "a2"), (b0, b1, b2, a1, a2), strict=True)),
        "counts": float(drive.encoder_counts_per_turn),
        "alpha_w": lag_gain(drive.speed_filter_s, dt),
        "late": drive.speed_delay_s / dt,
    }


def loop_values(settings: PiSettings, drive: Any, hold_nm: float) -> dict[str, float]:
    """The numbers of loop and drive by symbol, limits aside; `drive` is the machine's drive block."""
    return {
        **loop_gains(settings, drive),
        "rate": settings.torque_rate_limit_nm_per_s or NEVER,
        "ff_J": settings.feed_forward.inertia,
        "ff_w": settings.feed_forward.weight,
        "ff_F": settings.feed_forward.friction,
        "ff_wire": settings.feed_forward.wire,
        "T_hold": hold_nm,
    }
