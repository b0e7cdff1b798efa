"""The hoist's metrics, each declared once.

Torque of one motor is that of the harder-worked one. Speeds are the motor's, up positive.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from workbench.metrics.metric import HUGE, Metric, Observer, Signals, Sums, integral, largest, smallest, the
from workbench.trace.expr import Scalar, absolute, maximum, minimum, where

SETTLED = 0.01  # of nominal speed: a speed error that counts as none
AT_REST = 1e-6  # of nominal speed: a reference that counts as still


def _torque(s: Signals) -> Scalar:
    return s["torque_motor_nm"]


def _share(s: Signals, p: Any) -> Scalar:
    """Of the torque, what the harder-worked motor gives; more once another one failed."""
    return where(s["time_s"] >= p.t_fail, p.share_failed, p.share)


def _error(s: Signals) -> Scalar:
    return s["speed_reference_rad_s"] - s["speed_motor_rad_s"]


def _moves(s: Signals, p: Any) -> Scalar:
    return absolute(s["speed_reference_rad_s"]) > AT_REST * p.w_nominal


def _margin(s: Signals, p: Any) -> Scalar:
    return minimum(s["position_carriage_m"] - p.x_low, p.x_high - s["position_carriage_m"])


def _root_mean(sums: Sequence[float], p: Any, duration: float) -> float:
    return math.sqrt(max(sums[0], 0.0) / duration)


def _since_last(a: Sequence[Scalar], s: Signals, p: Any, dt: Scalar) -> list[Scalar]:
    """Work and changes since the last sample.

    Work at the shaft by sign: torque times the angle turned. The torque is the one held since
    then or, behind a lagging drive, the mean of both ends. per_s: one over the time since then,
    0 at the first sample, which has none before it.
    """
    motoring, regenerated, rate, jerk, torque, one, angle, acceleration, per_s = a
    mean = where(p.t_lag > 0.0, 0.5 * (torque + _torque(s)), torque)
    work = where(per_s > 0.0, mean * (s["angle_motor_rad"] - angle), 0.0)
    one_now, acceleration_now = _torque(s) * _share(s, p), s["acceleration_carriage_m_s2"]
    return [
        motoring + maximum(work, 0.0),
        regenerated + maximum(-work, 0.0),
        maximum(rate, absolute(one_now - one) * per_s),
        maximum(jerk, absolute(acceleration_now - acceleration) * per_s),
        _torque(s),
        one_now,
        s["angle_motor_rad"],
        acceleration_now,
        1.0 / dt,
    ]


def _slack_so_far(a: Sequence[Scalar], s: Signals, p: Any, dt: Scalar) -> list[Scalar]:
    slack = where(s["tension_min_n"] <= 0.0, 1.0, 0.0)
    return [a[0] + slack * dt, a[1] + maximum(slack - a[2], 0.0), slack]


def _tops(a: Sequence[Scalar], s: Signals, p: Any, dt: Scalar) -> list[Scalar]:
    """Largest and smallest tension at the top of either fall."""
    drum, dead = s["tension_drum_n"], s["tension_dead_line_n"]
    return [maximum(a[0], drum), minimum(a[1], drum), maximum(a[2], dead), minimum(a[3], dead)]


def _safety(sums: Sequence[float], p: Any, duration: float) -> float | None:
    return p.W_break / max(sums[0], sums[2]) if p.W_break > 0.0 else None


def _speeds(a: Sequence[Scalar], s: Signals, p: Any, dt: Scalar) -> list[Scalar]:
    w, r = s["speed_motor_rad_s"], s["speed_reference_rad_s"]
    return [maximum(a[0], w), minimum(a[1], w), maximum(a[2], r), minimum(a[3], r)]


def _overshoot(sums: Sequence[float], p: Any, duration: float) -> float:
    return max(sums[0] - sums[2], sums[3] - sums[1], 0.0)


def _settling(a: Sequence[Scalar], s: Signals, p: Any, dt: Scalar) -> list[Scalar]:
    """Until when the reference moved, and until when the speed was off it."""
    until = s["time_s"] + dt
    off = absolute(_error(s)) > SETTLED * p.w_nominal
    return [where(_moves(s, p), until, a[0]), where(off, until, a[1])]


def _behind(a: Sequence[Scalar], s: Signals, p: Any, dt: Scalar) -> list[Scalar]:
    """The angle by which the motor is behind its reference: now, at most, when the reference last moved."""
    angle = a[0] + _error(s) * dt
    return [angle, maximum(a[1], absolute(angle)), where(_moves(s, p), angle, a[2])]


def _lift(p: Any) -> float:
    """Carriage travel per motor angle on a stiff wire: two falls."""
    return float(p.D_w / (4.0 * p.ratio))


_PEAK = largest(lambda s, p: absolute(_torque(s)) * _share(s, p))
_SQUARE = integral(lambda s, p: (_torque(s) * _share(s, p)) * (_torque(s) * _share(s, p)))
_SINCE_LAST = Sums((0.0,) * 9, _since_last)
_SLACK = Sums((0.0,) * 3, _slack_so_far)
_TOPS = Sums((-HUGE, HUGE, -HUGE, HUGE), _tops)
_SETTLING = Sums((0.0, 0.0), _settling)
_BEHIND = Sums((0.0, 0.0, 0.0), _behind)

METRICS = (
    Metric("peak_torque_motor_nm", "N m", "largest torque of the harder-worked motor, either way", _PEAK, the(0)),
    Metric(
        "peak_torque_percent", "%", "the same in per cent of one motor's nominal torque",
        _PEAK, lambda a, p, duration: a[0] * 100.0 / p.T_nominal,
    ),
    Metric(
        "peak_torque_above_static_nm", "N m",
        "largest torque of both motors above the torque that holds the load at the start",
        largest(lambda s, p: _torque(s) - p.T_hold), the(0),
    ),
    Metric(
        "rms_torque_motor_nm", "N m", "root mean square of the harder-worked motor's torque over the run",
        _SQUARE, _root_mean,
    ),
    Metric(
        "i2t_s", "s", "∫ (T/T_nominal)² dt of the harder-worked motor over the run: seconds at nominal torque "
        "that would heat its windings as much",
        _SQUARE, lambda a, p, duration: a[0] / p.T_nominal**2,
    ),
    Metric(
        "thermal_load_percent", "%", "the same over the run's duration: 100 % heats as nominal torque does",
        _SQUARE, lambda a, p, duration: 100.0 * a[0] / (p.T_nominal**2 * duration),
    ),
    Metric(
        "overload_time_s", "s", "time with the harder-worked motor above its nominal torque, either way",
        integral(lambda s, p: where(absolute(_torque(s)) * _share(s, p) > p.T_nominal, 1.0, 0.0)), the(0),
    ),
    Metric(
        "torque_rate_max_nm_per_s", "N m/s",
        "largest change of the harder-worked motor's torque from one sample to the next, by the time between them",
        _SINCE_LAST, the(2),
    ),
    Metric(
        "speed_error_rms_rad_s", "rad/s", "root mean square of reference minus motor speed",
        integral(lambda s, p: _error(s) * _error(s)), _root_mean,
    ),
    Metric(
        "speed_error_max_rad_s", "rad/s", "largest difference of reference and motor speed",
        largest(lambda s, p: absolute(_error(s))), the(0),
    ),
    Metric(
        "speed_error_iae_rad", "rad", "∫ |reference − motor speed| dt (IAE)",
        integral(lambda s, p: absolute(_error(s))), the(0),
    ),
    Metric(
        "speed_overshoot_rad_s", "rad/s",
        "how far the motor speed goes beyond the largest or the smallest speed of the whole reference; 0 within them",
        Sums((-HUGE, HUGE, -HUGE, HUGE), _speeds), _overshoot,
    ),
    Metric(
        "settling_time_s", "s",
        f"from the end of the last move until the motor speed stays within {SETTLED:.0%} of nominal speed of its "
        "reference; until the end of the run where it never does",
        _SETTLING, lambda a, p, duration: max(a[1] - a[0], 0.0),
    ),
    Metric(
        "position_error_max_m", "m",
        "largest distance, either way, of the carriage from its reference, seen at the motor shaft: speed error "
        "summed up, times the carriage's travel per angle (drum diameter / (4 · ratio)). Exact for a rigid drive; "
        "the stretch of the wire is not in it",
        _BEHIND, lambda a, p, duration: a[1] * _lift(p),
    ),
    Metric(
        "position_error_stop_m", "m",
        "the same when the reference of the last move comes to rest, position minus reference",
        _BEHIND, lambda a, p, duration: -a[2] * _lift(p),
    ),
    Metric(
        "min_wire_tension_n", "N", "smallest elastic tension of the two falls; zero is slack",
        smallest(lambda s, p: s["tension_min_n"]), the(0),
    ),
    Metric(
        "max_wire_tension_n", "N", "largest tension at the top of a fall, the wire's own weight included",
        _TOPS, lambda a, p, duration: max(a[0], a[2]),
    ),
    Metric(
        "wire_tension_swing_n", "N",
        "largest minus smallest tension at the top of a fall, of the fall that swings more",
        _TOPS, lambda a, p, duration: max(a[0] - a[1], a[2] - a[3]),
    ),
    Metric(
        "wire_safety_factor", "–", "the wire's breaking load over its largest tension, where machine.yaml gives "
        "`wire.breaking_load_n`",
        _TOPS, _safety, optional=True,
    ),
    Metric("slack_time_s", "s", "time with a fall of wire slack", _SLACK, the(0)),
    Metric("slack_events", "–", "how often a fall went slack", _SLACK, the(1)),
    Metric("energy_motoring_j", "J", "work of the motors on the machine", _SINCE_LAST, the(0)),
    Metric("energy_regenerated_j", "J", "work of the machine on the motors", _SINCE_LAST, the(1)),
    Metric(
        "peak_power_motoring_kw", "kW", "largest power of both motors on the machine, torque times speed",
        largest(lambda s, p: _torque(s) * s["speed_motor_rad_s"]), lambda a, p, duration: max(a[0], 0.0) / 1000.0,
    ),
    Metric(
        "peak_power_regenerating_kw", "kW", "largest power of the machine on both motors",
        smallest(lambda s, p: _torque(s) * s["speed_motor_rad_s"]), lambda a, p, duration: max(-a[0], 0.0) / 1000.0,
    ),
    Metric(
        "peak_carriage_acceleration_m_s2", "m/s²", "largest acceleration of the carriage, either way",
        largest(lambda s, p: absolute(s["acceleration_carriage_m_s2"])), the(0),
    ),
    Metric(
        "peak_carriage_jerk_m_s3", "m/s³",
        "largest change of the carriage's acceleration from one sample to the next, by the time between them",
        _SINCE_LAST, the(3),
    ),
    Metric(
        "rail_margin_m", "m", "smallest distance of the carriage from the ends of its rail; negative beyond them",
        smallest(_margin), the(0),
    ),
)  # fmt: skip

PARAMETERS = (
    "T_nominal", "T_hold", "share", "share_failed", "t_fail", "t_lag", "x_low", "x_high", "w_nominal", "W_break",
    "D_w", "ratio",
)  # fmt: skip
HOIST_OBSERVER = Observer(METRICS, PARAMETERS)
