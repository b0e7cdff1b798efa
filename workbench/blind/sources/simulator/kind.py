"""What a kind of machine is to these campaigns: one record each, read by all that is shared."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.blind.sources.simulator.causes import Cause
from workbench.blind.sources.simulator.families import Family
from workbench.blind.sources.simulator.sensors import Columns, Sampled, Sensors

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class RunPlan:
    """One run: name and profile, stated payload, kg, height or position at its start, m (rad), when it began in the
    campaign, s, and how long it lasts, s. reference: a recorded one in place of the profile, a value each `record_s` of
    its kind, rad/s or m/s."""

    name: str
    profile: str
    payload_kg: float
    start: float
    start_time_s: float
    duration_s: float
    reference: tuple[float, ...] | None = None


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
    other values. usual: effects that show on a family. pair: two of them,
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
    usual: Callable[[Family], tuple[str, ...]]
    pair: Callable[[np.random.Generator, Family, str | None], tuple[str, str]]
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
