"""Metrics over what a study sweeps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from workbench.figures.panels import Panels
from workbench.metrics import Metric, View, shown_in
from workbench.study.findings import NO_CHANGE
from workbench.study.labels import Point, SweptAxis, drawn_in, shown
from workbench.study.rows import Row, metrics_of
from workbench.view.style import MARKERS, label, line

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MOST_COLUMNS = 3


def metrics_over_axis(
    rows: Sequence[Row], axis: SweptAxis, nominal_torque_nm: float | None, torque_limit_nm: float, height: int = 900
) -> Figure:
    """The metrics that change along an axis, a panel each; a column a payload, a line a reference.

    Where other fields are swept too, the line is the worst of their runs and a band shows all. torque limits: of
    one motor, or of an axis' drive, which may state none (None, inf). Of more than three payloads the lightest, a
    middle and the heaviest are drawn.
    """
    good = [row for row in rows if row.ok]
    judged = metrics_of(good)
    metrics = changing(good, axis) or list(shown_in(View.SWEEP, judged)[:1])
    payloads = sorted({row.payload_kg for row in good})
    if len(payloads) > MOST_COLUMNS:
        payloads = [payloads[i] for i in np.linspace(0, len(payloads) - 1, MOST_COLUMNS).round().astype(int)]
    panels = Panels(
        f"Over {axis.words}",
        [drawn_in(metric.name)[0].axis.replace(" (", "<br>(") for metric in metrics],
        [f"payload {p:g} kg" if judged.payload else "" for p in payloads],
        x_title=axis.label,
    )
    x = np.array([point[0] for point in axis.points], dtype=float) if axis.numeric else np.arange(len(axis.points))
    for number, kind in enumerate(dict.fromkeys(row.reference for row in good)):
        marker = {"symbol": MARKERS[number % len(MARKERS)], "size": 7}
        look = line(kind, number)
        for column, payload in enumerate(payloads):
            here = [row for row in good if row.reference == kind and row.payload_kg == payload]
            for level, metric in enumerate(metrics):
                groups = [
                    [metric.scale * row[metric.name] for row in here if axis.at(row) == point] for point in axis.points
                ]
                low, high = (np.array([f(g) if g else np.nan for g in groups]) for f in (min, max))
                worst, other = (low, high) if metric.better == "higher" else (high, low)
                if max(map(len, groups), default=0) > 1:
                    both = np.concatenate([x, x[::-1]]), np.concatenate([worst, other[::-1]])
                    known = np.isfinite(both[1])
                    panels.line(
                        level, column, both[0][known], both[1][known], f"{label(kind)}: all", {"width": 0},
                        fill="toself", fillcolor=look["color"], opacity=0.18, hoverinfo="skip", hovertemplate=None,
                        showlegend=False,
                    )  # fmt: skip
                panels.line(
                    level, column, x.astype(float), worst, label(kind), look, metric.shown_unit,
                    mode="lines+markers", marker=marker,
                )  # fmt: skip
    names = [metric.name for metric in metrics]
    if judged.peak in names:  # its panel has the limits in it
        at, unit = names.index(judged.peak), judged.rate_unit
        for column in range(len(payloads)):
            for value, what, dash in ((nominal_torque_nm, "nominal", "dot"), (torque_limit_nm, "limit", "dash")):
                if value is not None and np.isfinite(value):
                    panels.level(at, column, value, f"{what} {value:.4g} {unit}" if column == 0 else "", dash)
    figure = panels.figure(max(260 + 150 * len(metrics), 420) if height == 900 else height)
    if not axis.numeric:
        words = [shown(point[0]) for point in axis.points]
        figure.update_xaxes(tickmode="array", tickvals=list(range(len(words))), ticktext=words)
    elif _even_in_ratio(x):
        figure.update_xaxes(type="log", tickmode="array", tickvals=list(x), ticktext=[f"{v:.3g}" for v in x])
    figure.update_yaxes(zeroline=False)
    return figure


def changing(rows: Sequence[Row], axis: SweptAxis) -> list[Metric]:
    """The metrics whose worst value at a point of the axis is not the same along it."""
    return [
        metric
        for metric in shown_in(View.SWEEP, metrics_of(rows))
        if all(row.metrics.get(metric.name) is not None for row in rows) and _changes(rows, axis, metric)
    ]


def _changes(rows: Sequence[Row], axis: SweptAxis, metric: Metric) -> bool:
    worst: dict[tuple[float, str], dict[Point, float]] = {}
    for row in rows:
        case = worst.setdefault((row.payload_kg, row.reference), {})
        value = row[metric.name]
        case[axis.at(row)] = metric.worst([value, case.get(axis.at(row), value)])
    return any(
        max(case.values()) - min(case.values()) > NO_CHANGE * max(map(abs, case.values())) for case in worst.values()
    )


def _even_in_ratio(x: np.ndarray) -> bool:
    """Whether values go in equal ratios rather than in equal steps."""
    if len(x) < 4 or np.min(x) <= 0.0:
        return False
    ratio, step = np.diff(np.log(x)), np.diff(x)
    return bool(np.ptp(ratio) < 0.01 * np.abs(ratio).max() and np.ptp(step) > 0.01 * np.abs(step).max())
