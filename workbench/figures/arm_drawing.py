"""The multi-body machine's lengths as a drawing, made from its own geometry: docs/img/arm.svg.

python -m workbench.figures.arm_drawing > docs/img/arm.svg
"""

from __future__ import annotations

from workbench.machine import Hoist, default_hoist
from workbench.multibody import geometry_of

Point = tuple[float, float]
_SCALE, _LEFT, _TOP = 95.0, 150.0, 150.0  # px per m, and of the margins
_BLACK, _BLUE, _ORANGE, _GREY, _GREEN = "#222222", "#0072B2", "#D55E00", "#6B6B6B", "#009E73"


class _Drawing:
    """Metres in, pixels out; y goes up."""

    def __init__(self, top_m: float) -> None:
        self.top_m = top_m
        self.lines: list[str] = []

    def at(self, p: Point) -> Point:
        return round(_LEFT + _SCALE * p[0], 1), round(_TOP + _SCALE * (self.top_m - p[1]), 1)

    def line(self, a: Point, b: Point, colour: str = _BLACK, width: float = 2.0, dash: str = "") -> None:
        (x1, y1), (x2, y2) = self.at(a), self.at(b)
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        self.lines.append(
            f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" stroke="{colour}" stroke-width="{width}"{dashed}/>'
        )

    def circle(self, p: Point, radius_px: float, colour: str, fill: str = "white") -> None:
        x, y = self.at(p)
        self.lines.append(
            f'<circle cx="{x}" cy="{y}" r="{radius_px}" stroke="{colour}" stroke-width="2" fill="{fill}"/>'
        )

    def box(self, low: Point, high: Point, colour: str) -> None:
        (x1, y2), (x2, y1) = self.at(low), self.at(high)
        size = f'width="{x2 - x1:.1f}" height="{y2 - y1:.1f}"'
        self.lines.append(
            f'<rect x="{x1}" y="{y1}" {size} stroke="{colour}" stroke-width="2" fill="{colour}" fill-opacity="0.08"/>'
        )

    def text(
        self, p: Point, words: str, colour: str = _BLACK, anchor: str = "start", dx: float = 0, dy: float = 0
    ) -> None:
        x, y = self.at(p)
        self.lines.append(
            f'<text x="{x + dx:.1f}" y="{y + dy:.1f}" fill="{colour}" text-anchor="{anchor}">{words}</text>'
        )

    def length(self, a: Point, b: Point, words: str, anchor: str = "middle", dx: float = 0, dy: float = -6) -> None:
        """A dimension line between two points, its name at the middle."""
        self.line(a, b, _GREY, 1.2)
        for p in (a, b):
            self.circle(p, 2.2, _GREY, _GREY)
        self.text(((a[0] + b[0]) / 2, (a[1] + b[1]) / 2), words, _GREY, anchor, dx, dy)

    def svg(self, width: int, height: int) -> str:
        body = "\n".join(self.lines)
        head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif"'
        return f'{head} font-size="13">\n<rect width="{width}" height="{height}" fill="white"/>\n{body}\n</svg>\n'


