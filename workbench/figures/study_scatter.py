"""Of a study that draws: how its results are spread, and what that hangs on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from workbench.figures.panels import Panels
from workbench.study.labels import drawn_in, metric_label
from workbench.study.pareto import Correlation
from workbench.study.rows import Row
from workbench.view.style import BLUE, TEMPLATE, VERMILLION, label, line

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

QUANTILES = (0.05, 0.5, 0.95)


def spread(rows: Sequence[Row], metrics: Sequence[str], height: int = 520) -> Figure:
    """Histogram and empirical distribution of each metric, a column a metric; 5 %, 50 % and 95 % are marked."""
    import plotly.graph_objects as go

    good = [row for row in rows if row.ok]
    cases = list(dict.fromkeys((row.payload_kg, row.reference) for row in good))
    panels = Panels(
        "Spread of the results",
        ["share of runs<br>(%)", "share of runs<br>at or below (%)"],
        [drawn_in(name)[0].axis for name in metrics],
        x_title="",
        row_weights=(1.0, 1.2),
    )
    many = len({payload for payload, _ in cases}) > 1
    for column, name in enumerate(metrics):
        scale = drawn_in(name)[1]
        everything = scale * np.array([row[name] for row in good])
        edges = np.histogram_bin_edges(everything, bins=min(40, max(8, round(2 * len(everything) ** (1 / 3)))))
        for number, (payload, kind) in enumerate(cases):
            case = [row[name] for row in good if (row.payload_kg, row.reference) == (payload, kind)]
            values = np.sort(scale * np.array(case))
            title = f"{label(kind)}, {payload:g} kg" if many else label(kind)
            look = line(kind, number)
            counts, _ = np.histogram(values, edges)
            # Outlined steps: two cases that overlap stay apart, in black and white too.
            x, y = np.repeat(edges, 2), np.concatenate([[0.0], np.repeat(100.0 * counts / len(values), 2), [0.0]])
            panels.line(0, column, x, y, title, look, "%", fill="tozeroy", fillcolor=_faint(look["color"]))
            share = 100.0 * (np.arange(len(values)) + 1.0) / len(values)
            panels.line(1, column, values, share, title, look | {"shape": "hv"}, "%")
            at = np.quantile(values, QUANTILES)
            panels.line(
                1, column, at, 100.0 * np.array(QUANTILES), title, {}, mode="markers+text",
                marker={"size": 9, "symbol": "line-ns-open", "color": look["color"], "line": {"width": 3}},
                text=[f"{value:.4g}" for value in at], textposition="middle right", textfont={"size": 11},
                cliponaxis=False, showlegend=False, hovertemplate="%{y:.0f} %: %{x:.4~g}",
            )  # fmt: skip
    figure: go.Figure = panels.figure(height)
    # Each metric has an axis of its own; the panels of one share it.
    columns = len(metrics)
    for row in range(2):
        for column in range(columns):
            number = row * columns + column + 1
            figure.layout[f"xaxis{number if number > 1 else ''}"].matches = f"x{column + 1}" if column else "x"
    figure.update_layout(hovermode="closest")
    return figure


def _faint(colour: str) -> str:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.15)"


def tornado(groups: Sequence[tuple[str, Sequence[Correlation]]], metric: str, height: int | None = None) -> Figure:
    """Rank correlation of each drawn field with a metric, a column a group, the strongest on top."""
    import plotly.graph_objects as go

    strongest: dict[str, float] = {}
    for _, ranked in groups:
        for correlation in ranked:
            strongest[correlation.label.words] = max(
                strongest.get(correlation.label.words, 0.0), abs(correlation.value)
            )
    order = sorted(strongest, key=lambda words: strongest[words])
    data = []
    layout: dict[str, object] = {
        "template": TEMPLATE,
        "height": height or 190 + 30 * len(order),
        "title": {"text": f"What the {metric_label(metric).words} hangs on"},
        "showlegend": False,
        "bargap": 0.35,
        "hovermode": "closest",
    }
    annotations = []
    gap = 0.04
    width = (1.0 - gap * (len(groups) - 1)) / len(groups)
    for column, (name, ranked) in enumerate(groups):
        value = {correlation.label.words: correlation.value for correlation in ranked}
        number = "" if column == 0 else str(column + 1)
        bars = [value.get(words, 0.0) for words in order]
        data.append(
            {"type": "bar", "orientation": "h", "x": bars, "y": order, "name": name}
            | {"xaxis": f"x{number}", "yaxis": f"y{number}", "text": [f"{bar:+.2f}" for bar in bars]}
            | {"textposition": "outside", "cliponaxis": False, "hovertemplate": "%{y}: %{x:+.2f}<extra></extra>"}
            | {"marker": {"color": [BLUE if bar >= 0.0 else VERMILLION for bar in bars]}}
        )
        left = column * (width + gap)
        layout[f"xaxis{number}"] = {
            "domain": [left, min(left + width, 1.0)], "anchor": f"y{number}", "range": [-1.15, 1.15],
            "title": {"text": "rank correlation (–)"},
        }  # fmt: skip
        layout[f"yaxis{number}"] = {"anchor": f"x{number}", "showticklabels": column == 0, "zeroline": False}
        annotations.append(
            {"text": f"<b>{name}</b>", "x": left + width / 2, "y": 1.0, "xref": "paper", "yref": "paper"}
            | {"xanchor": "center", "yanchor": "bottom", "yshift": 3, "showarrow": False, "font": {"size": 13}}
        )
    layout["annotations"] = annotations
    return go.Figure({"data": data, "layout": layout})
