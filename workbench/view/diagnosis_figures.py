"""The figures of a diagnosis: runs over time, what the gap depends on, the verdict, how far the gap shrinks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.names import powers
from workbench.core.numbers import whole_percent
from workbench.core.run import Array
from workbench.diagnose.diagnose import Diagnosis
from workbench.diagnose.location.profiles import Profile
from workbench.diagnose.residual_tests import ResidualTest
from workbench.machines import plant_of
from workbench.metrics import set_of
from workbench.view import style
from workbench.view.replay import Line, Stretches, run_panels, spans, torque_residual
from workbench.view.style import Figure

if TYPE_CHECKING:
    from workbench.diagnose.tables import Curve
    from workbench.study.consequences import Consequences

COLUMNS, BETWEEN = 3, 96  # panels side by side; px between two rows
MOST_RUNS = 12  # that are drawn, those with most of the gap's energy
SHARE_ROOM = 3.0  # the bars of the energy's share fill a third of a panel
COLOURS = {"named": style.BLUE, "unknown": style.PURPLE, "no_gap": style.GREY, "": style.FAINT}
ROOM = 1.18  # over the highest bar, for its number
ALL = "all runs"


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
    changed, speed = d.corrected != d.refitted, plant_of(d.refitted).speeds[0]
    windows = d.where.windows if d.where else ()
    energy = {run.name: run.share for run in d.delivered.runs if d.where}
    kept = sorted(range(len(refitted.runs)), key=lambda j: -energy.get(refitted.runs[j].name, 0.0))[:most]
    series = []
    for run, better in ((refitted.runs[j], corrected.runs[j]) for j in sorted(kept)):
        balance, name, per_cent = run.balance, run.name, 100.0 / run.speed_scale
        series.append(
            RunSeries(
                name=name,
                time_s=balance.run.time_s,
                measured=balance.measured,
                before=np.where(balance.inside, balance.predicted, np.nan),  # an end that is cut off foretells nothing
                after=np.where(balance.inside, better.balance.predicted, np.nan) if changed else None,
                speed=per_cent * balance.motion.speed,
                speed_before=per_cent * run.simulated[speed],
                speed_after=per_cent * better.simulated[speed] if changed else None,
                moving=balance.moving,
                windows=tuple((w.from_s, w.to_s) for w in windows if w.run == name),
                rests=tuple(spans(balance.run.time_s, ~balance.moving)),
                said=f"{100.0 * energy[name]:.0f} % of the gap's energy" if name in energy else "",
            )
        )
    return tuple(series)


# Runs over time


def autocorrelations(tests: Sequence[ResidualTest]) -> Figure:
    """The autocorrelation of each run's residual over the lag, with its 95 and 99 % bounds."""
    stem, drawn = style.look(style.BLACK, width=1.6), []
    for test in tests:
        lags, nothing = test.lags_s, np.full(len(test.lags_s), np.nan)  # between two stems
        x, y = np.stack([lags, lags, lags], 1).ravel(), np.stack([0.0 * lags, test.autocorrelation, nothing], 1).ravel()
        bounds = [
            Line(f"{name} bound", lags, sign * bound, style.look(style.GREY, dash, 1.4))
            for name, bound, dash in (("95 %", test.bound_95, "2px,2px"), ("99 %", test.bound_99, style.NOISE_DASH))
            for sign in (1.0, -1.0)
        ]
        drawn.append([Line("autocorrelation", x, y, stem), *bounds])
    names = [test.run for test in tests]
    figure = run_panels("Autocorrelation of what is left", "autocorrelation", names, drawn, x_title="lag (s)")
    return figure.update_xaxes(range=[0.0, max(test.lags_s[-1] + 0.5 * test.lags_s[0] for test in tests)])


