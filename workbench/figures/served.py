"""Figures of a served plant: its last seconds, and how late its steps began."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.figures.panels import Panels
from workbench.figures.style import BLUE, GREY, ORANGE, SKY, TEMPLATE, VERMILLION, heading, line
from workbench.run import Array

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

ROWS = ("height<br>(m)", "motor speed<br>(rad/s)", "torque, all<br>motors (N m)", "wire tension<br>(kN)")


def last_seconds(
    columns: Mapping[str, Array],
    window_s: float,
    torque_limit_nm: float,
    events: Sequence[tuple[float, str]] = (),
    height: int = 640,
) -> Figure:
    """Height, speed with its set point, torque asked for and at work, tensions, over the last `window_s`.

    columns: name -> (n,), among them `time_s`, by the names of `workbench serve`. events: (time_s, words).
    """
    time = columns["time_s"]
    end = float(time[-1]) if len(time) else 0.0
    start = max(end - window_s, float(time[0]) if len(time) else 0.0)
    shown = time >= start
    panels = Panels("", ROWS, x_title="time of the plant (s)", one_cursor=True)

    def draw(row: int, name: str, words: str, look: dict[str, Any], unit: str, scale: float = 1.0) -> None:
        panels.line(row, 0, time[shown], scale * columns[name][shown], words, look, unit)

    draw(0, "position_carriage_m", "height", {"color": BLUE, "width": 2.0}, "m")
    if np.any(np.isfinite(columns["speed_reference_rad_s"][shown])):
        draw(1, "speed_reference_rad_s", "set point", line("set point", width=1.2), "rad/s")
    draw(1, "speed_motor_rad_s", "speed", {"color": VERMILLION, "width": 1.8}, "rad/s")
    draw(2, "torque_motor_nm", "asked for", {"color": GREY, "width": 1.2, "dash": "2px,2px"}, "N m")
    draw(2, "torque_at_work_nm", "at work", {"color": ORANGE, "width": 1.8}, "N m")
    draw(3, "tension_drum_n", "at the drum", {"color": BLUE, "width": 1.8}, "kN", 1e-3)
    draw(3, "tension_dead_line_n", "dead line", {"color": SKY, "width": 1.4}, "kN", 1e-3)
    draw(3, "tension_min_n", "least of any fall", {"color": VERMILLION, "width": 1.2, "dash": "4px,2px"}, "kN", 1e-3)
    asked = np.abs(columns["torque_at_work_nm"][shown])
    if len(asked) and float(asked.max()) > 0.7 * torque_limit_nm:  # else it would take the room from the torque
        sign = 1.0 if float(columns["torque_at_work_nm"][shown][int(asked.argmax())]) > 0.0 else -1.0
        panels.level(2, 0, sign * torque_limit_nm, f"limit {sign * torque_limit_nm:.4g} N m", "dash")
    for at, words in events:
        if start <= at <= end:
            panels.mark(0, at, words, VERMILLION)
    figure = panels.figure(height)
    return figure.update_xaxes(range=[start, start + window_s])


def late_starts(jitter: Mapping[str, int], height: int = 230) -> Figure:
    """How late the steps began. jitter: name of a class ("<50 us") -> steps."""
    import plotly.graph_objects as go

    steps = max(sum(jitter.values()), 1)
    names = [name.replace("us", "µs").replace("<", "< ").replace(">=", "≥ ") for name in jitter]
    share = [100.0 * count / steps for count in jitter.values()]
    bars = {
        "type": "bar", "x": names, "y": share, "marker": {"color": BLUE}, "customdata": list(jitter.values()),
        "hovertemplate": "%{customdata} steps, %{y:.3f} %<extra></extra>",
    }  # fmt: skip
    layout = {
        "template": TEMPLATE,
        "height": height,
        "title": heading("How late the steps began", height),
        "margin": {"t": 50, "b": 50},
        "yaxis": {"title": {"text": "steps (%)"}, "rangemode": "tozero"},
        "hovermode": "closest",
    }
    return go.Figure({"data": [bars], "layout": layout})
