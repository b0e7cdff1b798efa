"""The machine as a drawing that moves with a run: played and scrubbed in the browser, without the server.

Plotly frames: each holds only what moves, and the browser redraws only that. Every moving part is a
line or a filled outline, for those are what a frame can change without a redraw of the whole figure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.figures import arm_parts as parts
from workbench.figures.arm_panels import Gauges, Strips, readout
from workbench.figures.arm_style import Look, colour_at, look_of
from workbench.figures.style import TEMPLATE
from workbench.machine import Hoist
from workbench.run import Array

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MOST_FRAMES = 150
HEIGHT = 600


@dataclass(frozen=True, eq=False)
class Scene:
    """A run as the drawing needs it; arrays (n,) over rising time_s, up and hoisting positive.

    wound_m: wire taken in by the drum since height 0. torques_nm: one motor each. slack: either fall.
    speed_reference_m_s: of the carriage, where there is one. tension_of, height_of: where these come from.
    """

    name: str
    payload_kg: float
    time_s: Array
    height_m: Array
    speed_m_s: Array
    speed_motor_rad_s: Array
    wound_m: Array
    torques_nm: tuple[Array, ...]
    tension_drum_n: Array
    tension_dead_line_n: Array
    slack: np.ndarray
    speed_reference_m_s: Array | None = None
    tension_of: str = "simulated"
    height_of: str = "simulated"

    def at(self, time_s: Array) -> Scene:
        """The scene at other times. Slack is kept where there was any since the time before."""

        def between(values: Array) -> Array:
            return np.interp(time_s, self.time_s, values)

        edges = np.searchsorted(self.time_s, time_s, side="right")
        before = np.concatenate([[0], edges[:-1]])
        slack = np.array([bool(np.any(self.slack[a : max(b, a + 1)])) for a, b in zip(before, edges, strict=True)])
        reference = self.speed_reference_m_s
        return Scene(
            self.name, self.payload_kg, time_s, between(self.height_m), between(self.speed_m_s),
            between(self.speed_motor_rad_s), between(self.wound_m), tuple(between(t) for t in self.torques_nm),
            between(self.tension_drum_n), between(self.tension_dead_line_n), slack,
            None if reference is None else between(reference), self.tension_of, self.height_of,
        )  # fmt: skip


def moving_arm(
    machine: Hoist,
    scene: Scene,
    dark: bool = False,
    most_frames: int = MOST_FRAMES,
    height: int = HEIGHT,
    validate: bool = False,
) -> Figure:
    """The drawing with gauges and strips; play, pause and slider are in the figure itself.

    validate: have plotly check it, which takes four times as long.
    """
    import plotly.graph_objects as go

    look = look_of(dark)
    n = min(most_frames, max(2, len(scene.time_s)))
    coarse = scene.at(np.linspace(float(scene.time_s[0]), float(scene.time_s[-1]), n))
    stage = _Stage(machine, scene, look)
    still, moments = stage.still(), [stage.moving(coarse, k) for k in range(n)]
    numbers = list(range(len(still), len(still) + len(moments[0])))
    frames = [{"name": str(k), "data": data, "traces": numbers} for k, data in enumerate(_only_what_changes(moments))]
    # Unchecked by plotly, which would take four times as long: a test has it checked.
    figure: Figure = go.Figure(
        data=[*still, *moments[0]], layout=stage.layout(coarse) | {"height": height}, frames=frames, _validate=validate
    )
    return figure


def _only_what_changes(moments: list[list[dict[str, Any]]]) -> list[list[dict[str, Any]]]:
    """The moving traces of each frame without what is alike in all of them."""
    keys = [
        [key for key in trace if key == "type" or any(moment[i][key] != trace[key] for moment in moments[1:])]
        for i, trace in enumerate(moments[0])
    ]
    return [[{key: trace[key] for key in kept} for trace, kept in zip(m, keys, strict=True)] for m in moments]


class _Stage:
    """What stands still, what moves, and the axes they stand on."""

    def __init__(self, machine: Hoist, scene: Scene, look: Look):
        self.machine, self.scene, self.look = machine, scene, look
        self.sizes = parts.sizes(machine)
        self.half_pipe = parts.half_pipe(self.sizes, scene.payload_kg, machine.carriage.mass_kg)
        self.pipe_edge = 1.2 if self.half_pipe else 0.0
        self.gauges = Gauges(machine, scene, look)
        self.strips = Strips(machine, scene, look)

    def _filled(self, outline: parts.Outline, fill: str, edge: str, width: float = 1.6) -> dict[str, Any]:
        return _trace(outline) | {"fill": "toself", "fillcolor": fill, "line": {"color": edge, "width": width}}

    def still(self) -> list[dict[str, Any]]:
        s, look = self.sizes, self.look
        chords, bracing = parts.mast(s)
        drum = parts.moved(parts.circle(s.R), s.drum_x, s.top)
        machine = [
            _line(parts.floor_line(s), look.faint, 1.2),
            _line(bracing, look.faint, 1.4),
            _line(chords, look.edge, 3.2),
            self._filled(parts.frame(s), look.steel, look.edge),
            self._filled(parts.bracket(s), look.steel, look.edge),
            self._filled(drum, look.wheel, look.edge, 2.2),
        ]
        return [*machine, *self.strips.still()]

    def moving(self, scene: Scene, k: int) -> list[dict[str, Any]]:
        """What moves, at sample k."""
        s, look, u = self.sizes, self.look, self.sizes.u
        h = float(scene.height_m[k])
        drum_angle, sheave_angle = float(scene.wound_m[k]) / s.R, -float(scene.wound_m[k]) / (2.0 * s.r)
        fall_1 = parts.path((-s.r, s.top), (-s.r, h))
        around = parts.moved(parts.circle(s.r, 17, math.pi, 2.0 * math.pi), 0.0, h)
        fall_2 = parts.path((s.r, h), (s.r, s.top))
        on_drum = parts.moved(parts.circle(s.R, 33, 0.0, 1.5 * math.pi), s.drum_x, s.top)
        tensions = [float(t[k]) for t in (scene.tension_drum_n, scene.tension_dead_line_n)]
        slack = bool(scene.slack[k])
        colours = [colour_at(tension, self.gauges.largest_n) for tension in (*tensions, sum(tensions) / 2.0)]
        dash = "6px,5px" if slack else "solid"
        wheels = {"size": 8, "color": look.wheel, "line": {"color": look.edge, "width": 1.6}}
        wheel = parts.joined(parts.circle(s.r), parts.circle(0.2 * s.r, 13))
        return [
            self._filled(parts.moved(parts.arm(s), 0.0, h), look.steel, look.edge),
            self._filled(parts.moved(parts.pipe(s, self.half_pipe), 0.0, h), look.pipe, look.edge, self.pipe_edge),
            self._filled(parts.moved(parts.gripper(s, self.half_pipe), 0.0, h), look.arm, look.edge),
            self._filled(parts.moved(parts.carriage(s), 0.0, h), look.arm, look.edge),
            _trace(parts.moved(parts.rollers(s), 0.0, h)) | {"mode": "markers", "marker": wheels},
            self._filled(parts.moved(wheel, 0.0, h), look.wheel, look.edge, 2.0),
            _line(parts.moved(parts.spokes(s.r, sheave_angle), 0.0, h), look.edge, 2.2),
            _line(parts.moved(parts.spokes(s.R, drum_angle), s.drum_x, s.top), look.edge, 2.6),
            _line(_mark(s.R, drum_angle, s.drum_x, s.top), look.accent, 4.0),
            _line(_mark(s.r, sheave_angle, 0.0, h), look.accent, 3.4),
            _line(parts.joined(on_drum, fall_1, around, fall_2), look.casing, 7.5),
            _line(parts.joined(on_drum, fall_1), colours[0], 4.5, dash),
            _line(around, colours[2], 4.5, dash),
            _line(fall_2, colours[1], 4.5, dash),
            _trace(parts.path((s.reach - self.half_pipe - 0.5 * u, h), (s.r + 0.2 * u, (h + s.top) / 2.0)))
            | {"mode": "text", "text": [self._payload_text(), "SLACK" if slack else ""]}
            | {"textposition": ["middle left", "middle right"]}
            | {"textfont": {"size": [14, 20], "color": [look.ink, look.alarm]}},
            readout(scene, k, self.machine, look),
            *self.gauges.moving(scene, k),
            *self.strips.moving(scene, k),
        ]

    def _payload_text(self) -> str:
        mass = self.scene.payload_kg
        return "empty" if mass <= 0.0 else f"{mass:.0f} kg"

    def layout(self, coarse: Scene) -> dict[str, Any]:
        s, look = self.sizes, self.look
        machine_axes = {
            "xaxis": {"domain": [0.05, 0.38], "anchor": "y", "range": list(s.x_range), "visible": False,
                      "fixedrange": True},
            "yaxis": {"domain": [0.14, 1.0], "anchor": "x", "range": list(s.y_range), "scaleanchor": "x",
                      "title": {"text": "height (m)"}, "tickvals": _heights(s), "zeroline": False, "fixedrange": True,
                      "gridcolor": look.grid},
        }  # fmt: skip
        axes = machine_axes | self.gauges.axes() | self.strips.axes()
        return {
            "template": TEMPLATE if not look.dark else look.template,
            "margin": {"l": 8, "r": 12, "t": 12, "b": 8},
            "showlegend": False,
            "hovermode": False,
            "annotations": self.gauges.notes(),
            "shapes": [*self.gauges.shapes(), *self.strips.shapes()],
            **axes,
            **_controls(coarse.time_s, look),
        }


def _mark(radius: float, angle: float, x: float, y: float) -> parts.Outline:
    c, s = math.cos(angle), math.sin(angle)
    return parts.path((x + 0.3 * radius * c, y + 0.3 * radius * s), (x + 0.92 * radius * c, y + 0.92 * radius * s))


def _heights(s: parts.Sizes) -> list[float]:
    step = next(step for step in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0) if (s.top - s.low) / step <= 7.0)
    first = math.ceil(s.low / step)
    return [k * step for k in range(first, math.floor(s.top / step) + 1)]


def _trace(outline: parts.Outline) -> dict[str, Any]:
    x, y = outline
    return {"type": "scatter", "mode": "lines", "x": _short(x), "y": _short(y), "hoverinfo": "skip"}


def _short(values: Array) -> list[float | None]:
    """To the millimetre: a drawing needs no more, and a page of frames is a third as large."""
    return [None if math.isnan(v) else round(v, 3) for v in values.tolist()]


def _line(outline: parts.Outline, colour: str, width: float, dash: str = "solid") -> dict[str, Any]:
    return _trace(outline) | {"line": {"color": colour, "width": width, "dash": dash, "simplify": False}}


def _controls(time_s: Array, look: Look) -> dict[str, Any]:
    """Play in real time, four times as fast, pause; the slider scrubs."""
    step_ms = 1000.0 * float(time_s[1] - time_s[0])

    def play(times: float) -> list[Any]:
        frame = {"duration": step_ms / times, "redraw": False}
        return [None, {"frame": frame, "fromcurrent": True, "mode": "immediate", "transition": {"duration": 0}}]

    stop = [[None], {"frame": {"duration": 0, "redraw": False}, "mode": "immediate", "transition": {"duration": 0}}]
    buttons = [
        {"label": "▶ play", "method": "animate", "args": play(1.0)},
        {"label": "▶▶ 4×", "method": "animate", "args": play(4.0)},
        {"label": "❚❚ pause", "method": "animate", "args": stop},
    ]
    steps = [
        {"label": f"{t:.1f}", "method": "animate", "args": [[str(k)], stop[1]]} for k, t in enumerate(time_s.tolist())
    ]
    ink = {"color": look.ink, "size": 13}
    return {
        "updatemenus": [
            {"type": "buttons", "direction": "right", "showactive": False, "buttons": buttons, "x": 0.0, "y": 0.055,
             "xanchor": "left", "yanchor": "top", "pad": {"l": 4, "t": 4}, "font": ink, "bgcolor": look.steel,
             "bordercolor": look.edge}
        ],
        "sliders": [
            {"active": 0, "steps": steps, "x": 0.27, "len": 0.73, "y": 0.065, "xanchor": "left", "yanchor": "top",
             "pad": {"t": 0, "b": 0}, "ticklen": 0, "minorticklen": 0, "font": {"color": "rgba(0,0,0,0)", "size": 1},
             "bgcolor": look.grid, "activebgcolor": look.accent, "bordercolor": look.edge,
             "transition": {"duration": 0}, "currentvalue": {"visible": False}}
        ],
    }  # fmt: skip
