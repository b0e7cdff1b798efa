"""The figures of a diagnosis: runs over time, what the gap depends on, the verdict, how far the gap shrinks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.names import powers
from workbench.core.run import Array
from workbench.diagnose.diagnose import Diagnosis
from workbench.diagnose.location.profiles import Profile
from workbench.diagnose.residual_tests import ResidualTest
from workbench.diagnose.tables import Curve
from workbench.machines import plant_of
from workbench.view.panels import ranges_below_names
from workbench.view.replay import run_grid, runs_figure, stretches, torque_residual
from workbench.view.style import (
    AFTER,
    BEFORE,
    BLACK,
    BLUE,
    FAINT,
    GREY,
    LINE_AFTER,
    LINE_BEFORE,
    MARKERS,
    MEASURED,
    NOISE,
    NOISE_DASH,
    PURPLE,
    SPARE,
    TEMPLATE,
    WINDOW,
    heading,
)

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MOST_RUNS = 12  # that are drawn, those with most of the gap's energy
COLUMNS = 3
PANEL, BETWEEN, TOP, BOTTOM = 190, 96, 124, 56  # px
GAP_X, GAP_X_TITLED = 0.055, 0.1  # of the width, between panels; where each has a title of its own
SHARE_ROOM = 3.0  # the bars of the energy's share fill a third of a panel
COLOURS = {"named": BLUE, "unknown": PURPLE, "no_gap": GREY, "": FAINT}
BAR, AROUND = 30, 112  # px
CELL, LABELS = 27, 240  # px
BARS_HEIGHT = 380
ROOM = 1.18  # over the highest bar, for its number
ALL = "all runs"
Stretches = Sequence[tuple[float, float]]
Box = tuple[list[float], list[float]]


@dataclass(frozen=True)
class RunSeries:
    """One run under the machine before and after its correction; all arrays (n,).

    measured, before, after: the input, N m (N), low-passed alike. speed, speed_before, speed_after: of the driven
    coordinate, measured and replayed open loop, in per cent of the machine's speed scale. windows: where most of the
    gap's energy lies. rests: what is left out, at rest and at the ends. after and speed_after are None where nothing
    was corrected. said: what stands beside the name.
    """

    name: str
    time_s: Array
    measured: Array
    before: Array
    after: Array | None
    speed: Array
    speed_before: Array
    speed_after: Array | None
    moving: np.ndarray
    windows: Stretches = ()
    rests: Stretches = ()
    said: str = ""

    def before_is(self, what: str) -> str:
        """Where nothing was corrected there is no before."""
        return what if self.after is None else f"{what} before"


def series_of(d: Diagnosis, most: int = MOST_RUNS) -> tuple[RunSeries, ...]:
    """Balances and open-loop replays of the refitted machine and, where it differs, of the corrected one.

    At most `most` runs: those with the largest energy of the gap, in the order of the campaign.
    """
    refitted, corrected = d.replayed()
    speed = plant_of(d.refitted).speeds[0]
    windows = () if d.where is None else d.where.windows
    energy = {} if d.where is None else d.where.energy_by_run
    kept = sorted(range(len(refitted.runs)), key=lambda j: -energy.get(refitted.runs[j].name, 0.0))[:most]
    series = []
    for j in sorted(kept):
        run, better = refitted.runs[j], None if d.corrected == d.refitted else corrected.runs[j]
        name, balance = run.name, run.balance
        series.append(
            RunSeries(
                name,
                balance.run.time_s,
                balance.measured,
                balance.predicted,
                None if better is None else better.balance.predicted,
                100.0 * balance.motion.speed / run.speed_scale,
                100.0 * run.simulated[speed] / run.speed_scale,
                None if better is None else 100.0 * better.simulated[speed] / better.speed_scale,
                balance.moving,
                tuple((w.from_s, w.to_s) for w in windows if w.run == name),
                tuple(stretches(balance.run.time_s, ~balance.moving)),
                f"{100.0 * energy[name]:.0f} % of the gap's energy" if name in energy else "",
            )
        )
    return tuple(series)


def autocorrelations(tests: Sequence[ResidualTest]) -> Figure:
    """The autocorrelation of each run's residual over the lag, with its 95 and 99 % bounds."""
    panels, places, height = run_grid("Autocorrelation of what is left", "autocorrelation", [t.run for t in tests])
    panels.x_title = "lag (s)"
    bar = {"color": BLACK, "dash": "solid", "width": 1.6}
    for test, place in zip(tests, places, strict=True):
        for lag, value in zip(test.lags_s, test.autocorrelation, strict=True):
            panels.line(*place, np.array([lag, lag]), np.array([0.0, value]), "autocorrelation", bar)
        for name, bound, dash in (("95 %", test.bound_95, "2px,2px"), ("99 %", test.bound_99, NOISE_DASH)):
            for sign in (1.0, -1.0):
                panels.line(*place, test.lags_s, sign * bound, f"{name} bound", {"color": GREY, "dash": dash})
    drawn = [[t.autocorrelation, t.bound_99, -t.bound_99] for t in tests]
    return runs_figure(panels, height, places, ranges_below_names(places, drawn))


