"""The figures of a study's report, by what the study varies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from workbench.figures.pareto import pareto
from workbench.figures.study import overview, peak_torque_over_payload
from workbench.figures.study_axis import axis_overview
from workbench.figures.study_plane import torque_speed_plane
from workbench.figures.study_scatter import spread, tornado
from workbench.figures.study_sweep import changing, metrics_over_axis
from workbench.kinds import kind_of
from workbench.metrics import View, shown_in
from workbench.run import Run
from workbench.study.findings import sweeps_limits
from workbench.study.labels import SweptAxis, drawn_columns, swept_axes
from workbench.study.pareto import fronts, rank_correlations
from workbench.study.rows import Row, metrics_of, with_payload
from workbench.study.run import peak_limit
from workbench.study.store import Finished

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Noted = tuple["Figure", str]
MOST_CURVES = 6
MOST_GROUPS = 3
SWING = "wire_tension_swing_n"


def figures_of(result: Finished) -> list[Noted]:
    """The figures that a study's kind asks for, each with a line that says how to read it."""
    good = [row for row in result.rows if row.ok]
    if not good:
        return []
    axes, drawn = swept_axes(result.rows), drawn_columns(result.rows)
    figures: list[Noted] = []
    if sweeps_limits(good):
        figures += _paretos(good, axes)
    elif not axes and len({row.reference for row in good}) > 2 and not drawn:
        pass
    if drawn:
        figures += _scatter(good, drawn)
    figures += [_over(result, good, axis) for axis in axes if changing(good, axis)]
    if not axes and not drawn and len({row.payload_kg for row in good}) > 1:
        figures.append((_over_payload(result, good), ""))
    if (curves := _curves(result, good, axes, bool(drawn))) is not None:
        figures += curves
    return figures


def _paretos(good: Sequence[Row], axes: Sequence[SweptAxis]) -> list[Noted]:
    note = (
        "Each point is a run; the line joins those that no other run beats in both. The knee is the run farthest below "
        "the line between the front's ends: beyond it on either side a little of one cost is bought dearly."
    )
    seconds = [name for name in (metrics_of(good).peak, SWING) if all(name in row.metrics for row in good)]
    return [(pareto(good, fronts(good, name)[-MOST_GROUPS:], axes, name), note) for name in seconds]


def _scatter(good: Sequence[Row], drawn: Sequence[str]) -> list[Noted]:
    groups: dict[tuple[float, str], list[Row]] = {}
    for row in good:
        groups.setdefault((row.payload_kg, row.reference), []).append(row)
    peak = metrics_of(good).peak
    ranked = [
        (f"{payload:g} kg, {kind}" if with_payload(rows[0]) else kind, rank_correlations(rows, drawn, peak))
        for (payload, kind), rows in groups.items()
    ]
    ranked = [group for group in ranked if group[1]][-MOST_GROUPS:]
    figures: list[Noted] = [
        (
            spread(good, _spread(good)),
            "Above the histogram, below the share of runs at or below a value; ticks: 5, 50, 95 %.",
        )
    ]
    if ranked:
        note = "Spearman's rank correlation of each drawn value with the metric: ±1 is a fixed order, 0 no relation."
        figures.append((tornado(ranked, peak), note))
    return figures


def _spread(good: Sequence[Row]) -> list[str]:
    """The metrics whose scatter is drawn."""
    return [
        m.name
        for m in shown_in(View.SPREAD, metrics_of(good))
        if all(row.metrics.get(m.name) is not None for row in good)
    ]


def _over(result: Finished, good: Sequence[Row], axis: SweptAxis) -> Noted:
    machine = result.machine
    figure = metrics_over_axis(good, axis, kind_of(machine).looped.nominal(machine), peak_limit(machine))
    several = len(good) > len({(row.payload_kg, row.reference, axis.at(row)) for row in good})
    note = "The line is the worst of the runs at a value, the band all of them." if several else ""
    if len(axis.columns) > 1:
        note = f"{axis.words.capitalize()} are walked together. {note}".strip()
    return figure, note


