"""The gap over time, a panel a run: torque measured and predicted, what is left of it, and the replayed speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.run import Array
from workbench.view.panels import Panels, ranges_below_names
from workbench.view.style import LINE_AFTER, LINE_BEFORE, MEASURED, NOISE_DASH, REST, WINDOW

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

COLUMNS = 2
PANEL, AROUND = 200, 140  # px: of a row of panels, and of title, legend and axis
Stretches = Sequence[tuple[float, float]]


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


def inputs(runs: Sequence[RunSeries], unit: str) -> Figure:
    """Measured input and what the machine before its correction predicts; the gap's windows shaded."""
    quantity = _quantity(unit)
    panels, places, height = _grid(
        f"Measured and predicted {quantity}", f"{quantity} ({unit})", [_named(run.name, run.said) for run in runs]
    )
    for run, place in zip(runs, places, strict=True):
        panels.line(*place, run.time_s, run.measured, "measured", MEASURED, unit)
        panels.line(*place, run.time_s, run.before, _before(run, "predicted"), LINE_BEFORE, unit)
        _shade(panels, place, run.windows, WINDOW)
    return _figure(panels, height, places, [[run.measured, run.before] for run in runs])


def residuals(runs: Sequence[RunSeries], unit: str, noise_rms: float) -> Figure:
    """Measured minus predicted input while moving, before and after; dashed: ± twice the noise. Rests are grey."""
    quantity = _quantity(unit)
    panels, places, height = _grid(
        f"{quantity.capitalize()} residual: measured − predicted",
        f"{quantity} residual ({unit})",
        [run.name for run in runs],
    )
    largest = 4.0 * noise_rms
    for run, place in zip(runs, places, strict=True):
        left = _moving(run, run.before)
        largest = max(largest, 1.15 * float(np.max(np.abs(left[np.isfinite(left)]), initial=0.0)))
        panels.line(*place, run.time_s, left, "residual" if run.after is None else "before", LINE_BEFORE, unit)
        if run.after is not None:
            panels.line(*place, run.time_s, _moving(run, run.after), "after", LINE_AFTER, unit)
        for level in (2.0 * noise_rms, -2.0 * noise_rms):
            panels.level(*place, level, dash=NOISE_DASH)
        _shade(panels, place, run.windows, WINDOW)
        _shade(panels, place, run.rests, REST)
    return _figure(panels, height, places, [[np.array([-largest, largest])] for _ in runs])


def speeds(runs: Sequence[RunSeries], scale: str) -> Figure:
    """Measured speed, and the open-loop replay of the machine before and after; scale: what the per cent are of."""
    names = [_named(run.name, _errors(run)) for run in runs]
    panels, places, height = _grid(f"Speed replayed open loop, in % of {scale}", "speed (%)", names)
    for run, place in zip(runs, places, strict=True):
        panels.line(*place, run.time_s, run.speed, "measured", MEASURED, "%")
        panels.line(*place, run.time_s, run.speed_before, _before(run, "replayed"), LINE_BEFORE, "%")
        if run.speed_after is not None:
            panels.line(*place, run.time_s, run.speed_after, "replayed after", LINE_AFTER, "%")
    drawn = [[run.speed, run.speed_before, *([] if run.speed_after is None else [run.speed_after])] for run in runs]
    return _figure(panels, height, places, drawn)


def _before(run: RunSeries, what: str) -> str:
    """Where nothing was corrected there is no before."""
    return what if run.after is None else f"{what} before"


def _moving(run: RunSeries, predicted: Array) -> Array:
    """The residual; at rest it says nothing, so nothing is drawn there."""
    return np.where(run.moving, run.measured - predicted, np.nan)


def _errors(run: RunSeries) -> str:
    """The rms error in per cent, before and after."""
    both = [run.speed_before] if run.speed_after is None else [run.speed_before, run.speed_after]
    shown = [f"{float(np.sqrt(np.mean((speed - run.speed) ** 2))):.2f} %" for speed in both]
    return f"RMSE {' → '.join(shown)}"


def _named(name: str, said: str) -> str:
    return f"{name}</b>, {said}<b>" if said else name


def _quantity(unit: str) -> str:
    return "torque" if unit == "N m" else "force"


def _shade(panels: Panels, place: tuple[int, int], stretches: Stretches, colour: str) -> None:
    for start, end in stretches:
        panels.shade(*place, start, end, colour)


def _grid(title: str, y_title: str, names: Sequence[str]) -> tuple[Panels, list[tuple[int, int]], int]:
    """Panels, (row, column) of each run, height."""
    columns = min(COLUMNS, len(names))
    rows = -(-len(names) // columns)
    panels = Panels(title, [y_title] * rows, [""] * columns)
    places = [divmod(index, columns) for index in range(len(names))]
    for (row, column), name in zip(places, names, strict=True):
        number = "" if row == column == 0 else str(row * columns + column + 1)
        panels.annotations.append(_in_corner(f"<b>{name}</b>", number))
    return panels, places, AROUND + max(PANEL * rows, 300)


def _figure(panels: Panels, height: int, places: Sequence[tuple[int, int]], drawn: Sequence[Sequence[Array]]) -> Figure:
    """Each row from its lowest to its highest value, with room above for the runs' names."""
    figure = panels.figure(height, ranges_below_names(places, drawn))
    # Where the last row is not full, the panel above its empty place ends its column.
    columns, count = len(panels.column_titles), len(places)
    for index in range(max(count - columns, 0), count):
        figure.layout["xaxis" if index == 0 else f"xaxis{index + 1}"].update(
            showticklabels=True, title={"text": panels.x_title}
        )
    return figure


def _in_corner(text: str, number: str) -> dict[str, Any]:
    return {
        "text": text, "x": 0.01, "y": 0.99, "xref": f"x{number} domain", "yref": f"y{number} domain",
        "xanchor": "left", "yanchor": "top", "showarrow": False, "font": {"size": 12},
        "bgcolor": "rgba(255,255,255,0.75)", "borderpad": 1,
    }  # fmt: skip
