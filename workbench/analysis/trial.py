"""Candidates on the nonlinear closed loop: limits, friction, wire and all, many at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.control import Events, PiSettings
from workbench.machine import Hoist
from workbench.references import Limits, Step, allowed_carriage_speed_m_s, motor_speed_rad_s, plan_motion
from workbench.run import Array
from workbench.simulate.loop import NO_EVENTS, LoopCase, Outcome, simulate_loop


@dataclass(frozen=True, eq=False)
class Trial:
    """The moves that candidates are run through: every payload with every reference, the machine's effects at work.

    references: name -> motor speed (n,), rad/s, at the controller's samples; all of one length, a stop among the
    events already in them. events: what happens in every run. step_s: the plant's longest step.
    """

    machine: Hoist
    payloads_kg: tuple[float, ...]
    start_position_m: float
    references: Mapping[str, Array]
    events: Events = NO_EVENTS
    step_s: float = 0.001


@dataclass(frozen=True)
class Score:
    """Of one candidate the worst over the trial's runs; all NaN where a run failed.

    tracking: rms speed error in % of nominal motor speed. peak: largest torque of the harder-worked motor,
    % of nominal. effort: rms torque of that motor over the run, % of nominal.
    """

    tracking_percent: float
    peak_percent: float
    effort_percent: float

    @property
    def ok(self) -> bool:
        return bool(np.isfinite(self.tracking_percent))


def usual_trial(machine: Hoist, payloads_kg: Sequence[float], sample_time_s: float) -> Trial:
    """Up and down again at nine tenths of nominal speed, as a trapezoid and jerk-limited.

    Ramps of 1.2 s, jerk limited so that it takes 2 s; starting in the middle of the lower half of the rail.
    """
    low, high = machine.rail.lowest_position_m, machine.highest_position_m
    allowed = allowed_carriage_speed_m_s(
        machine.motor.nominal_speed_rad_s, machine.gearbox.ratio, machine.winch.drum_diameter_m
    )
    speed = 0.9 * allowed
    limits = Limits(speed, speed / 1.2, speed / 1.2 / 0.8)
    start, way = low + 0.25 * (high - low), min(0.5 * (high - low), 5.0 * speed)
    steps = [Step(by_m=way), Step(dwell_s=1.0), Step(by_m=-way)]
    kinds = ("trapezoid", "ruckig")
    plans = {kind: plan_motion(kind, steps, start, limits, (low, high), 0.5, 1.5) for kind in kinds}
    length = max(plan.duration_s for plan in plans.values())
    return Trial(
        machine,
        tuple(payloads_kg),
        start,
        {
            kind: motor_speed_rad_s(
                plan.sample(sample_time_s, length).speed_m_s, machine.gearbox.ratio, machine.winch.drum_diameter_m
            )
            for kind, plan in plans.items()
        },
    )


def try_out(trial: Trial, candidates: Sequence[PiSettings]) -> list[Score]:
    """Run every candidate through the trial."""
    cases = [
        LoopCase(f"{i}", trial.machine, payload, trial.start_position_m, settings, speed, trial.events)
        for i, settings in enumerate(candidates)
        for payload in trial.payloads_kg
        for speed in trial.references.values()
    ]
    results = simulate_loop(cases, record_every=0, step_s=trial.step_s)
    nominal = trial.machine.motor.nominal_torque_nm
    table = np.array(
        [
            [
                100.0 * r.metrics["speed_error_rms_rad_s"] / trial.machine.motor.nominal_speed_rad_s,
                r.metrics["peak_torque_percent"],
                100.0 * r.metrics["rms_torque_motor_nm"] / nominal,
            ]
            if r.outcome is Outcome.COMPLETED
            else [np.nan] * 3
            for r in results
        ]
    )
    worst = table.reshape(len(candidates), -1, 3).max(axis=1)  # NaN where any run failed
    return [Score(*map(float, row)) for row in worst]
