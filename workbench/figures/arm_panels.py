"""Beside the drawing of the machine: figures of the moment, gauges of tension and torque, strips over time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.figures.arm_style import Look, colour_at
from workbench.figures.style import PURPLE, SKY
from workbench.figures.thin import thin
from workbench.machine import Hoist
from workbench.run import Array

if TYPE_CHECKING:
    from workbench.figures.arm import Scene

MOTORS = ((SKY, "solid"), (PURPLE, "4px,2px"))
GAUGE_Y = [0.2, 0.68]
STRIP_POINTS = 500
BAR_STEPS = 48


def readout(scene: Scene, k: int, machine: Hoist, look: Look) -> dict[str, Any]:
    """Time, height, speeds, as large as a meeting room needs them."""
    speed, motor = float(scene.speed_m_s[k]), float(scene.speed_motor_rad_s[k])
    nominal = 100.0 * motor / machine.motor.nominal_speed_rad_s
    text = [
        f"<b>{scene.time_s[k]:.1f} s</b>",
        f"height <b>{scene.height_m[k]:.2f} m</b>",
        f"carriage <b>{_signed(speed, 2)} m/s</b>",
        f"motors {_signed(motor, 0)} rad/s, {_signed(nominal, 0)} %",
    ]
    return {
        "type": "scatter", "mode": "text", "x": [0.0] * 4, "y": [0.86, 0.58, 0.34, 0.12], "xaxis": "x2", "yaxis": "y2",
        "text": text, "textposition": "middle right", "hoverinfo": "skip",
        "textfont": {"size": [26, 17, 17, 13], "color": [look.ink, look.ink, look.ink, look.less]},
    }  # fmt: skip


def _signed(value: float, digits: int) -> str:
    shown = round(value, digits) + 0.0
    return f"{shown:+.{digits}f}".replace("-", "\N{MINUS SIGN}") if shown else f"{0.0:.{digits}f}"


def _bar(x: str, xs: list[float], ys: list[float], colour: str, width: float, dash: str = "solid") -> dict[str, Any]:
    line = {"color": colour, "width": width, "dash": dash, "simplify": False}
    return {
        "type": "scatter", "mode": "lines", "x": xs, "y": ys, "line": line, "hoverinfo": "skip",
        "xaxis": f"x{x}", "yaxis": f"y{x}",
    }  # fmt: skip


class Gauges:
    """Tension in kN as a strip of the wire's colours with a pointer a fall; torque of each motor as a bar."""

    def __init__(self, machine: Hoist, scene: Scene, look: Look):
        self.look = look
        alone = len(scene.torques_nm) == 1
        self.names = ["each" if machine.motor.count > 1 else "1"] if alone else ["1", "2"]
        self.nominal_nm = machine.motor.nominal_torque_nm
        self.limit_nm = self.nominal_nm * machine.drive.overload
        most = max(float(np.max(scene.tension_drum_n)), float(np.max(scene.tension_dead_line_n)), 1.0)
        self.largest_n = 5000.0 * math.ceil(most / 5000.0)
        torque = max(float(np.max(np.abs(t))) for t in scene.torques_nm)
        self.largest_nm = 1.12 * max(self.limit_nm, torque)
        self.lowest_nm = min(0.0, *(1.12 * float(np.min(t)) for t in scene.torques_nm))

    def moving(self, scene: Scene, k: int) -> list[dict[str, Any]]:
        look = self.look
        tensions = [float(scene.tension_drum_n[k]) / 1000.0, float(scene.tension_dead_line_n[k]) / 1000.0]
        pointers = {
            "type": "scatter", "mode": "markers+text", "x": [1.35, 1.75], "y": tensions, "xaxis": "x3", "yaxis": "y3",
            "marker": {"symbol": ["triangle-left", "triangle-left-open"], "size": 13, "color": look.ink},
            "hoverinfo": "skip", "cliponaxis": False, "text": ["", ""],
        }  # fmt: skip
        bars = [
            _bar("4", [i + 0.5, i + 0.5], [0.0, float(torque[k])], MOTORS[i % 2][0], 24.0)
            for i, torque in enumerate(scene.torques_nm)
        ]
        values = {
            "type": "scatter", "mode": "text", "x": [i + 0.5 for i in range(len(scene.torques_nm))],
            "y": [float(t[k]) for t in scene.torques_nm], "xaxis": "x4", "yaxis": "y4", "hoverinfo": "skip",
            "text": [f"{float(t[k]):.0f}".replace("-", "\N{MINUS SIGN}") for t in scene.torques_nm],
            "textposition": "top center", "textfont": {"size": 13, "color": look.ink},
        }  # fmt: skip
        return [pointers, *bars, values]

    def axes(self) -> dict[str, Any]:
        hidden = {"visible": False, "fixedrange": True}
        return {
            "xaxis2": {"domain": [0.435, 0.65], "anchor": "y2", "range": [0, 1], **hidden},
            "yaxis2": {"domain": [0.74, 1.0], "anchor": "x2", "range": [0, 1], **hidden},
            "xaxis3": {"domain": [0.462, 0.502], "anchor": "y3", "range": [0, 2], **hidden},
            "yaxis3": {"domain": GAUGE_Y, "anchor": "x3", "range": [0, self.largest_n / 1000.0], "fixedrange": True,
                       "showgrid": False, "zeroline": False, "nticks": 8},
            "xaxis4": {"domain": [0.565, 0.645], "anchor": "y4", "range": [0, len(self.names)],
                       "fixedrange": True, "showgrid": False, "ticks": "", "ticktext": self.names,
                       "tickvals": [i + 0.5 for i in range(len(self.names))]},
            "yaxis4": {"domain": GAUGE_Y, "anchor": "x4", "range": [self.lowest_nm, self.largest_nm],
                       "fixedrange": True, "nticks": 8},
        }  # fmt: skip

    def shapes(self) -> list[dict[str, Any]]:
        top = self.largest_n / 1000.0
        colours = [
            {"type": "rect", "xref": "x3", "yref": "y3", "x0": 0, "x1": 1, "line": {"width": 0}, "layer": "below",
             "y0": top * k / BAR_STEPS, "y1": top * min(k + 1.2, BAR_STEPS) / BAR_STEPS,
             "fillcolor": colour_at(top * (k + 0.5) / BAR_STEPS, top)}
            for k in range(BAR_STEPS)
        ]  # fmt: skip
        place = {"type": "line", "xref": "x4 domain", "yref": "y4", "x0": 0, "x1": 1}
        levels = [
            (sign * level, width, dash)
            for level, width, dash in ((self.nominal_nm, 1.6, "5px,3px"), (self.limit_nm, 2.4, "solid"))
            for sign in (1.0, -1.0)
        ]
        return colours + [
            place | {"y0": y, "y1": y, "line": {"color": self.look.less, "width": width, "dash": dash}}
            for y, width, dash in levels
            if self.lowest_nm <= y <= self.largest_nm
        ]

    def notes(self) -> list[dict[str, Any]]:
        look = self.look
        head = {"xref": "paper", "yref": "paper", "showarrow": False, "yanchor": "bottom", "y": GAUGE_Y[1] + 0.012,
                "font": {"size": 13, "color": look.ink}, "xanchor": "center"}  # fmt: skip
        foot = {"xref": "paper", "yref": "paper", "showarrow": False, "yanchor": "top", "y": GAUGE_Y[0] - 0.012,
                "font": {"size": 12, "color": look.less}, "xanchor": "center"}  # fmt: skip
        level = {"xref": "x4 domain", "yref": "y4", "x": 1.0, "xanchor": "right", "yanchor": "bottom",
                 "showarrow": False, "font": {"size": 11, "color": look.less}}  # fmt: skip
        return [
            head | {"x": 0.478, "text": "tension (kN)"},
            head | {"x": 0.605, "text": "torque (N m)"},
            foot | {"x": 0.478, "text": "◀ drum ◁ dead line<br>0: slack"},
            foot | {"x": 0.605, "y": GAUGE_Y[0] - 0.05, "text": "motor"},
            level | {"y": self.nominal_nm, "text": "nominal"},
            level | {"y": self.limit_nm, "text": "limit"},
        ]