def _over_payload(result: Finished, good: Sequence[Row]) -> Figure:
    machine = result.machine
    payloads = np.array(sorted({row.payload_kg for row in good}))
    peak = {(row.reference, row.payload_kg): row[metrics_of(good).peak] for row in good}
    held = {row.payload_kg: row["hold_torque_nm"] / machine.motor.count for row in good}
    kinds = dict.fromkeys(row.reference for row in good)
    peaks = {kind: np.array([peak.get((kind, payload), np.nan) for payload in payloads]) for kind in kinds}
    static = np.array([held[payload] for payload in payloads])
    limit = peak_limit(machine)
    return peak_torque_over_payload(payloads, peaks, machine.motor.nominal_torque_nm, limit, static)


def _curves(result: Finished, good: Sequence[Row], axes: Sequence[SweptAxis], drawn: bool) -> list[Noted] | None:
    """Signals over time, and torque over speed, of a choice of runs that can be told apart."""
    runs, what = _chosen(result, good, axes, drawn)
    if not runs:
        return None
    kind = kind_of(result.machine)
    if kind.looped.position_loop:
        of = kind, peak_limit(result.machine), result.machine.drive.nominal
        ramp = _first_ramp(runs[0][1], kind.looped.references[1])
        short = ramp[0] + 0.3, ramp[1] - 1.3  # what an axis does is soon over
        start = axis_overview(
            runs, *of, "Start of the first move", (short[0], max(short[1], 1.5 * short[1] - 0.5 * short[0]))
        )
        return [(start, what), (axis_overview(runs, *of, "Closed loop over time"), what)]
    motor, limit = result.machine.motor, peak_limit(result.machine)
    shaded = "Where a fall of wire is slack the panel of its tension is shaded."
    plane = torque_speed_plane(
        runs, motor.nominal_torque_nm, limit, motor.nominal_speed_rad_s, result.machine.drive.field_weakening
    )
    over_time = overview(runs, motor.nominal_torque_nm, limit, "Closed loop over time")
    start = overview(
        runs, motor.nominal_torque_nm, limit, "Start of the first move", _first_ramp(runs[0][1]),
        ("speed", "error", "torque"),
    )  # fmt: skip
    return [
        (start, what),
        (over_time, f"{what} {shaded}".strip()),
        (
            plane,
            f"{what} Within the continuous line for as long as one likes, up to the peak line for a while.".strip(),
        ),
    ]


def _first_ramp(run: Run, signal: str = "speed_reference_rad_s") -> tuple[float, float]:
    """From when the reference begins to move to a moment after it has its speed (s)."""
    speed = np.abs(run[signal])
    moving = np.flatnonzero(speed > 1e-3 * speed.max())
    if not len(moving):
        return float(run.time_s[0]), float(run.time_s[-1])
    there = moving[0] + int(np.argmax(speed[moving[0] :] >= 0.999 * speed.max()))
    return float(run.time_s[moving[0]]) - 0.4, float(run.time_s[there]) + 1.5


def _chosen(
    result: Finished, good: Sequence[Row], axes: Sequence[SweptAxis], drawn: bool
) -> tuple[list[tuple[str, Run]], str]:
    kept = [row for row in good if row.run_id in result.runs]
    if not kept or drawn:
        return [], ""
    if not axes:
        return [(row.reference, result.runs[row.run_id]) for row in kept], ""
    axis, others = axes[0], axes[1:]
    points = [axis.points[i] for i in np.unique(np.linspace(0, len(axis.points) - 1, MOST_CURVES).round().astype(int))]
    kind = kept[-1].reference
    shown = [
        row for row in kept
        if row.reference == kind and axis.at(row) in points and all(o.at(row) == o.points[0] for o in others)
    ]  # fmt: skip
    said = "; ".join([kind, *(other.say(other.points[0]) for other in others)])
    return [(axis.say(axis.at(row)), result.runs[row.run_id]) for row in shown], f"Runs with {said}."
