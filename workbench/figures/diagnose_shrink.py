"""How far the gap shrinks on runs that were held out: bars before and after, with the noise floor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from workbench.figures.diagnose_style import AFTER, BEFORE, NOISE, heading
from workbench.figures.style import TEMPLATE

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

HEIGHT = 380
ROOM = 1.18  # over the highest bar, for its number
ALL = "all runs"


def shrink_bars(
    by_run: Mapping[str, tuple[float, float]], together: tuple[float, float], noise: float, unit: str
) -> Figure:
    """Two bars a run and two for all of them, rms in `unit`; dashed: the noise floor in the same band."""
    import plotly.graph_objects as go

    rows = {**by_run, f"<b>{ALL}</b>": together} if len(by_run) != 1 else dict(by_run)
    names = list(rows)
    data = [
        _bars(names, [both[index] for both in rows.values()], name, colour, unit)
        for index, (name, colour) in enumerate((("before", BEFORE), ("after", AFTER)))
    ]
    # A line of the whole width is a shape; this one only stands for it in the legend.
    floor = {"name": f"noise floor, {noise:.2g} {unit}", "mode": "lines", "line": NOISE, "hoverinfo": "skip"}
    data.append({"type": "scatter", "x": names[:1], "y": [noise], **floor})
    highest = max([noise, *(value for both in rows.values() for value in both)]) or 1.0
    layout = {
        "template": TEMPLATE,
        "height": HEIGHT,
        "title": heading(f"Residual on held-out runs, rms ({unit})", HEIGHT),
        "legend": {"y": 1.0 - 64.0 / HEIGHT, "traceorder": "normal"},
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


def _bars(names: list[str], values: list[float], name: str, colour: str, unit: str) -> dict[str, Any]:
    return {
        "type": "bar", "x": names, "y": values, "name": name, "marker": {"color": colour},
        "text": [f"{value:#.3g}" for value in values], "textposition": "outside", "textangle": 0, "cliponaxis": False,
        "textfont": {"size": 11}, "hovertemplate": f"%{{x}}, {name}: %{{y:.4~g}} {unit}<extra></extra>",
    }  # fmt: skip
