"""What an import proposes, drawn: each signal in SI over its own samples, with the column it comes from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from workbench.core.run import Array
from workbench.view.panels import Panels
from workbench.view.style import BLUE

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def proposed(signals: Sequence[tuple[str, str, Array, Array]]) -> Figure:
    """signals: (signal, column, time in s, values in SI) of each."""
    panels = Panels("Proposed signals", [signal.replace("_", " ") for signal, _, _, _ in signals])
    for i, (signal, column, time_s, values) in enumerate(signals):
        panels.line(i, 0, time_s, values, f"{signal}: {column}", {"color": BLUE, "width": 1.3})
    figure = panels.figure(170 * len(signals) + 120)
    figure.update_layout(showlegend=False)
    return figure
