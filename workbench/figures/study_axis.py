"""The runs of an axis' study over time: position, tracking error, speed, force."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from workbench.core.run import Run
from workbench.figures.panels import Panels
from workbench.machines import Kind
from workbench.view.style import label, line

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def axis_overview(
    runs: Sequence[tuple[str, Run]],
    kind: Kind,
    limit: float,
    nominal: float | None,
    title: str = "Closed loop",
    window_s: tuple[float, float] | None = None,
    height: int = 780,
) -> Figure:
    """Position and speed with their references, tracking error, and the drive's force or torque; a line a run.

    runs: (reference, run) with the closed loop's signals. limit, nominal: of the drive; inf and None where it states
    none. window_s: the stretch of time drawn; without it all.
    """
    loop, way, drive = kind.looped, kind.moved.unit, kind.drive
    x_ref, v_ref = loop.references
    speed = "velocity" if way == "m" else "speed"
    panels = Panels(
        title,
        [f"position<br>({way})", f"tracking error<br>(m{way})", f"{speed}<br>({kind.moved.speed_unit})",
         f"{drive.quantity}<br>({drive.unit})"],
        row_weights=[1.0, 1.0, 1.0, 1.25],
        one_cursor=True,
    )  # fmt: skip
    dots = line("set point", width=1.2)
    for number, (name, run) in enumerate(runs):
        part = run if window_s is None else _within(run, *window_s)
        look, t = line(name, number), part.time_s
        panels.line(0, 0, t, part[loop.position], label(name), look, way)
        panels.line(1, 0, t, 1000.0 * (part[x_ref] - part[loop.position]), label(name), look, f"m{way}")
        panels.line(2, 0, t, part[loop.speed], label(name), look, kind.moved.speed_unit)
        panels.line(3, 0, t, part[kind.plant.input], label(name), look, drive.unit)
        panels.line(0, 0, t, part[x_ref], "set points", dots, way, legendrank=2000)
        panels.line(2, 0, t, part[v_ref], "set points", dots, kind.moved.speed_unit, legendrank=2000)
    for value, what, dash in ((nominal, "nominal", "dot"), (limit, "limit", "dash")):
        if value is not None and math.isfinite(value):
            panels.level(3, 0, value, f"{what} {value:.4g} {drive.unit}", dash)
            panels.level(3, 0, -value, "", dash)
    return panels.figure(height)


def _within(run: Run, start_s: float, end_s: float) -> Run:
    inside = (run.time_s >= start_s) & (run.time_s <= end_s)
    signals = {name: values[inside] for name, values in run.signals.items()}
    return replace(run, time_s=run.time_s[inside], signals=signals)
