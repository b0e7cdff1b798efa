"""Fitted values against their nominal ones, with error bars: which of them moved, how far and how surely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from workbench.figures.style import BLACK, BLUE, GREY, TEMPLATE

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

ROW, AROUND = 34, 130  # px: of one value, and of title and axis


@dataclass(frozen=True)
class Estimate:
    """A value that a fit found: its distance from the nominal one with a standard error, both in the axis' unit.

    said: the value with its error, in words.
    """

    name: str
    shift: float
    std_error: float
    said: str


def estimates(found: Sequence[Estimate], unit: str, tolerance: float | None = None) -> Figure:
    """A line a value; a grey band of ± `tolerance` around the nominal values where there is one."""
    import plotly.graph_objects as go

    names = [each.name for each in found]
    furthest = max((abs(each.shift) + each.std_error for each in found), default=1.0)
    reach = 1.15 * max(furthest, tolerance or 0.0) or 1.0
    height = AROUND + ROW * max(len(found), 2)
    dots: dict[str, Any] = {
        "type": "scatter", "mode": "markers", "x": [each.shift for each in found], "y": names,
        "error_x": {"array": [each.std_error for each in found], "color": BLACK, "thickness": 2, "width": 6},
        "marker": {"color": BLUE, "size": 11}, "customdata": [each.said for each in found], "showlegend": False,
        "hovertemplate": "%{y}: %{customdata}<extra></extra>",
    }  # fmt: skip
    words = [
        {"text": each.said, "x": 1.01, "xref": "paper", "xanchor": "left", "y": each.name, "showarrow": False,
         "font": {"size": 12}}
        for each in found
    ]  # fmt: skip
    band = {
        "type": "rect", "x0": -(tolerance or 0.0), "x1": tolerance or 0.0, "y0": 0, "y1": 1, "yref": "paper",
        "layer": "below", "line": {"width": 0}, "fillcolor": GREY, "opacity": 0.18,
    }  # fmt: skip
    said = "" if tolerance is None else "; grey: tolerance"
    layout = {
        "template": TEMPLATE,
        "height": height,
        "hovermode": "closest",
        "title": {"text": f"Identified values, ± one standard error{said}", "y": 1.0 - 22.0 / height,
                  "yanchor": "middle", "font": {"size": 15}},
        "margin": {"l": 12, "t": 52, "r": 164},
        "shapes": [] if tolerance is None else [band],
        "annotations": words,
        "xaxis": {"title": {"text": f"distance from nominal ({unit})"}, "range": [-reach, reach], "zeroline": True,
                  "zerolinewidth": 2},
        "yaxis": {"autorange": "reversed", "type": "category"},
    }  # fmt: skip
    return go.Figure({"data": [dots], "layout": layout})
