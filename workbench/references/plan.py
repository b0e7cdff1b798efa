"""Several moves in a row, with dwells, planned once and sampled at a controller's times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.errors import InputError, nearest
from workbench.references.limits import Limits, Step
from workbench.references.shapes import KINDS, Shape
from workbench.run import Array


@dataclass(frozen=True)
class Profile:
    """A reference of the carriage at a controller's sample times.

    time_s, position_m, speed_m_s, acceleration_m_s2: (n,), up positive. move_windows: start and
    end of each move (s). move_limits: the limits used for each move.
    """

    kind: str
    time_s: Array
    position_m: Array
    speed_m_s: Array
    acceleration_m_s2: Array
    move_windows: tuple[tuple[float, float], ...]
    move_limits: tuple[Limits, ...]

    @property
    def move_time_s(self) -> float:
        """Time in motion, all moves together."""
        return sum(end - start for start, end in self.move_windows)


@dataclass(frozen=True)
class MotionPlan:
    """Moves at their start times: exact, not yet sampled."""

    kind: str
    start_position_m: float
    moves: tuple[tuple[float, Shape], ...]
    duration_s: float

    @property
    def end_position_m(self) -> float:
        return self.start_position_m + sum(shape.distance_m for _, shape in self.moves)

    def sample(self, sample_time_s: float, duration_s: float | None = None) -> Profile:
        """The profile at 0, T, 2T, … up to the end of the plan, or held at rest up to a longer `duration_s`."""
        if not (math.isfinite(sample_time_s) and sample_time_s > 0.0):
            raise InputError(f"{sample_time_s:g} s, expected a positive time", place="sample_time_s")
        last = max(self.duration_s, duration_s or 0.0)
        # The small number keeps 49.76 s / 0.001 s from growing a sample by rounding.
        samples = math.ceil(last / sample_time_s - 1e-9) + 1
        time_s: Array = np.arange(samples, dtype=np.float64) * np.float64(sample_time_s)
        position = np.full(time_s.shape, self.start_position_m)
        speed, acceleration = np.zeros_like(time_s), np.zeros_like(time_s)
        for start_s, shape in self.moves:
            p, v, a = shape.at(time_s - start_s)
            position += p
            speed += v
            acceleration += a
        return Profile(
            kind=self.kind,
            time_s=time_s,
            position_m=position,
            speed_m_s=speed,
            acceleration_m_s2=acceleration,
            move_windows=tuple((start, start + shape.duration_s) for start, shape in self.moves),
            move_limits=tuple(shape.limits for _, shape in self.moves),
        )


def plan_motion(
    kind: str,
    steps: Sequence[Step],
    start_position_m: float,
    limits: Limits,
    rail_m: tuple[float, float],
    lead_s: float = 0.0,
    settle_s: float = 0.0,
) -> MotionPlan:
    """Plan the steps one after the other, at rest for `lead_s` before and `settle_s` after.

    kind: one of KINDS. rail_m: lowest and highest carriage height. Raises InputError for an unknown
    kind, a list without a move, a move of 0 m, and a start or a move that leaves the rail; `place` names the step.
    """
    if kind not in KINDS:
        raise InputError(f"unknown reference '{kind}'; {nearest(kind, KINDS)}", place="references")
    low, high = rail_m
    if not low <= start_position_m <= high:
        raise InputError(
            f"{start_position_m:g} m is off the rail, which reaches from {low:g} m to {high:g} m",
            place="start_position_m",
        )
    moves: list[tuple[float, Shape]] = []
    now, here = lead_s, start_position_m
    for number, step in enumerate(steps):
        place = f"moves[{number}]"
        if step.dwell_s is not None:
            now += step.dwell_s
            continue
        target = step.to_m if step.to_m is not None else here + (step.by_m or 0.0)
        if abs(target - here) < 1e-9:
            raise InputError(f"a move of 0 m (from {here:g} m to {target:g} m); leave it out or dwell", place=place)
        # Sums of decimal distances may end a rounding error above the rail's end.
        if not low - 1e-9 <= target <= high + 1e-9:
            raise InputError(
                f"goes from {here:g} m to {target:g} m and leaves the rail, which reaches from {low:g} m to {high:g} m",
                place=place,
            )
        shape = KINDS[kind](target - here, limits)
        moves.append((now, shape))
        now += shape.duration_s
        here = target
    if not moves:
        raise InputError("no move in the list, expected at least one by_m or to_m", place="moves")
    return MotionPlan(kind, start_position_m, tuple(moves), now + settle_s)
