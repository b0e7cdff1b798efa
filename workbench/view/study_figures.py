"""Figures of a study: runs over time, the torque-speed plane, metrics over what is varied, trade-offs, scatter."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from workbench.core.numbers import signed
from workbench.core.run import Array, Run
from workbench.machines import AnyKind, kind_of
from workbench.metrics import Metric, View, shown_in
from workbench.study.conclude import Correlation
from workbench.study.front import Front
from workbench.study.labels import NO_CHANGE, SweptAxis, drawn_in, metric_label, run_in_words, set_in, shown
from workbench.study.rows import Row, metrics_of
from workbench.study.run import peak_limit
from workbench.view import style
from workbench.view.panels import MOST_POINTS, Panels
from workbench.view.replay import spans
from workbench.view.style import BLACK, GREY, MARKERS, SPARE, Figure, faint, label, line, look

MOST_COLUMNS = 3  # more leave no panel wide enough to read at 1280 px
QUANTITIES = ("speed", "error", "torque", "tension")
QUANTILES = (0.05, 0.5, 0.95)
# Title of a row, weight of its height, what is drawn in it, its unit, the set point drawn beside it.
Drawn = tuple[str, float, Callable[[Run], Array], str, str]
_SETTING = "%{text}<br>%{x:.4~g}, %{y:.4~g}"
Runs = Sequence[tuple[str, Run]]


def few(payloads: Sequence[float]) -> list[float]:
    """The lightest, a middle and the heaviest of more than three payloads."""
    loads = sorted(set(payloads))
    if len(loads) <= MOST_COLUMNS:
        return loads
    return [loads[i] for i in np.linspace(0, len(loads) - 1, MOST_COLUMNS).round().astype(int)]


def harder_worked_nm(run: Run) -> Array:
    """The torque of whichever motor carries more at each time; half the sum where motors are not told apart."""
    if "torque_motor1_nm" not in run or "torque_motor2_nm" not in run:
        return run["torque_motor_nm"] / 2.0
    one, two = run["torque_motor1_nm"], run["torque_motor2_nm"]
    return np.where(np.abs(one) >= np.abs(two), one, two)


_HOIST: dict[str, Drawn] = {
    "speed": ("motor speed<br>(rad/s)", 1.0, lambda run: run["speed_motor_rad_s"], "rad/s", "speed_reference_rad_s"),
    "error": (
        "set point − speed<br>(rad/s)", 0.75, lambda run: run["speed_reference_rad_s"] - run["speed_motor_rad_s"],
        "rad/s", "",
    ),
    "torque": ("torque per motor<br>(N m)", 1.25, harder_worked_nm, "N m", ""),
    "tension": ("wire tension<br>(kN)", 1.0, lambda run: run["tension_drum_n"] / 1000.0, "kN", ""),
}  # fmt: skip


def over_time(
    runs: Runs, machine: AnyKind, title: str = "", window_s: tuple[float, float] | None = None,
    quantities: Sequence[str] = QUANTITIES, height: int = 780,
) -> Figure:  # fmt: skip
    """Named runs of the closed loop over time, against the limits of a machine.

    Hoist: speed and set point, tracking error, torque of the harder-worked motor, wire tension; a column a payload.
    Axis: position and speed with their references, tracking error, force or torque. runs: (reference, run). window_s:
    the stretch of time drawn; without it all. quantities: of a hoist, some of QUANTITIES.
    """
    kind = kind_of(machine)
    loop, unit, drive, rate = kind.looped, kind.moved.unit, kind.drive, kind.moved.speed_unit
    loads, nominal = [], kind.looped.nominal(machine)
    rows = [_HOIST[quantity] for quantity in quantities]
    if loop.position_loop:
        x_ref, v_ref = loop.references
        rows = [
            (f"position<br>({unit})", 1.0, lambda run: run[loop.position], unit, x_ref),
            (f"tracking error<br>(m{unit})", 1.0, lambda run: 1e3 * (run[x_ref] - run[loop.position]), f"m{unit}", ""),
            (f"{'velocity' if unit == 'm' else 'speed'}<br>({rate})", 1.0, lambda run: run[loop.speed], rate, v_ref),
            (f"{drive.quantity}<br>({drive.unit})", 1.25, lambda run: run[kind.plant.input], drive.unit, ""),
        ]
    else:
        loads, every = few([run.payload_kg for _, run in runs]), len({run.payload_kg for _, run in runs})
        title = f"{title} ({len(loads)} of {every} payloads)".strip() if len(loads) < every else title
    heads = [f"payload {p:g} kg" for p in loads] or [""]
    panels = Panels(title, [row[0] for row in rows], heads, row_weights=[row[1] for row in rows], one_cursor=True)
    numbers = {name: k for k, name in enumerate(dict.fromkeys(name for name, _ in runs))}
    for name, run in sorted(runs, key=lambda one: numbers[one[0]]):
        if loads and run.payload_kg not in loads:
            continue
        part, column = _within(run, window_s), loads.index(run.payload_kg) if loads else 0
        for row, (_, _, signal, of, asked) in enumerate(rows):
            panels.line(row, column, part.time_s, signal(part), label(name), line(name, numbers[name]), of)
            if asked:  # its legend entry comes last
                set_point = line("set point", width=1.2)
                panels.line(row, column, part.time_s, part[asked], "set points", set_point, of, legendrank=2000)
        for start, end in slack_stretches(part) if loads and "tension" in quantities else ():
            panels.shade(quantities.index("tension"), column, start, end, style.PURPLE, edge=2.0, text="slack")
    if loop.position_loop or "torque" in quantities:
        row = 3 if loop.position_loop else quantities.index("torque")
        for column in range(len(heads)):  # the lightest payload leaves the most room for the lines' names
            _limits(panels, row, column, nominal, peak_limit(machine), drive.unit, loop.position_loop)
    return panels.figure(height)


def _limits(
    panels: Panels, row: int, column: int, nominal: float | None, limit: float, unit: str, both_ways: bool = False,
    left: bool = False,
) -> None:  # fmt: skip
    """Nominal value and limit, where there is one, named in the first column, at its right or left end."""
    for value, what, dash in ((nominal, "nominal", "dot"), (limit, "limit", "dash")):
        if value is not None and math.isfinite(value):
            panels.level(row, column, value, "" if column else f"{what} {value:.4g} {unit}", dash, left)
            if both_ways:
                panels.level(row, column, -value, "", dash)


def _within(run: Run, window_s: tuple[float, float] | None) -> Run:
    if window_s is None:
        return run
    inside = (run.time_s >= window_s[0]) & (run.time_s <= window_s[1])
    signals = {name: values[inside] for name, values in run.signals.items()}
    return replace(run, time_s=run.time_s[inside], signals=signals)


def slack_stretches(run: Run) -> list[tuple[float, float]]:
    """Start and end (s) of each stretch in which a wire carries nothing."""
    return spans(run.time_s, run["tension_min_n"] <= 0.0) if "tension_min_n" in run else []


def peak_torque_over_payload(
    payload_kg: Array, peaks_nm: Mapping[str, Array], nominal_torque_nm: float, torque_limit_nm: float,
    static_nm: Array | None = None, height: int = 520,
) -> Figure:  # fmt: skip
    """The harder-worked motor's torque peak over payload, a line a reference.

    payload_kg: (n,) rising; peaks_nm: reference -> (n,), NaN where a run failed; static_nm: (n,) the torque per motor
    that holds the load.
    """
    panels = Panels("Torque peak over payload", ["torque peak per motor (N m)"], x_title="payload (kg)")
    for number, (kind, peak) in enumerate(peaks_nm.items()):
        more = {"mode": "lines+markers", "marker": _marker(number, 9)}
        panels.line(0, 0, payload_kg, peak, label(kind), line(kind, number, 2.2), "N m", **more)
    if static_nm is not None:
        held = {"color": GREY, "dash": "2px,2px", "width": 1.5}
        panels.line(0, 0, payload_kg, static_nm, "holding the load", held, "N m")
    _limits(panels, 0, 0, nominal_torque_nm, torque_limit_nm, "N m", left=True)  # where the least torque is
    highest = np.nanmax([torque_limit_nm, nominal_torque_nm, *np.concatenate(list(peaks_nm.values()))])
    return panels.figure(height, y_ranges={0: (0.0, 1.08 * float(highest))}).update_layout(hovermode="x unified")


def envelope_nm(speed_rad_s: Array, torque_nm: float, nominal_speed_rad_s: float, field_weakening: bool) -> Array:
    """Torque (n,) that a motor gives at speeds (n,): constant up to nominal speed, then at constant power."""
    if not field_weakening:
        return np.full_like(speed_rad_s, torque_nm)
    return torque_nm * np.minimum(1.0, nominal_speed_rad_s / np.maximum(np.abs(speed_rad_s), 1e-9))


def plane(runs: Runs, machine: AnyKind, height: int = 560) -> Figure:
    """The harder-worked motor's path in the torque-speed plane; continuous and peak envelope; a column a payload."""
    loads, motor = few([run.payload_kg for _, run in runs]), machine.motor
    panels = Panels(
        "Torque and speed of one motor, in what the drive can give", ["torque per motor (N m)"],
        [f"payload {p:g} kg" for p in loads], x_title="motor speed (rad/s)",
    )  # fmt: skip
    top = motor.nominal_speed_rad_s
    fastest = max([top * 1.15, *(float(np.abs(run["speed_motor_rad_s"]).max()) for _, run in runs)])
    speed = np.linspace(-fastest, fastest, 241)
    envelopes = ((motor.nominal_torque_nm, "continuous", "2px,2px"), (peak_limit(machine), "peak", "6px,3px"))
    for column in range(len(loads)):
        for torque, name, dash in envelopes:
            edge = envelope_nm(speed, torque, top, machine.drive.field_weakening)
            closed = np.concatenate([speed, speed[::-1], speed[:1]]), np.concatenate([edge, -edge[::-1], edge[:1]])
            grey = look(GREY, dash, 1.6)
            panels.line(0, column, *closed, f"{name} {torque:.4g} N m", grey, hoverinfo="skip", hovertemplate=None)
    numbers = {kind: k for k, kind in enumerate(dict.fromkeys(kind for kind, _ in runs))}
    for kind, run in sorted(runs, key=lambda one: numbers[one[0]]):
        if run.payload_kg in loads:
            x, y = _fewer(run["speed_motor_rad_s"], harder_worked_nm(run))
            own, hover = line(kind, numbers[kind], 1.4), "%{x:.4~g} rad/s, %{y:.4~g} N m"
            panels.line(0, loads.index(run.payload_kg), x, y, label(kind), own, hovertemplate=hover)
    return panels.figure(height).update_layout(hovermode="closest")


