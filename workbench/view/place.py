"""Where on the machine a gap lies: a small drawing with the part marked, and the residual before and after below it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from workbench.core.names import powers
from workbench.view.style import BLUE, GREY, ORANGE, on_dark

WIDTH, HEIGHT = 320, 250
INK, GROUND = "#222222", "white"
_FILL, _MARK, _NOISE = "#E9EDF2", ORANGE, "#C8CDD3"
_FILL_DARK = "#2B303B"
Part = tuple[str, float, float, float, float]  # what is drawn, x, y, width, height in px; a circle by its box

# What stands for each part of a hoist. A sensor is a small box at the shaft.
_HOIST: Mapping[str, tuple[Part, ...]] = {
    "platform": (("box", 8, 186, 304, 8),),
    "motor": (("box", 14, 40, 46, 30),),
    "torque_sensor": (("box", 14, 14, 46, 16),),
    "speed_sensor": (("box", 14, 80, 46, 16),),
    "brake": (("box", 62, 36, 9, 38),),
    "gearbox": (("box", 74, 38, 48, 34),),
    "drum": (("circle", 124, 30, 50, 50),),
    "wire": (("box", 172, 52, 3, 86), ("box", 209, 30, 3, 108)),
    "sheave": (("circle", 172, 118, 40, 40),),
    "guide": (("box", 232, 20, 7, 164), ("box", 298, 20, 7, 164)),
    "payload": (("box", 246, 146, 46, 22),),
}
_NAMES = {
    "motor": (37, 59), "gearbox": (98, 59), "drum": (149, 59), "sheave": (192, 172), "payload": (269, 161),
    "torque_sensor": (37, 26), "speed_sensor": (37, 92), "guide": (268, 14), "wire": (192, 100),
    "platform": (90, 182), "brake": (82, 30),
}  # fmt: skip
_SHORT = {"torque_sensor": "torque", "speed_sensor": "speed"}

# An axis that a motor drives along a rail.
_AXIS: Mapping[str, tuple[Part, ...]] = {
    "motor": (("box", 20, 60, 60, 40),),
    "torque_sensor": (("box", 20, 30, 60, 20),),
    "speed_sensor": (("box", 20, 110, 60, 20),),
    "axis": (("box", 80, 76, 220, 8), ("box", 160, 54, 60, 52)),
}
# One that turns, and the coupling between its motor and its load where there is one.
_ROTARY: Mapping[str, tuple[Part, ...]] = {
    **{name: _AXIS[name] for name in ("motor", "torque_sensor", "speed_sensor")},
    "axis": (("box", 80, 76, 130, 8), ("circle", 190, 40, 80, 80)),
}
_COUPLED: Mapping[str, tuple[Part, ...]] = {**_ROTARY, "gearbox": (("box", 102, 60, 62, 40),)}
_ROTARY_NAMES = {"motor": (50, 85), "axis": (230, 85), "torque_sensor": (50, 44), "speed_sensor": (50, 124)}
_COUPLED_NAMES = {**_ROTARY_NAMES, "gearbox": (133, 85)}
_AXIS_NAMES = {"motor": (50, 85), "axis": (190, 85), "torque_sensor": (50, 44), "speed_sensor": (50, 124)}


def marked_machine(machine: Any, subsystem: str, shrink: Any) -> str:
    """SVG, self-contained, on a white ground. shrink: before, after and noise of the residual, and its unit."""
    hoist = subsystem in _HOIST and hasattr(machine, "winch")
    parts, names = (_HOIST, _NAMES) if hoist else _axis(machine)
    drawn = [_part(part, name == subsystem) for name, part in parts.items()]
    if hoist:  # what no gap is named after: the carriage that the sheave hangs in
        drawn.insert(0, f'<rect x="240" y="116" width="57" height="24" fill="{_FILL}" stroke="{INK}"/>')
        drawn.insert(0, f'<path d="M212 128 H240" stroke="{INK}" stroke-width="3"/>')
    short = _SHORT if hoist else {**_SHORT, "gearbox": "coupling"}
    words = [_text(x, y, short.get(name, name), name == subsystem) for name, (x, y) in names.items()]
    inside = "".join([*drawn, *words]) + _bars(shrink)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif">'
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="{GROUND}"/>{inside}</svg>'
    )


def _axis(machine: Any) -> tuple[Mapping[str, tuple[Part, ...]], Mapping[str, tuple[int, int]]]:
    """What is drawn of an axis, and where its names stand: along a rail, or turning, with a coupling or without."""
    if hasattr(machine, "coupling"):
        return _COUPLED, _COUPLED_NAMES
    return (_ROTARY, _ROTARY_NAMES) if getattr(machine, "motion", "") == "rotary" else (_AXIS, _AXIS_NAMES)


def for_dark_ground(svg: str) -> str:
    """The same drawing on a dark page: ground, ink and what is not marked change, marks and bars stay."""
    for light in (INK, GROUND, GREY):
        svg = svg.replace(f'"{light}"', f'"{on_dark(light)}"')
    return svg.replace(_FILL, _FILL_DARK)


def _part(parts: tuple[Part, ...], marked: bool) -> str:
    look = (
        f'fill="{_MARK if marked else _FILL}" stroke="{_MARK if marked else INK}" stroke-width="{3 if marked else 1}"'
    )
    shapes = []
    for shape, x, y, w, h in parts:
        if shape == "circle":
            shapes.append(f'<circle cx="{x + w / 2:g}" cy="{y + h / 2:g}" r="{w / 2:g}" {look}/>')
        else:
            shapes.append(f'<rect x="{x:g}" y="{y:g}" width="{w:g}" height="{h:g}" {look}/>')
    return "".join(shapes)


def _text(x: float, y: float, words: str, marked: bool) -> str:
    weight = ' font-weight="bold"' if marked else ""
    return f'<text x="{x:g}" y="{y:g}" font-size="11" text-anchor="middle" fill="{INK}"{weight}>{words}</text>'


def _bars(s: Any) -> str:
    """The held-out residual before and after, and the noise that no model takes away."""
    largest = max(s.before, s.after, s.noise, 1e-12)
    lines = []
    for k, (name, value, colour) in enumerate(
        (("before", s.before, GREY), ("after", s.after, BLUE), ("noise", s.noise, _NOISE))
    ):
        y = 198 + 17 * k
        lines.append(f'<text x="52" y="{y + 11}" font-size="11" text-anchor="end" fill="{INK}">{name}</text>')
        lines.append(f'<rect x="58" y="{y}" width="{170.0 * value / largest:.1f}" height="12" fill="{colour}"/>')
        number = powers(f"{value:.3g} {s.unit}")
        x = 64.0 + 170.0 * value / largest
        lines.append(f'<text x="{x:.1f}" y="{y + 11}" font-size="11" fill="{INK}">{number}</text>')
    return "".join(lines)
