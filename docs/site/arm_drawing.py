"""The multi-body machine's lengths as a drawing, made from its own geometry: docs/img/arm.svg.

python docs/site/arm_drawing.py > docs/img/arm.svg
"""

from __future__ import annotations

import math

from workbench.machines import Hoist, default_hoist
from workbench.machines.multibody import geometry_of

Point = tuple[float, float]
_SCALE, _LEFT = 95.0, 185.0  # px per m, and of the margin
_BLACK, _BLUE, _ORANGE, _GREY, _GREEN = "#222222", "#0072B2", "#D55E00", "#5A5A5A", "#009E73"


class _Drawing:
    """Metres in, pixels out; y goes up. left, top: of the paper, m."""

    def __init__(self, left_m: float, top_m: float) -> None:
        self.left_m, self.top_m = left_m, top_m
        self.lines: list[str] = []

    def at(self, p: Point) -> Point:
        return round(_SCALE * (p[0] - self.left_m), 1), round(_SCALE * (self.top_m - p[1]), 1)

    def line(self, a: Point, b: Point, colour: str = _BLACK, width: float = 2.0, dash: str = "") -> None:
        (x1, y1), (x2, y2) = self.at(a), self.at(b)
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        self.lines.append(
            f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" stroke="{colour}" stroke-width="{width}"{dashed}/>'
        )

    def circle(self, p: Point, radius_px: float, colour: str, fill: str = "white") -> None:
        x, y = self.at(p)
        self.lines.append(
            f'<circle cx="{x}" cy="{y}" r="{radius_px:.1f}" stroke="{colour}" stroke-width="2" fill="{fill}"/>'
        )

    def box(self, low: Point, high: Point, colour: str) -> None:
        (x1, y2), (x2, y1) = self.at(low), self.at(high)
        size = f'width="{x2 - x1:.1f}" height="{y2 - y1:.1f}"'
        self.lines.append(
            f'<rect x="{x1}" y="{y1}" {size} stroke="{colour}" stroke-width="2" fill="{colour}" fill-opacity="0.08"/>'
        )

    def text(
        self, p: Point, words: str, colour: str = _BLACK, anchor: str = "start", dx: float = 0, dy: float = 4,
        turn: float = 0.0,
    ) -> None:  # fmt: skip
        """Words at a point, moved by dx, dy px; turned by degrees, clockwise."""
        x, y = self.at(p)
        turned = f' transform="rotate({turn:.1f} {x} {y})"' if turn else ""
        self.lines.append(
            f'<text x="{x + dx:.1f}" y="{y + dy:.1f}" fill="{colour}" text-anchor="{anchor}"{turned}>{words}</text>'
        )

    def length(self, a: Point, b: Point, words: str, *, off: float = 0.0, beside: bool = False, dy: float = -6) -> None:
        """A dimension line from a to b, moved `off` m to its left, with a tick at both ends and its name along it.

        beside: the name stands before the line's first point, upright, where the line is too short for it.
        """
        size = math.dist(a, b)
        ux, uy = (b[0] - a[0]) / size, (b[1] - a[1]) / size
        ends = [(p[0] - off * uy, p[1] + off * ux) for p in (a, b)]
        for p, end in zip((a, b), ends, strict=True):
            if off:
                self.line(p, end, _GREY, 0.7, "2,3")
            tick = 0.05
            self.line((end[0] - tick * (ux - uy), end[1] - tick * (uy + ux)),
                      (end[0] + tick * (ux - uy), end[1] + tick * (uy + ux)), _GREY, 1.6)  # fmt: skip
        self.line(ends[0], ends[1], _GREY, 1.1)
        if beside:
            self.text(ends[0], words, _GREY, "end", dx=-10)
            return
        middle = ((ends[0][0] + ends[1][0]) / 2, (ends[0][1] + ends[1][1]) / 2)
        turn = -math.degrees(math.atan2(uy, ux))
        self.text(middle, words, _GREY, "middle", dy=dy, turn=turn)

    def svg(self, width: int, height: int) -> str:
        body = "\n".join(self.lines)
        head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif"'
        return f'{head} font-size="13">\n<rect width="{width}" height="{height}" fill="white"/>\n{body}\n</svg>\n'


def arm_svg(machine: Hoist) -> str:
    """The arm with a payload, from the side: bodies, joints, rollers, and every length of the `arm` block."""
    arm, g = machine.arm, geometry_of(machine, 1.0, 0.0)
    half, low = arm.roller_spacing_m / 2.0, -arm.roller_spacing_m / 2.0 - 0.35
    top = arm.dolly_distance_m + half + 0.75
    d = _Drawing(-_LEFT / _SCALE, top + 0.45)
    joint = {name: point for name, (_, _, point) in g.joints.items()}
    _column(d, machine, joint["sheave_pin"], low, top)
    _linkage(d, machine, joint, low)
    for y in (0.0, arm.dolly_distance_m):
        d.length((0, y - half), (0, y + half), "roller_spacing_m", off=0.3)
    _below(d, machine, low)
    width = _LEFT + _SCALE * (joint["gripper"][0] + 1.6)
    return d.svg(int(width), int(_SCALE * (top + 0.45 - low + 1.3)))