def _fewer(x: Array, y: Array) -> tuple[Array, Array]:
    """Points of a path where it moves: stretches at rest are left out, corners stay."""
    most, scale = 1400, (np.ptp(x) or 1.0, np.ptp(y) or 1.0)
    length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x) / scale[0], np.diff(y) / scale[1]))])
    if len(x) <= most or length[-1] == 0.0:
        return x, y
    keep = np.searchsorted(length, np.linspace(0.0, length[-1], most)).clip(max=len(x) - 1)
    keep = np.unique(np.concatenate([keep, [np.argmax(y), np.argmin(y), np.argmax(x), np.argmin(x)]]))
    return x[keep], y[keep]


def metrics_over_axis(rows: Sequence[Row], axis: SweptAxis, nominal_nm: float | None, limit_nm: float) -> Figure:
    """The metrics that change along an axis, a panel each; a column a payload, a line a reference.

    Where other fields are swept too, the line is the worst of their runs and a band shows all. torque limits: of
    one motor, or of an axis' drive, which may state none (None, inf).
    """
    good = [row for row in rows if row.ok]
    judged, loads = metrics_of(good), few([row.payload_kg for row in good])
    metrics = changing(good, axis) or list(shown_in(View.SWEEP, judged)[:1])
    heads = [f"payload {p:g} kg" if judged.payload else "" for p in loads]
    titles = [drawn_in(metric.name)[0].axis.replace(" (", "<br>(") for metric in metrics]
    panels = Panels(f"Over {axis.words}", titles, heads, x_title=axis.label)
    x = np.array([point[0] if axis.numeric else k for k, point in enumerate(axis.points)], dtype=float)
    for number, kind in enumerate(dict.fromkeys(row.reference for row in good)):
        own = line(kind, number)
        for column, payload in enumerate(loads):
            by_point = axis.grouped([row for row in good if (row.reference, row.payload_kg) == (kind, payload)])
            for level, metric in enumerate(metrics):
                groups = [[metric.scale * row[metric.name] for row in by_point.get(p, ())] for p in axis.points]
                low, high = (np.array([f(g) if g else np.nan for g in groups]) for f in (min, max))
                worst, other = (low, high) if metric.better == "higher" else (high, low)
                if max(map(len, groups), default=0) > 1:
                    band = np.concatenate([worst, other[::-1]])
                    known = np.isfinite(band)
                    panels.line(
                        level, column, np.concatenate([x, x[::-1]])[known], band[known], f"{label(kind)}: all",
                        {"width": 0}, fill="toself", fillcolor=own["color"], opacity=0.18, hoverinfo="skip",
                        hovertemplate=None, showlegend=False,
                    )  # fmt: skip
                more = {"mode": "lines+markers", "marker": _marker(number, 7)}
                panels.line(level, column, x, worst, label(kind), own, metric.shown_unit, **more)
    for level, metric in enumerate(metrics):
        for column in range(len(loads)) if metric.name == judged.peak else ():  # its panel has the limits in it
            _limits(panels, level, column, nominal_nm, limit_nm, judged.rate_unit)
    figure = panels.figure(max(260 + 150 * len(metrics), 420))
    if not axis.numeric:
        figure.update_xaxes(tickmode="array", tickvals=list(x), ticktext=[shown(point[0]) for point in axis.points])
    elif _even_in_ratio(x):
        figure.update_xaxes(type="log", tickmode="array", tickvals=list(x), ticktext=[f"{v:.3g}" for v in x])
    return figure.update_yaxes(zeroline=False)


