"""Colours of the machine's drawing, on a light and on a dark ground."""

from __future__ import annotations

from dataclasses import dataclass

from workbench.figures.style import VERMILLION

# Viridis in eight steps: even in lightness, and read alike by the colour-blind (S. van der Walt, N. Smith, 2015).
VIRIDIS = (
    (68, 1, 84), (70, 51, 127), (54, 92, 141), (39, 127, 142), (31, 161, 135), (74, 194, 109), (159, 218, 58),
    (253, 231, 37),
)  # fmt: skip


@dataclass(frozen=True)
class Look:
    """steel, arm, wheel, pipe: fills."""

    ink: str
    edge: str
    faint: str
    grid: str
    steel: str
    arm: str
    wheel: str
    pipe: str
    accent: str
    alarm: str


def look_of(dark: bool) -> Look:
    if dark:
        return Look(
            "#E8E8E8", "#AEB9C9", "#56627A", "#2B303B", "#232B39", "#33506B", "#2A3342", "#8A7A5C", "#56B4E9",
            "#FF8A3D",
        )  # fmt: skip
    return Look(
        "#222222", "#3B485C", "#9AA5B5", "#E4E4E4", "#E6EAF1", "#BFD5EA", "#F7F8FA", "#CDBB92", "#0072B2", VERMILLION,
    )  # fmt: skip
