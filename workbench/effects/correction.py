"""A machine's measured correction at work: a table of a force (torque) over one variable, a level for each way.

    F = −(held(x) + S(v) friction(x)),  friction = forward or backward, by the way

What both ways have in common, such as a weight that is off, is `held`: it stays at standstill.
The rest is friction and turns over there within the machine's own standstill: S is linear. With
levels that are both positive nothing is held and the table only ever takes energy.

It is no effect of the library, so that no fit pays for it: its piece joins those at work where
the machine has a table. Its number of points is rounded up to one of two, so few kernels serve all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any

from workbench.kinds import KINDS, Port
from workbench.machine import Axis, Hoist, MeasuredCorrection
from workbench.plants import Effects
from workbench.trace.expr import Scalar, clip, floor, where

NAME = "measured_correction"
SEGMENTS = (17, 33)  # between points; a periodic table has one more than points on a line
TURN = 2.0 * math.pi


def correction_of(machine: Hoist | Axis, kind: str) -> tuple[Effects, Mapping[str, float]] | None:
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
def _pieces(kind: str, over: str, acts_on: str, periodic: bool, segments: int) -> Effects:
    """One object for one kind of table: kernels are found by it."""
    port = KINDS[kind].ports[acts_on]
    variable = next(table.of for table in KINDS[kind].tables if table.over == over)
    piece = partial(_force, variable, port, periodic, segments)
    return Effects({port.place: [piece]}, (*_symbols(segments), "start_time_s"))


def _force(variable: Callable[[Any, Any], Scalar], port: Port, periodic: bool, segments: int, s: Any, p: Any) -> Scalar:
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