def arm_svg(machine: Hoist) -> str:
    """The arm with a payload, from the side: bodies, joints, rollers, and every length of the `arm` block."""
    arm, g = machine.arm, geometry_of(machine, 1.0, 0.0)
    s, e, x0, reach = arm.dolly_distance_m, arm.level_bar_offset_m, arm.pivot_offset_m, arm.reach_m
    half = arm.roller_spacing_m / 2.0
    d = _Drawing(s + half + 1.1)
    top, low = s + half + 0.9, -half - 0.5
    joint = {name: point for name, (_, _, point) in g.joints.items()}
    d.line((0, low), (0, top), _BLACK, 5)
    d.text((0, top), "guide rails (a pair)", anchor="end", dx=-10, dy=12)
    for y in (0.0, s):
        d.box((0.03, y - half - 0.08), (x0 + 0.1, y + half + 0.08), _BLUE)
    for _, point in g.rollers.values():
        d.circle((point[0] + 0.06, point[1]), 7, _BLUE)
    d.text((0.03, -half), "lower dolly", _BLUE, dx=0, dy=32)
    d.text((x0 + 0.1, s + half), "upper dolly", _BLUE, dx=8, dy=0)
    for p in (joint["sheave_pin"],):
        d.line((p[0], p[1]), (p[0], top), _ORANGE, 1.6)
        d.line((p[0] + 0.08, p[1]), (p[0] + 0.08, top), _ORANGE, 1.6)
        d.circle(p, 12, _ORANGE)
    d.text((arm.sheave_offset_m, top), "wire: from the drum over the sheave to the dead anchor", _ORANGE, dx=-4, dy=-8)
    d.line(g.cylinder[0], g.cylinder[1], _GREEN, 5)
    d.text((arm.cylinder_offset_m, s * 0.30), "cylinders (a pair)", _GREEN, "end", dx=-30)
    d.line(joint["upper_pivot"], joint["head_pivot"], _BLACK, 5)
    d.line(joint["lower_pivot"], joint["middle_pivot"], _BLACK, 4)
    d.line(joint["level_bar_inner"], joint["level_bar_outer"], _BLACK, 2.5)
    d.box((x0 + reach - 0.12, -0.18), (x0 + reach + arm.pipe_offset_m, e + 0.12), _BLACK)
    d.text((x0 + reach + arm.pipe_offset_m, e), "head, gripper", dx=-88, dy=-18)
    pipe = joint["gripper"]
    d.line((pipe[0], low), (pipe[0], e + 0.9), _ORANGE, 9)
    d.text((pipe[0], e + 0.9), "payload", _ORANGE, "middle", dy=-8)
    for name in ("lower_pivot", "upper_pivot", "middle_pivot", "head_pivot", "level_bar_inner", "level_bar_outer"):
        d.circle(joint[name], 5, _BLACK)
    d.text(((joint["upper_pivot"][0] + joint["middle_pivot"][0]) / 2, s * 0.75), "main_arm_m", dx=-92, dy=20)
    d.text((x0 + reach * 0.25, s * 0.25), "main_arm_m / 2", dx=8, dy=14)
    d.text((x0 + reach * 0.55, s * 0.45 + e), "level bar", dx=12, dy=-12)
    y = low - 0.02
    d.length((0, y), (x0, y), "pivot_offset_m", "middle", dx=-16, dy=18)
    d.length((x0, y), (x0 + reach, y), "reach_m", dy=18)
    d.length((x0 + reach, y), (pipe[0], y), "pipe_offset_m", dx=14, dy=18)
    d.length((-0.22, -half), (-0.22, half), "roller_spacing_m", "end", dx=-6, dy=4)
    d.length((-0.22, 0 + s - half), (-0.22, s + half), "roller_spacing_m", "end", dx=-6, dy=4)
    d.length((x0 + reach + arm.pipe_offset_m + 0.35, 0), (x0 + reach + arm.pipe_offset_m + 0.35, s),
             f"dolly distance √(main_arm_m² − reach_m²) = {s:.2f} m", "start", dx=8, dy=0)  # fmt: skip
    d.length((x0 + 0.02, s), (x0 + 0.02, s + e), "level_bar_offset_m", "start", dx=14, dy=-4)
    d.length((0, s + half + 0.45), (arm.sheave_offset_m, s + half + 0.45), "sheave_offset_m", "end", dx=-22, dy=4)
    d.length((0, s * 0.5), (arm.cylinder_offset_m, s * 0.5), "cylinder_offset_m", "end", dx=-16, dy=4)
    d.line((-0.9, 0), (0, 0), _GREY, 1, "4,3")
    d.text((-0.9, 0), "carriage height", _GREY, dx=-50, dy=-6)
    width = int(_LEFT + _SCALE * (pipe[0] + 0.35) + 330)
    return d.svg(width, int(2 * _TOP * 0.6 + _SCALE * (top - low) + 60))


if __name__ == "__main__":
    print(arm_svg(default_hoist()), end="")