def _column(d: _Drawing, machine: Hoist, sheave: Point, low: float, top: float) -> None:
    """Rails, dollies on their rollers, cylinders, and the wire over the sheave."""
    arm, g, r = machine.arm, geometry_of(machine, 1.0, 0.0), machine.sheave.diameter_m / 2.0
    s, half, x0 = arm.dolly_distance_m, arm.roller_spacing_m / 2.0, arm.pivot_offset_m
    d.line((0, low), (0, top), _BLACK, 5)
    d.text((0, top), "guide rails (a pair)", anchor="end", dx=-10, dy=10)
    for y, name, side in ((0.0, "lower dolly", -half), (s, "upper dolly", half)):
        d.box((0.03, y - half - 0.08), (x0 + 0.1, y + half + 0.08), _BLUE)
        d.text((x0 + 0.1, y + side), name, _BLUE, dx=8)
    for _, point in g.rollers.values():
        d.circle((point[0] + 0.07, point[1]), 6, _BLUE)
    d.line(g.cylinder[0], g.cylinder[1], _GREEN, 5)
    d.text((g.cylinder[1][0], s * 0.36), "cylinders (a pair)", _GREEN, "end", dx=-40)
    for side, end in ((-r, "drum"), (r, "dead anchor")):
        d.line((sheave[0] + side, sheave[1]), (sheave[0] + side, top), _ORANGE, 1.6)
        anchor, dx = ("end", 0) if side < 0 else ("start", -4)
        d.text((sheave[0] + side, top), f"to the {end}", _ORANGE, anchor, dx=dx, dy=-8)
    d.circle(sheave, _SCALE * r, _ORANGE, "none")
    d.circle(sheave, 2, _ORANGE, _ORANGE)
    d.length((0, top - 0.32), (arm.sheave_offset_m, top - 0.32), "sheave_offset_m", beside=True)
    d.length((0, s * 0.52), (arm.cylinder_offset_m, s * 0.52), "cylinder_offset_m", beside=True)
    d.line((-1.75, 0), (-0.5, 0), _GREY, 1, "5,4")
    d.text((-1.75, 0), "carriage height", _GREY, dy=-6)


def _linkage(d: _Drawing, machine: Hoist, joint: dict[str, Point], low: float) -> None:
    """Main arm, support link, level bar, head, payload."""
    arm, s, e = machine.arm, machine.arm.dolly_distance_m, machine.arm.level_bar_offset_m
    head, pipe = joint["head_pivot"], joint["gripper"]
    d.box((head[0] - 0.12, -0.18), (pipe[0], e + 0.12), _BLACK)
    d.text(((head[0] + pipe[0]) / 2, e / 2), "head", anchor="middle", dx=4)
    d.line((pipe[0], low), (pipe[0], e + 1.1), _ORANGE, 9)
    d.text((pipe[0], e + 1.1), "payload, a pipe of", _ORANGE, "middle", dy=-26)
    d.text((pipe[0], e + 1.1), "pipe_length_m", _GREY, "middle", dy=-9)
    d.circle(pipe, 4, _ORANGE)
    d.text(pipe, "its centre of mass", _ORANGE, dx=10)
    d.line(joint["upper_pivot"], head, _BLACK, 5)
    d.line(joint["lower_pivot"], joint["middle_pivot"], _BLACK, 4)
    d.line(joint["level_bar_inner"], joint["level_bar_outer"], _BLACK, 2.5)
    for name in ("lower_pivot", "upper_pivot", "middle_pivot", "head_pivot", "level_bar_inner", "level_bar_outer"):
        d.circle(joint[name], 5, _BLACK)
    d.length(joint["upper_pivot"], head, "main_arm_m", off=e + 0.22)
    turn = math.degrees(math.atan2(s, arm.reach_m))
    inner, outer = joint["level_bar_inner"], joint["level_bar_outer"]
    d.text((inner[0] + 0.62 * (outer[0] - inner[0]), inner[1] + 0.62 * (outer[1] - inner[1])), "level bar",
           anchor="middle", dy=-6, turn=turn)  # fmt: skip
    upper, middle = joint["upper_pivot"], joint["middle_pivot"]
    d.text(((upper[0] + middle[0]) / 2, (upper[1] + middle[1]) / 2), "main arm", anchor="middle", dy=18, turn=turn)
    d.text(((joint["lower_pivot"][0] + joint["middle_pivot"][0]) / 2, s / 4), "support link", anchor="middle", dy=-8,
           turn=-turn)  # fmt: skip
    d.length(joint["lower_pivot"], joint["middle_pivot"], "main_arm_m / 2", off=-0.3, dy=16)
    x, y = joint["upper_pivot"]
    d.line((x, y), (x + 1.1, y), _GREY, 0.7, "2,3")
    d.line((x, y + e), (x + 1.1, y + e), _GREY, 0.7, "2,3")
    d.length((x + 1.1, y), (x + 1.1, y + e), "")
    d.text((x + 1.1, y + e / 2), "level_bar_offset_m", _GREY, dx=10)


def _below(d: _Drawing, machine: Hoist, low: float) -> None:
    """Lengths along the floor: rail to pivots, reach with its limits, head pivot to pipe."""
    arm, x0, y = machine.arm, machine.arm.pivot_offset_m, low - 0.3
    out = x0 + arm.reach_m
    for x in (0.0, x0, out, out + arm.pipe_offset_m):
        d.line((x, low), (x, y), _GREY, 0.7, "2,3")
    d.length((0, y), (x0, y), "pivot_offset_m", beside=True)
    d.length((x0, y), (out, y), "reach_m")
    d.length((out, y), (out + arm.pipe_offset_m, y), "")
    d.text((out + arm.pipe_offset_m, y), "pipe_offset_m", _GREY, dx=10)
    for k, (limit, words) in enumerate(
        ((arm.shortest_reach_m, "shortest_reach_m"), (arm.longest_reach_m, "longest_reach_m")), start=1
    ):
        d.length((x0, y - 0.3 * k), (x0 + limit, y - 0.3 * k), "")
        d.text((x0 + limit, y - 0.3 * k), words, _GREY, dx=10)
    d.line((x0, y), (x0, y - 0.6), _GREY, 0.7, "2,3")


if __name__ == "__main__":
    print(arm_svg(default_hoist()), end="")
