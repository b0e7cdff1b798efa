"""Colours of the machine's drawing, on a light and on a dark ground, and the colour of a tension."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from workbench.figures.style import DARK_TEMPLATE, TEMPLATE, VERMILLION

# Viridis in eight steps: even in lightness, and read alike by the colour-blind (S. van der Walt, N. Smith, 2015).
VIRIDIS = (
    (68, 1, 84), (70, 51, 127), (54, 92, 141), (39, 127, 142), (31, 161, 135), (74, 194, 109), (159, 218, 58),
    (253, 231, 37),
)  # fmt: skip


@dataclass(frozen=True)
class Look:
    """steel, arm, wheel, pipe: fills. casing: around the wire, so that each of its colours is seen."""

    dark: bool
    ink: str
    less: str
    edge: str
    faint: str
    grid: str
    steel: str
    arm: str
    wheel: str
    pipe: str
    casing: str
    accent: str
    alarm: str
    template: dict[str, Any]


def look_of(dark: bool) -> Look:
    if dark:
        return Look(
            True, "#E8E8E8", "#A8A8A8", "#AEB9C9", "#56627A", "#2B303B", "#232B39", "#33506B", "#2A3342", "#8A7A5C",
            "#F2F2F2", "#56B4E9", "#FF8A3D", DARK_TEMPLATE,
        )  # fmt: skip
    return Look(
        False, "#222222", "#6B6B6B", "#3B485C", "#9AA5B5", "#E4E4E4", "#E6EAF1", "#BFD5EA", "#F7F8FA", "#CDBB92",
        "#222222", "#0072B2", VERMILLION, TEMPLATE,
    )  # fmt: skip


def colour_at(tension_n: float, largest_n: float) -> str:
    """The colour of a tension between 0 and the largest that the bar shows."""
    place = min(max(tension_n / largest_n, 0.0), 1.0) * (len(VIRIDIS) - 1)
    k = min(int(place), len(VIRIDIS) - 2)
    part = place - k
    r, g, b = (round(a + part * (c - a)) for a, c in zip(VIRIDIS[k], VIRIDIS[k + 1], strict=True))
    return f"rgb({r},{g},{b})"
