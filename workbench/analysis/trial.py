"""Candidates on the nonlinear closed loop: limits, friction, wire and all, many at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from workbench.control import Events, Settings
from workbench.kinds import kind_of
from workbench.machine import AnyKind, Axis, Hoist
from workbench.metrics import set_of
from workbench.references import Limits, Plan, Step, plan_motion
from workbench.run import Array
from workbench.simulate.loop import NO_EVENTS, LoopCase, Outcome, simulate_loop


@dataclass(frozen=True, eq=False)
class Trial:
    """The moves that candidates are run through: every payload with every reference, the machine's effects at work.

    references: name -> speed of the driven coordinate (n,), rad/s or m/s, at the controller's samples; all of one
    length, a stop among the events already in them. positions: the same of an axis' position reference. events:
    what happens in every run. step_s: the plant's longest step.
    """

    machine: AnyKind
    payloads_kg: tuple[float, ...]
    start_position_m: float
    references: Mapping[str, Array]
    events: Events = NO_EVENTS
    step_s: float = 0.001
    positions: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Score:
    """Of one candidate the worst over the trial's runs; all NaN where a run failed.

    tracking: rms speed error in % of nominal motor speed; of an axis rms position error in % of a second's way at
    its speed scale. peak: largest torque of the harder-worked motor, % of nominal; of an axis of its input scale.
    effort: rms torque over the run, % of the same.
    """

    tracking_percent: float
    peak_percent: float
    effort_percent: float

    @property
    def ok(self) -> bool:
        return bool(np.isfinite(self.tracking_percent))


def usual_trial(machine: Hoist | Axis, payloads_kg: Sequence[float], sample_time_s: float) -> Trial:
    """There and back again at nine tenths of the top speed, as a trapezoid and jerk-limited.

    Of a hoist ramps of 1.2 s, jerk limited so that it takes 2 s; starting in the middle of the lower half of the rail.
    An axis starts at 0 with ramps that take 0.2 s, longer where half of its limit cannot; for a top speed that is
    nowhere stated its even motion's serves, twice.
    """
    loop = kind_of(machine).looped
    low, high = loop.rail(machine)
    speed = 0.9 * min(loop.top_speed(machine).speed, loop.speed_scale(machine) if loop.position_loop else math.inf)
    if loop.position_loop:
        ramp = max(0.2, 2.0 * speed * loop.total_inertia(machine, 0.0) / loop.input_limit(machine))
        start, way, rest, rounding = 0.0, 3.0 * speed * ramp, 2.0 * ramp, ramp / 1.5
    else:
        ramp, rest, rounding = 1.2, 1.0, 0.8
        start, way = low + 0.25 * (high - low), min(0.5 * (high - low), 5.0 * speed)
    limits = Limits(speed, speed / ramp, speed / ramp / rounding)
    steps = [Step(by_m=way), Step(dwell_s=rest), Step(by_m=-way)]
    kinds = ("trapezoid", "ruckig")
    ends = (0.5, 1.5) if not loop.position_loop else (0.5 * ramp, 3.0 * ramp)
    plans = {kind: plan_motion(kind, steps, start, limits, (low, high), *ends) for kind in kinds}
    length = max(plan.duration_s for plan in plans.values())
    speeds, positions = motions(machine, plans, sample_time_s, length)
    return Trial(machine, tuple(payloads_kg), start, speeds, positions=positions)


def motions(
    machine: Hoist | Axis, plans: Mapping[str, Plan], sample_time_s: float, length_s: float
) -> tuple[dict[str, Array], dict[str, Array]]:
    """name -> the driven coordinate's speed at the controller's samples, all equally long; the same of its position,
    where the loop follows that."""
    loop = kind_of(machine).looped
    per_way = loop.per_way(machine)
    profiles = {name: plan.sample(sample_time_s, length_s) for name, plan in plans.items()}
    n = min(len(profile.speed_m_s) for profile in profiles.values())
    positions = {name: (profile.position_m * per_way)[:n] for name, profile in profiles.items()}
    speeds = {name: (profile.speed_m_s * per_way)[:n] for name, profile in profiles.items()}
    return speeds, positions if loop.position_loop else {}


def try_out(trial: Trial, candidates: Sequence[Settings]) -> list[Score]:
    """Run every candidate through the trial."""
    cases = [
        LoopCase(
            f"{i}", trial.machine, payload, trial.start_position_m, settings, speed, trial.events,
            position_reference=trial.positions.get(name),
        )
        for i, settings in enumerate(candidates)
        for payload in trial.payloads_kg
        for name, speed in trial.references.items()
    ]  # fmt: skip
    results = simulate_loop(cases, record_every=0, step_s=trial.step_s)
    kind = kind_of(trial.machine)
    judged, loop = set_of(kind.name), kind.looped
    speed, most = loop.speed_scale(trial.machine), loop.input_scale(trial.machine)
    # A hoist's motor is judged by its speed, an axis by its place, over the way that its top speed makes in a second.
    table = np.array(
        [
            [
                100.0 * r.metrics[judged.rms_error] / speed,
                100.0 * r.metrics[judged.peak] / most if loop.position_loop else r.metrics["peak_torque_percent"],
                100.0 * r.metrics[judged.rms] / most,
            ]
            if r.outcome is Outcome.COMPLETED
            else [np.nan] * 3
            for r in results
        ]
    )
    worst = table.reshape(len(candidates), -1, 3).max(axis=1)  # NaN where any run failed
    return [Score(*map(float, row)) for row in worst]
