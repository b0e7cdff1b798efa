"""Torque over speed of one motor, inside what the drive can give."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from workbench.core.run import Array, Run
from workbench.figures.panels import Panels
from workbench.figures.study import MOST_COLUMNS, harder_worked_nm
from workbench.view.style import GREY, label, line

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def envelope_nm(speed_rad_s: Array, torque_nm: float, nominal_speed_rad_s: float, field_weakening: bool) -> Array:
    """Torque (n,) that a motor gives at speeds (n,): constant up to nominal speed, then at constant power."""
    if not field_weakening:
        return np.full_like(speed_rad_s, torque_nm)
    return torque_nm * np.minimum(1.0, nominal_speed_rad_s / np.maximum(np.abs(speed_rad_s), 1e-9))


def torque_speed_plane(
    runs: Sequence[tuple[str, Run]],
    nominal_torque_nm: float,
    torque_limit_nm: float,
    nominal_speed_rad_s: float,
    field_weakening: bool = True,
    height: int = 560,
) -> Figure:
    """The harder-worked motor's path in the torque-speed plane; continuous and peak envelope; a column a payload.

    runs: (reference, run) with the closed loop's signals.
    """
    payloads = sorted({run.payload_kg for _, run in runs})
    if len(payloads) > MOST_COLUMNS:
        payloads = [payloads[i] for i in np.linspace(0, len(payloads) - 1, MOST_COLUMNS).round().astype(int)]
    panels = Panels(
        "Torque and speed of one motor, in what the drive can give", ["torque per motor (N m)"],
        [f"payload {p:g} kg" for p in payloads], x_title="motor speed (rad/s)",
    )  # fmt: skip
    fastest = max([nominal_speed_rad_s * 1.15, *(float(np.abs(run["speed_motor_rad_s"]).max()) for _, run in runs)])
    speed = np.linspace(-fastest, fastest, 241)
    for column in range(len(payloads)):
        for torque, name, dash in ((nominal_torque_nm, "continuous", "2px,2px"), (torque_limit_nm, "peak", "6px,3px")):
            edge = envelope_nm(speed, torque, nominal_speed_rad_s, field_weakening)
            closed = np.concatenate([speed, speed[::-1], speed[:1]]), np.concatenate([edge, -edge[::-1], edge[:1]])
            look = {"color": GREY, "dash": dash, "width": 1.6, "simplify": False}
            panels.line(0, column, *closed, f"{name} {torque:.4g} N m", look, hoverinfo="skip", hovertemplate=None)
    for number, kind in enumerate(dict.fromkeys(kind for kind, _ in runs)):
        for of_kind, run in runs:
            if of_kind == kind and run.payload_kg in payloads:
                x, y = _fewer(run["speed_motor_rad_s"], harder_worked_nm(run))
                column = payloads.index(run.payload_kg)
                panels.line(0, column, x, y, label(kind), line(kind, number, 1.4), hovertemplate=_HOVER)
    figure = panels.figure(height)
    figure.update_layout(hovermode="closest")
    return figure


_HOVER = "%{x:.4~g} rad/s, %{y:.4~g} N m"


def _fewer(x: Array, y: Array, most: int = 1400) -> tuple[Array, Array]:
    """Points of a path where it moves: stretches at rest are left out, corners stay."""
    scale = np.ptp(x) or 1.0, np.ptp(y) or 1.0
    length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x) / scale[0], np.diff(y) / scale[1]))])
    if len(x) <= most or length[-1] == 0.0:
        return x, y
    keep = np.unique(np.searchsorted(length, np.linspace(0.0, length[-1], most)).clip(max=len(x) - 1))
    keep = np.unique(np.concatenate([keep, [np.argmax(y), np.argmin(y), np.argmax(x), np.argmin(x)]]))
    return x[keep], y[keep]
