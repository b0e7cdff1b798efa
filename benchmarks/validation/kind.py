"""A kind of machine in these campaigns, its causes and its runs: one record each, read by all that is shared."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.validation.families import Family
from benchmarks.validation.sensors import Columns, Sampled, Sensors

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


Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class RunPlan:
    """One run: name and profile, stated payload, kg, height or position at its start, m (rad), when it began in the
    campaign, s, and how long it lasts, s. reference: a recorded one in place of the profile, a value each `record_s` of
    its kind, rad/s or m/s. logs: signals that this run logs beside those of all."""

    name: str
    profile: str
    payload_kg: float
    start: float
    start_time_s: float
    duration_s: float
    reference: tuple[float, ...] | None = None
    logs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Logging:
    """rate_hz; logs: signals beside the input that are logged; uneven: steps of time differ."""

    rate_hz: float
    logs: tuple[str, ...]
    uneven: bool = False


@dataclass(frozen=True)
class Kind:
    """record_s: step of the kernel's record. input, speed: its columns of torque or force and of the motion.

    drawn: nominal machine of (rng, family, effects' names); rebuilt: the same of plain data, machine.yaml's and its
    other values. usual: effects that show. pair: two of them,
    the first given or drawn. plan: runs and logging of (rng, drawn machine, family, effects' names). causes: effect
    -> how it is drawn of (rng, scales); scales: of (drawn machine, runs, logging). truth: the true machine; ailing:
    with a cause at work; in_run: of one run; inertia: all that
    moves, at the motor; sensors: the true sensors. move: reference of a run and what the
    kernel makes of the truth: (plan, drawn, truth, family, rng) -> reference, record. columns: of the log. band_hz:
    in which the causes' size is measured, of the log's rate. said: what runs.yaml says of a run.
    """

    name: str
    record_s: float
    input: int
    speed: int
    listed: tuple[str, ...]
    unlisted: tuple[str, ...]
    events: tuple[str, ...]
    usual: tuple[str, ...]
    pair: Callable[[np.random.Generator, str | None], tuple[str, str]]
    drawn: Callable[[np.random.Generator, Family, Sequence[str]], Any]
    rebuilt: Callable[[Mapping[str, Any], Mapping[str, Any]], Any]
    plan: Callable[[np.random.Generator, Any, Family], tuple[tuple[RunPlan, ...], Logging]]
    shown_by: Callable[[Logging, Any, Sequence[Cause]], Logging]
    scales: Callable[[Any, Sequence[RunPlan], Logging], Any]
    causes: Mapping[str, Callable[[np.random.Generator, Any], Cause]]
    truth: Callable[[Any, Family, np.random.Generator], Any]
    ailing: Callable[[Any, Cause], Any]
    in_run: Callable[[Any, RunPlan, np.random.Generator], Any]
    sensors: Callable[[np.random.Generator, Any, Family, Logging], Sensors]
    excitation: Callable[[np.random.Generator, RunPlan, Any], tuple[Array, Array]]
    inertia: Callable[[Any], float]
    move: Callable[[np.random.Generator, Any, Any, Family, Array, Array], Array]
    motion: Callable[[Array], Array]
    columns: Callable[[Sampled, Array, Array, Sensors, np.random.Generator, Any, RunPlan, Logging], Columns]
    band_hz: Callable[[float], float]
    said: Callable[[RunPlan], dict[str, float]]
