"""One cause of a gap, as campaigns of both kinds hold it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

Numbers = Mapping[str, float]
TURN = 2.0 * math.pi


@dataclass(frozen=True)
class Event:
    """A brief event in one run only.

    run, moment: which run, and when of its time in motion, as shares from 0 to 1. length_s: how long it lasts.
    What happens stands in the cause's `truth` or `log`, and works only while the event lasts.
    """

    run: float
    moment: float
    length_s: float


@dataclass(frozen=True)
class Cause:
    """One effect at work.

    name: the effect's, or "unlisted: …". truth: values in place of those of `Truth` (each kind's `ailing` says
    which few are added instead); log: what the sensors do; per_run: phases and moments that each run draws anew,
    name -> range. values: for the label. library: name and parameters in the workbench's library.
    """

    name: str
    subsystem: str
    regime: str
    values: Numbers
    truth: Numbers = field(default_factory=dict)
    log: Numbers = field(default_factory=dict)
    per_run: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    library: Mapping[str, Numbers] = field(default_factory=dict)
    alike: tuple[str, ...] = ()
    event: Event | None = None


def about(rng: np.random.Generator, low: float, high: float) -> float:
    """Even on a logarithmic scale."""
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def either(rng: np.random.Generator, low: float, high: float) -> float:
    """As `about`, with either sign."""
    return float(rng.choice([-1.0, 1.0])) * about(rng, low, high)


def drawn_event(rng: np.random.Generator, shortest_s: float, longest_s: float) -> Event:
    """In any run, away from the first and the last motion of it."""
    return Event(rng.random(), rng.uniform(0.1, 0.85), about(rng, shortest_s, longest_s))
