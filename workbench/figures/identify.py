"""Figures of an identification: how the levels settled, and what the fit is sure of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from workbench.figures.panels import Panels
from workbench.figures.style import BLACK, MARKERS, SPARE, TEMPLATE
from workbench.run import Array

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def level_history(levels: Mapping[str, Sequence[float]], unit: str = "N") -> Figure:
    """The friction levels over the paper's iterations, a line a level; iteration 0 is the start."""
    panels = Panels("Friction levels over the iterations", [f"level ({unit})"], x_title="iteration")
    for number, (name, values) in enumerate(levels.items()):
        colour, dash = SPARE[number % len(SPARE)]
        marker = {"symbol": MARKERS[number % len(MARKERS)], "size": 9}
        x, y = np.arange(len(values), dtype=float), np.asarray(values, dtype=float)
        look = {"color": colour, "dash": dash, "width": 2.0}
        panels.line(0, 0, x, y, name, look, unit, mode="lines+markers", marker=marker)
    figure = panels.figure(480)
    longest = max((len(v) for v in levels.values()), default=1)
    figure.update_xaxes(tickmode="linear", dtick=max(1, longest // 12))
    return figure


def correlation_matrix(names: Sequence[str], correlation: Array) -> Figure:
    """The fit's correlation matrix (m, m): what is near ±1 the data cannot tell apart."""
    import plotly.graph_objects as go

    values = np.asarray(correlation, dtype=float)
    heat = {
        "type": "heatmap",
        "z": values,
        "x": list(names),
        "y": list(names),
        "zmin": -1.0,
        "zmax": 1.0,
        # Blue, white, orange-red: Okabe and Ito's blue and vermillion as ends.
        "colorscale": [[0.0, "#0072B2"], [0.5, "#FFFFFF"], [1.0, "#D55E00"]],
        "text": [[f"{value:.2f}" for value in row] for row in values],
        "texttemplate": "%{text}",
        "textfont": {"color": BLACK},
        "colorbar": {"title": {"text": "correlation (–)"}},
        "hovertemplate": "%{y} and %{x}: %{z:.3f}<extra></extra>",
    }
    size = 220 + 48 * len(names)
    layout = {
        "template": TEMPLATE,
        "height": size,
        "width": size + 160,
        "title": {"text": "Correlation of the fitted parameters"},
        "yaxis": {"autorange": "reversed"},
    }
    return go.Figure({"data": [heat], "layout": layout})
