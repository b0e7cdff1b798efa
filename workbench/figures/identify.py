"""Figures of an identification: values with error bars, how the levels settled, what the fit is sure of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.run import Array
from workbench.view.panels import Panels
from workbench.view.style import BLACK, BLUE, GREY, MARKERS, SPARE, TEMPLATE

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

ROW, AROUND = 34, 130  # px: of one value, and of title and axis


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


@dataclass(frozen=True)
class Estimate:
    """A value that a fit found: its distance from the nominal one with a standard error, both in the axis' unit.

    said: the value with its error, in words.
    """

    name: str
    shift: float
    std_error: float
    said: str


def estimates(fitted: Sequence[Estimate], unit: str, tolerance: float | None = None) -> Figure:
    """A line a value; a grey band of ± `tolerance` around the nominal values where there is one."""
    import plotly.graph_objects as go

    names = [estimate.name for estimate in fitted]
    furthest = max((abs(estimate.shift) + estimate.std_error for estimate in fitted), default=1.0)
    reach = 1.15 * max(furthest, tolerance or 0.0) or 1.0
    height = AROUND + ROW * max(len(fitted), 2)
    dots: dict[str, Any] = {
        "type": "scatter", "mode": "markers", "x": [estimate.shift for estimate in fitted], "y": names,
        "error_x": {"array": [estimate.std_error for estimate in fitted], "color": BLACK, "thickness": 2, "width": 6},
        "marker": {"color": BLUE, "size": 11}, "customdata": [estimate.said for estimate in fitted],
        "showlegend": False, "hovertemplate": "%{y}: %{customdata}<extra></extra>",
    }  # fmt: skip
    words = [
        {"text": estimate.said, "x": 1.01, "xref": "paper", "xanchor": "left", "y": estimate.name, "showarrow": False,
         "font": {"size": 12}}
        for estimate in fitted
    ]  # fmt: skip
    band = {
        "type": "rect", "x0": -(tolerance or 0.0), "x1": tolerance or 0.0, "y0": 0, "y1": 1, "yref": "paper",
        "layer": "below", "line": {"width": 0}, "fillcolor": GREY, "opacity": 0.18,
    }  # fmt: skip
    tolerance_note = "" if tolerance is None else "; grey: tolerance"
    layout = {
        "template": TEMPLATE,
        "height": height,
        "hovermode": "closest",
        "title": {"text": f"Identified values, ± one standard error{tolerance_note}", "y": 1.0 - 22.0 / height,
                  "yanchor": "middle", "font": {"size": 15}},
        "margin": {"l": 12, "t": 52, "r": 164},
        "shapes": [] if tolerance is None else [band],
        "annotations": words,
        "xaxis": {"title": {"text": f"distance from nominal ({unit})"}, "range": [-reach, reach], "zeroline": True,
                  "zerolinewidth": 2},
        "yaxis": {"autorange": "reversed", "type": "category"},
    }  # fmt: skip
    return go.Figure({"data": [dots], "layout": layout})
