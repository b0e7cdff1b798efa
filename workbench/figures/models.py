"""Both models of one machine over time: speeds, their difference, the forces that only one of them has."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from workbench.core.run import Run
from workbench.view.panels import ranges_below_names
from workbench.view.replay import run_grid
from workbench.view.style import BLUE, ORANGE, SPARE, line

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

SPEED = "speed_motor_rad_s"
_FORCES = ("force_roller_", "force_cylinder_n")


class Pair(Protocol):
    """A record and both models' run under its torque."""

    @property
    def name(self) -> str: ...
    @property
    def measured(self) -> Run: ...
    @property
    def lumped(self) -> Run: ...
    @property
    def multibody(self) -> Run: ...


def models_speed(runs: Sequence[Pair], scale_rad_s: float) -> Figure:
    """Fig. 8 of the paper: speed of the record and of both models in per cent of nominal, a panel a run."""
    panels, places, height = run_grid("Motor speed of both models", "speed (% of nominal)", [run.name for run in runs])
    looks = {
        "measured": line("measured", width=3.4),
        "lumped": {"color": ORANGE, "width": 1.8, "simplify": False},
        "multi-body": {"color": BLUE, "dash": "5px,3px", "width": 1.6, "simplify": False},
    }
    drawn = []
    for (row, column), run in zip(places, runs, strict=True):
        speeds = {}
        for name, source in (("measured", run.measured), ("lumped", run.lumped), ("multi-body", run.multibody)):
            speeds[name] = source[SPEED] * (100.0 / scale_rad_s)
            panels.line(row, column, source.time_s, speeds[name], name, looks[name], "%")
        drawn.append(list(speeds.values()))
    return panels.figure(height, ranges_below_names(places, drawn))


def models_apart(runs: Sequence[Pair], scale_rad_s: float) -> Figure:
    """Multi-body less lumped motor speed in per cent of nominal."""
    panels, places, height = run_grid("Difference of both models", "speed (% of nominal)", [run.name for run in runs])
    drawn = []
    for (row, column), run in zip(places, runs, strict=True):
        apart = (run.multibody[SPEED] - run.lumped[SPEED]) * (100.0 / scale_rad_s)
        look = {"color": BLUE, "width": 1.6, "simplify": False}
        panels.line(row, column, run.multibody.time_s, apart, "multi-body − lumped", look, "%")
        drawn.append([apart])
    return panels.figure(height, ranges_below_names(places, drawn))


def models_forces(runs: Sequence[Pair]) -> Figure:
    """Forces of rollers and cylinders, kN."""
    panels, places, height = run_grid("Forces of rollers and cylinders", "force (kN)", [run.name for run in runs])
    drawn = []
    for (row, column), run in zip(places, runs, strict=True):
        names = [name for name in run.multibody.signals if name.startswith(_FORCES)]
        for number, name in enumerate(names):
            colour, dash = SPARE[number % len(SPARE)]
            shown = name.removeprefix("force_").removesuffix("_n").replace("_", " ")
            look = {"color": colour, "dash": dash, "width": 1.4, "simplify": False}
            panels.line(row, column, run.multibody.time_s, run.multibody[name] / 1000.0, shown, look, "kN")
        drawn.append([run.multibody[name] / 1000.0 for name in names] or [np.zeros(1)])
    return panels.figure(height, ranges_below_names(places, drawn))
