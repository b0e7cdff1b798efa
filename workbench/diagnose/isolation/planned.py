"""The menu of runs that could be driven next: payloads, speeds and motions within the range of the logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array, Run
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.profiles import place
from workbench.machines import kind_of
from workbench.references import Limits, Step, plan_motion
from workbench.simulate.lowpass import lowpass

SLOW = 0.2  # of the fastest speed logged
LONGEST_S = 25.0  # of one way, at the slow speed
HOLD_PERIODS = 5.0  # of the band, a hold lasts
LEAD_PERIODS = 3.0  # at rest before and after
SAMPLES = 10.0  # a period
BETWEEN_S = 60.0  # from the campaign's last run to the next one
MOST_PAYLOADS = 4


@dataclass(frozen=True)
class Planned:
    """A planned run. words: its motion as text."""

    run: Run
    payload_kg: float
    words: str

    @property
    def duration_s(self) -> float:
        return self.run.duration_s


@dataclass(frozen=True)
class Seen:
    """The range of motion in the logs, in m and m/s (rad on a rotary axis)."""

    low: float
    high: float
    speed: float
    acceleration: float


def menu(problem: Problem) -> list[Planned]:
    """All combinations of payload, speed and motion (plain, reversals, holds); [] if the logs hold no motion."""
    seen = seen_in(problem)
    if not (seen.high > seen.low and seen.speed > 0.0 and seen.acceleration > 0.0):
        return []
    unit = kind_of(problem.machine).moved.speed_unit
    runs = []
    for payload in _payloads(problem):
        for word, speed in (("slow", SLOW * seen.speed), ("fast", seen.speed)):
            for motion, steps in _motions(problem, seen, speed).items():
                run = _run(problem, seen, speed, steps, payload, f"{payload:g} {word} {motion}")
                runs.append(Planned(run, payload, f"{word} ({speed:.2g} {unit}), both ways, {motion}"))
    return runs


def seen_in(problem: Problem) -> Seen:
    """Largest speed and acceleration in the band, and the range of heights, of all runs."""
    bench, lift = problem.bench, kind_of(problem.machine).transmission_of(problem.machine)
    places = [place(bench, j) for j in range(len(bench.runs))]
    smooth = [
        [lowpass(run.time_s, values, bench.band_hz)[inside] for values in (motion.speed, motion.acceleration)]
        for run, motion, inside in zip(bench.runs, bench.motions, bench.inside, strict=True)
    ]
    speed, acceleration = (
        max(float(np.max(np.abs(of_run[k]), initial=0.0)) for of_run in smooth) * lift for k in (0, 1)
    )
    low, high = min(float(np.min(x)) for x in places), max(float(np.max(x)) for x in places)
    return Seen(low, high, speed, acceleration)


def _payloads(problem: Problem) -> list[float]:
    """The lightest, middle and heaviest payload of the campaign, and none."""
    if not kind_of(problem.machine).payload:
        return [problem.runs[0].payload_kg]
    known = sorted({run.payload_kg for run in problem.runs})
    middle = min(known, key=lambda load: abs(load - 0.5 * (known[0] + known[-1])))
    return sorted({0.0, known[0], middle, known[-1]})[:MOST_PAYLOADS]


def _motions(problem: Problem, seen: Seen, speed: float) -> dict[str, list[Step]]:
    way = 0.96 * min(seen.high - seen.low, LONGEST_S * speed)
    hold = Step(dwell_s=HOLD_PERIODS / problem.band_hz)

    def go(*quarters: float) -> list[Step]:
        return [Step(by_m=quarter * way / 4.0) for quarter in quarters]

    def with_holds(steps: Sequence[Step]) -> list[Step]:
        return [part for step in steps for part in (step, hold)][:-1]

    return {
        "without a stop on the way": with_holds(go(4, -4)),
        "with reversals at half height": go(2, -1, 1, 2, -2, 1, -1, -2),
        "with holds on the way": with_holds(go(1, 1, 2, -1, -1, -2)),
    }


def _run(problem: Problem, seen: Seen, speed: float, steps: Sequence[Step], payload: float, name: str) -> Run:
    """The run as a log: exact motion, no torque, the tension of the weight at rest."""
    rest = LEAD_PERIODS / problem.band_hz
    limits = Limits(speed, seen.acceleration, 4.0 * seen.acceleration * problem.band_hz)
    span = seen.high - seen.low
    begin = seen.low + 0.02 * span
    plan = plan_motion("ruckig", steps, begin, limits, (seen.low - span, seen.high + span), rest, rest)
    profile = plan.sample(1.0 / (SAMPLES * problem.band_hz))
    kind, machine, n = kind_of(problem.machine), problem.machine, len(profile.time_s)
    plant = kind.plant
    last = max(problem.runs, key=lambda run: run.start_time_s)
    after = last.start_time_s + last.duration_s + BETWEEN_S
    signals: dict[str, Array] = {plant.input: np.zeros(n)}
    signals[plant.speeds[0]] = profile.speed_m_s / kind.transmission_of(machine)
    if kind.moved.placed_by_log:
        signals[plant.positions[0]] = profile.position_m
    if kind.dead_line is not None:
        signals[kind.dead_line.signal] = np.full(n, kind.dead_line.at_rest(machine, payload))
    return Run(name, profile.time_s, signals, payload, begin, after)
