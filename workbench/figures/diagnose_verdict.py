"""The verdict: probability of every hypothesis, which effects these runs tell apart, how far the gap shrinks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.names import powers
from workbench.core.run import Array
from workbench.view.style import AFTER, BEFORE, BLUE, FAINT, GREY, NOISE, PURPLE, TEMPLATE, heading

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

COLOURS = {"named": BLUE, "unknown": PURPLE, "no_gap": GREY, "": FAINT}
BAR, AROUND = 30, 112  # px
CELL, LABELS = 27, 240  # px
BARS_HEIGHT = 380
ROOM = 1.18  # over the highest bar, for its number
ALL = "all runs"


def ranking(rows: Sequence[tuple[str, str, float]]) -> Figure:
    """Horizontal bars. rows: (named, unknown, no_gap or "" for a rest, what stands beside the bar, probability)."""
    import plotly.graph_objects as go

    height = AROUND + BAR * max(len(rows), 2)
    bars = {
        "type": "bar", "orientation": "h", "x": [100.0 * p for *_, p in rows], "y": [name for _, name, _ in rows],
        "text": [_percent(p) for *_, p in rows], "textposition": "outside", "cliponaxis": False, "showlegend": False,
        "marker": {"color": [COLOURS[word] for word, *_ in rows]}, "hovertemplate": "%{y}: %{x:.2f} %<extra></extra>",
    }  # fmt: skip
    layout = {
        "template": TEMPLATE,
        "height": height,
        "hovermode": "closest",
        "title": heading("Probability of each hypothesis", height),
        "margin": {"l": 12, "t": 48, "r": 84},  # room for "> 99.9 %"
        "bargap": 0.3,
        "xaxis": {"title": {"text": "probability (%)"}, "range": [0, 100], "zeroline": False},
        "yaxis": {"autorange": "reversed", "type": "category", "ticks": ""},
    }
    return go.Figure({"data": [bars], "layout": layout})


def _percent(probability: float) -> str:
    percent = 100.0 * probability
    if percent < 0.1:
        return "< 0.1 %"
    if percent > 99.9:
        return "> 99.9 %"
    return f"{percent:.1f} %" if percent < 10.0 or percent > 99.0 else f"{percent:.0f} %"


def isolability(names: Sequence[str], angle: Array, chosen: Sequence[str] = ()) -> Figure:
    """Angles between signatures, degrees, (k, k), as the lower triangle: 0° is one and the same, 90° unmistakable.

    chosen: names that are set in bold. k is at least 2.
    """
    import plotly.graph_objects as go

    k = len(names)
    below = np.where(np.tri(k, k=-1, dtype=bool), angle, np.nan)[1:, :-1]  # the others are empty
    labels = [f"<b>{name}</b>" if name in chosen else name for name in names]
    # Small angles stand out: vermillion where two effects leave the same mark, white at right angles.
    heat: dict[str, Any] = {
        "type": "heatmap", "x": labels[:-1], "y": labels[1:], "z": [[_cell(v) for v in row] for row in below],
        "zmin": 0.0, "zmax": 90.0, "xgap": 1, "ygap": 1, "hoverongaps": False,
        "colorscale": [[0.0, "#D55E00"], [0.17, "#E69F00"], [0.5, "#F8E6C0"], [1.0, "#FFFFFF"]],
        "text": [["" if np.isnan(v) else f"{v:.0f}" for v in row] for row in below],
        "texttemplate": "%{text}", "textfont": {"size": 10},  # dark or light as the cell asks for
        "colorbar": {"title": {"text": "angle (°)", "side": "right"}, "thickness": 14, "tickvals": [*range(0, 91, 15)]},
        "hovertemplate": "%{y} and %{x}: %{z:.1f}°<extra></extra>",
    }  # fmt: skip
    height = LABELS + CELL * max(k - 1, 3)
    axis = {"type": "category", "showgrid": False, "ticks": "", "tickfont": {"size": 11}}
    layout = {
        "template": TEMPLATE,
        "height": height,
        "hovermode": "closest",
        "title": heading("Angle between the marks that two effects leave in these runs", height),
        "margin": {"l": 12, "t": 48, "r": 20, "b": 12},
        "xaxis": axis | {"tickangle": -50},
        "yaxis": axis | {"autorange": "reversed"},
    }
    return go.Figure({"data": [heat], "layout": layout})


def _cell(value: float) -> float | None:
    return None if np.isnan(value) else round(float(value), 2)


def shrink_bars(
    by_run: Mapping[str, tuple[float, float]], together: tuple[float, float], noise: float, unit: str
) -> Figure:
    """Two bars a run and two for all of them, rms in `unit`; dashed: the noise floor in the same band."""
    import plotly.graph_objects as go

    rows = {**by_run, f"<b>{ALL}</b>": together} if len(by_run) != 1 else dict(by_run)
    names = list(rows)
    data = [
        _shrink_bars(names, [both[index] for both in rows.values()], name, colour, unit)
        for index, (name, colour) in enumerate((("before", BEFORE), ("after", AFTER)))
    ]
    # A line of the whole width is a shape; this one only stands for it in the legend.
    floor = {"name": powers(f"noise floor, {noise:.2g} {unit}"), "mode": "lines", "line": NOISE, "hoverinfo": "skip"}
    data.append({"type": "scatter", "x": names[:1], "y": [noise], **floor})
    highest = max([noise, *(value for both in rows.values() for value in both)]) or 1.0
    layout = {
        "template": TEMPLATE,
        "height": BARS_HEIGHT,
        "title": heading(f"Residual on held-out runs, rms ({unit})", BARS_HEIGHT),
        "legend": {"y": 1.0 - 64.0 / BARS_HEIGHT, "traceorder": "normal"},
        "margin": {"t": 80},
        "barmode": "group",
        "bargap": 0.3,
        "hovermode": "closest",
        "shapes": [
            {"type": "line", "x0": 0, "x1": 1, "y0": noise, "y1": noise, "xref": "x domain", "yref": "y", "line": NOISE}
        ],
        "xaxis": {"type": "category", "categoryorder": "array", "categoryarray": names},
        "yaxis": {"title": {"text": f"residual, rms ({unit})"}, "range": [0.0, ROOM * highest]},
    }
    return go.Figure({"data": data, "layout": layout})


def _shrink_bars(names: list[str], values: list[float], name: str, colour: str, unit: str) -> dict[str, Any]:
    return {
        "type": "bar", "x": names, "y": values, "name": name, "marker": {"color": colour},
        "text": [powers(f"{value:#.3g}") for value in values], "textposition": "outside", "textangle": 0,
        "cliponaxis": False,
        "textfont": {"size": 11}, "hovertemplate": f"%{{x}}, {name}: %{{y:.4~g}} {unit}<extra></extra>",
    }  # fmt: skip
