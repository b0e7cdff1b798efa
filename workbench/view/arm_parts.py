"""The parts of the machine as outlines, in metres, around their own origins: the `d` of SVG paths."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.machines import Hoist

Point = tuple[float, float]


def path(*points: Point) -> str:
    return "M" + "L".join(f"{x:.4g} {y:.4g}" for x, y in points)


def box(left: float, bottom: float, right: float, top: float) -> str:
    return path((left, bottom), (right, bottom), (right, top), (left, top), (left, bottom))


def circle(radius: float, points: int = 48, start: float = 0.0, end: float = 2.0 * math.pi, at: Point = (0, 0)) -> str:
    angles = np.linspace(start, end, points)
    return path(*((at[0] + radius * math.cos(a), at[1] + radius * math.sin(a)) for a in angles))


def spokes(radius: float, count: int = 3, inner: float = 0.22) -> str:
    angles = [k * 2.0 * math.pi / count for k in range(count)]
    ends = [(radius * math.cos(a), radius * math.sin(a)) for a in angles]
    return "".join(path((inner * x, inner * y), (x, y)) for x, y in ends)


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


def mast(s: Sizes) -> tuple[str, str]:
    """(chords and end plates, bracing) of the column with the guide rail."""
    left, right = s.mast
    rungs = enumerate(np.linspace(s.floor, s.beam[0], 15))
    chords = path((left, s.floor), (left, s.beam[0])) + path((right, s.floor), (right, s.beam[0]))
    return chords, path(*((left if i % 2 == 0 else right, float(at)) for i, at in rungs))


def frame(s: Sizes) -> str:
    """Beam, motor and gearbox on it, foot of the mast."""
    (under, over), u, x = s.beam, s.u, s.drum_x
    return "".join([
        box(x - s.R, under, s.mast[1] + 0.25 * u, over),
        box(x - 0.9 * u, over, x + 0.9 * u, over + 0.95 * u),
        box(x + 0.9 * u, over, x + 1.8 * u, over + 0.7 * u),
        box(s.mast[0] - 0.3 * u, s.floor - 0.3 * u, s.mast[1] + 0.3 * u, s.floor),
    ])  # fmt: skip


def bracket(s: Sizes) -> str:
    """What holds the drum's axis and the dead anchor under the beam."""
    under, u, x = s.beam[0], s.u, s.drum_x
    hanger = path((x - 0.7 * u, under), (x - 0.25 * u, s.top), (x + 0.25 * u, s.top), (x + 0.7 * u, under))
    return hanger + box(s.r - 0.16 * u, s.top, s.r + 0.16 * u, under)


def floor_line(s: Sizes) -> str:
    (left, right), u, y = s.x_range, s.u, s.floor - 0.3 * s.u
    hatch = (path((x, y), (x - 0.45 * u, y - 0.4 * u)) for x in np.arange(left + 0.5 * u, right, 0.75 * u))
    return path((left, y), (right, y)) + "".join(hatch)


def carriage(s: Sizes) -> str:
    """The dolly: a plate around the sheave, reaching to the guide rail. Origin: the sheave's axis."""
    u, r, right = s.u, s.r, s.mast[0] - 0.12 * s.u
    return path(
        (-r - 0.5 * u, -0.9 * u - r), (right, -0.9 * u - r), (right, r + 1.6 * u), (right - 0.8 * u, r + 1.6 * u),
        (r + 0.35 * u, r * 0.4), (-r - 0.5 * u, r * 0.4), (-r - 0.5 * u, -0.9 * u - r),
    )  # fmt: skip


def arm(s: Sizes) -> str:
    """Two links from the dolly to the gripper's head."""
    u, r, head = s.u, s.r, s.reach + 1.5 * s.u
    return _link((-r, -0.55 * u - r), (head, -0.75 * u), 0.24 * u) + _link(
        (-r - 0.2 * u, 0.0), (head, 0.55 * u), 0.18 * u
    )


def _link(a: Point, b: Point, half: float) -> str:
    length = math.dist(a, b)
    x, y = (a[1] - b[1]) / length * half, (b[0] - a[0]) / length * half
    first = (a[0] + x, a[1] + y)
    return path(first, (b[0] + x, b[1] + y), (b[0] - x, b[1] - y), (a[0] - x, a[1] - y), first)


def gripper(s: Sizes, half_pipe: float) -> str:
    """Head with jaws around the pipe, or open where it holds none."""
    u, x = s.u, s.reach
    hand = x + max(half_pipe, 0.18 * u) + 0.25 * u
    grip = x - half_pipe - 0.2 * u if half_pipe else x - 0.3 * u
    jaws = [box(grip, y - 0.16 * u, hand, y + 0.16 * u) for y in (-0.75 * u, 0.55 * u)]
    return box(hand, -1.15 * u, x + 1.75 * u, 0.95 * u) + "".join(jaws)


def pipe(s: Sizes, half: float) -> str:
    return box(s.reach - half, -2.7 * s.u, s.reach + half, 4.3 * s.u)


def half_pipe(s: Sizes, payload_kg: float, carriage_kg: float) -> float:
    """Half the drawn width of the payload: its cross-section grows with its mass; 0 for none."""
    return 0.0 if payload_kg <= 0.0 else s.u * (0.1 + 0.22 * min(math.sqrt(payload_kg / carriage_kg), 1.5))
