"""The metrics of an axis under its cascade: force of a linear one, torque of a rotary one.

Errors are reference minus measured at the motor's encoder, exact positions and speeds and not the counted ones.
"""

from __future__ import annotations

from typing import Any

from workbench.machines import KINDS, LINEAR, ROTARY, Kind
from workbench.metrics import hoist, metric
from workbench.metrics.metric import INDEX_ONLY, Accumulators, LoopMetric, Metric, MetricSet, RunMetric, View
from workbench.symbolic.expr import Scalar, Scalars, Signals, absolute, maximum, where

SETTLED = 1e-3  # of the reference's way: a position error that counts as none
ASTRAY = 5.0  # times that: an axis that has not come to where it should
AT_REST = 1e-6  # of the loop's speed scale: a reference that counts as still
PARAMETERS = ("hold", "before", "settled", "v_scale", "u_limit", "u_nominal")
NEITHER = 1e29  # a limit beyond it is none


def metric_set(kind: Kind) -> MetricSet:
    """The metrics of one kind of axis, with its signals and units."""
    linear = kind.drive.suffix == "n"
    word, n, unit = kind.drive.quantity, kind.drive.suffix, kind.drive.unit
    way, speed_unit = kind.moved.unit, kind.moved.speed_unit
    fine, fine_scale = f"m{way}", 1e3
    rate, speed_word = ("m_s", "velocity") if linear else ("rad_s", "speed")
    fine_rate = f"m{way}/s"
    loop = kind.looped
    force, x, v = kind.plant.input, loop.position, loop.speed
    x_ref, v_ref = loop.references

    def _lag(s: Signals) -> Scalar:
        return s[x_ref] - s[x]

    def _slow(s: Signals) -> Scalar:
        return s[v_ref] - s[v]

    def _since_last(a: Scalars, s: Signals, p: Any, dt: Scalar) -> list[Scalar]:
        """Work at the axis by sign and the input's rate; the input is its mean since the last sample."""
        motoring, regenerated, steepest, before, at, per_s = a
        mean = p.before * before + (1.0 - p.before) * s[force]
        work = where(per_s > 0.0, mean * (s[x] - at), 0.0)
        return [
            motoring + maximum(work, 0.0),
            regenerated + maximum(-work, 0.0),
            maximum(steepest, absolute(s[force] - before) * per_s),
            s[force],
            s[x],
            1.0 / dt,
        ]

    peak = metric.largest(lambda s, p: absolute(s[force]))
    square = metric.integral(lambda s, p: s[force] * s[force])
    since_last, (ends, overshoot) = Accumulators((0.0,) * 6, _since_last), metric.beyond(x, x_ref)
    settled = metric.settling(
        lambda s, p: absolute(s[v_ref]) > AT_REST * p.v_scale, lambda s, p: absolute(_lag(s)) > p.settled
    )
    by_encoder = "seen at the motor's encoder"
    metrics: tuple[Metric, ...] = (
        LoopMetric(
            name=f"peak_{word}_{n}", unit=unit, label=f"{word} peak", better="lower", visible=1e-6,
            definition=f"largest {word}, either way", head="peak", significant=4, note=f"{word} of the drive",
            extremes=((f"highest {word} peak", 1), (f"lowest {word} peak", -1)),
            accumulators=peak, finish=metric.as_summed(0),
        ),
        LoopMetric(
            name=f"peak_{word}_percent", unit="%", label=f"{word} peak of the limit", better="lower", visible=0.01,
            definition=f"the same in per cent of the drive's {word} limit, where one is stated", optional=True,
            head="of limit", decimals=0, views=View.DRIVE, accumulators=peak,
            finish=lambda a, p, duration: 100.0 * a[0] / p.u_limit if p.u_limit < NEITHER else None,
        ),
        LoopMetric(
            name=f"peak_{word}_above_static_{n}", unit=unit, label=f"{word} peak above static", better="lower",
            visible=1e-6, definition=f"largest difference, either way, of the {word} from the one that holds the load "
            "at the start", head="above\nstatic", significant=4, views=View.SWEPT_RUNS,
            note=f"{word} beside the one that holds the load",
            accumulators=metric.largest(lambda s, p: absolute(s[force] - p.hold)), finish=metric.as_summed(0),
        ),
        LoopMetric(
            name=f"rms_{word}_{n}", unit=unit, label=f"RMS {word}", better="lower", visible=1e-6,
            definition=f"root mean square of the {word} over the run", head="RMS", significant=4,
            note=f"{word} of the drive", views=View.RUNS | View.QUANTILES | View.COMPARE,
            accumulators=square, finish=metric.root_mean,
        ),
        LoopMetric(
            name="thermal_load_percent", unit="%", label="thermal load", better="lower", visible=0.01,
            definition=f"mean square of the {word} over that of the drive's nominal one, where that is stated",
            optional=True, head="thermal\nload", decimals=0, views=View.DRIVE, accumulators=square,
            finish=lambda a, p, duration: 100.0 * a[0] / (p.u_nominal**2 * duration) if p.u_nominal < NEITHER else None,
        ),
        LoopMetric(
            name=f"{word}_rate_max_{n}_per_s", unit=f"{unit}/s", label=f"largest {word} rate", better="lower",
            visible=1e-3, definition=f"largest change of the {word} from one sample to the next, by the time between "
            "them", head=f"{word} rate", significant=3, note="largest", views=View.DRIVE,
            accumulators=since_last, finish=metric.as_summed(2),
        ),
        LoopMetric(
            name=f"tracking_error_max_{way}", unit=way, label="largest tracking error", better="lower", visible=1e-9,
            definition=f"largest difference, either way, of position reference and position, {by_encoder}",
            shown_in=fine, scale=fine_scale, head="tracking\nmax", significant=3, note=f"position error {by_encoder}",
            views=~(View.DRIVE | View.MOTION), extremes=(("largest tracking error", 1),),
            accumulators=metric.largest(lambda s, p: absolute(_lag(s))), finish=metric.as_summed(0),
        ),
        LoopMetric(
            name=f"tracking_error_rms_{way}", unit=way, label="RMS tracking error", better="lower", visible=1e-9,
            definition="root mean square of the same over the run", shown_in=fine, scale=fine_scale,
            head="tracking\nRMS", significant=3, note=f"position error {by_encoder}",
            views=View.RUNS | View.COMPARE,
            accumulators=metric.integral(lambda s, p: _lag(s) * _lag(s)), finish=metric.root_mean,
        ),
        RunMetric(
            name=f"tracking_error_end_{way}", unit=way, label="position error at the end", better="zero", visible=1e-9,
            definition="position at the end of the run minus the end of its reference", shown_in=fine,
            scale=fine_scale, head="position\nend", significant=3, note=f"position error {by_encoder}",
            views=View.RUNS | View.MOTION | View.COMPARE,
            value=lambda run: run.end_position_m - run.reference_end_m,
        ),
        LoopMetric(
            name=f"overshoot_{way}", unit=way, label="position overshoot", better="lower", visible=1e-9,
            definition="how far the position goes beyond the largest or the smallest one of the whole reference",
            shown_in=fine, scale=fine_scale, head="overshoot", significant=3, views=View.MOTION | View.COMPARE,
            note="beyond the extremes of the reference",
            accumulators=ends, finish=overshoot,
        ),
        LoopMetric(
            name="settling_time_s", unit="s", label="settling time", better="lower", visible=1e-3,
            definition=f"from the end of the last move until the position stays within {SETTLED:.1%} of the "
            "reference's whole way of it; until the end of the run where it never does",
            head="settling", decimals=3, note=f"after the last move, to {SETTLED:.1%} of the way",
            taken_at="after the last move", views=View.RUNS | View.MOTION | View.COMPARE,
            accumulators=settled, finish=metric.after_the_move,
        ),
        LoopMetric(
            name=f"settling_window_{way}", unit=way, label="settling window", better=None, visible=1e-9,
            definition=f"{SETTLED:.1%} of the reference's whole way", shown_in=fine, scale=fine_scale, significant=3,
            views=INDEX_ONLY, accumulators=settled, finish=lambda a, p, duration: float(p.settled),
        ),
        LoopMetric(
            name=f"{speed_word}_error_max_{rate}", unit=speed_unit, label=f"largest {speed_word} error", better="lower",
            visible=1e-9, definition=f"largest difference of {speed_word} reference and {speed_word}, either way",
            shown_in=fine_rate, scale=1e3, head="error max", significant=3, note=f"{speed_word} against its set point",
            views=View.MOTION | View.COMPARE, accumulators=metric.largest(lambda s, p: absolute(_slow(s))),
            finish=metric.as_summed(0),
        ),
        LoopMetric(
            name=f"{speed_word}_error_rms_{rate}", unit=speed_unit, label=f"RMS {speed_word} error", better="lower",
            visible=1e-9, definition=f"root mean square of {speed_word} reference minus {speed_word}",
            shown_in=fine_rate, scale=1e3, head="error RMS", significant=3, note=f"{speed_word} against its set point",
            views=View.MOTION, accumulators=metric.integral(lambda s, p: _slow(s) * _slow(s)), finish=metric.root_mean,
        ),
        LoopMetric(
            name=f"peak_{speed_word}_{rate}", unit=speed_unit, label=f"largest {speed_word}", better=None, visible=1e-6,
            definition=f"largest {speed_word}, either way", significant=4, views=INDEX_ONLY,
            accumulators=metric.largest(lambda s, p: absolute(s[v])), finish=metric.as_summed(0),
        ),
        LoopMetric(
            name="peak_power_w", unit="W", label="largest power", better="lower", visible=1e-3,
            definition=f"largest product of {word} and {speed_word}, the drive giving", head="power", significant=3,
            note="largest, given", views=View.DRIVE, accumulators=metric.largest(lambda s, p: s[force] * s[v]),
            finish=metric.as_summed(0),
        ),
        LoopMetric(
            name="energy_motoring_j", unit="J", label="work of the drive", better="lower", visible=1e-6,
            definition="work of the drive on the axis, where it gives", head="work", significant=4,
            note="work of the drive", views=View.RUNS | View.DRIVE | View.COMPARE,
            accumulators=since_last, finish=metric.as_summed(0),
        ),
        LoopMetric(
            name="energy_regenerated_j", unit="J", label="work on the drive", better="higher", visible=1e-6,
            definition="work of the axis on the drive", head="work back", significant=4, note="work of the axis on it",
            views=View.DRIVE, accumulators=since_last, finish=metric.as_summed(1),
        ),
        *(one for one in hoist.METRICS if one.name in ("move_time_s", "moves")),
        RunMetric(
            name=f"hold_{word}_{n}", unit=unit, label=f"hold {word}", better=None, visible=1e-6, significant=4,
            definition=f"{word} that holds the load at the start without friction's help", views=INDEX_ONLY,
            known_before=True, value=lambda run: run.hold_torque_nm,
        ),
        RunMetric(
            name=f"acceleration_limit_{rate}2", unit=f"{way}/s²", label="acceleration limit", better=None, visible=1e-6,
            definition="the acceleration that the reference was planned with", views=INDEX_ONLY, significant=3,
            known_before=True, value=lambda run: run.acceleration_m_s2,
        ),
    )  # fmt: skip
    return MetricSet(
        metrics=metrics,
        parameters=PARAMETERS,
        peak=f"peak_{word}_{n}",
        above=f"peak_{word}_above_static_{n}",
        rms=f"rms_{word}_{n}",
        error=f"tracking_error_max_{way}",
        rms_error=f"tracking_error_rms_{way}",
        fastest=f"peak_{speed_word}_{rate}",
        end=f"tracking_error_end_{way}",
        astray=ASTRAY,
        window=f"settling_window_{way}",
        input_words=word,
        input_unit=unit,
        rate_unit=unit,
        moved="axis",
        sides=("beyond", "short of"),
        payload=False,
    )


LINEAR_SET = metric_set(LINEAR)
ROTARY_SET = metric_set(ROTARY)
# Of every kind with a position loop.
SETS = {
    kind.name: LINEAR_SET if kind.drive.suffix == LINEAR.drive.suffix else ROTARY_SET
    for kind in KINDS.values()
    if kind.closed_loop is not None and kind.closed_loop.position_loop
}
