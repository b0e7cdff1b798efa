"""The multi-body machine's lengths as a drawing, made from its own geometry: docs/img/arm.svg.

python docs/site/arm_drawing.py > docs/img/arm.svg
"""

from __future__ import annotations

import math
from typing import Any

from workbench.machines import Hoist, default_hoist
from workbench.machines.multibody import geometry_of

Point = tuple[float, float]
SCALE, LEFT = 95.0, 185.0  # px per m, and of the margin
BLACK, BLUE, ORANGE, GREY, GREEN = "#222222", "#0072B2", "#D55E00", "#5A5A5A", "#009E73"


class Drawing:
    """Metres in, pixels out; y goes up. top_m: of the paper. Each shape becomes one element of the SVG."""

    def __init__(self, top_m: float) -> None:
        self.top_m = top_m
        self.elements: list[str] = []

    def at(self, p: Point) -> Point:
        return round(LEFT + SCALE * p[0], 1), round(SCALE * (self.top_m - p[1]), 1)

    def add(self, tag: str, words: str = "", **attributes: Any) -> None:
        listed = " ".join(f'{name.replace("_", "-")}="{value}"' for name, value in attributes.items() if value != "")
        self.elements.append(f"<{tag} {listed}>{words}</{tag}>" if words else f"<{tag} {listed}/>")

    def line(self, a: Point, b: Point, colour: str = BLACK, width: float = 2.0, dash: str = "") -> None:
        (x1, y1), (x2, y2) = self.at(a), self.at(b)
        self.add("line", x1=x1, y1=y1, x2=x2, y2=y2, stroke=colour, stroke_width=width, stroke_dasharray=dash)

    def circle(self, p: Point, radius_px: float, colour: str, fill: str = "white") -> None:
        x, y = self.at(p)
        self.add("circle", cx=x, cy=y, r=round(radius_px, 1), stroke=colour, stroke_width=2, fill=fill)

    def box(self, low: Point, high: Point, colour: str) -> None:
        (x1, y2), (x2, y1) = self.at(low), self.at(high)
        width, height = round(x2 - x1, 1), round(y2 - y1, 1)
        self.add(
            "rect",
            x=x1,
            y=y1,
            width=width,
            height=height,
            stroke=colour,
            stroke_width=2,
            fill=colour,
            fill_opacity=0.08,
        )

    def text(
        self,
        p: Point,
        words: str,
        colour: str = BLACK,
        anchor: str = "start",
        dx: float = 0,
        dy: float = 4,
        turn: float = 0,
    ) -> None:
        """Words at a point, moved by dx, dy px; turned by degrees, clockwise."""
        x, y = self.at(p)
        turned = f"rotate({turn:.1f} {x} {y})" if turn else ""
        self.add(
            "text", words, x=round(x + dx, 1), y=round(y + dy, 1), fill=colour, text_anchor=anchor, transform=turned
        )

    def length(self, a: Point, b: Point, words: str, off: float = 0.0, where: str = "along", dy: float = -6) -> None:
        """A dimension line from a to b, moved `off` m to its left, with a tick at both ends and its name.

        where: along the line; upright before its first point; or after its last one.
        """
        size = math.dist(a, b)
        ux, uy = (b[0] - a[0]) / size, (b[1] - a[1]) / size
        ends = [(p[0] - off * uy, p[1] + off * ux) for p in (a, b)]
        for p, (x, y) in zip((a, b), ends, strict=True):
            if off:
                self.line(p, (x, y), GREY, 0.7, "2,3")
            dx, dy_m = 0.05 * (ux - uy), 0.05 * (uy + ux)
            self.line((x - dx, y - dy_m), (x + dx, y + dy_m), GREY, 1.6)
        self.line(*ends, GREY, 1.1)
        if where == "along":
            middle = ((ends[0][0] + ends[1][0]) / 2, (ends[0][1] + ends[1][1]) / 2)
            self.text(middle, words, GREY, "middle", dy=dy, turn=-math.degrees(math.atan2(uy, ux)))
        else:
            before = where == "before"
            self.text(ends[not before], words, GREY, "end" if before else "start", dx=-10 if before else 10)