def inputs(runs: Sequence[RunSeries], unit: str) -> Figure:
    """Measured input and what the machine before its correction predicts; the gap's windows shaded."""
    quantity = "torque" if unit == "N m" else "force"
    names = [f"{run.name}</b>, {run.said}<b>" if run.said else run.name for run in runs]
    drawn = [
        [
            Line("measured", run.time_s, run.measured, style.MEASURED),
            Line(run.before_is("predicted"), run.time_s, run.before, style.LINE_BEFORE),
        ]
        for run in runs
    ]
    windows = [[(run.windows, style.WINDOW)] for run in runs]
    return run_panels(f"Measured and predicted {quantity}", f"{quantity} ({unit})", names, drawn, unit, windows)


def residuals(runs: Sequence[RunSeries], unit: str, noise_rms: float) -> Figure:
    """Measured minus predicted input while moving, before and after; dashed: ± twice the noise. Rests are grey."""
    # At rest it says nothing, so nothing is drawn there.
    before = [np.where(run.moving, run.measured - run.before, np.nan) for run in runs]
    after = [np.where(run.moving, run.measured - run.after, np.nan) for run in runs if run.after is not None]
    largest = max((float(np.nanmax(np.abs(left), initial=0.0)) for left in before), default=0.0)
    return torque_residual(
        [run.name for run in runs], [run.time_s for run in runs], after or before, unit, noise_rms,
        before if after else (), max(4.0 * noise_rms, 1.15 * largest), [run.windows for run in runs],
        [run.rests for run in runs], style.LINE_BEFORE,
    )  # fmt: skip


def speeds(runs: Sequence[RunSeries], scale: str) -> Figure:
    """Measured speed, and the open-loop replay of the machine before and after; scale: what the per cent are of."""
    names, drawn = [], []
    for run in runs:
        lines = [Line(run.before_is("replayed"), run.time_s, run.speed_before, style.LINE_BEFORE)]
        if run.speed_after is not None:
            lines.append(Line("replayed after", run.time_s, run.speed_after, style.LINE_AFTER))
        errors = [f"{float(np.sqrt(np.mean((line.y - run.speed) ** 2))):.2f} %" for line in lines]
        names.append(f"{run.name}</b>, RMSE {' → '.join(errors)}<b>")
        drawn.append([Line("measured", run.time_s, run.speed, style.MEASURED), *lines])
    return run_panels(f"Speed replayed open loop, in % of {scale}", "speed (%)", names, drawn, "%")


# Panels with a horizontal axis each