def inputs(runs: Sequence[RunSeries], unit: str) -> Figure:
    """Measured input and what the machine before its correction predicts; the gap's windows shaded."""
    quantity = "torque" if unit == "N m" else "force"
    names = [f"{run.name}</b>, {run.said}<b>" if run.said else run.name for run in runs]
    panels, places, height = run_grid(f"Measured and predicted {quantity}", f"{quantity} ({unit})", names)
    for run, place in zip(runs, places, strict=True):
        panels.line(*place, run.time_s, run.measured, "measured", MEASURED, unit)
        panels.line(*place, run.time_s, run.before, run.before_is("predicted"), LINE_BEFORE, unit)
        for start, end in run.windows:
            panels.shade(*place, start, end, WINDOW)
    return runs_figure(panels, height, places, ranges_below_names(places, [[r.measured, r.before] for r in runs]))


def residuals(runs: Sequence[RunSeries], unit: str, noise_rms: float) -> Figure:
    """Measured minus predicted input while moving, before and after; dashed: ± twice the noise. Rests are grey."""
    # At rest it says nothing, so nothing is drawn there.
    before = [np.where(run.moving, run.measured - run.before, np.nan) for run in runs]
    after = [np.where(run.moving, run.measured - run.after, np.nan) for run in runs if run.after is not None]
    largest = max((float(np.nanmax(np.abs(left), initial=0.0)) for left in before), default=0.0)
    return torque_residual(
        [run.name for run in runs],
        [run.time_s for run in runs],
        after or before,
        unit,
        noise_rms,
        windows=[run.windows for run in runs],
        rests=[run.rests for run in runs],
        before=before if after else (),
        limit=max(4.0 * noise_rms, 1.15 * largest),
        alone=LINE_BEFORE,
    )


def speeds(runs: Sequence[RunSeries], scale: str) -> Figure:
    """Measured speed, and the open-loop replay of the machine before and after; scale: what the per cent are of."""
    names, drawn = [], []
    for run in runs:
        lines = [run.speed_before, *([] if run.speed_after is None else [run.speed_after])]
        errors = [f"{float(np.sqrt(np.mean((speed - run.speed) ** 2))):.2f} %" for speed in lines]
        names.append(f"{run.name}</b>, RMSE {' → '.join(errors)}<b>")
        drawn.append([run.speed, *lines])
    panels, places, height = run_grid(f"Speed replayed open loop, in % of {scale}", "speed (%)", names)
    for run, place in zip(runs, places, strict=True):
        panels.line(*place, run.time_s, run.speed, "measured", MEASURED, "%")
        panels.line(*place, run.time_s, run.speed_before, run.before_is("replayed"), LINE_BEFORE, "%")
        if run.speed_after is not None:
            panels.line(*place, run.time_s, run.speed_after, "replayed after", LINE_AFTER, "%")
    return runs_figure(panels, height, places, ranges_below_names(places, drawn))


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
    shown: Sequence[Curve],
    ways: tuple[str, str],
    words: Mapping[str, tuple[str, str]],
    units: Sequence[str],
    law: Array | None = None,
) -> Figure:
    """A panel a curve: the unknown cause's force against the motion, both ways, with a band of two standard errors.

    law: (2 points,) a law in a formula over the first curve's points, forward, then backward.

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
        if law is not None and number == 1:
            for way, values in enumerate(np.split(law, 2)):
                said = _line(curve.at, values, f"law, {ways[way]}", way, of, number, True)
                data.append(said | {"mode": "lines", "line": said["line"] | {"dash": "dot", "width": 3}})
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


def ranking(rows: Sequence[tuple[str, str, float]]) -> Figure:
    """Horizontal bars. rows: (named, unknown, no_gap or "" for a rest, what stands beside the bar, probability)."""
    import plotly.graph_objects as go

    height = AROUND + BAR * max(len(rows), 2)
    bars = {
        "type": "bar", "orientation": "h", "x": [100.0 * p for *_, p in rows], "y": [name for _, name, _ in rows],
        "text": [percent(p) for *_, p in rows], "textposition": "outside", "cliponaxis": False, "showlegend": False,
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


def percent(probability: float) -> str:
    """A probability in per cent, with one more digit near 0 and 1."""
    p = 100.0 * probability
    if p < 0.1:
        return "< 0.1 %"
    if p > 99.9:
        return "> 99.9 %"
    return f"{p:.1f} %" if p < 10.0 or p > 99.0 else f"{p:.0f} %"


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