def changing(rows: Sequence[Row], axis: SweptAxis) -> list[Metric]:
    """The metrics whose worst value at a point of the axis is not the same along it."""
    cases: dict[tuple[float, str], list[Row]] = {}
    for row in rows:
        cases.setdefault((row.payload_kg, row.reference), []).append(row)
    groups = [axis.grouped(case).values() for case in cases.values()]

    def changes(metric: Metric) -> bool:
        if any(row.metrics.get(metric.name) is None for row in rows):
            return False
        courses = [[metric.worst([row[metric.name] for row in own]) for own in case] for case in groups]
        return any(max(course) - min(course) > NO_CHANGE * max(map(abs, course)) for course in courses)

    return [metric for metric in shown_in(View.SWEEP, metrics_of(rows)) if changes(metric)]


def _even_in_ratio(x: np.ndarray) -> bool:
    """Whether values go in equal ratios rather than in equal steps."""
    if len(x) < 4 or np.min(x) <= 0.0:
        return False
    ratio, step = np.diff(np.log(x)), np.diff(x)
    return bool(np.ptp(ratio) < 0.01 * np.abs(ratio).max() and np.ptp(step) > 0.01 * np.abs(step).max())


def _marker(number: int, size: int) -> dict[str, Any]:
    return {"symbol": MARKERS[number % len(MARKERS)], "size": size}


