"""Where the gap lies: its mean over each variable, both ways, as small multiples; curves of an unknown cause."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.location.records import Profile
from workbench.diagnose.unexplained.records import Curve
from workbench.view.style import FAINT, GREY, MARKERS, SPARE, TEMPLATE, heading

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

COLUMNS = 3
PANEL, BETWEEN, TOP, BOTTOM = 190, 96, 124, 56  # px
GAP_X, GAP_X_TITLED = 0.055, 0.1  # of the width, between panels; where each has a title of its own
SHARE_ROOM = 3.0  # the bars of the energy's share fill a third of a panel


def profiles(shown: Sequence[Profile], unit: str, ways: tuple[str, str]) -> Figure:
    """A panel a variable, as many as are given: mean residual in each bin, forward and backward; grey: energy's share.

    The scale is common to all panels, so that they compare at a glance. A spectrum has no mean: what one
    wave takes of the energy fills the panel, over frequency on a logarithmic axis. ways: what the two directions are
    called.
    """
    boxes, height = _boxes(len(shown))
    data: list[dict[str, Any]] = []
    layout = _layout(f"Mean residual ({unit}) over what may explain it", height)
    largest = max((_largest(profile.mean_forward, profile.mean_backward) for profile in shown), default=0.0) or 1.0
    in_legend: set[str] = set()  # what the legend has
    labelled: set[float] = set()  # rows, by where they begin, that have the common scale's numbers
    for number, (profile, box) in enumerate(zip(shown, boxes, strict=True), start=1):
        name, _, best = profile.label.partition(", ")
        unit_of = f" ({profile.unit})" if profile.unit not in ("", "1") else ""
        _panel(layout, number, box, f"{name}{unit_of}")
        traces = _spectrum(profile, number) if is_spectrum(profile) else _means(profile, unit, ways, number, len(shown))
        for trace in traces:
            trace["showlegend"] = trace["legendgroup"] not in in_legend
            in_legend.add(trace["legendgroup"])
        data += traces
        if is_spectrum(profile):
            axis = {
                "range": [0.0, 115.0 * _most(profile.share)],
                "ticksuffix": " %",
                "rangemode": "tozero",
                "nticks": 6,
            }
            layout[f"xaxis{number}"] |= {"type": "log", "dtick": 1}
            title = "one wave's share of the energy"
        else:
            _scales(layout, profile, box, number, len(shown), largest, ways)
            axis, title = {"showticklabels": box[1][0] not in labelled}, f"mean residual ({unit})"
            labelled.add(box[1][0])
        layout[f"yaxis{number}"] |= axis
        if box[0][0] == 0.0:
            layout[f"yaxis{number}"]["title"] = {"text": title, "font": {"size": 12}}
        low, high, explains = (round(100.0 * x) for x in (*profile.interval, profile.explains))
        heading = f"{best}, explains" if best else "explains"
        layout["annotations"].append(_above(f"<b>{name}</b><br>{heading} {explains} % ({low} to {high})", box))
    return _figure(data, layout)


def is_spectrum(profile: Profile) -> bool:
    """Whether a profile has no mean in any bin, only its share of the energy."""
    return not np.any(np.isfinite([profile.mean_forward, profile.mean_backward]))


def worth_a_panel(profile: Profile) -> bool:
    """A wave that explains nothing is nothing to look at; what a mean does not explain is."""
    return not is_spectrum(profile) or profile.explains >= 0.005


def _spectrum(profile: Profile, number: int) -> list[dict[str, Any]]:
    """Steps over frequency."""
    share = 100.0 * np.append(profile.share, profile.share[-1])
    return [{
        "type": "scatter", "mode": "lines", "x": profile.edges, "y": _gaps(share),
        "fill": "tozeroy", "fillcolor": FAINT,
        "line": {"shape": "hv", "color": GREY, "width": 1.2}, "name": "share of the gap's energy (grey)",
        "legendgroup": "share", "xaxis": f"x{number}", "yaxis": f"y{number}", "hovertemplate": "%{y:.1f} %",
    }]  # fmt: skip


def _means(profile: Profile, unit: str, ways: tuple[str, str], number: int, count: int) -> list[dict[str, Any]]:
    """Bars of the energy's share, and over them the mean of each way."""
    middle = (profile.edges[1:] + profile.edges[:-1]) / 2.0
    share = {
        "type": "bar", "x": middle, "y": 100.0 * profile.share, "width": np.diff(profile.edges),
        "name": "share of the gap's energy (grey)", "legendgroup": "share",
        "marker": {"color": FAINT, "line": {"width": 0}}, "xaxis": f"x{number}", "yaxis": f"y{number + count}",
        "hovertemplate": "%{y:.1f} %",
    }  # fmt: skip
    both = (profile.mean_forward, profile.mean_backward)
    return [share, *(_line(middle, values, ways[way], way, unit, number, True) for way, values in enumerate(both))]


def _scales(
    layout: dict[str, Any], profile: Profile, box: Box, number: int, count: int, largest: float, ways: tuple[str, str]
) -> None:
    """Of the means, common to all panels, and of the bars, which have their own."""
    if profile.variable == "direction":  # a sign: backward or forward
        middle = (profile.edges[1:] + profile.edges[:-1]) / 2.0
        layout[f"xaxis{number}"] |= {"tickvals": list(middle), "ticktext": list(ways[::-1])}
    # Over the bars' axis, yet with ticks of its own.
    scale = {"range": [-1.15 * largest, 1.15 * largest], "tickmode": "auto", "nticks": 7}
    layout[f"yaxis{number}"] |= scale | {"overlaying": f"y{number + count}"}
    layout[f"yaxis{number + count}"] = {
        "domain": box[1], "anchor": f"x{number}", "range": [0.0, SHARE_ROOM * 100.0 * _most(profile.share)],
        "showticklabels": False, "showgrid": False, "ticks": "", "showline": False, "zeroline": False,
    }  # fmt: skip


