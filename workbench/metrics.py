"""What a run is judged by: each metric declared once, fed sample by sample.

A metric is a few running sums, how a sample changes them, and what they come to at
the end. The same functions run inside the compiled loop and on a measured log, so a
batch of thousands keeps no signals.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.run import Array, Run
from workbench.trace.expr import Scalar, absolute, maximum, minimum, where

HUGE = 1e300


@dataclass(frozen=True)
class Metric:
    """name and unit as results carry it; `definition` is the sentence in the docs.

    update(sums, s, p, dt): new sums after a sample with signals s; finish(sums, p, duration).
    """

    name: str
    unit: str
    definition: str
    start: tuple[float, ...]
    update: Callable[[Sequence[Scalar], Mapping[str, Scalar], Any, Scalar], Sequence[Scalar]]
    finish: Callable[[Sequence[float], Any, float], float]


def _torque(s: Mapping[str, Scalar]) -> Scalar:
    return s["torque_motor_nm"]


def _share(s: Mapping[str, Scalar], p: Any) -> Scalar:
    """Of the torque, what the harder-worked motor gives; more once another one failed."""
    return where(s["time_s"] >= p.t_fail, p.share_failed, p.share)


def _error(s: Mapping[str, Scalar]) -> Scalar:
    return s["speed_reference_rad_s"] - s["speed_motor_rad_s"]


def _margin(s: Mapping[str, Scalar], p: Any) -> Scalar:
    return minimum(s["position_carriage_m"] - p.x_low, p.x_high - s["position_carriage_m"])


def _first(sums: Sequence[float], p: Any, duration: float) -> float:
    return float(sums[0])


def _largest(value: Callable[[Mapping[str, Scalar], Any], Scalar]) -> dict[str, Any]:
    return {
        "start": (-HUGE,),
        "update": lambda a, s, p, dt: [maximum(a[0], value(s, p))],
        "finish": _first,
    }


def _mean_square(value: Callable[[Mapping[str, Scalar], Any], Scalar]) -> dict[str, Any]:
    return {
        "start": (0.0,),
        "update": lambda a, s, p, dt: [a[0] + value(s, p) * value(s, p) * dt],
        "finish": lambda a, p, duration: math.sqrt(max(a[0], 0.0) / duration),
    }


def _work(sign: float) -> dict[str, Any]:
    """Work at the motor shaft of one sign: torque since the last sample times the angle turned.

    The torque is the one held since then or, behind a lagging drive, the mean of both ends.
    """

    def update(a: Sequence[Scalar], s: Mapping[str, Scalar], p: Any, dt: Scalar) -> list[Scalar]:
        total, torque, angle, begun = a
        mean = where(p.t_lag > 0.0, 0.5 * (torque + _torque(s)), torque)
        work = begun * mean * (s["angle_motor_rad"] - angle) * sign
        return [total + maximum(work, 0.0), _torque(s), s["angle_motor_rad"], 1.0]

    return {"start": (0.0, 0.0, 0.0, 0.0), "update": update, "finish": _first}


def _slack_events(a: Sequence[Scalar], s: Mapping[str, Scalar], p: Any, dt: Scalar) -> list[Scalar]:
    slack = where(s["tension_min_n"] <= 0.0, 1.0, 0.0)
    return [a[0] + maximum(slack - a[1], 0.0), slack]


METRICS = (
    Metric(
        "peak_torque_motor_nm", "N m", "largest torque of the harder-worked motor, either way",
        **_largest(lambda s, p: absolute(_torque(s)) * _share(s, p)),
    ),
    Metric(
        "peak_torque_percent", "%", "the same in per cent of one motor's nominal torque",
        **_largest(lambda s, p: absolute(_torque(s)) * _share(s, p) * 100.0 / p.T_nominal),
    ),
    Metric(
        "peak_torque_above_static_nm", "N m",
        "largest torque of both motors above the torque that holds the load at the start",
        **_largest(lambda s, p: _torque(s) - p.T_hold),
    ),
    Metric(
        "rms_torque_motor_nm", "N m", "root mean square of the harder-worked motor's torque over the run",
        **_mean_square(lambda s, p: _torque(s) * _share(s, p)),
    ),
    Metric(
        "speed_error_rms_rad_s", "rad/s", "root mean square of reference minus motor speed",
        **_mean_square(lambda s, p: _error(s)),
    ),
    Metric(
        "speed_error_max_rad_s", "rad/s", "largest difference of reference and motor speed",
        **_largest(lambda s, p: absolute(_error(s))),
    ),
    Metric(
        "min_wire_tension_n", "N", "smallest elastic tension of the two falls; zero is slack",
        start=(HUGE,), update=lambda a, s, p, dt: [minimum(a[0], s["tension_min_n"])], finish=_first,
    ),
    Metric(
        "max_wire_tension_n", "N", "largest tension at the top of a fall, the wire's own weight included",
        **_largest(lambda s, p: maximum(s["tension_drum_n"], s["tension_dead_line_n"])),
    ),
    Metric(
        "slack_time_s", "s", "time with a fall of wire slack",
        start=(0.0,), update=lambda a, s, p, dt: [a[0] + where(s["tension_min_n"] <= 0.0, 1.0, 0.0) * dt],
        finish=_first,
    ),
    Metric(
        "slack_events", "", "how often a fall went slack",
        start=(0.0, 0.0), update=_slack_events, finish=_first,
    ),
    Metric(
        "energy_motoring_j", "J", "work of the motors on the machine",
        **_work(1.0),
    ),
    Metric(
        "energy_regenerated_j", "J", "work of the machine on the motors",
        **_work(-1.0),
    ),
    Metric(
        "peak_carriage_acceleration_m_s2", "m/s²", "largest acceleration of the carriage, either way",
        **_largest(lambda s, p: absolute(s["acceleration_carriage_m_s2"])),
    ),
    Metric(
        "rail_margin_m", "m", "smallest distance of the carriage from the ends of its rail; negative beyond them",
        start=(HUGE,), update=lambda a, s, p, dt: [minimum(a[0], _margin(s, p))], finish=_first,
    ),
)  # fmt: skip


class Observer:
    """All metrics as one set of running sums."""

    def __init__(self, metrics: Sequence[Metric], parameters: Sequence[str]) -> None:
        self.metrics = tuple(metrics)
        self.parameters = tuple(parameters)
        self.start = [x for m in self.metrics for x in m.start]
        self.size = len(self.start)

    def _parts(self, sums: Any) -> list[Sequence[Any]]:
        parts: list[Sequence[Any]] = []
        at = 0
        for metric in self.metrics:
            parts.append(sums[at : at + len(metric.start)])
            at += len(metric.start)
        return parts

    def update(self, sums: Sequence[Scalar], signals: Mapping[str, Scalar], p: Any, dt: Scalar) -> list[Scalar]:
        parts = zip(self.metrics, self._parts(sums), strict=True)
        return [x for metric, part in parts for x in metric.update(part, signals, p, dt)]

    def finish(self, sums: Sequence[float] | Array, p: Any, duration_s: float) -> dict[str, float]:
        parts = zip(self.metrics, self._parts(sums), strict=True)
        return {metric.name: float(metric.finish(part, p, duration_s)) for metric, part in parts}


HOIST_OBSERVER = Observer(
    METRICS, ("T_nominal", "T_hold", "share", "share_failed", "t_fail", "t_lag", "x_low", "x_high")
)


def measure(run: Run, p: Any, observer: Observer = HOIST_OBSERVER) -> dict[str, float]:
    """The same metrics from a run's signals: a log, or a trace made by hand.

    p: the observer's parameters by symbol. Each sample counts until the next one.
    """
    sums: Sequence[float] = observer.start
    steps = [*(run.time_s[1:] - run.time_s[:-1]), run.sample_time_s]
    for k, dt in enumerate(steps):
        signals = {name: values[k] for name, values in run.signals.items()} | {"time_s": run.time_s[k]}
        sums = observer.update(sums, signals, p, dt)
    return observer.finish(sums, p, float(sum(steps)))
