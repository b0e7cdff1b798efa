"""The machine as it is drawn: its sizes in m, and outlines as the `d` of SVG paths; film_stage.j2 has the parts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.machines import Hoist

Point = tuple[float, float]


@dataclass(frozen=True)
class Sizes:
    """How large things are drawn: heights to scale, parts larger, all by one unit u (m).

    Fall 1 runs at -r, fall 2 at +r, the sheave's axis at the carriage's height. The drum's axis is at the top of
    the falls. Wheels turn as the drawn wire runs, so magnified ones turn less often than the real ones.
    """

    low: float
    top: float
    u: float
    R: float
    r: float

    @property
    def drum_x(self) -> float:
        return -self.r - self.R

    @property
    def mast(self) -> tuple[float, float]:
        """Left and right chord; the left one is the guide rail."""
        return self.r + 1.3 * self.u, self.r + 3.3 * self.u

    @property
    def beam(self) -> tuple[float, float]:
        """Bottom and top of the beam that carries the winch."""
        return self.top + self.R + 0.45 * self.u, self.top + self.R + 1.25 * self.u

    @property
    def floor(self) -> float:
        return self.low - 3.3 * self.u

    @property
    def reach(self) -> float:
        """Where the gripper holds the pipe."""
        return -self.r - 6.2 * self.u

    @property
    def y_range(self) -> tuple[float, float]:
        return self.floor - 0.7 * self.u, self.beam[1] + 2.0 * self.u

    @property
    def x_range(self) -> tuple[float, float]:
        return self.reach - 3.4 * self.u, self.mast[1] + 0.6 * self.u


def sizes(machine: Hoist) -> Sizes:
    low, top = machine.rail.lowest_position_m, machine.wire.segment_length_m
    u = (top - low) / 22.0
    R = 1.55 * u
    # The sheave beside the drum as it really is, within what can be seen.
    r = R * min(max(machine.sheave.diameter_m / machine.winch.drum_diameter_m, 0.6), 1.3)
    return Sizes(low, top, u, R, r)


def half_pipe(s: Sizes, payload_kg: float, carriage_kg: float) -> float:
    """Half the drawn width of the payload: its cross-section grows with its mass; 0 for none."""
    return 0.0 if payload_kg <= 0.0 else s.u * (0.1 + 0.22 * min(math.sqrt(payload_kg / carriage_kg), 1.5))


def path(points: Sequence[Point]) -> str:
    return "M" + "L".join(f"{x:.4g} {y:.4g}" for x, y in points)


def box(left: float, bottom: float, right: float, top: float) -> str:
    return path([(left, bottom), (right, bottom), (right, top), (left, top), (left, bottom)])


def circle(radius: float, x: float = 0.0, y: float = 0.0, begins: float = 0.0) -> str:
    """From a share of the turn to its end."""
    angles = 2.0 * math.pi * np.linspace(begins, 1.0, 49)
    return path([(x + radius * math.cos(a), y + radius * math.sin(a)) for a in angles])


def spokes(radius: float) -> str:
    ends = [(radius * math.cos(a), radius * math.sin(a)) for a in 2.0 * math.pi * np.arange(3) / 3.0]
    return "".join(path([(0.22 * x, 0.22 * y), (x, y)]) for x, y in ends)


def link(x0: float, y0: float, x1: float, y1: float, half: float) -> str:
    """A bar from one point to the other, so thick to each side."""
    length = math.dist((x0, y0), (x1, y1))
    x, y = (y0 - y1) / length * half, (x1 - x0) / length * half
    return path([(x0 + x, y0 + y), (x1 + x, y1 + y), (x1 - x, y1 - y), (x0 - x, y0 - y), (x0 + x, y0 + y)])


def zigzag(left: float, right: float, low: float, high: float) -> str:
    return path([(left if k % 2 == 0 else right, float(y)) for k, y in enumerate(np.linspace(low, high, 15))])


def hatch(left: float, right: float, step: float, y: float, across: float, down: float) -> str:
    return "".join(path([(x, y), (x - across, y - down)]) for x in np.arange(left, right, step))
