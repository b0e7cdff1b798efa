"""One run of a study, fully resolved: what a worker needs to know and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

from workbench.control import Events, Settings
from workbench.errors import InputError
from workbench.kinds import kind_of, load_of
from workbench.machine import AnyKind, Axis, Hoist
from workbench.references import (
    LimitPair,
    Plan,
    RecordedPlan,
    Step,
    StoppedPlan,
    plan_motion,
    planned_kind,
)
from workbench.run import Array


@dataclass(frozen=True, eq=False)
class Recording:
    """A recorded motion of a carriage: (n,) times and speeds (up positive), and how it is followed.

    smoothing_s: 0 as it is, above 0 as its moving average over that time. digest: of the samples.
    """

    label: str
    time_s: Array
    speed_m_s: Array
    start_position_m: float
    smoothing_s: float
    digest: str


@dataclass(frozen=True)
class RunSpec:
    """One run. run_id: unique in the study, stable, safe as the name of a file.

    machine: overrides, drive and effects are in it. reference: its name in the results, a planned
    kind, or the label of `recording`. duration_s: all runs of a study are held at rest until then.
    record_every: keep each n-th sample of the controller, 0 none. assigned: index column -> what
    sweep and sample have set. problem: why this run cannot take place; "" for one that can.
    """

    run_id: str
    scenario: str
    machine: AnyKind
    payload_kg: float
    start_position_m: float
    reference: str
    moves: tuple[Step, ...]
    limits: LimitPair | None
    lead_s: float
    settle_s: float
    duration_s: float
    controller: Settings
    events: Events = field(default_factory=Events)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    step_s: float = 0.001
    plant: str = "lumped"
    record_every: int = 10
    recording: Recording | None = None
    assigned: Mapping[str, float | str] = field(default_factory=dict)
    problem: str = ""

    def plan(self) -> Plan:
        """The motion; equal motions are planned once. InputError where it is not possible."""
        if self.problem:
            raise InputError(self.problem)
        plan, events = self._undisturbed(), self.events
        if events.emergency_stop_s is None or events.emergency_deceleration_m_s2 is None:
            return plan
        return _stopped(plan, events.emergency_stop_s, events.emergency_deceleration_m_s2)

    def _undisturbed(self) -> Plan:
        rail = kind_of(self.machine).looped.rail(self.machine)
        if self.recording is not None:
            return _recorded_plan(self.recording, rail, self.lead_s, self.settle_s)
        assert self.limits is not None
        check_speed(self.limits, self.machine)
        kind = planned_kind(self.reference)
        load = load_of(self.machine, self.payload_kg) if kind.needs_load or kind.uses_load else None
        return _planned(
            self.reference, self.moves, self.start_position_m, self.limits, rail, self.lead_s, self.settle_s, load
        )


_planned = lru_cache(maxsize=256)(plan_motion)
_stopped = lru_cache(maxsize=256)(StoppedPlan)


@lru_cache(maxsize=16)
def _recorded_plan(recording: Recording, rail: tuple[float, float], lead_s: float, settle_s: float) -> RecordedPlan:
    return RecordedPlan(
        kind=recording.label,
        time_s=recording.time_s,
        speed_recorded_m_s=recording.speed_m_s,
        start_position_m=recording.start_position_m,
        rail_m=rail,
        lead_s=lead_s,
        settle_s=settle_s,
        smoothing_s=recording.smoothing_s,
    )


def check_speed(limits: LimitPair, machine: Hoist | Axis) -> None:
    """InputError where a speed limit is beyond what the machine allows."""
    kind = kind_of(machine)
    top = kind.looped.top_speed(machine)
    key = "speed_rad_s" if kind.moved.unit == "rad" else "speed_m_s"
    for name, way_limits in (("hoisting", limits.hoisting), ("lowering", limits.lowering)):
        if way_limits.speed_m_s > top.speed * (1.0 + 1e-9):
            raise InputError(
                f"{top.reason.format(limit=way_limits.speed_m_s)}; "
                f"expected at most {int(top.speed * 1000.0) / 1000.0:g} {kind.moved.speed_unit}",
                place=f"limits.{key}" if limits.hoisting == limits.lowering else f"limits.{name}.{key}",
            )
