"""Figures of a study: the runs over time, and what they cost over payload."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.core.run import Array, Run
from workbench.figures.panels import Panels
from workbench.view.style import GREY, MARKERS, PURPLE, label, line

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

# More columns than this leave no panel wide enough to read at 1280 px.
MOST_COLUMNS = 3
QUANTITIES = ("speed", "error", "torque", "tension")
_TITLES = {
    "speed": "motor speed<br>(rad/s)",
    "error": "set point − speed<br>(rad/s)",
    "torque": "torque per motor<br>(N m)",
    "tension": "wire tension<br>(kN)",
}


def overview(
    runs: Sequence[tuple[str, Run]],
    nominal_torque_nm: float,
    torque_limit_nm: float,
    title: str = "Closed loop",
    window_s: tuple[float, float] | None = None,
    quantities: Sequence[str] = QUANTITIES,
    height: int = 780,
) -> Figure:
    """Speed and set point, tracking error, torque of the harder-worked motor, wire tension; a column a payload.

    runs: (reference, run) with the closed loop's signals. nominal_torque_nm, torque_limit_nm: of one motor.
    window_s: the stretch of time drawn; without it all. quantities: some of QUANTITIES. Of more than three payloads the
    lightest, a middle and the heaviest are drawn, and the title says so.
    """
    payloads = sorted({run.payload_kg for _, run in runs})
    shown = payloads
    if len(payloads) > MOST_COLUMNS:
        shown = [payloads[i] for i in np.linspace(0, len(payloads) - 1, MOST_COLUMNS).round().astype(int)]
        title = f"{title} ({len(shown)} of {len(payloads)} payloads)".strip()
    panels = Panels(
        title,
        [_TITLES[q] for q in quantities],
        [f"payload {p:g} kg" for p in shown],
        row_weights=[{"error": 0.75, "torque": 1.25}.get(q, 1.0) for q in quantities],
        one_cursor=True,
    )
    # The set point's legend entry comes last; its lines lie under the others.
    references = list(dict.fromkeys(reference for reference, _ in runs))
    for number, reference in enumerate(references):
        for kind, run in runs:
            if kind == reference and run.payload_kg in shown:
                part = run if window_s is None else _within(run, *window_s)
                _draw(panels, shown.index(run.payload_kg), part, quantities, label(kind), line(kind, number))
    if "torque" in quantities:
        row = quantities.index("torque")
        for column in range(len(shown)):
            # The lightest payload leaves the most room below the lines for their names.
            first = column == 0
            panels.level(row, column, nominal_torque_nm, f"nominal {nominal_torque_nm:.4g} N m" if first else "", "dot")
            panels.level(row, column, torque_limit_nm, f"limit {torque_limit_nm:.4g} N m" if first else "", "dash")
    return panels.figure(height)


def _draw(panels: Panels, column: int, run: Run, quantities: Sequence[str], name: str, look: dict[str, Any]) -> None:
    t = run.time_s
    for row, quantity in enumerate(quantities):
        if quantity == "speed":
            panels.line(row, column, t, run["speed_motor_rad_s"], name, look, "rad/s")
            thin_dots = line("set point", width=1.2)
            panels.line(row, column, t, run["speed_reference_rad_s"], "set points", thin_dots, "rad/s", legendrank=2000)
        elif quantity == "error":
            error = run["speed_reference_rad_s"] - run["speed_motor_rad_s"]
            panels.line(row, column, t, error, name, look, "rad/s")
        elif quantity == "torque":
            panels.line(row, column, t, harder_worked_nm(run), name, look, "N m")
        else:
            panels.line(row, column, t, run["tension_drum_n"] / 1000.0, name, look, "kN")
            for start, end in slack_stretches(run):
                panels.shade(row, column, start, end, PURPLE, edge=2.0, text="slack")


def _within(run: Run, start_s: float, end_s: float) -> Run:
    inside = (run.time_s >= start_s) & (run.time_s <= end_s)
    signals = {name: values[inside] for name, values in run.signals.items()}
    return replace(run, time_s=run.time_s[inside], signals=signals)


def harder_worked_nm(run: Run) -> Array:
    """The torque of whichever motor carries more at each time; half the sum where motors are not told apart."""
    if "torque_motor1_nm" not in run or "torque_motor2_nm" not in run:
        return run["torque_motor_nm"] / 2.0
    one, two = run["torque_motor1_nm"], run["torque_motor2_nm"]
    return np.where(np.abs(one) >= np.abs(two), one, two)


def slack_stretches(run: Run) -> list[tuple[float, float]]:
    """Start and end (s) of each stretch in which a wire carries nothing."""
    if "tension_min_n" not in run:
        return []
    slack = np.concatenate(([False], run["tension_min_n"] <= 0.0, [False]))
    starts, ends = np.flatnonzero(slack[1:] & ~slack[:-1]), np.flatnonzero(~slack[1:] & slack[:-1])
    return [(float(run.time_s[a]), float(run.time_s[b - 1])) for a, b in zip(starts, ends, strict=True)]


def peak_torque_over_payload(
    payload_kg: Array,
    peaks_nm: Mapping[str, Array],
    nominal_torque_nm: float,
    torque_limit_nm: float,
    static_nm: Array | None = None,
    height: int = 520,
) -> Figure:
    """The harder-worked motor's torque peak over payload, a line a reference.

    payload_kg: (n,); peaks_nm: reference -> (n,), NaN where a run failed; static_nm: (n,) the torque
    per motor that holds the load.
    """
    panels = Panels("Torque peak over payload", ["torque peak per motor (N m)"], x_title="payload (kg)")
    order = np.argsort(payload_kg)
    for number, (kind, peak) in enumerate(peaks_nm.items()):
        marker = {"symbol": MARKERS[number % len(MARKERS)], "size": 9}
        look = line(kind, number, 2.2)
        x, y = payload_kg[order], np.asarray(peak)[order]
        panels.line(0, 0, x, y, label(kind), look, "N m", mode="lines+markers", marker=marker)
    ran = [peak[np.isfinite(peak)] for peak in map(np.asarray, peaks_nm.values())]
    levels = [torque_limit_nm, nominal_torque_nm, *(float(np.max(peak)) for peak in ran if peak.size)]
    if static_nm is not None:
        held = {"color": GREY, "dash": "2px,2px", "width": 1.5}
        panels.line(0, 0, payload_kg[order], static_nm[order], "holding the load", held, "N m")
    panels.level(0, 0, nominal_torque_nm, f"nominal {nominal_torque_nm:.4g} N m", "dot")
    panels.level(0, 0, torque_limit_nm, f"limit {torque_limit_nm:.4g} N m", "dash")
    figure = panels.figure(height, y_ranges={0: (0.0, 1.08 * max(x for x in levels if np.isfinite(x)))})
    figure.update_layout(hovermode="x unified")
    return figure
