"""What is paid for what: all runs, the front that none of them beats, and its knee."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.run import Array
from workbench.figures.panels import Panels
from workbench.study.labels import SweptAxis, drawn_in, run_in_words, set_in
from workbench.study.pareto import Front, cost
from workbench.study.rows import Row
from workbench.view.style import BLACK, MARKERS, SPARE, label, line
from workbench.view.thin import MOST_POINTS

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def pareto(
    rows: Sequence[Row],
    fronts: Sequence[Front],
    axes: Sequence[SweptAxis],
    second: str,
    first: str = "move_time_s",
    height: int = 560,
    chosen: Sequence[Row] = (),
) -> Figure:
    """Two costs of all good runs, a panel a payload; the front as steps, the knee with its settings.

    chosen: runs that are pointed out, such as those of the settings at hand.
    """
    payloads = [front.payload_kg for front in fronts]
    across, up = drawn_in(first)[0], drawn_in(second)[0]
    panels = Panels(
        f"{across.words.capitalize()} against {up.words}",
        [up.axis],
        [f"payload {p:g} kg" for p in payloads] if len(payloads) > 1 else [""],
        x_title=across.axis,
    )
    for number, kind in enumerate(dict.fromkeys(row.reference for row in rows)):
        colour = line(kind, number)["color"]
        marker = {"symbol": MARKERS[number % len(MARKERS)], "size": 6, "color": colour, "opacity": 0.55}
        for column, payload in enumerate(payloads):
            here = [row for row in rows if row.ok and row.reference == kind and row.payload_kg == payload]
            _points(panels, column, here, (first, second), label(kind), marker, axes)
    for column, front in enumerate(fronts):
        _front(panels, column, front, axes)
        _chosen(
            panels, column, [row for row in chosen if row.ok and row.payload_kg == front.payload_kg], (first, second)
        )
    figure = panels.figure(height)
    figure.update_layout(hovermode="closest")
    return figure


Taken = Mapping[float, Mapping[str, float]]


def curves_over_time(
    good: Sequence[Row], beside: Sequence[Row], names: Sequence[str], taken: Taken, height: int = 760
) -> Figure:
    """Metrics over move time, a row a metric and a column a payload: each family's best limits at each time.

    taken: payload -> the metrics of what is recommended there, a star.
    """
    payloads = sorted({row.payload_kg for row in beside})
    labels = [drawn_in(name)[0] for name in names]
    panels = Panels(
        "What more time buys",
        [f"{one.words}<br>({one.unit})" for one in labels],
        [f"payload {payload:g} kg" for payload in payloads] if len(payloads) > 1 else [""],
        x_title=drawn_in("move_time_s")[0].axis,
    )
    for number, kind in enumerate(dict.fromkeys(row.reference for row in (*good, *beside))):
        look = line(kind, number)
        marker = {"symbol": MARKERS[number % len(MARKERS)], "size": 8, "color": look["color"]}
        for column, payload in enumerate(payloads):
            own, slowed = (
                [row for row in rows if row.ok and row.reference == kind and row.payload_kg == payload]
                for rows in (good, beside)
            )
            for at, name in enumerate(names):
                best = _best_at_each_time([*own, *slowed], name)
                fill = {**marker, "symbol": [marker["symbol"] + ("" if row in own else "-open") for row in best]}
                hover = [f"{run_in_words(row, [])}<br>{set_in(row)}" for row in best]
                panels.line(
                    at, column, _costs(best, "move_time_s"), _costs(best, name), label(kind), look,
                    mode="lines+markers", marker=fill, text=hover, hovertemplate=_HOVER,
                )  # fmt: skip
    star = {"symbol": "star", "size": 13, "color": SPARE[0][0], "line": {"color": BLACK, "width": 1.0}}
    for column, payload in enumerate(payloads):
        for at, name in enumerate(names) if payload in taken else ():
            x, y = (drawn_in(of)[1] * np.array([taken[payload][of]]) for of in ("move_time_s", name))
            panels.line(
                at,
                column,
                x,
                y,
                "taken",
                {},
                mode="markers",
                marker=star,
                hovertemplate="taken<br>%{x:.4~g}, %{y:.4~g}",
            )
    figure = panels.figure(height)
    figure.update_layout(hovermode="closest")
    return figure


def _best_at_each_time(rows: Sequence[Row], name: str) -> list[Row]:
    """By rising time the run with the least of a metric at each."""
    best: dict[float, Row] = {}
    for row in rows:
        time = round(row["move_time_s"], 2)
        if time not in best or row[name] < best[time][name]:
            best[time] = row
    return [best[time] for time in sorted(best)]


def _costs(rows: Sequence[Row], name: str) -> Array:
    return drawn_in(name)[1] * np.array([cost(row, name) for row in rows])


def _points(
    panels: Panels, column: int, rows: Sequence[Row], costs: tuple[str, str], name: str, look: dict[str, Any],
    axes: Sequence[SweptAxis],
) -> None:  # fmt: skip
    if not rows:
        return
    rows = rows[:: -(-len(rows) // MOST_POINTS)]  # a cloud's shape; the front has all of its own
    x, y = (_costs(rows, cost) for cost in costs)
    panels.line(
        0, column, x, y, name, {}, mode="markers", marker=look, text=[run_in_words(row, axes) for row in rows],
        hovertemplate=_HOVER,
    )  # fmt: skip


def _chosen(panels: Panels, column: int, rows: Sequence[Row], costs: tuple[str, str]) -> None:
    for number, row in enumerate(rows):
        look = {"symbol": "star", "size": 15, "color": line(row.reference, number)["color"]}
        look |= {"line": {"color": BLACK, "width": 1.2}}
        x, y = (_costs([row], name) for name in costs)
        name = f"chosen: {label(row.reference)}"
        hover = f"{name}<br>%{{x:.4~g}}, %{{y:.4~g}}"
        panels.line(0, column, x, y, name, {}, mode="markers", marker=look, hovertemplate=hover)


def _front(panels: Panels, column: int, front: Front, axes: Sequence[SweptAxis]) -> None:
    x, y = (_costs(front.rows, name) for name in front.costs)
    look = {"color": BLACK, "width": 1.6, "shape": "hv", "simplify": False}
    panels.line(
        0, column, x, y, "front: beaten by no run", look, mode="lines+markers",
        marker={"size": 9, "symbol": "circle-open", "color": BLACK},
        text=[run_in_words(row, axes) for row in front.rows], hovertemplate=_HOVER,
    )  # fmt: skip
    if front.knee is None:
        return
    at = [_costs([front.knee], name) for name in front.costs]
    ring = {"symbol": "circle-open", "size": 17, "color": SPARE[0][0], "line": {"width": 3}}
    panels.line(0, column, at[0], at[1], "knee", {}, mode="markers", marker=ring, hoverinfo="skip", hovertemplate=None)
    number = panels._number(0, column)
    setting = set_in(front.knee).replace(", ", "<br>")
    where = {"x": float(at[0][0]), "y": float(at[1][0]), "xref": f"x{number}", "yref": f"y{number}"}
    panels.annotations.append(
        {"text": f"<b>knee</b>: {label(front.knee.reference)}<br>{setting}", "align": "left", **where}
        | {"showarrow": True, "arrowhead": 0, "arrowcolor": SPARE[0][0], "ax": 60, "ay": -64, "xanchor": "left"}
        | {"font": {"size": 12}, "bgcolor": "rgba(255,255,255,0.85)", "borderpad": 2}
    )


_HOVER = "%{text}<br>%{x:.4~g}, %{y:.4~g}"
