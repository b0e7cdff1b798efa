"""Figures of a watch: each parameter over the cycles with its baseline, and the statistic with its threshold."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from workbench.figures.panels import Panels
from workbench.figures.style import BLUE, GREY, VERMILLION
from workbench.run import Array

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MEAN_OF = 20  # cycles


def parameters(names: Sequence[tuple[str, str]], values: Array, baseline: int, alarms: Sequence[int]) -> Figure:
    """names: (words, unit) of each; values: (cycles, m); baseline: cycles whose mean is drawn; alarms: cycles."""
    heads = [f"{word} ({unit})" if unit else word for word, unit in names]
    panels = Panels("Estimates, cycle by cycle", heads, x_title="cycle")
    x = np.arange(len(values), dtype=float)
    for i, (_, unit) in enumerate(names):
        dots = {"size": 4, "color": GREY}
        panels.line(i, 0, x, values[:, i], "one cycle", {"color": GREY}, unit, mode="markers", marker=dots)
        if len(values) > MEAN_OF:
            sums = np.cumsum(np.concatenate([[0.0], values[:, i]]))
            mean = (sums[MEAN_OF:] - sums[:-MEAN_OF]) / MEAN_OF
            look = {"color": BLUE, "width": 1.8}
            panels.line(i, 0, x[MEAN_OF - 1 :], mean, f"mean of {MEAN_OF}", look, unit)
        panels.level(i, 0, float(np.mean(values[: max(1, baseline), i])), "baseline" if i == 0 else "")
    figure = panels.figure(190 * len(names) + 120)
    _mark(figure, alarms)
    return figure


def statistic(values: Array, threshold: float | None, alarms: Sequence[int]) -> Figure:
    """values: (cycles,) of the test, zero where a cycle did not count."""
    panels = Panels("Test of a change", ["log likelihood ratio"], x_title="cycle")
    x = np.arange(len(values), dtype=float)
    panels.line(0, 0, x, values, "statistic", {"color": BLUE, "width": 1.6})
    if threshold is not None:
        panels.level(0, 0, threshold, "alarm above")
    figure = panels.figure(380)
    _mark(figure, alarms)
    return figure


def _mark(figure: Figure, cycles: Sequence[int]) -> None:
    for cycle in cycles:
        figure.add_vline(x=cycle, line={"color": VERMILLION, "width": 1.2, "dash": "dot"})
