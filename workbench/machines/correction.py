"""`measured_correction`: a measured force or torque that the model lacks, as a table; for an unknown cause.

A force (torque) against the motion over one variable, a level for each way. It is no effect:
it has no cause, no name, and holds within the runs it was measured in only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache, partial
from itertools import pairwise
from typing import Any, ClassVar

from pydantic import field_validator, model_validator

from workbench.core.record import Finite, Record
from workbench.machines.declare import Kind, Port
from workbench.machines.plant import Effects, Piece
from workbench.symbolic.expr import Scalar, clip, floor, where

FEWEST, MOST = 3, 33
TURN = 2.0 * math.pi
Numbers = tuple[Finite, ...]


class MeasuredCorrection(Record):
    """What the three forms share. forward, backward: against the motion positive, in N or N m, at each of `at`.

    Linear between the points; beyond the ends the last value stands. A periodic table covers one turn
    and closes by itself. Over a speed or a payload `at` holds magnitudes.
    """

    over: str
    acts_on: str
    at: Numbers

    PERIODIC: ClassVar[tuple[str, ...]] = ()
    MAGNITUDES: ClassVar[tuple[str, ...]] = ()
    UNITS: ClassVar[Mapping[str, str]] = {}  # acts_on -> the unit that its levels' keys end in

    @property
    def forward(self) -> tuple[float, ...]:
        return self._levels("forward")

    @property
    def backward(self) -> tuple[float, ...]:
        return self._levels("backward")

    def _levels(self, way: str) -> tuple[float, ...]:
        return getattr(self, f"{way}_{self.UNITS[self.acts_on]}") or ()

    @property
    def periodic(self) -> bool:
        return self.over in self.PERIODIC

    @field_validator("at")
    @classmethod
    def _rises(cls, at: tuple[float, ...]) -> tuple[float, ...]:
        if not FEWEST <= len(at) <= MOST:
            raise ValueError(f"{len(at)} points, expected {FEWEST} to {MOST}")
        for i, (before, after) in enumerate(pairwise(at)):
            if after <= before:
                raise ValueError(f"{after:g} (point {i + 1}) after {before:g}, expected rising values")
        return at

    @model_validator(mode="after")
    def _fits(self) -> MeasuredCorrection:
        if self.over in self.MAGNITUDES and self.at[0] < 0.0:
            raise ValueError(f"at begins at {self.at[0]:g}, expected at least 0: {self.over} is a magnitude here")
        # Rounded to some digits, a whole turn may lie just within one.
        if self.periodic and self.at[-1] - self.at[0] > TURN * (1.0 - 1e-3):
            raise ValueError(
                f"at spans {self.at[-1] - self.at[0]:.4g} rad, expected less than one turn, {TURN:.4g}: "
                "the table closes by itself"
            )
        for name, values in (("forward", self.forward), ("backward", self.backward)):
            if len(values) != len(self.at):
                raise ValueError(f"{name} has {len(values)} values, at has {len(self.at)}; expected as many")
        return self


NAME = "measured_correction"
SEGMENTS = (17, 33)  # between points; a periodic table has one more than points on a line


def correction_of(machine: Any, kind: Kind) -> tuple[Effects, Mapping[str, float]] | None:
    """The machine's measured correction as pieces for its plant, with their numbers by symbol; None without one."""
    correction = machine.measured_correction
    if correction is None:
        return None
    pieces = _pieces(kind, correction.over, correction.acts_on, correction.periodic, _segments(correction))
    return pieces, _numbers(correction)


def _segments(correction: MeasuredCorrection) -> int:
    needed = len(correction.at) - (0 if correction.periodic else 1)
    return next(many for many in SEGMENTS if many >= needed)


def _symbols(segments: int) -> tuple[str, ...]:
    first = (f"{NAME}__{what}" for what in ("begins", "held", "forward", "backward"))
    of_segments = (
        f"{NAME}__{what}_{i}" for i in range(segments) for what in ("at", "width", "held", "forward", "backward")
    )
    return (*first, *of_segments)


@cache
def _pieces(kind: Kind, over: str, acts_on: str, periodic: bool, segments: int) -> Effects:
    """One object for one kind of table: kernels are found by it."""
    port = kind.ports[acts_on]
    variable = next(table.of for table in kind.tables if table.over == over)
    piece = partial(_force, variable, port, periodic, segments)
    return Effects({port.place: [piece]}, (*_symbols(segments), "start_time_s"))


def _force(variable: Piece, port: Port, periodic: bool, segments: int, s: Any, p: Any) -> Scalar:
    """The sum over all segments of slope times the way gone in the segment."""

    def of(what: str) -> Scalar:
        return getattr(p, f"{NAME}__{what}")

    x = variable(s, p)
    if periodic:
        x = x - TURN * floor((x - of("begins")) / TURN)
    ahead = getattr(s, port.speed) > 0.0
    held, friction = of("held"), where(ahead, of("forward"), of("backward"))
    for i in range(segments):
        gone = clip(x - of(f"at_{i}"), 0.0, of(f"width_{i}"))
        held = held + of(f"held_{i}") * gone
        friction = friction + where(ahead, of(f"forward_{i}"), of(f"backward_{i}")) * gone
    return -(held + port.sign(s, p) * friction)


def _numbers(correction: MeasuredCorrection) -> dict[str, float]:
    """symbol -> value: where each segment begins, how wide it is, the slopes in it; spare ones have no width."""
    at, forward, backward = list(correction.at), list(correction.forward), list(correction.backward)
    if correction.periodic:
        at, forward, backward = [*at, at[0] + TURN], [*forward, forward[0]], [*backward, backward[0]]
    held = [_common(f, b) for f, b in zip(forward, backward, strict=True)]
    levels = {
        "held": held,
        "forward": [f - h for f, h in zip(forward, held, strict=True)],
        "backward": [b + h for b, h in zip(backward, held, strict=True)],
    }
    values = dict.fromkeys(_symbols(_segments(correction)), 0.0)
    values[f"{NAME}__begins"] = at[0]
    for what, level in levels.items():
        values[f"{NAME}__{what}"] = level[0]
    for i in range(len(at) - 1):
        width = at[i + 1] - at[i]
        values[f"{NAME}__at_{i}"], values[f"{NAME}__width_{i}"] = at[i], width
        for what, level in levels.items():
            values[f"{NAME}__{what}_{i}"] = (level[i + 1] - level[i]) / width
    return values


def _common(forward: float, backward: float) -> float:
    """The force against forward motion that both ways share: none where both only brake, or both only drive."""
    return math.copysign(min(abs(forward), abs(backward)), forward) if forward * backward < 0.0 else 0.0
