"""The sampled loops of hoist and axes, as the pure steps that are compiled and as they are analysed.

    asked    = s r' + kv (r - r0) + load damping        r: position reference, r0: where the run begins
    measured = filtered speed + kv (position - r0), late by the drive's delay
    error    = asked - measured
    wanted   = filters(kp (error - (1 - b) s r') + integral) + feed-forward
    input    = rate limit(clip(wanted, +-limit))
    integral += Ts (ki error + (input - wanted)/Tt)

A position loop is linear, as the PI is: both are one PI on speed + kv position, and one delay line serves both. On a
hoist s is 1, and the position reference is the speed's, summed up by the trapezoidal rule. Without kv what is left is
the PI of the speed (W. Leonhard, Control of Electrical Drives, 3rd ed., Springer 2001, section 15.2). Back-calculation
(the last term) runs the integral back while the drive is at its limit: K. J. Astrom, T. Hagglund, "Advanced PID
Control", ISA 2006, section 3.5. Input: torque of all motors together; of a linear axis its force.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from workbench.control.settings import Cascade, PiSettings, lag_gain, low_pass_gain, notch_coefficients
from workbench.machines import ClosedLoop
from workbench.symbolic.expr import Scalar, Scalars, absolute, clip, floor, maximum, where

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
    measured: the signals that it is given, the speed first.
    """

    parameters: tuple[str, ...]
    memory: tuple[str, ...]
    references: tuple[str, ...]
    step: Callable[..., tuple[Scalar, list[Scalar]]]
    start: Callable[[Any, float, float], list[float]]
    sensed: Callable[..., Scalar] | None = None
    left: Callable[..., Scalar] | None = None
    measured: tuple[str, ...] = ("speed_motor_rad_s",)


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


def _plain_step(p: Any, memory: Scalars, reference: Any, measured: Any, dt: Scalar) -> tuple[Scalar, list[Scalar]]:
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
MEMORY = ("integral", "z1", "z2", "smooth", "input", "r", "counted", "w_f")
ANGLE_REFERENCE = "angle_reference_rad"
LOAD_SIGNALS = {"carriage_speed": "speed_carriage_m_s", "tension": "tension_drum_n"}


def _seen(p: Any, memory: Scalars, position: Scalar, speed: Scalar, dt: Scalar) -> tuple[Scalar, ...]:
    """(marks counted, speed counted and filtered, position counted): what the drive knows before the delay."""
    counted, w_f = memory[6:8]
    count, marks = floor(position * p.counts / TURN), maximum(p.counts, 1.0)
    w = where(p.counts > 0.0, (count - counted) * TURN / (marks * dt), speed)
    return count, w_f + p.alpha_w * (w - w_f), where(p.counts > 0.0, count * TURN / marks, position)