def _panels(title: str, heads: Sequence[str], columns: int, panel: int, gap: float) -> Figure:
    """Empty panels, each below its head; the lines' vertical axis is the second, over that of the bars."""
    from plotly.subplots import make_subplots

    columns = min(columns, max(len(heads), 1))
    rows = max(-(-len(heads) // columns), 1)
    inner = rows * panel + (rows - 1) * BETWEEN
    height = inner + 180
    figure = make_subplots(
        rows, columns, subplot_titles=heads, specs=[[{"secondary_y": True}] * columns] * rows,
        horizontal_spacing=gap if columns > 1 else None, vertical_spacing=BETWEEN / inner if rows > 1 else None,
    )  # fmt: skip
    layout = figure.to_dict()["layout"]  # written at once: plotly takes milliseconds for each change
    across, up = ([axis for name, axis in layout.items() if name.startswith(kind)] for kind in ("xaxis", "yaxis"))
    for axis, own in [*((axis, {"nticks": 6}) for axis in across), *((axis, {"side": "left"}) for axis in up)]:
        axis.update(own, title={"font": {"size": 12}})
    for note, axis in zip(layout.get("annotations", ()), across, strict=False):
        note.update(x=axis["domain"][0], xanchor="left", yshift=3, font={"size": 11}, align="left")
    figure.layout = layout | {
        "template": style.TEMPLATE, "height": height, "title": style.heading(title, height), "barmode": "overlay",
        "bargap": 0.0, "legend": style.legend(height), "margin": {"t": 124, "b": 56},
    }  # fmt: skip
    return figure


def profiles(shown: Sequence[Profile], unit: str, ways: tuple[str, str]) -> Figure:
    """A panel a variable, as many as are given: mean residual in each bin, forward and backward; grey: energy's share.

    The scale is common to all panels, so that they compare at a glance. A spectrum has no mean: what one
    wave takes of the energy fills the panel, over frequency on a logarithmic axis. ways: what the two directions are
    called.
    """
    heads = []
    for profile in shown:
        name, _, best = profile.label.partition(", ")
        low, high = (round(100.0 * x) for x in profile.interval)
        explains = f"explains {whole_percent(profile.explains)}" + ("" if low > 99 else f" ({low} to {high})")
        heads.append(f"<b>{name}</b><br>{f'{best}, {explains}' if best else explains}")
    figure = _panels(f"Mean residual ({unit}) over what may explain it", heads, COLUMNS, 190, 0.055)
    means = np.concatenate([[0.0], *(values for p in shown for values in (p.mean_forward, p.mean_backward))])
    largest = float(np.nanmax(np.abs(means))) or 1.0
    for k, profile in enumerate(shown):
        panel = {"row": k // COLUMNS + 1, "col": k % COLUMNS + 1}
        share, name = 100.0 * profile.share, profile.label.partition(", ")[0]
        most = float(np.nanmax(share)) if np.any(share > 0.0) else 100.0
        figure.update_xaxes(title_text=name if profile.unit in ("", "1") else f"{name} ({profile.unit})", **panel)
        bars = {"name": "share of the gap's energy (grey)", "legendgroup": "share", "hovertemplate": "%{y:.1f} %"}
        if is_spectrum(profile):
            figure.add_scatter(
                x=profile.edges, y=_gaps(np.append(share, share[-1])), mode="lines", fill="tozeroy",
                fillcolor=style.FAINT, line={"shape": "hv", "color": style.GREY, "width": 1.2}, **bars, **panel,
            )  # fmt: skip
            title = "one wave's share of the energy" if k % COLUMNS == 0 else ""
            wide = profile.edges[-1] > 30.0 * profile.edges[0]
            ticks = [float(f"{n}e{k}") for k in range(-4, 5) for n in ((1,) if wide else (1, 2, 5))]
            figure.update_xaxes(type="log", tickvals=ticks, ticktext=[f"{at:g}" for at in ticks], **panel)
            figure.update_yaxes(range=[0.0, 1.15 * most], ticksuffix=" %", title_text=title, **panel, secondary_y=False)
            continue
        middle = (profile.edges[1:] + profile.edges[:-1]) / 2.0
        grey = {"color": style.FAINT, "line_width": 0}
        figure.add_bar(x=middle, y=share, width=np.diff(profile.edges), marker=grey, **bars, **panel)
        for way, values in enumerate((profile.mean_forward, profile.mean_backward)):
            figure.add_scatter(**_line(middle, values, ways[way], way, unit), **panel, secondary_y=True)
        if profile.variable == "direction":  # a sign: backward or forward
            figure.update_xaxes(tickvals=list(middle), ticktext=list(ways[::-1]), **panel)
        figure.update_yaxes(
            range=[0.0, SHARE_ROOM * most], showticklabels=False, showgrid=False, ticks="", showline=False,
            zeroline=False, **panel, secondary_y=False,
        )  # fmt: skip
        figure.update_yaxes(
            range=[-1.15 * largest, 1.15 * largest], nticks=7, tickmode="auto", **panel, secondary_y=True,
            title_text=f"mean residual ({unit})" if k % COLUMNS == 0 else "",
        )  # fmt: skip
    return _once_in_the_legend(figure)


def curves(
    shown: Sequence[Curve], ways: tuple[str, str], words: Mapping[str, tuple[str, str]], units: Sequence[str],
    law: Array | None = None,
) -> Figure:  # fmt: skip
    """A panel a curve: the unknown cause's force against the motion, both ways, with a band of two standard errors.

    law: (2 points,) a law in a formula over the first curve's points, forward, then backward; it is drawn at their mean
    level, for base parameters take levels up. words: variable -> (what it is called, its unit). units: of each curve's
    force (N) or torque (N m).
    """
    names = [words.get(curve.over, (curve.over, "")) for curve in shown]
    explains = [f"<br>explains {whole_percent(curve.explains)}" if curve.explains > 0.0 else "" for curve in shown]
    heads = [f"<b>{name}</b>{said}" for (name, _), said in zip(names, explains, strict=True)]
    figure = _panels("The unknown cause: what acts against the motion", heads, 2, 300, 0.1)
    for k, (curve, (name, unit), of) in enumerate(zip(shown, names, units, strict=True)):
        panel = {"row": k // 2 + 1, "col": k % 2 + 1}
        both = ((curve.forward, curve.std_forward), (curve.backward, curve.std_backward))
        for way, (values, error) in enumerate(both):
            known = np.isfinite(curve.at) & np.isfinite(values) & np.isfinite(error)
            x, y, reach = curve.at[known], values[known], 2.0 * error[known]
            figure.add_scatter(
                x=np.concatenate([x, x[::-1]]), y=np.concatenate([y + reach, (y - reach)[::-1]]), mode="lines",
                fill="toself", line={"width": 0}, fillcolor=style.faint(style.SPARE[way][0], 0.25), showlegend=False,
                hoverinfo="skip", **panel,
            )  # fmt: skip
            figure.add_scatter(**_line(curve.at, values, ways[way], way, of), **panel)
            if law is not None and k == 0:
                levels = np.split(law, 2)[way]
                levels = levels + np.mean((values - levels)[known])
                said = _line(curve.at, levels, f"law, {ways[way]}", way, of) | {"mode": "lines"}
                figure.add_scatter(**said | {"line": style.look(style.BLACK, style.SPARE[way][1], 2.4)}, **panel)
        figure.update_xaxes(title_text=f"{name} ({unit})" if unit else name, **panel)
        quantity = "force" if of == "N" else "torque"
        figure.update_yaxes(title_text=f"{quantity} at the {curve.acts_on} ({of})", **panel, secondary_y=False)
    return _once_in_the_legend(figure)


def _line(x: Array, y: Array, name: str, way: int, unit: str) -> dict[str, Any]:
    colour, dash = style.SPARE[way]
    return {
        "mode": "lines+markers", "x": x, "y": _gaps(y), "name": name, "legendgroup": name,
        "line": {"color": colour, "dash": dash, "width": 1.8}, "hovertemplate": f"%{{y:.3~g}} {unit}",
        "marker": {"symbol": style.MARKERS[way], "size": 6, "color": colour},
    }  # fmt: skip


def _gaps(values: Array) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]


def _once_in_the_legend(figure: Figure) -> Figure:
    known: set[str] = set()
    for trace in figure.data:
        if trace.showlegend is not False:
            trace.showlegend = trace.legendgroup not in known
            known.add(trace.legendgroup)
    return figure


def is_spectrum(profile: Profile) -> bool:
    """Whether a profile has no mean in any bin, only its share of the energy."""
    return not np.any(np.isfinite([profile.mean_forward, profile.mean_backward]))


def worth_a_panel(profile: Profile) -> bool:
    """A wave that explains nothing is nothing to look at; what a mean does not explain is."""
    return not is_spectrum(profile) or profile.explains >= 0.005


# Verdict, shrink, consequences


def ranking(rows: Sequence[tuple[str, str, float]]) -> Figure:
    """Horizontal bars. rows: (named, unknown, no_gap or "" for a rest, what stands beside the bar, probability)."""
    bars = {
        "type": "bar", "orientation": "h", "x": [round(100.0 * p, 4) for *_, p in rows],
        "y": [name for _, name, _ in rows],
        "text": [percent(p) for *_, p in rows], "textposition": "outside", "cliponaxis": False, "showlegend": False,
        "marker": {"color": [COLOURS[word] for word, *_ in rows]}, "hovertemplate": "%{y}: %{x:.2f} %<extra></extra>",
    }  # fmt: skip
    return style.figure(
        "Probability of each hypothesis", 112 + 30 * max(len(rows), 2), [bars], bargap=0.3,
        margin={"l": 12, "t": 48, "r": 84},  # room for "> 99.9 %"
        xaxis={"title": {"text": "probability (%)"}, "range": [0, 100], "zeroline": False},
        yaxis={"autorange": "reversed", "type": "category", "ticks": ""},
    )  # fmt: skip


def percent(probability: float) -> str:
    """A probability in per cent, with one more digit near 0 and 1."""
    p = 100.0 * probability
    if p < 0.1 or p > 99.9:
        return "< 0.1 %" if p < 0.1 else "> 99.9 %"
    return f"{p:.1f} %" if p < 10.0 or p > 99.0 else f"{p:.0f} %"


def isolability(names: Sequence[str], angle: Array, chosen: Sequence[str] = ()) -> Figure:
    """Angles between signatures, degrees, (k, k), as the lower triangle: 0° is one and the same, 90° unmistakable.

    chosen: names that are set in bold. k is at least 2.
    """
    below = np.where(np.tri(len(names), k=-1, dtype=bool), angle, np.nan)[1:, :-1]  # the others are empty
    labels = [f"<b>{name}</b>" if name in chosen else name for name in names]
    # Small angles stand out: vermillion where two effects leave the same mark, white at right angles.
    heat = {
        "type": "heatmap", "x": labels[:-1], "y": labels[1:], "z": [_gaps(np.round(row, 2)) for row in below],
        "zmin": 0.0, "zmax": 90.0, "xgap": 1, "ygap": 1, "hoverongaps": False,
        "colorscale": [[0.0, "#D55E00"], [0.17, "#E69F00"], [0.5, "#F8E6C0"], [1.0, "#FFFFFF"]],
        "text": [["" if np.isnan(v) else f"{v:.0f}" for v in row] for row in below],
        "texttemplate": "%{text}", "textfont": {"size": 10},  # dark or light as the cell asks for
        "colorbar": {"title": {"text": "angle (°)", "side": "right"}, "thickness": 14, "tickvals": [*range(0, 91, 15)]},
        "hovertemplate": "%{y} and %{x}: %{z:.1f}°<extra></extra>",
    }  # fmt: skip
    axis = {"type": "category", "showgrid": False, "ticks": "", "tickfont": {"size": 11}}
    return style.figure(
        "Angle between the marks that two effects leave in these runs", 240 + 27 * max(len(names) - 1, 3), [heat],
        margin={"l": 12, "t": 48, "r": 20, "b": 12}, xaxis=axis | {"tickangle": -50},
        yaxis=axis | {"autorange": "reversed"},
    )  # fmt: skip


def shrink_bars(
    by_run: Mapping[str, tuple[float, float]], together: tuple[float, float], noise: float, unit: str
) -> Figure:
    """Two bars a run and two for all of them, rms in `unit`; dashed: the noise floor in the same band."""
    rows = {**by_run, f"<b>{ALL}</b>": together} if len(by_run) != 1 else dict(by_run)
    names, height = list(rows), 380
    data: list[dict[str, Any]] = [
        {
            "type": "bar", "x": names, "y": values, "name": name, "marker": {"color": colour},
            "text": [powers(f"{value:#.3g}") for value in values], "textposition": "outside", "textangle": 0,
            "cliponaxis": False, "textfont": {"size": 11},
            "hovertemplate": f"%{{x}}, {name}: %{{y:.4~g}} {unit}<extra></extra>",
        }
        for name, colour, values in zip(
            ("before", "after"), (style.BEFORE, style.AFTER), zip(*rows.values(), strict=True), strict=True)
    ]  # fmt: skip
    # A line of the whole width is a shape; this one only stands for it in the legend.
    floor = {"name": powers(f"noise floor, {noise:.2g} {unit}"), "mode": "lines", "line": style.NOISE}
    across = {"type": "line", "x0": 0, "x1": 1, "y0": noise, "y1": noise, "xref": "x domain", "yref": "y"}
    highest = max([noise, *(value for both in rows.values() for value in both)]) or 1.0
    return style.figure(
        f"Residual on held-out runs, rms ({unit})", height,
        [*data, {"type": "scatter", "x": names[:1], "y": [noise], "hoverinfo": "skip", **floor}],
        legend=style.legend(height, 64.0), margin={"t": 80}, barmode="group", bargap=0.3,
        shapes=[across | {"line": style.NOISE}],
        xaxis={"type": "category", "categoryorder": "array", "categoryarray": names},
        yaxis={"title": {"text": f"residual, rms ({unit})"}, "range": [0.0, ROOM * highest]},
    )  # fmt: skip


def consequences(found: Consequences, height: int = 620) -> Figure:
    """What the effects change in the control study: torque peak and largest speed error, a panel each.

    Two bars a payload and reference. Before: light and hatched. After: solid, with its change in per cent above it.
    Where a run failed "failed" stands in place of its bar. The dotted line is one motor's nominal torque.
    """
    from plotly.subplots import make_subplots

    kind, rows, names = found.study.kind, found.rows, found.effects
    judged, figure = set_of(kind.name), make_subplots(2, 1, vertical_spacing=0.1)
    for level, metric in enumerate((judged.by_name[judged.peak], judged.by_name[judged.error]), 1):
        panel = {"row": level, "col": 1}
        highest = max((metric.scale * run[metric.name] for row in rows for run in (row.before, row.after) if run.ok),
                      default=1.0) or 1.0  # fmt: skip
        for reference in dict.fromkeys(row.reference for row in rows):
            own, colour = [row for row in rows if row.reference == reference], style.line(reference)["color"]
            for when in ("before", "after"):
                runs, name = [getattr(row, when) for row in own], f"{reference}, {when}"
                values = [metric.scale * run[metric.name] if run.ok else 0.0 for run in runs]
                changes = ["" if when == "before" else _change(row.percent(metric.name)) for row in own]
                fill: dict[str, Any] = {"color": colour, "line": {"color": colour, "width": 1.2}}
                if when == "before":
                    hatched = {"shape": "/", "fgcolor": colour, "size": 7}
                    fill |= {"color": style.faint(colour, 0.18), "pattern": hatched}
                figure.add_bar(
                    name=name, legendgroup=name, offsetgroup=name, showlegend=level == 1, marker=fill, y=values,
                    x=[f"{row.payload_kg:g} kg" if kind.payload else "there and back" for row in own],
                    text=[change if run.ok else "failed" for run, change in zip(runs, changes, strict=True)],
                    textposition="outside", textfont_size=11, textangle=0, cliponaxis=False,
                    hovertext=[run.reason or f"{value:.4g} {metric.shown_unit}"
                               for run, value in zip(runs, values, strict=True)],
                    hovertemplate="%{x}: %{hovertext}", **panel,
                )  # fmt: skip
        if level == 1 and found.nominal is not None:
            highest = max(highest, found.nominal)
            figure.add_hline(
                found.nominal, line={"color": style.GREY, "width": 1.2, "dash": "dot"},
                annotation={"text": f"nominal {found.nominal:.4g} N m", "font": {"size": 11, "color": style.GREY}},
                annotation_position="top left", **panel,
            )  # fmt: skip
        title = f"{metric.label}<br>({metric.shown_unit})"
        figure.update_yaxes(title_text=title, range=[0.0, 1.16 * highest], **panel)  # room for what stands above
    figure.update_xaxes(title_text="payload" if kind.payload else "", row=2, col=1)
    title = "Control study before and after"
    title += f": {' and '.join(names)}" if 0 < len(names) <= 2 else " the correction"
    return figure.update_layout(
        template=style.TEMPLATE, height=height, barmode="group", bargap=0.25, hovermode="closest", margin_t=88,
        title=style.heading(title, height), legend=style.legend(height, 72.0),
    )  # fmt: skip


def _change(percent: float) -> str:
    if not math.isfinite(percent):
        return ""
    return f"{percent:+.1f} %" if abs(percent) >= 0.05 else "±0 %"
