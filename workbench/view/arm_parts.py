"""The parts of the machine as outlines, in metres, around their own origins; several outlines are parted by NaN."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array
from workbench.machines import Hoist

Outline = tuple[Array, Array]


def joined(*outlines: Outline) -> Outline:
    """Several outlines as one line with gaps."""
    gap = np.array([np.nan])
    xs = [part for x, _ in outlines for part in (x, gap)][:-1]
    ys = [part for _, y in outlines for part in (y, gap)][:-1]
    return np.concatenate(xs), np.concatenate(ys)


def moved(outline: Outline, x: float, y: float) -> Outline:
    return outline[0] + x, outline[1] + y


def path(*points: tuple[float, float]) -> Outline:
    at = np.array(points, dtype=float)
    return at[:, 0], at[:, 1]


def box(left: float, bottom: float, right: float, top: float) -> Outline:
    return path((left, bottom), (right, bottom), (right, top), (left, top), (left, bottom))


def circle(radius: float, points: int = 48, start: float = 0.0, end: float = 2.0 * math.pi) -> Outline:
    angle = np.linspace(start, end, points)
    return radius * np.cos(angle), radius * np.sin(angle)


def spokes(radius: float, angle_rad: float, count: int = 3, inner: float = 0.22) -> Outline:
    """Spokes of a wheel turned by an angle, counter-clockwise positive."""
    angles = [angle_rad + k * 2.0 * math.pi / count for k in range(count)]
    ends = [(radius * math.cos(a), radius * math.sin(a)) for a in angles]
    return joined(*(path((inner * x, inner * y), (x, y)) for x, y in ends))


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


def mast(s: Sizes) -> tuple[Outline, Outline]:
    """(chords and end plates, bracing) of the column with the guide rail."""
    left, right = s.mast
    foot, head = s.floor, s.beam[0]
    bays = 14
    y = np.linspace(foot, head, bays + 1)
    zigzag = path(*((left if i % 2 == 0 else right, float(at)) for i, at in enumerate(y)))
    chords = joined(path((left, foot), (left, head)), path((right, foot), (right, head)))
    return chords, zigzag


def frame(s: Sizes) -> Outline:
    """Beam, bearing bracket of the drum, motor and gearbox on the beam, foot of the mast."""
    under, over = s.beam
    u = s.u
    motor = box(s.drum_x - 0.9 * u, over, s.drum_x + 0.9 * u, over + 0.95 * u)
    gearbox = box(s.drum_x + 0.9 * u, over, s.drum_x + 1.8 * u, over + 0.7 * u)
    beam = box(s.drum_x - s.R, under, s.mast[1] + 0.25 * u, over)
    foot = box(s.mast[0] - 0.3 * u, s.floor - 0.3 * u, s.mast[1] + 0.3 * u, s.floor)
    return joined(beam, motor, gearbox, foot)


def bracket(s: Sizes) -> Outline:
    """What holds the drum's axis and the dead anchor under the beam."""
    under, u = s.beam[0], s.u
    hanger = path(
        (s.drum_x - 0.7 * u, under), (s.drum_x - 0.25 * u, s.top), (s.drum_x + 0.25 * u, s.top),
        (s.drum_x + 0.7 * u, under),
    )  # fmt: skip
    anchor = box(s.r - 0.16 * u, s.top, s.r + 0.16 * u, under)
    return joined(hanger, anchor)


def floor_line(s: Sizes) -> Outline:
    left, right = s.x_range
    y = s.floor - 0.3 * s.u
    hatch = [path((x, y), (x - 0.45 * s.u, y - 0.4 * s.u)) for x in np.arange(left + 0.5 * s.u, right, 0.75 * s.u)]
    return joined(path((left, y), (right, y)), *hatch)


def carriage(s: Sizes) -> Outline:
    """The dolly: a plate around the sheave, reaching to the guide rail. Origin: the sheave's axis."""
    u, r = s.u, s.r
    right = s.mast[0] - 0.12 * u
    return path(
        (-r - 0.5 * u, -0.9 * u - r), (right, -0.9 * u - r), (right, r + 1.6 * u), (right - 0.8 * u, r + 1.6 * u),
        (r + 0.35 * u, r * 0.4), (-r - 0.5 * u, r * 0.4), (-r - 0.5 * u, -0.9 * u - r),
    )  # fmt: skip


def rollers(s: Sizes) -> Outline:
    """Centres of the four wheels that run on the guide rail."""
    left, u = s.mast[0], s.u
    ys = (-0.45 * u - s.r, s.r + 1.15 * u)
    return path(*((left + side * 0.33 * u, y) for y in ys for side in (-1.0, 1.0)))


def arm(s: Sizes) -> Outline:
    """Two links from the dolly to the gripper's head."""
    u, r = s.u, s.r
    head = s.reach + 1.5 * u
    return joined(
        _link((-r, -0.55 * u - r), (head, -0.75 * u), 0.24 * u), _link((-r - 0.2 * u, 0.0), (head, 0.55 * u), 0.18 * u)
    )


def _link(a: tuple[float, float], b: tuple[float, float], half: float) -> Outline:
    dx, dy = b[0] - a[0], b[1] - a[1]
    length = math.hypot(dx, dy)
    nx, ny = -dy / length * half, dx / length * half
    return path(
        (a[0] + nx, a[1] + ny), (b[0] + nx, b[1] + ny), (b[0] - nx, b[1] - ny), (a[0] - nx, a[1] - ny),
        (a[0] + nx, a[1] + ny),
    )  # fmt: skip


def gripper(s: Sizes, half_pipe: float) -> Outline:
    """Head with jaws around the pipe, or open where it holds none."""
    u, x = s.u, s.reach
    hand = x + max(half_pipe, 0.18 * u) + 0.25 * u
    body = box(hand, -1.15 * u, x + 1.75 * u, 0.95 * u)
    grip = x - half_pipe - 0.2 * u if half_pipe else x - 0.3 * u
    jaws = [box(grip, y - 0.16 * u, hand, y + 0.16 * u) for y in (-0.75 * u, 0.55 * u)]
    return joined(body, *jaws)


def pipe(s: Sizes, half: float) -> Outline:
    return box(s.reach - half, -2.7 * s.u, s.reach + half, 4.3 * s.u)


def half_pipe(s: Sizes, payload_kg: float, carriage_kg: float) -> float:
    """Half the drawn width of the payload: its cross-section grows with its mass; 0 for none."""
    return 0.0 if payload_kg <= 0.0 else s.u * (0.1 + 0.22 * min(math.sqrt(payload_kg / carriage_kg), 1.5))
