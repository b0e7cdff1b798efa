"""An effect's numbers: how they are called and what they may be, on a machine of any kind and size."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from workbench.kinds import KINDS


def words(kind: str) -> Mapping[str, str]:
    """What the placeholders in names stand for, on a kind of plant."""
    return KINDS[kind].words


Domain = Literal["any", "not_negative", "positive"]
Scan = Literal["", "position", "drum_angle", "phase", "frequency", "waves", "order"]
INEXACT = 0.06  # of a value: one standard deviation of what a simple law near standstill, or of a wire, is off
DOMAINS: Mapping[str, tuple[Callable[[float], bool], str]] = {
    "any": (lambda value: True, "a number"),
    "not_negative": (lambda value: value >= 0.0, "at least 0"),
    "positive": (lambda value: value > 0.0, "more than 0"),
}


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    symbol: as the function reads it. name: with its unit, as YAML has it; {n}, {m}, {input},
    {up}, {dn} stand for the plant's own words. lowest, highest (of a fit), scale and start are
    in units of `size`, a quotient of the machine's sizes ("force/speed"; "1" for plain
    numbers), so that they fit a machine of any size. vanishes_at: the value, in the same unit,
    at which the effect is exactly off; None for what has no such value (a width, a phase).
    per_run: every run has its own. domain: what a value has to be at all.
    scan: how a search tries a shape (what has no vanishing value) before it refines it: as a
    place that the runs have passed (position, drum_angle), as a phase of the amplitude beside
    it, as a frequency, as waves along the way, as finely as the runs resolve it; as an order (`tries`, of which the
    way has to show more than one wave); "": `tries` (in `size`), or some
    values from lowest to highest.
    simplified: one standard deviation, in the unit of the name, by which the fitted value may be off because the law
    simplifies what a machine does: a function of e, the effect's values. No run shows it, for all runs have it alike.
    """

    symbol: str
    name: str
    meaning: str
    size: str
    lowest: float
    highest: float
    scale: float
    start: float
    vanishes_at: float | None = None
    per_run: bool = False
    domain: Domain = "any"
    scan: Scan = ""
    tries: tuple[float, ...] = ()
    simplified: Callable[[Any], float] | None = None

    def named(self, kind: str) -> str:
        return self.name.format(**words(kind))


@dataclass(frozen=True)
class Ranged:
    """A parameter on one machine: bounds, scale, start and vanishing value in the unit of its name.

    symbol: what it is called among the plant's parameters.
    """

    name: str
    symbol: str
    lowest: float
    highest: float
    scale: float
    start: float
    vanishes_at: float | None
    per_run: bool
    scan: Scan
    tries: tuple[float, ...]
