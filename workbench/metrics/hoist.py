"""The hoist's metrics, each declared once and in the order in which tables show them.

Torque of one motor is that of the harder-worked one. Speeds are the motor's, up positive.
"""

from __future__ import annotations

from typing import Any

from workbench.metrics import metric
from workbench.metrics.metric import HUGE, INDEX_ONLY, Accumulators, LoopMetric, Metric, MetricSet, RunMetric, View
from workbench.symbolic.expr import Scalar, Scalars, Signals, absolute, maximum, minimum, where

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


def _since_last(a: Scalars, s: Signals, p: Any, dt: Scalar) -> list[Scalar]:
    """Work and changes since the last sample.

    Work at the shaft by sign: torque times the angle turned. The torque is its mean since then: the one held or,
    behind a lagging drive, what its exponential holds between both ends. per_s: one over the time since then,
    0 at the first sample, which has none before it.
    """
    motoring, regenerated, rate, jerk, torque, one, angle, acceleration, per_s = a
    mean = p.before * torque + (1.0 - p.before) * _torque(s)
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


def _slack_so_far(a: Scalars, s: Signals, p: Any, dt: Scalar) -> list[Scalar]:
    slack = where(s["tension_min_n"] <= 0.0, 1.0, 0.0)
    return [a[0] + slack * dt, a[1] + maximum(slack - a[2], 0.0), slack]


def _tops(a: Scalars, s: Signals, p: Any, dt: Scalar) -> list[Scalar]:
    """Largest and smallest tension at the top of either fall."""
    drum, dead = s["tension_drum_n"], s["tension_dead_line_n"]
    return [maximum(a[0], drum), minimum(a[1], drum), maximum(a[2], dead), minimum(a[3], dead)]


def _overloaded(a: Scalars, s: Signals, p: Any, dt: Scalar) -> list[Scalar]:
    """The heat above what the drive's duty cycle bears without end, in seconds at nominal torque: now, and at most."""
    one = _torque(s) * _share(s, p) / p.T_nominal
    heat = maximum(a[0] + (one * one - p.cycle_mean_square) * dt, 0.0)
    return [heat, maximum(a[1], heat)]


def _swings(a: Scalars, s: Signals, p: Any, dt: Scalar) -> list[Scalar]:
    """Turning points: the largest torque while it rises, the smallest while it falls, in nominal torques.

    It turns where it has come back from there by more than one.
    """
    count, way, extreme = a
    one = _torque(s) * _share(s, p) / p.T_nominal
    farthest = where(way > 0.0, maximum(extreme, one), minimum(extreme, one))
    turns = absolute(farthest - one) > 1.0
    return [count + where(turns, 1.0, 0.0), where(turns, -way, way), where(turns, one, farthest)]


def _behind(a: Scalars, s: Signals, p: Any, dt: Scalar) -> list[Scalar]:
    """The angle by which the motor is behind its reference: now, at most, when the reference last moved."""
    angle = a[0] + _error(s) * dt
    return [angle, maximum(a[1], absolute(angle)), where(_moves(s, p), angle, a[2])]


def _lift(p: Any) -> float:
    """Carriage travel per motor angle on a stiff wire: two falls."""
    return float(p.D_w / (4.0 * p.ratio))


_PEAK = metric.largest(lambda s, p: absolute(_torque(s)) * _share(s, p))
_SQUARE = metric.integral(lambda s, p: (_torque(s) * _share(s, p)) * (_torque(s) * _share(s, p)))
_SINCE_LAST = Accumulators((0.0,) * 9, _since_last)
_SLACK = Accumulators((0.0,) * 3, _slack_so_far)
_TOPS = Accumulators((-HUGE, HUGE, -HUGE, HUGE), _tops)
_SETTLING = metric.settling(_moves, lambda s, p: absolute(_error(s)) > SETTLED * p.w_nominal)
_SPEEDS, _overshoot = metric.beyond("speed_motor_rad_s", "speed_reference_rad_s")
_BEHIND = Accumulators((0.0, 0.0, 0.0), _behind)