def pareto(
    rows: Sequence[Row], fronts: Sequence[Front], axes: Sequence[SweptAxis], second: str,
    height: int = 560, chosen: Sequence[Row] = (),
) -> Figure:  # fmt: skip
    """Two costs of all good runs, a panel a payload; the front as steps, the knee with its settings.

    chosen: runs that are pointed out, such as those of the settings at hand.
    """
    first = "move_time_s"
    across, up = drawn_in(first)[0], drawn_in(second)[0]
    titles = [f"payload {front.payload_kg:g} kg" for front in fronts] if len(fronts) > 1 else [""]
    panels = Panels(f"{across.words.capitalize()} against {up.words}", [up.axis], titles, x_title=across.axis)

    def points(column: int, some: Sequence[Row], name: str, own: dict[str, Any], mode: str, **marker: Any) -> None:
        if some:
            more: dict[str, Any] = {"text": [run_in_words(row, axes) for row in some], "hovertemplate": _SETTING}
            panels.line(0, column, _costs(some, first), _costs(some, second), name, own, mode=mode, marker=marker,
                        **more)  # fmt: skip

    good = [row for row in rows if row.ok]
    for number, kind in enumerate(dict.fromkeys(row.reference for row in rows)):
        for column, front in enumerate(fronts):
            here = [row for row in good if row.reference == kind and row.payload_kg == front.payload_kg]
            some = here[:: max(-(-len(here) // MOST_POINTS), 1)]  # a cloud's shape; the front has all of its own
            dots = {**_marker(number, 6), "color": line(kind, number)["color"], "opacity": 0.55}
            points(column, some, label(kind), {}, "markers", **dots)
    for column, front in enumerate(fronts):
        steps, ring = look(BLACK, width=1.6) | {"shape": "hv"}, {"size": 9, "symbol": "circle-open", "color": BLACK}
        points(column, front.rows, "front: beaten by no run", steps, "lines+markers", **ring)
        if front.knee is not None:
            _knee(panels, column, front.knee, (first, second))
        for number, row in enumerate(row for row in chosen if row.ok and row.payload_kg == front.payload_kg):
            star = _star(line(row.reference, number)["color"], 15, 1.2)
            points(column, [row], f"chosen: {label(row.reference)}", {}, "markers", **star)
    return panels.figure(height).update_layout(hovermode="closest")


def _star(colour: str, size: int, width: float) -> dict[str, Any]:
    return {"symbol": "star", "size": size, "color": colour, "line": {"color": BLACK, "width": width}}


def _knee(panels: Panels, column: int, knee: Row, costs: tuple[str, str]) -> None:
    x, y = (_costs([knee], name) for name in costs)
    ring = {"symbol": "circle-open", "size": 17, "color": SPARE[0][0], "line": {"width": 3}}
    panels.line(0, column, x, y, "knee", {}, mode="markers", marker=ring, hoverinfo="skip", hovertemplate=None)
    said = f"<b>knee</b>: {label(knee.reference)}<br>{set_in(knee).replace(', ', '<br>')}"
    panels.note(0, column, float(x[0]), float(y[0]), said, arrowcolor=SPARE[0][0])


def _costs(rows: Sequence[Row], name: str) -> Array:
    return drawn_in(name)[1] * np.array([row[name] for row in rows])


def curves_over_time(
    good: Sequence[Row], beside: Sequence[Row], names: Sequence[str], taken: Mapping[float, Mapping[str, float]]
) -> Figure:
    """Metrics over move time, a row a metric and a column a payload: each family's best limits at each time.

    taken: payload -> the metrics of what is recommended there, a star.
    """
    payloads, every = sorted({row.payload_kg for row in beside}), [*good, *beside]
    titles = [f"{one.words}<br>({one.unit})" for one, *_ in map(drawn_in, names)]
    heads = [f"payload {payload:g} kg" for payload in payloads] if len(payloads) > 1 else [""]
    panels = Panels("What more time buys", titles, heads, x_title=drawn_in("move_time_s")[0].axis)
    for number, kind in enumerate(dict.fromkeys(row.reference for row in every)):
        own, symbol = line(kind, number), MARKERS[number % len(MARKERS)]
        for column, payload in enumerate(payloads):
            here = [row for row in every if row.ok and row.reference == kind and row.payload_kg == payload]
            for at, name in enumerate(names if here else ()):
                best = best_at_each_time(here, name)
                symbols = [symbol if row in good else f"{symbol}-open" for row in best]
                panels.line(
                    at, column, _costs(best, "move_time_s"), _costs(best, name), label(kind), own,
                    mode="lines+markers", marker={"symbol": symbols, "size": 8, "color": own["color"]},
                    text=[f"{run_in_words(row, [])}<br>{set_in(row)}" for row in best], hovertemplate=_SETTING,
                )  # fmt: skip
    for column, payload in enumerate(payloads):
        for at, name in enumerate(names) if payload in taken else ():
            x, y = (drawn_in(of)[1] * np.array([taken[payload][of]]) for of in ("move_time_s", name))
            more: dict[str, Any] = {
                "marker": _star(SPARE[0][0], 13, 1.0),
                "hovertemplate": "taken<br>%{x:.4~g}, %{y:.4~g}",
            }
            panels.line(at, column, x, y, "taken", {}, mode="markers", **more)
    return panels.figure(760).update_layout(hovermode="closest")


def best_at_each_time(rows: Sequence[Row], name: str) -> list[Row]:
    """By rising time the run with the least of a metric at each."""
    best: dict[float, Row] = {}
    for row in sorted(rows, key=lambda row: row[name]):
        best.setdefault(round(row["move_time_s"], 2), row)
    return [best[time] for time in sorted(best)]


def spread(rows: Sequence[Row], metrics: Sequence[str]) -> Figure:
    """Histogram and empirical distribution of each metric, a column a metric; 5 %, 50 % and 95 % are marked."""
    good = [row for row in rows if row.ok]
    cases = list(dict.fromkeys((row.payload_kg, row.reference) for row in good))
    many = len({payload for payload, _ in cases}) > 1
    titles = ["share of runs<br>(%)", "share of runs<br>at or below (%)"]
    panels = Panels("Spread of the results", titles, [drawn_in(name)[0].axis for name in metrics], "", (1.0, 1.2))
    for column, name in enumerate(metrics):
        everything = _costs(good, name)
        edges = np.histogram_bin_edges(everything, bins=min(40, max(8, round(2 * len(everything) ** (1 / 3)))))
        for number, (payload, kind) in enumerate(cases):
            values = np.sort(_costs([row for row in good if (row.payload_kg, row.reference) == (payload, kind)], name))
            title, own = f"{label(kind)}, {payload:g} kg" if many else label(kind), line(kind, number)
            counts = 100.0 * np.histogram(values, edges)[0] / len(values)
            # Outlined steps: two cases that overlap stay apart, in black and white too.
            x, y = np.repeat(edges, 2), np.concatenate([[0.0], np.repeat(counts, 2), [0.0]])
            panels.line(0, column, x, y, title, own, "%", fill="tozeroy", fillcolor=faint(own["color"]))
            share, at = 100.0 * (np.arange(len(values)) + 1.0) / len(values), np.quantile(values, QUANTILES)
            panels.line(1, column, values, share, title, own | {"shape": "hv"}, "%")
            panels.line(
                1, column, at, 100.0 * np.array(QUANTILES), title, {}, mode="markers+text",
                marker={"size": 9, "symbol": "line-ns-open", "color": own["color"], "line": {"width": 3}},
                text=[f"{value:.4g}" for value in at], textposition="middle right", textfont={"size": 11},
                cliponaxis=False, showlegend=False, hovertemplate="%{y:.0f} %: %{x:.4~g}",
            )  # fmt: skip
    figure = panels.figure(520)
    for number in range(2 * len(metrics)):  # each metric has an axis of its own; the panels of one share it
        column = number % len(metrics)
        figure.layout[f"xaxis{number + 1 if number else ''}"].matches = f"x{column + 1}" if column else "x"
    return figure.update_layout(hovermode="closest")


def tornado(groups: Sequence[tuple[str, Sequence[Correlation]]], metric: str) -> Figure:
    """Rank correlation of each drawn field with a metric, a column a group, the strongest on top."""
    from plotly.subplots import make_subplots

    values = [{one.label.words: one.value for one in ranked} for _, ranked in groups]
    fields = dict.fromkeys(field for value in values for field in value)
    order = sorted(fields, key=lambda field: max(abs(value.get(field, 0.0)) for value in values))
    figure: Figure = make_subplots(
        1, len(groups), shared_yaxes=True, subplot_titles=[f"<b>{name}</b>" for name, _ in groups],
        horizontal_spacing=0.04, x_title="rank correlation (–)",
    )  # fmt: skip
    for column, ((name, _), value) in enumerate(zip(groups, values, strict=True), 1):
        bars = [value.get(field, 0.0) for field in order]
        figure.add_bar(
            x=bars, y=order, name=name, orientation="h", text=[signed(bar, 2) for bar in bars], textposition="outside",
            cliponaxis=False, hovertemplate="%{y}: %{x:+.2f}<extra></extra>",
            marker_color=[style.BLUE if bar >= 0.0 else style.VERMILLION for bar in bars], row=1, col=column,
        )  # fmt: skip
    figure.update_xaxes(range=[-1.15, 1.15]).update_yaxes(zeroline=False)
    return figure.update_layout(
        template=style.TEMPLATE, height=190 + 30 * len(order), showlegend=False, bargap=0.35,
        hovermode="closest",
        title={"text": f"What the {metric_label(metric).words} depends on"},
    )  # fmt: skip
