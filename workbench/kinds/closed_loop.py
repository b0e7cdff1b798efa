"""How machines of a kind are driven in closed loop: what studies, loop and tune ask of a kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from workbench.trace.expr import Scalar


@dataclass(frozen=True)
class TopSpeed:
    """speed: what moves may go at most, m/s or rad/s; inf where nothing is stated. reason: of a limit beyond it, with
    {limit} for it."""

    speed: float
    reason: str = ""


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The closed loop of one kind. Functions take the machine's record first.

    position, speed: the plant's signals at the encoder. references: the signals that the controller follows.
    recorded: the signals that a run keeps. rail: the lowest and the highest place of what moves, infinite where
    nothing ends it; top: a place that it never reaches. per_way: of the driven coordinate, per way of what moves.
    top_speed: of what moves. speed_scale, input_scale: what errors and inputs are judged against, in SI of the
    driven coordinate. inertia(p), load(p, position), friction(p, speed): what a feed-forward knows, of the plant's
    symbols. start: what a start position is, in words. position_loop: whether the controller has one, so that the
    machine knows its place. even_speed: of the driven coordinate, at which the loop is linearised in motion.
    places: of what moves, at which a loop is looked at unless told. drawn: keys of machine.yaml that a study draws
    by their tolerances: what changes the motion, and not the log alone. input_limit: the largest input, inf where
    none is stated; peak_limit: what the metric of the peak is held against; nominal: the same without end, None
    where none is stated; drive_words: the drive in a line; giver: who gives it, in words. swing: what an anti-
    resonance is. where(payload_kg, place): an operating point in words. more_often: (what a family is over, one of
    them), in words. motion_words: hoisting, lowering, at_rest as this kind says them.
    """

    position: str
    speed: str
    references: tuple[str, ...]
    recorded: tuple[str, ...]
    rail: Callable[[Any], tuple[float, float]]
    top: Callable[[Any], float]
    per_way: Callable[[Any], float]
    top_speed: Callable[[Any], TopSpeed]
    speed_scale: Callable[[Any], float]
    input_scale: Callable[[Any], float]
    total_inertia: Callable[[Any, float], float]
    even_speed: Callable[[Any], float]
    places: Callable[[Any], tuple[float, ...]]
    start: str
    drawn: tuple[str, ...]
    input_limit: Callable[[Any], float]
    peak_limit: Callable[[Any], float]
    nominal: Callable[[Any], float | None]
    drive_words: Callable[[Any], str]
    giver: str
    swing: str
    where: Callable[[float, float], str]
    more_often: tuple[str, str]
    motion_words: Mapping[str, str]
    position_loop: bool = False
    inertia: Callable[[Any], Scalar] | None = None
    load: Callable[[Any, Scalar], Scalar] | None = None
    friction: Callable[[Any, Scalar], Scalar] | None = None
