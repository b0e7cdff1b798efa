"""Where on the machine a gap lies: a small drawing with the part marked, and the residual before and after below it."""

from __future__ import annotations

from typing import Any

from workbench.core.names import powers
from workbench.core.templates import render
from workbench.view.style import BLUE, GREY, ORANGE, on_dark

INK, GROUND, FILL, NOISE = "#222222", "white", "#E9EDF2", "#C8CDD3"
FILL_DARK = "#2B303B"
LONGEST = 170.0  # px of a bar


def marked_machine(machine: Any, subsystem: str, shrink: Any) -> str:
    """SVG, self-contained, on a white ground. shrink: before, after and noise of the residual, and its unit.

    An axis is drawn along a rail, or turning, with a coupling where it has one.
    """
    turning = getattr(machine, "motion", "rotary") == "rotary"
    kind = "coupled" if hasattr(machine, "coupling") else "turning" if turning else "rail"
    largest = max(shrink.before, shrink.after, shrink.noise, 1e-12)
    bars = [
        (name, LONGEST * value / largest, powers(f"{value:.3g} {shrink.unit}"), colour)
        for name, value, colour in (
            ("before", shrink.before, GREY), ("after", shrink.after, BLUE), ("noise", shrink.noise, NOISE)
        )
    ]  # fmt: skip
    if hasattr(machine, "winch") and subsystem != "axis":
        kind = "hoist"
    return str(
        render(
            "view/place.svg.j2", kind=kind, marked=subsystem, bars=bars, ink=INK, ground=GROUND, fill=FILL, mark=ORANGE
        )
    )


def for_dark_ground(svg: str) -> str:
    """The same drawing on a dark page: ground, ink and what is not marked change, marks and bars stay."""
    for light in (INK, GROUND, GREY):
        svg = svg.replace(f'"{light}"', f'"{on_dark(light)}"')
    return svg.replace(FILL, FILL_DARK)
