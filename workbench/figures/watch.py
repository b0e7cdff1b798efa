"""Figures of a watch: each parameter over the cycles with its baseline, and the statistic with its threshold."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from workbench.core.run import Array
from workbench.view.panels import Panels
from workbench.view.style import BLUE, GREY, VERMILLION

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MEAN_OF = 20  # cycles


def parameters(
    names: Sequence[tuple[str, str]],
    values: Array,
    baseline: int,
    alarms: Sequence[int],
    counted: Sequence[bool] | None = None,
) -> Figure:
    """names: (words, unit) of each; values: (cycles, m); baseline: cycles that count whose mean is drawn; alarms:
    cycles; counted: whether each cycle counts, None for all."""
    heads = [f"{word} ({unit})" if unit else word for word, unit in names]
    panels = Panels("Estimates, cycle by cycle", heads, x_title="cycle")
    x = np.arange(len(values), dtype=float)
    counts = np.ones(len(values), dtype=bool) if counted is None else np.asarray(counted, dtype=bool)
    for i, (_, unit) in enumerate(names):
        for chosen, name, symbol in ((counts, "one cycle", "circle"), (~counts, "does not count", "circle-open")):
            if chosen.any():
                dots = {"size": 4, "color": GREY, "symbol": symbol}
                series = x[chosen], values[chosen, i]
                panels.line(i, 0, *series, name, {"color": GREY}, unit, mode="markers", marker=dots)
        of, at = values[counts, i], x[counts]
        if len(of) > MEAN_OF:
            sums = np.cumsum(np.concatenate([[0.0], of]))
            mean = (sums[MEAN_OF:] - sums[:-MEAN_OF]) / MEAN_OF
            look = {"color": BLUE, "width": 1.8}
            panels.line(i, 0, at[MEAN_OF - 1 :], mean, f"mean of {MEAN_OF}", look, unit)
        if len(of):
            panels.level(i, 0, float(np.mean(of[: max(1, baseline)])), "baseline" if i == 0 else "")
        _mark(panels, i, alarms)
    return panels.figure(190 * len(names) + 120)


def statistic(values: Array, threshold: float | None, alarms: Sequence[int]) -> Figure:
    """values: (cycles,) of the test, zero where a cycle did not count."""
    panels = Panels("Test of a change", ["log likelihood ratio"], x_title="cycle")
    x = np.arange(len(values), dtype=float)
    panels.line(0, 0, x, values, "statistic", {"color": BLUE, "width": 1.6})
    if threshold is not None:
        panels.level(0, 0, threshold, "alarm above")
    _mark(panels, 0, alarms)
    return panels.figure(380)


def _mark(panels: Panels, row: int, cycles: Sequence[int]) -> None:
    for cycle in cycles:
        panels.shade(row, 0, cycle, cycle, VERMILLION, edge=1.2)
