"""What the lowest torque peak costs in the other figures of the table that decides."""

from __future__ import annotations

from collections.abc import Sequence

from workbench.metrics import View, shown_in
from workbench.study.conclude.decide import TIME, choices, name_of
from workbench.study.results.row import Row

DEAR = 1.5  # times the best of the references: a figure that is worth a word


def price_sentence(rows: Sequence[Row]) -> str | None:
    """The figures in which the reference of the lowest peak is far from the best; None where it is dear in none."""
    compared = choices(rows)
    if len(compared) < 2:
        return None
    lowest = min(compared, key=lambda choice: choice.peak)
    dear = []
    for metric in shown_in(View.DECISION, lowest.judged):
        values = [choice.values[metric.name] for choice in compared]
        own, best = lowest.values[metric.name], min(values)
        if metric.name not in (lowest.judged.peak, TIME) and metric.better == "lower" and 0.0 < DEAR * best < own:
            dear.append(f"{metric.label} {metric.text(own)} {metric.shown_unit} against {metric.text(best)}")
    if not dear:
        return None
    name = name_of(lowest)
    return f"The lowest peak, by {name}, has its price: {', '.join(dear)}."