class Strips:
    """Height, speed, torque and tension over time, with a hand at the moment shown."""

    TITLES = ("height (m)", "speed (m/s)", "torque (N m)", "tension (kN)")

    def __init__(self, machine: Hoist, scene: Scene, look: Look):
        self.scene, self.look = scene, look
        self.nominal_nm = machine.motor.nominal_torque_nm

    def _values(self, scene: Scene) -> list[list[tuple[Array, str, str]]]:
        """Each strip's lines: values, colour, dash. The hand's dot stands on the last."""
        ink, less = self.look.ink, self.look.less
        speed = [(scene.speed_m_s, ink, "solid")]
        if scene.speed_reference_m_s is not None:
            speed.insert(0, (scene.speed_reference_m_s, less, "2px,2px"))
        return [
            [(scene.height_m, ink, "solid")],
            speed,
            self._torques(scene),
            [(scene.tension_dead_line_n / 1000.0, less, "4px,2px"), (scene.tension_drum_n / 1000.0, ink, "solid")],
        ]

    def _torques(self, scene: Scene) -> list[tuple[Array, str, str]]:
        """A line a motor; one where they share alike, for two would hide each other."""
        torques = scene.torques_nm
        if all(np.array_equal(self.scene.torques_nm[0], other) for other in self.scene.torques_nm[1:]):
            return [(torques[0], self.look.ink, "solid")]
        return [(torque, *MOTORS[i % 2]) for i, torque in enumerate(torques)]

    def still(self) -> list[dict[str, Any]]:
        traces = []
        for row, lines in enumerate(self._values(self.scene)):
            for values, colour, dash in lines:
                t, y = thin(self.scene.time_s, values, STRIP_POINTS)
                traces.append(_bar(str(5 + row), np.round(t, 3).tolist(), np.round(y, 3).tolist(), colour, 1.5, dash))
        return traces

    def moving(self, scene: Scene, k: int) -> list[dict[str, Any]]:
        t = float(scene.time_s[k])
        hands = []
        for row, lines in enumerate(self._values(scene)):
            low, high = self.ranges[row]
            hand = _bar(str(5 + row), [t, t, t], [low, float(lines[-1][0][k]), high], self.look.accent, 1.6)
            marker = {"size": [0, 9, 0], "color": self.look.accent, "line": {"width": 0}}
            hands.append(hand | {"mode": "lines+markers", "marker": marker})
        return hands

    @property
    def ranges(self) -> list[tuple[float, float]]:
        ranges = []
        for lines in self._values(self.scene):
            low, high = min(float(np.min(v)) for v, _, _ in lines), max(float(np.max(v)) for v, _, _ in lines)
            room = 0.08 * max(high - low, 1e-3)
            ranges.append((low - room, high + room))
        return ranges

    def axes(self) -> dict[str, Any]:
        axes: dict[str, Any] = {}
        n, low, gap = len(self.TITLES), 0.2, 0.035
        height = (1.0 - low - gap * (n - 1)) / n
        times = [float(self.scene.time_s[0]), float(self.scene.time_s[-1])]
        for row in range(n):
            top = 1.0 - row * (height + gap)
            x: dict[str, Any] = {"domain": [0.725, 1.0], "anchor": f"y{5 + row}", "range": times, "fixedrange": True}
            x |= {"title": {"text": "time (s)"}} if row == n - 1 else {"showticklabels": False, "matches": "x8"}
            axes[f"xaxis{5 + row}"] = x
            axes[f"yaxis{5 + row}"] = {
                "domain": [top - height, top], "anchor": f"x{5 + row}", "range": list(self.ranges[row]), "nticks": 5,
                "fixedrange": True, "title": {"text": self.TITLES[row], "font": {"size": 12}}, "tickfont": {"size": 11},
            }  # fmt: skip
        return axes

    def shapes(self) -> list[dict[str, Any]]:
        """Slack shaded in the strip of the tension."""
        mask = np.concatenate([[False], self.scene.slack, [False]]).astype(int)
        edges = np.flatnonzero(np.diff(mask)).reshape(-1, 2)
        last = len(self.scene.time_s) - 1
        return [
            {"type": "rect", "xref": "x8", "yref": "y8 domain", "y0": 0, "y1": 1, "line": {"width": 0},
             "x0": float(self.scene.time_s[a]), "x1": float(self.scene.time_s[min(b, last)]), "layer": "below",
             "fillcolor": self.look.alarm, "opacity": 0.35}
            for a, b in edges[:200].tolist()
        ]  # fmt: skip