def _filtered(p: Any, memory: Scalars, raw: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """(z1, z2, smooth): notch (direct form II, transposed) and low-pass in the output."""
    z1, z2, smooth = memory[1:4]
    cut = p.b0 * raw + z1
    return p.b1 * raw - p.a1 * cut + z2, p.b2 * raw - p.a2 * cut, smooth + p.alpha_u * (cut - smooth)


def _limited(p: Any, memory: Scalars, wanted: Scalar, limit: Scalar, error: Scalar, dt: Scalar) -> tuple[Scalar, ...]:
    """(input, integral) under the limits, with anti-windup."""
    integral, before = memory[0], memory[4]
    torque = clip(clip(wanted, -limit, limit), before - p.rate * dt, before + p.rate * dt)
    deeper = (wanted - torque) * error > 0.0
    push = where(deeper, (1.0 - p.conditional) * error, error)
    return torque, integral + dt * (p.ki * push + p.track * (torque - wanted))


def _held(p: Any, still: float, hold: float, position: float) -> list[float]:
    """MEMORY at standstill without a bump. still: what the integral holds, beside the feed-forward."""
    z2 = (p.b2 - p.a2) * still
    return [still, (p.b1 - p.a1) * still + z2, z2, still, hold, 0.0, floor(position * p.counts / TURN), 0.0]


@cache
def full_pi(late: bool = False, wire: bool = False, position: str = "", damping: str = "") -> Controller:
    """The hoist's loop with everything; where it is `late`, so is what it measures, by as many samples as p.late says.

    wire: the feed-forward knows the load's swing on the wire, p.ff_wire of it. position: a position loop of gain p.kv,
    whose reference is the speed's "summed" up or, for the linear analysis, "given". damping: the load's signal that
    the loop damps by, see `LoadDamping`. Each of them adds two states.
    """
    used = [
        (("stretch", "stretch_rate"), ("ff_wire",), wire),
        (("angle_asked", "angle_start"), ("kv",), position),
        (("slow", "fresh"), ("damp", "alpha_d"), damping),
    ]
    names = (*MEMORY, *(name for more, _, one in used if one for name in more))
    parameters = (*LOOP, *EXTRAS, *(name for _, more, one in used if one for name in more))
    references = (ANGLE_REFERENCE, *REFERENCES) if position == "given" else REFERENCES
    signals = (*(("angle_motor_rad",) if position else ()), *((LOAD_SIGNALS[damping],) if damping else ()))

    def seen(p: Any, memory: Scalars, measured: Any, dt: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """(marks counted, speed, the same with kv times the angle turned since the start)."""
        count, w_f, angle = _seen(p, memory, measured.angle_motor_rad, measured.speed_motor_rad_s, dt)
        return count, w_f, w_f + p.kv * (angle - memory[names.index("angle_start")]) if position else w_f

    def step(p: Any, memory: Scalars, reference: Any, measured: Any, dt: Scalar) -> tuple[Scalar, list[Scalar]]:
        kept = dict(zip(names, memory, strict=True))
        r, r_before = reference.speed_reference_rad_s, kept["r"]
        acceleration = (r - r_before) / dt
        count, w_f, now = seen(p, memory, measured, dt)
        if late:
            now = measured.late
        more: list[Scalar] = []  # memory behind MEMORY
        beside: Scalar = 0.0  # speed asked for beside the reference's
        if position:
            angle = kept["angle_asked"] + dt * (r + r_before) / 2.0
            if position == "given":
                angle = getattr(reference, ANGLE_REFERENCE)
            more += [angle, kept["angle_start"]]
            beside = p.kv * (angle - kept["angle_start"])
        if damping:
            behind, slow = load_behind(p, damping, r, acceleration, measured, kept["slow"], kept["fresh"])
            more += [slow, 0.0]
            beside = beside + p.damp * behind
        z1, z2, smooth = _filtered(p, memory, _pi(p, kept["integral"], r, now - beside))
        wanted = smooth + feed_forward(p, r, acceleration)
        swing: list[Scalar] = []
        if wire:
            carried, *swing = behind_the_wire(p, kept["stretch"], kept["stretch_rate"], acceleration, dt)
            late_by = p.ff_wire * (acceleration - carried)  # the load's acceleration falls behind the shaft's by that
            wanted = wanted - p.ff_J * load_inertia(p) * late_by
        limit = torque_limit(p, measured.t, w_f if position else now)
        torque, integral = _limited(p, memory, wanted, limit, r + beside - now, dt)
        return torque, [integral, z1, z2, smooth, torque, r, count, w_f, *swing, *more]

    def start(p: Any, hold: float, angle: float) -> list[float]:
        held = _held(p, hold * (1.0 - p.ff_w), hold, angle)
        turned = [held[6] * TURN / p.counts if p.counts else angle] * 2
        return [*held, *([0.0, 0.0] if wire else []), *(turned if position else []), *([0.0, 1.0] if damping else [])]

    def sensed(p: Any, memory: Scalars, measured: Any, dt: Scalar) -> Scalar:
        return seen(p, memory, measured, dt)[2]

    measured = ("speed_motor_rad_s", *signals)
    return Controller(parameters, names, references, step, start, sensed if late else None, measured=measured)


def load_behind(
    p: Any, signal: str, r: Scalar, acceleration: Scalar, measured: Any, slow: Scalar, fresh: Scalar
) -> tuple[Scalar, Scalar]:
    """(by how much the load's acceleration is behind the reference's, rad/s² at the motor; new slow part).

    From the carriage's speed: the difference to the reference's, differentiated up to the filter's frequency. From the
    tension of the fall at the drum, 2 F/m: what is slower than the filter's frequency, the weight, is taken out; at
    the first sample, where `fresh` is 1, that is all of it.
    """
    if signal == "carriage_speed":
        y = r - measured.speed_carriage_m_s / _lever(p)
    else:
        y = acceleration - 2.0 * measured.tension_drum_n / ((p.m_c + p.s_p * p.m_p) * _lever(p))
        slow = where(fresh > 0.5, y, slow)
    return y - slow, slow + p.alpha_d * (y - slow)


@cache
def cascade(loop: ClosedLoop, late: bool = False) -> Controller:
    """The loops of an axis at a kind's signals; where it is `late`, so are speed and position, by p.late samples."""
    assert loop.inertia is not None and loop.load is not None and loop.friction is not None
    inertia, load, friction = loop.inertia, loop.load, loop.friction
    position_reference, speed_reference = loop.references
    parameters = (
        "kp", "ki", "b_set", "track", "conditional", "rate", "alpha_u", "b0", "b1", "b2", "a1", "a2", "ff_v", "ff_J",
        "ff_L", "ff_F", "counts", "alpha_w", "late", "kv", "x_start", "u_limit",
    )  # fmt: skip

    def seen(p: Any, memory: Scalars, measured: Any, dt: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        count, w_f, x = _seen(p, memory, getattr(measured, loop.position), getattr(measured, loop.speed), dt)
        return count, w_f, w_f + p.kv * (x - p.x_start)

    def step(p: Any, memory: Scalars, reference: Any, measured: Any, dt: Scalar) -> tuple[Scalar, list[Scalar]]:
        x_r, r = getattr(reference, position_reference), getattr(reference, speed_reference)
        count, w_f, now = seen(p, memory, measured, dt)
        error = p.ff_v * r + p.kv * (x_r - p.x_start) - (measured.late if late else now)
        raw = p.kp * (error - (1.0 - p.b_set) * p.ff_v * r) + memory[0]
        z1, z2, smooth = _filtered(p, memory, raw)
        ahead = p.ff_J * inertia(p) * ((r - memory[5]) / dt) + p.ff_L * load(p, x_r) + p.ff_F * friction(p, r)
        force, integral = _limited(p, memory, smooth + ahead, p.u_limit, error, dt)
        return force, [integral, z1, z2, smooth, force, r, count, w_f]

    def start(p: Any, hold: float, position: float) -> list[float]:
        return _held(p, hold - p.ff_L * load(p, position), hold, position)

    def sensed(p: Any, memory: Scalars, measured: Any, dt: Scalar) -> Scalar:
        return seen(p, memory, measured, dt)[2]

    measured = (loop.speed, loop.position)
    return Controller(parameters, MEMORY, loop.references, step, start, sensed if late else None, measured=measured)


def hoist_loop(settings: PiSettings, drive: Any) -> Controller:
    """The plain loop where nothing beside it is asked for, else the full one."""
    if settings.plain and not (drive.encoder_counts_per_turn or drive.speed_filter_s or drive.speed_delay_s):
        return PI
    return full_pi(drive.speed_delay_s > 0.0, *settings.parts)


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


def behind_the_wire(p: Any, stretch: Scalar, rate: Scalar, acceleration: Scalar, dt: Scalar) -> tuple[Scalar, ...]:
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
    return {
        "kp": settings.kp,
        "ki": settings.ki,
        "b_set": settings.set_point_weight,
        "track": settings.tracking_rate_per_s,
        "conditional": 1.0 if settings.anti_windup == "conditional" else 0.0,
        "alpha_u": low_pass_gain(settings.low_pass_hz, dt),
        **dict(zip(("b0", "b1", "b2", "a1", "a2"), notch_coefficients(settings.notch, dt), strict=True)),
        "counts": float(drive.encoder_counts_per_turn),
        "alpha_w": lag_gain(drive.speed_filter_s, dt),
        "late": drive.speed_delay_s / dt,
    }


def loop_values(settings: PiSettings, drive: Any, hold_nm: float, payload_kg: float | None = None) -> dict[str, float]:
    """The numbers of a hoist's loop and drive by symbol, limits aside; `drive` is the machine's drive block.

    payload_kg: for a gain schedule; InputError where it is missing.
    """
    settings, damping = settings.at(payload_kg), settings.load_damping
    numbers = {
        **loop_gains(settings, drive),
        "rate": settings.torque_rate_limit_nm_per_s or NEVER,
        "ff_J": settings.feed_forward.inertia,
        "ff_w": settings.feed_forward.weight,
        "ff_F": settings.feed_forward.friction,
        "ff_wire": settings.feed_forward.wire,
        "T_hold": hold_nm,
        "kv": settings.kv_per_s or 0.0,
    }
    if damping is not None:
        differentiated = 2.0 * math.pi * damping.filter_hz if damping.signal == "carriage_speed" else 1.0
        numbers |= {
            "damp": damping.time_s * differentiated,
            "alpha_d": low_pass_gain(damping.filter_hz, settings.sample_time_s),
        }
    return numbers


def cascade_values(settings: Cascade, drive: Any, start_position: float) -> dict[str, float]:
    """The numbers of an axis' loop and drive by symbol, the input's limit included; `drive` is the axis' block."""
    ahead = settings.feed_forward
    return {
        **loop_gains(settings, drive),
        "rate": settings.rate_limit or NEVER,
        "ff_v": ahead.speed,
        "ff_J": ahead.inertia,
        "ff_L": ahead.load,
        "ff_F": ahead.friction,
        "kv": settings.kv_per_s,
        "x_start": start_position,
        "u_limit": min(drive.limit, NEVER),
    }