def arm_svg(machine: Hoist) -> str:
    """The arm with a payload, from the side: bodies, joints, rollers, and every length of the `arm` block."""
    arm, g, r = machine.arm, geometry_of(machine, 1.0, 0.0), machine.sheave.diameter_m / 2.0
    s, e, half, x0 = arm.dolly_distance_m, arm.level_bar_offset_m, arm.roller_spacing_m / 2.0, arm.pivot_offset_m
    low, top, out = -half - 0.35, s + half + 0.75, x0 + arm.reach_m
    d = Drawing(top + 0.45)
    joint = {name: point for name, (_, _, point) in g.joints.items()}
    upper, head, pipe, sheave = joint["upper_pivot"], joint["head_pivot"], joint["gripper"], joint["sheave_pin"]

    # The column: rails, dollies on their rollers, cylinders, the wire over the sheave.
    d.line((0, low), (0, top), BLACK, 5)
    d.text((0, top), "guide rails (a pair)", anchor="end", dx=-10, dy=10)
    for y, name, side in ((0.0, "lower dolly", -half), (s, "upper dolly", half)):
        d.box((0.03, y - half - 0.08), (x0 + 0.1, y + half + 0.08), BLUE)
        d.text((x0 + 0.1, y + side), name, BLUE, dx=8)
        d.length((0, y - half), (0, y + half), "roller_spacing_m", off=0.3)
    for _, point in g.rollers.values():
        d.circle((point[0] + 0.07, point[1]), 6, BLUE)
    d.line(*g.cylinder, GREEN, 5)
    d.text((g.cylinder[1][0], s * 0.36), "cylinders (a pair)", GREEN, "end", dx=-40)
    for x, end, anchor in ((sheave[0] - r, "drum", "end"), (sheave[0] + r, "dead anchor", "start")):
        d.line((x, sheave[1]), (x, top), ORANGE, 1.6)
        d.text((x, top), f"to the {end}", ORANGE, anchor, dy=-8)
    d.circle(sheave, SCALE * r, ORANGE, "none")
    d.circle(sheave, 2, ORANGE, ORANGE)
    d.length((0, top - 0.32), (arm.sheave_offset_m, top - 0.32), "sheave_offset_m", where="before")
    d.length((0, s * 0.52), (arm.cylinder_offset_m, s * 0.52), "cylinder_offset_m", where="before")
    d.line((-1.75, 0), (-0.5, 0), GREY, 1, "5,4")
    d.text((-1.75, 0), "carriage height", GREY, dy=-6)

    # The linkage: main arm, support link, level bar, head, payload.
    d.box((head[0] - 0.12, -0.18), (pipe[0], e + 0.12), BLACK)
    d.text(((head[0] + pipe[0]) / 2, e / 2), "head", anchor="middle", dx=4)
    d.line((pipe[0], low), (pipe[0], e + 1.1), ORANGE, 9)
    d.text((pipe[0], e + 1.1), "payload, a pipe of", ORANGE, "middle", dy=-26)
    d.text((pipe[0], e + 1.1), "pipe_length_m", GREY, "middle", dy=-9)
    d.circle(pipe, 4, ORANGE)
    d.text(pipe, "its centre of mass", ORANGE, dx=10)
    turn = math.degrees(math.atan2(s, arm.reach_m))
    bars = {
        "main arm": ("upper_pivot", "head_pivot", 5, 0.25, 18, turn),
        "support link": ("lower_pivot", "middle_pivot", 4, 0.5, -8, -turn),
        "level bar": ("level_bar_inner", "level_bar_outer", 2.5, 0.62, -6, turn),
    }
    for name, (one, other, width, share, dy, angle) in bars.items():
        (x1, y1), (x2, y2) = joint[one], joint[other]
        d.line((x1, y1), (x2, y2), BLACK, width)
        d.text((x1 + share * (x2 - x1), y1 + share * (y2 - y1)), name, anchor="middle", dy=dy, turn=angle)
    for name in dict.fromkeys(end for bar in bars.values() for end in bar[:2]):
        d.circle(joint[name], 5, BLACK)
    d.length(upper, head, "main_arm_m", off=e + 0.22)
    d.length(joint["lower_pivot"], joint["middle_pivot"], "main_arm_m / 2", off=-0.3, dy=16)
    for y in (upper[1], upper[1] + e):
        d.line((upper[0], y), (upper[0] + 1.1, y), GREY, 0.7, "2,3")
    d.length((upper[0] + 1.1, upper[1]), (upper[0] + 1.1, upper[1] + e), "level_bar_offset_m", where="after")

    # Along the floor: rail to pivots, reach with its limits, head pivot to pipe.
    floor = low - 0.3
    for x, end in ((0.0, floor), (x0, floor - 0.6), (out, floor), (out + arm.pipe_offset_m, floor)):
        d.line((x, low), (x, end), GREY, 0.7, "2,3")
    d.length((0, floor), (x0, floor), "pivot_offset_m", where="before")
    d.length((x0, floor), (out, floor), "reach_m")
    d.length((out, floor), (out + arm.pipe_offset_m, floor), "pipe_offset_m", where="after")
    d.length((x0, floor - 0.3), (x0 + arm.shortest_reach_m, floor - 0.3), "shortest_reach_m", where="after")
    d.length((x0, floor - 0.6), (x0 + arm.longest_reach_m, floor - 0.6), "longest_reach_m", where="after")

    size = f"{LEFT + SCALE * (pipe[0] + 1.6):.0f} {SCALE * (top + 0.45 - low + 1.3):.0f}"
    head_line = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size}" font-family="sans-serif" font-size="13">'
    return "\n".join([head_line, '<rect width="100%" height="100%" fill="white"/>', *d.elements, "</svg>", ""])


if __name__ == "__main__":
    print(arm_svg(default_hoist()), end="")