def curves(
    shown: Sequence[Curve], ways: tuple[str, str], words: Mapping[str, tuple[str, str]], units: Sequence[str]
) -> Figure:
    """A panel a curve: the unknown cause's force against the motion, both ways, with a band of two standard errors.

    words: variable -> (what it is called, its unit). units: of each curve's force (N) or torque (N m).
    """
    boxes, height = _boxes(len(shown), columns=min(2, max(len(shown), 1)), panel=300, gap_x=GAP_X_TITLED)
    data: list[dict[str, Any]] = []
    layout = _layout("The unknown cause: force against the motion", height)
    for number, (curve, box, of) in enumerate(zip(shown, boxes, units, strict=True), start=1):
        name, unit = words.get(curve.over, (curve.over, ""))
        both = ((curve.forward, curve.std_forward), (curve.backward, curve.std_backward))
        for way, (values, error) in enumerate(both):
            data.append(_band(curve.at, values, 2.0 * error, way, number))
            data.append(_line(curve.at, values, ways[way], way, of, number, number == 1))
        _panel(layout, number, box, f"{name} ({unit})" if unit else name)
        layout[f"yaxis{number}"]["title"] = {
            "text": f"{'force' if of == 'N' else 'torque'} at the {curve.acts_on} ({of})"
        }
        heading = f"<b>{name}</b><br>explains {100.0 * curve.explains:.0f} %"
        layout["annotations"].append(_above(heading, box))
    return _figure(data, layout)


def _line(x: Array, y: Array, name: str, way: int, unit: str, number: int, legend: bool) -> dict[str, Any]:
    colour, dash = SPARE[way]
    return {
        "type": "scatter", "mode": "lines+markers", "x": x, "y": _gaps(y), "name": name, "legendgroup": name,
        "showlegend": legend, "line": {"color": colour, "dash": dash, "width": 1.8},
        "marker": {"symbol": MARKERS[way], "size": 6, "color": colour}, "xaxis": f"x{number}", "yaxis": f"y{number}",
        "hovertemplate": f"%{{y:.3~g}} {unit}",
    }  # fmt: skip


def _band(x: Array, y: Array, error: Array, way: int, number: int) -> dict[str, Any]:
    """The outline of y ± error; what is unknown is left out."""
    known = np.isfinite(x) & np.isfinite(y) & np.isfinite(error)
    x, y, error = x[known], y[known], error[known]
    red, green, blue = (int(SPARE[way][0][i : i + 2], 16) for i in (1, 3, 5))
    return {
        "type": "scatter", "mode": "lines", "x": np.concatenate([x, x[::-1]]),
        "y": np.concatenate([y + error, (y - error)[::-1]]), "fill": "toself", "line": {"width": 0},
        "fillcolor": f"rgba({red},{green},{blue},0.25)", "showlegend": False, "hoverinfo": "skip",
        "xaxis": f"x{number}", "yaxis": f"y{number}",
    }  # fmt: skip


def _gaps(values: Array) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]


def _largest(*values: Array) -> float:
    every = np.concatenate(values)
    return float(np.max(np.abs(every[np.isfinite(every)]), initial=0.0))


def _most(share: Array) -> float:
    return float(np.nanmax(share)) if np.any(share > 0.0) else 1.0


Box = tuple[list[float], list[float]]


def _boxes(count: int, columns: int = COLUMNS, panel: int = PANEL, gap_x: float = GAP_X) -> tuple[list[Box], int]:
    """The domains of so many panels, and the figure's height."""
    columns = min(columns, max(count, 1))
    rows = max(-(-count // columns), 1)
    inner = rows * panel + (rows - 1) * BETWEEN
    width = (1.0 - gap_x * (columns - 1)) / columns
    boxes = []
    for index in range(count):
        row, column = divmod(index, columns)
        left, top = column * (width + gap_x), 1.0 - row * (panel + BETWEEN) / inner
        boxes.append(([left, min(left + width, 1.0)], [max(top - panel / inner, 0.0), min(top, 1.0)]))
    return boxes, inner + TOP + BOTTOM


def _layout(title: str, height: int) -> dict[str, Any]:
    return {
        "template": TEMPLATE,
        "height": height,
        "title": heading(title, height),
        "legend": {"y": 1.0 - 68.0 / height, "traceorder": "normal"},
        "margin": {"t": TOP, "b": BOTTOM},
        "annotations": [],
        "barmode": "overlay",
        "bargap": 0.0,
    }


def _panel(layout: dict[str, Any], number: int, box: Box, x_title: str) -> None:
    layout[f"xaxis{number}"] = {
        "domain": box[0], "anchor": f"y{number}", "title": {"text": x_title, "font": {"size": 12}}, "nticks": 6,
    }  # fmt: skip
    layout[f"yaxis{number}"] = {"domain": box[1], "anchor": f"x{number}"}


def _above(text: str, box: Box) -> dict[str, Any]:
    return {
        "text": text, "x": box[0][0], "y": box[1][1], "xref": "paper", "yref": "paper", "xanchor": "left",
        "yanchor": "bottom", "yshift": 3, "showarrow": False, "font": {"size": 11}, "align": "left",
    }  # fmt: skip


def _figure(data: list[dict[str, Any]], layout: dict[str, Any]) -> Figure:
    import plotly.graph_objects as go

    # Plotly calls the first axes x and y, without a number.
    layout |= {axis: layout.pop(f"{axis}1") for axis in ("xaxis", "yaxis") if f"{axis}1" in layout}
    return go.Figure({"data": data, "layout": layout})
