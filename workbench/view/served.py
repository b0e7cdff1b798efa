"""A served plant's last seconds, and how late its steps began."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from workbench.core.run import Array
from workbench.view.panels import Panels
from workbench.view.style import BLUE, GREY, ORANGE, SKY, VERMILLION, Figure, figure, look

ROW = 118  # px
NEAR = 0.7  # of the torque's limit, which is drawn from there on
# Each row with its lines: column, words, colour, dash, factor, unit.
ROWS: Mapping[str, Sequence[tuple[str, str, str, str, float, str]]] = {
    "height<br>(m)": [("position_carriage_m", "height", BLUE, "solid", 1.0, "m")],
    "speed<br>(rad/s)": [("speed_reference_rad_s", "set point", GREY, "2px,2px", 1.0, "rad/s"),
                         ("speed_motor_rad_s", "motor", VERMILLION, "solid", 1.0, "rad/s")],
    "torque<br>(N m)": [("torque_motor_nm", "asked for", GREY, "2px,2px", 1.0, "N m"),
                        ("torque_at_work_nm", "at work", ORANGE, "solid", 1.0, "N m")],
    "tension<br>(kN)": [("tension_drum_n", "drum", BLUE, "solid", 1e-3, "kN"),
                        ("tension_dead_line_n", "dead line", SKY, "solid", 1e-3, "kN"),
                        ("tension_min_n", "least", VERMILLION, "4px,2px", 1e-3, "kN")],
}  # fmt: skip


def last_seconds(
    columns: Mapping[str, Array], window_s: float, torque_limit_nm: float, events: Sequence[tuple[float, str]] = ()
) -> Figure:
    """Height, speed with its set point, torque asked for and at work, tensions, over the last `window_s`.

    columns: name -> (n,), among them `time_s`, by the names of `workbench serve`. events: (time_s, words), each a line
    through all rows. The drive's limit of torque is drawn where the torque comes near it.
    """
    time = columns["time_s"]
    end = float(time[-1]) if len(time) else 0.0
    start = max(end - window_s, float(time[0]) if len(time) else 0.0)
    shown = time >= start
    panels = Panels("", list(ROWS), x_title="time of the plant (s)", one_cursor=True)
    for row, lines in enumerate(ROWS.values()):
        for column, words, colour, dash, factor, unit in lines:
            values = factor * columns[column][shown]
            if np.any(np.isfinite(values)):
                panels.line(row, 0, time[shown], values, words, look(colour, dash, 1.7), unit)
            if unit == "N m" and len(values) and np.nanmax(np.abs(values), initial=0.0) > NEAR * torque_limit_nm:
                panels.level(row, 0, torque_limit_nm if np.nanmax(values) > 0.0 else -torque_limit_nm, "limit")
        for at, words in events:
            if start <= at <= end:
                panels.shade(row, 0, at, at, VERMILLION, 1.2, words if row == 0 else "")
    return panels.figure(ROW * len(ROWS) + 130).update_xaxes(range=[start, start + window_s])


def late_starts(jitter: Mapping[str, int]) -> Figure:
    """How late the steps began, a bar a class. jitter: name of a class ("<50 us") -> steps."""
    steps = max(sum(jitter.values()), 1)
    share = [100.0 * count / steps for count in jitter.values()]
    names = [name.removesuffix(" us").replace(">=", "≥") for name in jitter]
    bars = {
        "type": "bar", "x": names, "y": share, "text": [f"{x:.0f} %" if x >= 1.0 else "" for x in share],
        "textposition": "outside", "cliponaxis": False, "marker": {"color": BLUE},
    }  # fmt: skip
    across = {"title": {"text": "how late the steps began (µs)"}, "tickfont": {"size": 10}, "type": "category"}
    down = {"title": {"text": "% of steps"}}
    return figure("", 230, [bars], margin={"t": 30, "b": 60}, xaxis=across, yaxis=down)