METRICS: tuple[Metric, ...] = (
    LoopMetric(
        name="peak_torque_motor_nm", unit="N m", label="torque peak per motor", better="lower", visible=0.1,
        definition="largest torque of the harder-worked motor, either way",
        head="peak", decimals=0, note="torque of one motor", fixed=True,
        extremes=(("highest torque peak", 1), ("lowest torque peak", -1)),
        accumulators=_PEAK, finish=metric.as_summed(0),
    ),
    LoopMetric(
        name="peak_torque_percent", unit="%", label="torque peak of nominal", better="lower", visible=0.01,
        definition="the same in per cent of one motor's nominal torque",
        head="peak", decimals=0, note="torque of one motor", fixed=True,
        views=View.RUNS | View.SWEPT_RUNS | View.QUANTILES,
        accumulators=_PEAK, finish=lambda a, p, duration: a[0] * 100.0 / p.T_nominal,
    ),
    LoopMetric(
        name="peak_torque_above_static_nm", unit="N m", label="torque peak above static", better="lower", visible=0.1,
        definition="largest torque of both motors above the torque that holds the load at the start",
        head="above\nstatic", decimals=0, fixed=True,
        note="torque of both motors together, above the torque that holds the load",
        views=View.RUNS | View.SWEPT_RUNS,
        accumulators=metric.largest(lambda s, p: _torque(s) - p.T_hold), finish=metric.as_summed(0),
    ),
    LoopMetric(
        name="rms_torque_motor_nm", unit="N m", label="RMS torque per motor", better="lower", visible=0.1,
        definition="root mean square of the harder-worked motor's torque over the run",
        head="RMS", decimals=0, note="torque of one motor", fixed=True,
        views=View.RUNS | View.QUANTILES | View.COMPARE,
        accumulators=_SQUARE, finish=metric.root_mean,
    ),
    LoopMetric(
        name="i2t_s", unit="s", label="I²t", better="lower", visible=1e-3,
        definition="∫ (T/T_nominal)² dt of the harder-worked motor over the run: seconds at nominal torque "
        "that would heat its windings as much",
        views=INDEX_ONLY,
        accumulators=_SQUARE, finish=lambda a, p, duration: a[0] / p.T_nominal**2,
    ),
    LoopMetric(
        name="thermal_load_percent", unit="%", label="thermal load", better="lower", visible=0.01,
        definition="the same over the run's duration: 100 % heats as nominal torque does",
        head="thermal\nload", decimals=0, taken_at="one motor against nominal torque",
        note="mean square torque of one motor over that of nominal torque",
        views=View.DRIVE | View.COMPARE,
        accumulators=_SQUARE, finish=lambda a, p, duration: 100.0 * a[0] / (p.T_nominal**2 * duration),
    ),
    LoopMetric(
        name="overload_time_s", unit="s", label="time above nominal torque", better="lower", visible=1e-3,
        definition="time with the harder-worked motor above its nominal torque, either way",
        head="above\nnominal", decimals=2, note="time of one motor", views=View.DRIVE,
        accumulators=metric.integral(lambda s, p: where(absolute(_torque(s)) * _share(s, p) > p.T_nominal, 1.0, 0.0)),
        finish=metric.as_summed(0),
    ),
    LoopMetric(
        name="overload_use_percent", unit="%", label="use of the overload", better="lower", visible=0.01,
        definition="largest value of ∫ ((T/T_nominal)² − q) dt, never below 0, of the harder-worked motor, over what "
        "the drive bears: its overload o for its overload time, once in its overload period. q = 1 + (o² − 1) "
        "time/period is the mean square of that duty cycle, which it bears without end",
        head="overload\nused", decimals=0, note="of what the drive bears, one motor", taken_at="one motor",
        views=View.DRIVE,
        accumulators=Accumulators((0.0, 0.0), _overloaded), finish=lambda a, p, duration: 100.0 * a[1] / p.overload_s,
    ),
    LoopMetric(
        name="torque_rate_max_nm_per_s", unit="N m/s", label="largest torque rate", better="lower", visible=1.0,
        definition="largest change of the harder-worked motor's torque from one sample to the next, by the time "
        "between them",
        shown_in="kN m/s", scale=1e-3, head="torque rate", decimals=2, note="largest, of one motor", views=View.DRIVE,
        accumulators=_SINCE_LAST, finish=metric.as_summed(2),
    ),
    LoopMetric(
        name="torque_swings", unit="–", label="torque swings", better="lower", visible=1.0,
        definition="how often the harder-worked motor's torque turns and goes back by more than its nominal torque; "
        "a loop that hunts between its limits does so many times a second",
        views=INDEX_ONLY,
        accumulators=Accumulators((0.0, 1.0, -HUGE), _swings), finish=metric.as_summed(0),
    ),
    LoopMetric(
        name="peak_speed_percent", unit="%", label="largest share of nominal speed", better="lower", visible=0.01,
        definition="largest motor speed, either way, in per cent of nominal", decimals=1,
        views=INDEX_ONLY,
        accumulators=metric.largest(lambda s, p: absolute(s["speed_motor_rad_s"]) * 100.0 / p.w_nominal),
        finish=metric.as_summed(0),
    ),
    LoopMetric(
        name="speed_error_rms_rad_s", unit="rad/s", label="RMS speed error", better="lower", visible=1e-3,
        definition="root mean square of reference minus motor speed",
        head="error RMS", decimals=2, note="motor speed against its set point", taken_at="motor side", fixed=True,
        views=View.RUNS | View.COMPARE,
        accumulators=metric.integral(lambda s, p: _error(s) * _error(s)), finish=metric.root_mean,
    ),
    LoopMetric(
        name="speed_error_max_rad_s", unit="rad/s", label="largest speed error", better="lower", visible=1e-3,
        definition="largest difference of reference and motor speed",
        head="error max", decimals=1, note="motor speed against its set point", taken_at="motor side", fixed=True,
        extremes=(("largest speed error", 1),),
        accumulators=metric.largest(lambda s, p: absolute(_error(s))), finish=metric.as_summed(0),
    ),
    LoopMetric(
        name="speed_error_iae_rad", unit="rad", label="integral of the absolute speed error", better="lower",
        visible=1e-3, definition="∫ |reference − motor speed| dt (IAE)",
        views=INDEX_ONLY,
        accumulators=metric.integral(lambda s, p: absolute(_error(s))), finish=metric.as_summed(0),
    ),
    LoopMetric(
        name="speed_overshoot_rad_s", unit="rad/s", label="speed overshoot", better="lower", visible=1e-3,
        definition="how far the motor speed goes beyond the largest or the smallest speed of the whole reference; "
        "0 within them",
        head="overshoot", decimals=2, note="motor speed beyond the extremes of its set point", views=View.MOTION,
        accumulators=_SPEEDS, finish=_overshoot,
    ),
    LoopMetric(
        name="settling_time_s", unit="s", label="settling time", better="lower", visible=1e-3,
        definition=f"from the end of the last move until the motor speed stays within {SETTLED:.0%} of nominal speed "
        "of its reference; until the end of the run where it never does",
        head="settling", decimals=2, note="after the last move, to 1 % of nominal speed",
        taken_at="after the last move",
        views=View.MOTION | View.COMPARE,
        accumulators=_SETTLING, finish=metric.after_the_move,
    ),
    LoopMetric(
        name="position_error_max_m", unit="m", label="largest position error", better="lower", visible=1e-4,
        definition="largest distance, either way, of the carriage from its reference, seen at the motor shaft: speed "
        "error summed up, times the carriage's travel per angle (drum diameter / (4 · ratio)). Exact for a rigid "
        "drive; the stretch of the wire is not in it",
        shown_in="mm", scale=1e3, head="position\nmax", decimals=1, note="largest error, seen at the motor shaft",
        taken_at="carriage side", views=View.MOTION | View.COMPARE,
        accumulators=_BEHIND, finish=lambda a, p, duration: a[1] * _lift(p),
    ),
    LoopMetric(
        name="position_error_stop_m", unit="m", label="position error at the stop", better="zero", visible=1e-4,
        definition="the same when the reference of the last move comes to rest, position minus reference",
        shown_in="mm", scale=1e3, views=INDEX_ONLY,
        accumulators=_BEHIND, finish=lambda a, p, duration: -a[2] * _lift(p),
    ),
    RunMetric(
        name="position_error_end_m", unit="m", label="position error at the end", better="zero", visible=1e-4,
        definition="height of the carriage at the end of the run minus the end of its reference, the stretch of the "
        "wire included",
        shown_in="mm", scale=1e3, head="position\nend", decimals=1, note="the carriage's own error", fixed=True,
        views=View.MOTION,
        value=lambda run: run.end_position_m - run.reference_end_m,
    ),
    LoopMetric(
        name="min_wire_tension_n", unit="N", label="smallest wire tension", better="higher", visible=1.0,
        definition="smallest elastic tension of the two falls; zero is slack",
        shown_in="kN", scale=1e-3, head="min wire", decimals=1, note="smallest tension of a fall", fixed=True,
        extremes=(("smallest wire tension", -1),),
        accumulators=metric.smallest(lambda s, p: s["tension_min_n"]), finish=metric.as_summed(0),
    ),
    LoopMetric(
        name="max_wire_tension_n", unit="N", label="largest wire tension", better="lower", visible=1.0,
        definition="largest tension at the top of a fall, the wire's own weight included",
        shown_in="kN", scale=1e-3, head="max wire", decimals=1, note="largest tension of a fall", fixed=True,
        views=View.MOTION,
        accumulators=_TOPS, finish=lambda a, p, duration: max(a[0], a[2]),
    ),
    LoopMetric(
        name="wire_tension_swing_n", unit="N", label="wire tension swing", better="lower", visible=1.0,
        definition="largest minus smallest tension at the top of a fall, of the fall that swings more",
        shown_in="kN", scale=1e-3, head="swing", decimals=1, note="of a fall's tension",
        views=View.QUANTILES | View.MOTION | View.SENTENCES | View.SWEEP | View.COMPARE,
        accumulators=_TOPS, finish=lambda a, p, duration: max(a[0] - a[1], a[2] - a[3]),
    ),
    LoopMetric(
        name="wire_safety_factor", unit="–", label="wire safety factor", better="higher", visible=1e-3,
        definition="the wire's breaking load over its largest tension, where machine.yaml gives "
        "`wire.breaking_load_n`",
        head="safety\nfactor", decimals=1, note="breaking load of the wire over its largest tension",
        views=View.MOTION, optional=True,
        accumulators=_TOPS, finish=lambda a, p, _: p.W_break / max(a[0], a[2]) if p.W_break > 0.0 else None,
    ),
    LoopMetric(
        name="slack_time_s", unit="s", label="slack time", better="lower", visible=1e-3,
        definition="time with a fall of wire slack",
        head="slack", decimals=2, note="time with a fall of wire slack", fixed=True, views=View.MOTION | View.COMPARE,
        accumulators=_SLACK, finish=metric.as_summed(0),
    ),
    LoopMetric(
        name="slack_events", unit="–", label="slack events", better="lower", visible=1.0,
        definition="how often a fall went slack", views=INDEX_ONLY,
        accumulators=_SLACK, finish=metric.as_summed(1),
    ),
    RunMetric(
        name="move_time_s", unit="s", label="move time", better="lower", visible=1e-3,
        definition="time in motion of the reference, all moves together, dwells left out",
        head="moves", decimals=2, note="time in motion", fixed=True, known_before=True,
        extremes=(("shortest moves", -1), ("longest moves", 1)),
        views=View.RUNS | View.SWEPT_RUNS | View.QUANTILES | View.EXTREMES | View.SWEEP | View.COMPARE | View.CARDS,
        value=lambda run: sum(end - start for start, end in run.move_windows),
    ),
    LoopMetric(
        name="peak_power_motoring_kw", unit="kW", label="largest motoring power", better="lower", visible=0.01,
        definition="largest power of both motors on the machine, torque times speed",
        head="motoring", decimals=1, note="power of both motors on the machine", taken_at="both motors",
        views=View.DRIVE | View.COMPARE,
        accumulators=metric.largest(lambda s, p: _torque(s) * s["speed_motor_rad_s"]),
        finish=lambda a, p, duration: max(a[0], 0.0) / 1000.0,
    ),
    LoopMetric(
        name="peak_power_regenerating_kw", unit="kW", label="largest regenerated power", better="lower", visible=0.01,
        definition="largest power of the machine on both motors",
        head="regenerating", decimals=1, note="power of the machine on both motors", taken_at="both motors",
        views=View.DRIVE,
        accumulators=metric.smallest(lambda s, p: _torque(s) * s["speed_motor_rad_s"]),
        finish=lambda a, p, duration: max(-a[0], 0.0) / 1000.0,
    ),
    LoopMetric(
        name="energy_motoring_j", unit="J", label="work of the motors", better="lower", visible=1.0,
        definition="work of the motors on the machine",
        shown_in="kJ", scale=1e-3, head="work in", decimals=0, note="work of both motors on the machine", fixed=True,
        views=View.DRIVE | View.COMPARE,
        accumulators=_SINCE_LAST, finish=metric.as_summed(0),
    ),
    LoopMetric(
        name="energy_regenerated_j", unit="J", label="work on the motors", better="higher", visible=1.0,
        definition="work of the machine on the motors",
        shown_in="kJ", scale=1e-3, head="work back", decimals=0, note="work of the machine on both motors", fixed=True,
        views=View.DRIVE,
        accumulators=_SINCE_LAST, finish=metric.as_summed(1),
    ),
    LoopMetric(
        name="peak_carriage_acceleration_m_s2", unit="m/s²", label="largest carriage acceleration", better="lower",
        visible=1e-3, definition="largest acceleration of the carriage, either way",
        head="carriage", decimals=2, note="its largest acceleration and jerk", views=View.MOTION,
        accumulators=metric.largest(lambda s, p: absolute(s["acceleration_carriage_m_s2"])), finish=metric.as_summed(0),
    ),
    LoopMetric(
        name="peak_carriage_jerk_m_s3", unit="m/s³", label="largest carriage jerk", better="lower", visible=1e-2,
        definition="largest change of the carriage's acceleration from one sample to the next, by the time between "
        "them",
        head="carriage", decimals=0, note="its largest acceleration and jerk", views=View.MOTION,
        accumulators=_SINCE_LAST, finish=metric.as_summed(3),
    ),
    LoopMetric(
        name="rail_margin_m", unit="m", label="rail margin", better="higher", visible=1e-4,
        definition="smallest distance of the carriage from the ends of its rail; negative beyond them",
        views=INDEX_ONLY,
        accumulators=metric.smallest(_margin), finish=metric.as_summed(0),
    ),
    RunMetric(
        name="moves", unit="–", label="moves", better=None, visible=1.0,
        definition="how many moves the reference makes", views=INDEX_ONLY, known_before=True,
        value=lambda run: float(len(run.move_windows)),
    ),
    RunMetric(
        name="hold_torque_nm", unit="N m", label="hold torque", better=None, visible=0.1,
        definition="torque of all motors that holds the load at the start", views=INDEX_ONLY, known_before=True,
        value=lambda run: run.hold_torque_nm,
    ),
    RunMetric(
        name="acceleration_limit_m_s2", unit="m/s²", label="acceleration limit", better=None, visible=1e-3,
        definition="the acceleration that the reference was planned with", views=INDEX_ONLY, known_before=True,
        value=lambda run: run.acceleration_m_s2,
    ),
)  # fmt: skip

# Of the machine and its drive, by the loop's symbols.
PARAMETERS = (
    "T_nominal", "T_hold", "share", "share_failed", "t_fail", "before", "x_low", "x_high", "w_nominal", "W_break",
    "D_w", "ratio", "overload_s", "cycle_mean_square",
)  # fmt: skip

SET = MetricSet(
    metrics=METRICS,
    parameters=PARAMETERS,
    peak="peak_torque_motor_nm",
    above="peak_torque_above_static_nm",
    rms="rms_torque_motor_nm",
    error="speed_error_max_rad_s",
    rms_error="speed_error_rms_rad_s",
    fastest="peak_speed_percent",
    end="position_error_end_m",
    astray=0.05,
    input_words="torque",
    input_unit="N m per motor",
    rate_unit="N m",
    moved="carriage",
    sides=("above", "below"),
    payload=True,
)
