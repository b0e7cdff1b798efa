"""A grid of panels over one common horizontal axis.

Built as plain dicts and handed to plotly once: ten times as fast as adding traces one by one,
which is what lets a study end within two seconds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.core.run import Array
from workbench.view.style import GREY, TEMPLATE, Figure, heading, legend

Index = np.ndarray[tuple[int], np.dtype[np.int64]]

Range = tuple[float, float]
FEW_POINTS = 200  # a line of fewer costs nothing, and the pointer finds each
PAPER, LEGEND_LINE = 640, 20  # px: what a legend's line has room for on paper, and its height
TITLE_LINE = 36  # px that a figure without a title does without
NAME_ROOM = 0.22  # above the highest value, of the span, for a run's name in the corner
MOST_POINTS = 1500
STRAIGHT = 1e-4  # of a line's extent in each pass: a tenth of a pixel on a wide screen
PASSES = 4  # each takes every other point at most, so that a sixteenth is left for the pointer to find
GLASS = {"bgcolor": "rgba(255,255,255,0.8)", "borderpad": 2}  # behind words that stand on lines


@dataclass
class Panels:
    """Rows of quantities, columns of cases. Rows and columns count from 0, from the top left.

    All panels share the horizontal axis; the panels of a row share the vertical one, so that
    columns compare at a glance and a zoom moves them together. one_cursor: the pointer in one panel shows the values
    of all rows of its column.
    """

    title: str
    row_titles: Sequence[str]
    column_titles: Sequence[str] = ("",)
    x_title: str = "time (s)"
    row_weights: Sequence[float] = ()
    link_rows: bool = True
    one_cursor: bool = False
    traces: list[dict[str, Any]] = field(default_factory=list)
    shapes: list[dict[str, Any]] = field(default_factory=list)
    annotations: list[dict[str, Any]] = field(default_factory=list)
    in_legend: set[str] = field(default_factory=set)

    def axes(self, row: int, column: int, within: str = "") -> dict[str, str]:
        """The axes of a panel for a shape or words; within: `x`, `y` or both, where the place is a share of the
        panel."""
        across, up = (" domain" if name in within else "" for name in "xy")
        return {"xref": f"x{self._across(row, column)}{across}", "yref": f"y{self._number(row, column)}{up}"}

    def _number(self, row: int, column: int) -> str:
        number = row * len(self.column_titles) + column + 1
        return "" if number == 1 else str(number)

    def _across(self, row: int, column: int) -> str:
        """The number of the panel's horizontal axis: its own, or that of its column, which one cursor goes over."""
        return self._number(len(self.row_titles) - 1 if self.one_cursor else row, column)

    def line(
        self, row: int, column: int, x: Array, y: Array, name: str, line: dict[str, Any], unit: str = "", **more: Any
    ) -> None:
        """A line, thinned; lines of one name stand in the legend once and are switched together."""
        x, y = thin(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        if len(x) > FEW_POINTS and "mode" not in more:  # markers stand for points, each of which is meant
            x, y = straightened(x, y)
        self.traces.append({
            "type": "scatter", "mode": "lines", "x": x.astype(np.float32), "y": y.astype(np.float32), "name": name,
            "legendgroup": name, "showlegend": name not in self.in_legend, "line": line,
            "xaxis": f"x{self._across(row, column)}", "yaxis": f"y{self._number(row, column)}",
            "hovertemplate": f"%{{y:.4~g}} {unit}", **more,
        })  # fmt: skip
        self.in_legend.add(name)

    def level(self, row: int, column: int, y: float, text: str = "", dash: str = "4px,3px", left: bool = False) -> None:
        """A horizontal line over the whole width, such as a limit. left: where its text stands, else right."""
        place, line = self.axes(row, column, "x"), {"color": GREY, "width": 1.2, "dash": dash}
        self.shapes.append({"type": "line", "x0": 0, "x1": 1, "y0": y, "y1": y, "line": line, **place})
        if text:
            self.words(text, 0 if left else 1, y, "left" if left else "right", "bottom", place, color=GREY)

    def shade(
        self, row: int, column: int, start: float, end: float, colour: str, edge: float = 0.0, text: str = ""
    ) -> None:
        """A stretch of the horizontal axis. edge: px, so that the shortest is seen; text: at its top, once a panel."""
        place = self.axes(row, column, "y")
        self.shapes.append(
            {"type": "rect", "x0": start, "x1": end, "y0": 0, "y1": 1, "layer": "below", **place}
            | {"line": {"width": edge, "color": colour}, "fillcolor": colour, "opacity": 0.6 if edge else 0.3}
        )
        if text and not any(note["text"] == text and note["xref"] == place["xref"] for note in self.annotations):
            self.words(text, end, 1, "left", "top", place, color=colour)

    def words(
        self, text: str, x: float, y: float, x_anchor: str, y_anchor: str, place: dict[str, str], **font: Any
    ) -> None:
        """Words at a place, without a line to it."""
        self.annotations.append(
            {"text": text, "x": x, "y": y, "xanchor": x_anchor, "yanchor": y_anchor, "showarrow": False, **place}
            | {"font": {"size": 11, **font}, **GLASS, "borderpad": 1}
        )

    def note(
        self, row: int, column: int, x: float, y: float, text: str, away: tuple[int, int] = (60, -64), **look: Any
    ) -> None:
        """Words beside a point, with a line to it; away: px right and down from the point."""
        self.annotations.append(
            {"text": text, "x": x, "y": y, "ax": away[0], "ay": away[1], "showarrow": True, "arrowhead": 0}
            | {"xanchor": "left" if away[0] > 0 else "right", "align": "left", "font": {"size": 12}, **GLASS, **look}
            | self.axes(row, column)
        )

    def _legend_lines(self) -> int:
        """How many lines the legend takes on paper, the narrowest that figures are drawn for."""
        widths = [7 * len(str(trace["name"])) + 46 for trace in self.traces if trace["showlegend"]]
        if sum(widths) <= PAPER:
            return 1
        return math.ceil(len(widths) / max(1, PAPER // max(widths)))  # broken, it has columns of equal width

    def figure(self, height: int, y_ranges: dict[int, Range] | None = None) -> Figure:
        """The figure; y_ranges: by row, where plotly's own choice would not do."""
        import plotly.graph_objects as go

        rows, columns, headed = len(self.row_titles), len(self.column_titles), any(self.column_titles)
        gap_x, gap_y = (0.035 if columns > 1 else 0.0), min(0.05, 0.12 / rows)
        width = (1.0 - gap_x * (columns - 1)) / columns
        weights = np.asarray(self.row_weights or np.ones(rows), dtype=float)
        heights = (1.0 - gap_y * (rows - 1)) * weights / weights.sum()
        more = LEGEND_LINE * (self._legend_lines() - 1) - (0 if self.title else TITLE_LINE)
        height += more
        layout: dict[str, Any] = {
            "template": TEMPLATE, "height": height, "title": heading(self.title, height),
            "legend": legend(height, (68.0 if headed else 72.0) + more),
            "margin": {"t": (100 if headed else 80) + more},
            "shapes": self.shapes, "annotations": list(self.annotations),
            "hoverdistance": 100,  # px: on a straight stretch points are far apart
            "meta": {"rows": rows, "columns": columns},  # a narrow page stacks the columns (dashboard/assets/chart.js)
        }  # fmt: skip
        for row in range(rows):
            top = 1.0 - float(heights[:row].sum()) - gap_y * row
            for column in range(columns):
                left = column * (width + gap_x)
                self._axes_of(layout, row, column, (left, min(left + width, 1.0)), (top - float(heights[row]), top))
                if row == 0 and self.column_titles[column]:
                    layout["annotations"].append(
                        {"text": f"<b>{self.column_titles[column]}</b>", "x": left + width / 2, "y": 1.0}
                        | {"xref": "paper", "yref": "paper", "xanchor": "center", "yanchor": "bottom"}
                        | {"yshift": 3, "showarrow": False, "font": {"size": 13}}
                    )
        for row, limits in (y_ranges or {}).items():
            layout[f"yaxis{self._number(row, 0)}"]["range"] = list(limits)
        if self.one_cursor:
            layout |= {"hovermode": "x unified", "hoversubplots": "axis"}  # one table of values at the cursor
            layout["meta"]["quantities"] = [title.replace("<br>", " ") for title in self.row_titles]
        return go.Figure({"data": self.traces, "layout": layout})

    def _axes_of(self, layout: dict[str, Any], row: int, column: int, x: Range, y: Range) -> None:
        """Adds a panel's axes to the layout. x, y: where it stands."""
        number, across, first = self._number(row, column), self._across(row, column), self._across(0, 0)
        x_axis: dict[str, Any] = {"domain": list(x), "anchor": f"y{number}"}
        y_axis: dict[str, Any] = {"domain": [max(y[0], 0.0), y[1]], "anchor": f"x{across}"}
        if first != across:
            x_axis["matches"] = f"x{first}"
        if self.one_cursor:
            x_axis |= {"showspikes": True, "spikemode": "across", "spikesnap": "cursor", "spikedash": "solid"}
            x_axis |= {"spikethickness": 1, "spikecolor": GREY}
        x_axis |= {"title": {"text": self.x_title}} if row == len(self.row_titles) - 1 else {"showticklabels": False}
        if column == 0:
            y_axis["title"] = {"text": self.row_titles[row]}
        elif self.link_rows:
            y_axis |= {"matches": f"y{self._number(row, 0)}", "showticklabels": False}
        layout[f"yaxis{number}"] = y_axis
        if across == number:
            layout[f"xaxis{number}"] = x_axis


def ranges_below_names(places: Sequence[tuple[int, int]], drawn: Sequence[Sequence[Array]]) -> dict[int, Range]:
    """Each row's range from its lowest to its highest value, with room above for names in the panels' corners.

    drawn: of each place all that is drawn in it.
    """
    ranges = {}
    for row in {row for row, _ in places}:
        values = np.concatenate([v for (r, _), values in zip(places, drawn, strict=True) if r == row for v in values])
        known = values[np.isfinite(values)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (-1.0, 1.0)
        span = (high - low) or 1.0
        ranges[row] = (low - 0.05 * span, high + NAME_ROOM * span)
    return ranges


# Fewer points for a plotted line, with its peaks kept.


def thin(time_s: Array, values: Array, most: int = MOST_POINTS) -> tuple[Array, Array]:
    """At most about `most` of the (n,) points: the smallest and the largest of each stretch, first and last.

    The extremes of the line survive at their own times. A stretch without any finite value
    is kept as a gap.
    """
    n = len(values)
    if n <= most:
        return time_s, values
    stretches = max(most // 2 - 1, 1)
    edges = np.linspace(0, n, stretches + 1).astype(np.int64)
    length = int(np.diff(edges).max())
    # Stretches differ by a point at most; the shorter ones repeat their last, which changes no extreme.
    index = np.minimum(edges[:-1, None] + np.arange(length)[None, :], edges[1:, None] - 1)
    block = values[index]
    low = np.argmin(np.where(np.isfinite(block), block, np.inf), axis=1)
    high = np.argmax(np.where(np.isfinite(block), block, -np.inf), axis=1)
    rows = np.arange(stretches)
    keep = np.unique(np.concatenate(([0], index[rows, low], index[rows, high], [n - 1])))
    return time_s[keep], values[keep]


def straightened(x: Array, y: Array) -> tuple[Array, Array]:
    """The (n,) points without those that lie between their neighbours on a straight line, or nearly.

    Nearly: off by STRAIGHT of the line's extent, in each of a few passes. The first and the
    last stay, and so do gaps. Most of a move is straight: speed at its limit, a hanging load.
    """
    across, up = (values / (_extent(values) or 1.0) for values in (x, y))
    kept = np.arange(len(x))
    for _ in range(PASSES):
        if len(kept) < 3:
            break
        before, point, after = kept[:-2:2], kept[1:-1:2], kept[2::2]
        off = _off_the_line(across, up, before, point, after[: len(point)])
        stays = np.ones(len(kept), dtype=bool)
        stays[1:-1:2] = ~(off <= STRAIGHT)  # NaN stays
        kept = kept[stays]
    return x[kept], y[kept]


def _extent(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.max() - known.min()) if len(known) else 0.0


def _off_the_line(x: Array, y: Array, before: Index, point: Index, after: Index) -> Array:
    """How far these points lie off the stretch between their neighbours."""
    along_x, along_y = x[after] - x[before], y[after] - y[before]
    away_x, away_y = x[point] - x[before], y[point] - y[before]
    length = np.maximum(along_x * along_x + along_y * along_y, 1e-30)
    share = np.minimum(np.maximum((along_x * away_x + along_y * away_y) / length, 0.0), 1.0)
    return np.asarray(np.hypot(away_x - share * along_x, away_y - share * along_y))
