"""The paper's figures of a validation (Figures 6 to 8), and the torque residual."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from workbench.core.run import Array, Run
from workbench.view.panels import Panels, ranges_below_names
from workbench.view.style import AFTER, BEFORE, BLACK, GREY, ORANGE, PURPLE, line

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

# Runs side by side in a grid of this many columns.
COLUMNS = 2


def run_grid(title: str, y_title: str, names: Sequence[str]) -> tuple[Panels, list[tuple[int, int]], int]:
    """A panel a run: panels, (row, column) of each run, height."""
    columns = min(COLUMNS, len(names))
    rows = -(-len(names) // columns)
    panels = Panels(title, [y_title] * rows, [""] * columns)
    places = [divmod(index, columns) for index in range(len(names))]
    for (row, column), name in zip(places, names, strict=True):
        number = panels._number(row, column)
        panels.annotations.append(
            {"text": f"<b>{name}</b>", "x": 0.01, "y": 0.99, "xref": f"x{number} domain", "yref": f"y{number} domain"}
            | {"xanchor": "left", "yanchor": "top", "showarrow": False, "font": {"size": 13}}
            | {"bgcolor": "rgba(255,255,255,0.7)"}
        )
    return panels, places, 150 + max(220 * rows, 330)


def torque_profiles(runs: Sequence[Run], nominal_torque_nm: float) -> Figure:
    """Fig. 6: both motors' measured torque over one motor's nominal torque, a panel a run."""
    panels, places, height = run_grid("Measured motor torque", "torque / nominal", [run.name for run in runs])
    drawn = []
    for (row, column), run in zip(places, runs, strict=True):
        if "torque_motor1_nm" in run and "torque_motor2_nm" in run:
            torques = {f"motor {number}": run[f"torque_motor{number}_nm"] / nominal_torque_nm for number in (1, 2)}
        else:
            torques = {"mean of both motors": run["torque_motor_nm"] / (2.0 * nominal_torque_nm)}
        for name, torque in torques.items():
            panels.line(
                row, column, run.time_s, torque, name, line(name if len(torques) > 1 else "measured", width=1.4)
            )
        drawn.append(list(torques.values()))
    return panels.figure(height, ranges_below_names(places, drawn))


def input_profiles(runs: Sequence[Run], signal: str, unit: str) -> Figure:
    """Fig. 6 for an axis: the measured force (torque) in its own unit, a panel a run."""
    quantity = signal.rpartition("_")[0].replace("_", " ")
    panels, places, height = run_grid(f"Measured {quantity}", f"{quantity} ({unit})", [run.name for run in runs])
    for (row, column), run in zip(places, runs, strict=True):
        panels.line(row, column, run.time_s, run[signal], "measured", line("measured", width=1.2), unit)
    return panels.figure(height, ranges_below_names(places, [[run[signal]] for run in runs]))


def speed_comparison(
    pairs: Sequence[tuple[Run, Run]],
    nominal_speed: float,
    rmse_percent: Sequence[float] | None = None,
    signal: str = "speed_motor_rad_s",
    restarted: Sequence[Array] = (),
    scale_name: str = "nominal",
) -> Figure:
    """Fig. 8: measured and simulated speed in per cent of `nominal_speed`, a panel a run.

    pairs: (measured, simulated), each with `signal`, in the unit of nominal_speed; their times may differ.
    rmse_percent: said beside the run's name. restarted: (n,) of each run, at the simulated run's times.
    """
    names = [measured.name for measured, _ in pairs]
    if rmse_percent is not None:
        names = [f"{name}</b>, RMSE {value:.2f} %<b>" for name, value in zip(names, rmse_percent, strict=True)]
    panels, places, height = run_grid("Measured and simulated speed", f"speed (% of {scale_name})", names)
    drawn = []
    for index, ((row, column), pair) in enumerate(zip(places, pairs, strict=True)):
        drawn.append([run[signal] * (100.0 / nominal_speed) for run in pair])
        for name, run in zip(("measured", "simulated"), pair, strict=True):
            speed = run[signal] * (100.0 / nominal_speed)
            # The measured line is wide and lies below, so that it is seen where both agree.
            width = 3.4 if name == "measured" else 1.6
            panels.line(row, column, run.time_s, speed, name, line(name, width=width), "%")
        if restarted:
            speed = restarted[index] * (100.0 / nominal_speed)
            look = {"color": PURPLE, "dash": "5px,3px", "width": 1.3, "simplify": False}
            panels.line(row, column, pair[1].time_s, speed, "restarted every 2 s", look, "%")
    return panels.figure(height, ranges_below_names(places, drawn))


def torque_residual(
    names: Sequence[str],
    times_s: Sequence[Array],
    residuals: Sequence[Array],
    unit: str = "N m",
    noise_rms: float | None = None,
    windows: Sequence[Sequence[tuple[float, float]]] = (),
    rests: Sequence[Sequence[tuple[float, float]]] = (),
    before: Sequence[Array] = (),
    limit: float | None = None,
) -> Figure:
    """Measured minus predicted torque (or force) over time, a panel a run, both low-passed alike.

    noise_rms: drawn as ± twice its value. windows, rests: for each run stretches to shade, orange and grey.
    before: the same of an earlier model, drawn below. limit: of the vertical axis, both ways.
    """
    quantity = "torque" if unit == "N m" else "force"
    legend = [] if noise_rms is None else [f"dashed: ± 2 × noise of {noise_rms:.2g} {unit}"]
    if any(rests):
        legend.append("grey: at rest or at an end, left out")
    title = f"{quantity.capitalize()} residual" + (f" ({'; '.join(legend)})" if legend else "")
    panels, places, height = run_grid(title, f"{quantity} residual ({unit})", names)
    for index, (row, column) in enumerate(places):
        if before:
            look = {"color": BEFORE, "dash": "solid", "width": 1.1, "simplify": False}
            panels.line(row, column, times_s[index], before[index], "before", look, unit)
        name, colour = ("after", AFTER) if before else ("measured − predicted", BLACK)
        look = {"color": colour, "dash": "solid", "width": 1.1, "simplify": False}
        panels.line(row, column, times_s[index], residuals[index], name, look, unit)
        if noise_rms is not None:
            panels.level(row, column, 2.0 * noise_rms)
            panels.level(row, column, -2.0 * noise_rms)
        for stretches, colour in ((windows, ORANGE), (rests, "#BBBBBB")):
            for start, end in stretches[index] if index < len(stretches) else ():
                panels.shade(row, column, start, end, colour)
    rows = {row for row, _ in places}
    return panels.figure(height, None if limit is None else dict.fromkeys(rows, (-limit, limit)))


def friction_law(
    speed: Array,
    laws: Sequence[tuple[str, Array]],
    weight: float | None,
    measured: tuple[Array, Array] | None = None,
    speed_unit: str = "m/s",
    unit: str = "N",
) -> Figure:
    """Fig. 7: friction force over the weight of the combined mass, against speed.

    speed: (m,); laws: name -> force (m,), such as nominal and identified; weight: what the force is
    divided by, in the same unit, None leaves it in `unit`; measured: (speed, force) points of a force
    balance, drawn small and grey.
    """
    quantity = "torque" if unit == "N m" else "force"
    y_title = f"friction {quantity} ({unit})" if weight is None else "friction force / weight (–)"
    divisor = 1.0 if weight is None else weight
    panels = Panels("Friction law", [y_title], x_title=f"speed ({speed_unit})")
    if measured is not None:
        points = {"mode": "markers", "marker": {"size": 4, "color": GREY, "opacity": 0.35}}
        # Every so many points, in order of speed: a cloud has no peaks that min-max thinning would keep.
        step = max(len(measured[0]) // 1400, 1)
        order = np.argsort(measured[0])[::step]
        panels.line(
            0, 0, measured[0][order], measured[1][order] / divisor, "force balance of the log", {}, "", **points
        )
    looks = [line("simulated", width=2.4), {"color": BLACK, "dash": "6px,3px", "width": 2.0}]
    for number, (name, force) in enumerate(laws):
        panels.line(0, 0, speed, force / divisor, name, looks[number] if number < 2 else line(name, number))
    return panels.figure(520)
