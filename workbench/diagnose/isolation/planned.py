"""Runs that could be driven next: a menu of plain ones, and motions designed for the question at hand.

Both stay within the places, speeds and accelerations that the logs show; where they show less than half of a
machine's nominal speed, others go up to that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.core.errors import InputError
from workbench.core.names import listed
from workbench.core.run import Array, Run
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.profiles import place
from workbench.machines import kind_of
from workbench.references import Limits, Step, plan_motion
from workbench.simulate.lowpass import lowpass

SLOW = 0.2  # of the fastest speed logged
LONGEST_S = 25.0  # of one way, at the slow speed
HOLD_PERIODS = 5.0  # of the band, a hold lasts
LEAD_PERIODS = 3.0  # at rest before and after, and at least wherever a run turns
HOLDS = (0.0, 0.0, HOLD_PERIODS)  # between legs the same way
SAMPLES = {"sensors": 10.0, "own": 30.0}  # a period, by `Kind.floor`: friction that turns over between two shows
BETWEEN_S = 60.0  # from the campaign's last run to the next one
MOST_PAYLOADS = 4
MOST_LEGS = 6  # of a designed motion
FASTER = "faster than any before"
SHARES = (0.15, 0.3, 0.6, 1.0)  # of the top speed


@dataclass(frozen=True)
class Planned:
    """A planned run. words: its motion as text. steps, limits, start: as `plan_motion` took them. faster: than any that
    was logged."""

    run: Run
    payload_kg: float
    words: str
    steps: tuple[Step, ...]
    limits: Limits
    start_position: float
    faster: bool = False

    @property
    def duration_s(self) -> float:
        return self.run.duration_s

    @property
    def motion(self) -> dict[str, Any]:
        """Plain data, of which `from_moves` makes the run again."""
        moves = [{key: value for key, value in vars(step).items() if value is not None} for step in self.steps]
        return {"start_position": self.start_position, "speed": self.limits.speed_m_s, "moves": moves}


@dataclass(frozen=True)
class Seen:
    """The range of motion in the logs, in m and m/s (rad on a rotary axis). nominal: speed that the machine is built
    for, where that is stated."""

    low: float
    high: float
    speed: float
    acceleration: float
    nominal: float = 0.0


def menu(problem: Problem) -> list[Planned]:
    """All combinations of payload, speed and motion (plain, reversals, holds); [] if the logs hold no motion."""
    seen = seen_in(problem)
    if not (seen.high > seen.low and seen.speed > 0.0 and seen.acceleration > 0.0):
        return []
    unit = kind_of(problem.machine).moved.speed_unit
    runs = []
    for payload in _payloads(problem):
        speeds = {"slow": SLOW * seen.speed, "fast": seen.speed}
        if seen.speed < settings.HALF * seen.nominal:
            speeds[FASTER] = seen.nominal
        for word, speed in speeds.items():
            for motion, steps in _motions(problem, seen, speed).items():
                begin = seen.low + 0.02 * (seen.high - seen.low)
                words = f"{word} ({speed:.2g} {unit}), both ways, {motion}"
                runs.append(_planned(problem, seen, speed, steps, payload, begin, words))
    return runs


def repeated(problem: Problem, planned: Planned, times: int) -> Planned:
    """A run of the menu several times over, in one run."""
    words = f"{planned.words}, {times} times"
    steps = ((*planned.steps, Step(dwell_s=HOLD_PERIODS / problem.band_hz)) * times)[:-1]
    return _planned(
        problem, seen_in(problem), planned.limits.speed_m_s, steps, planned.payload_kg, planned.start_position, words
    )


@dataclass(frozen=True)
class Design:
    """A motion by its numbers: legs of (place, 0 to 1 of the range seen; share of the top speed; hold before it,
    s)."""

    payload_kg: float
    start: float
    legs: tuple[tuple[float, float, float], ...]


def drawn(problem: Problem, many: int, rng: np.random.Generator) -> list[Design]:
    """Random designs."""
    loads = _payloads(problem)
    designs = []
    for _ in range(many):
        legs = rng.integers(2, MOST_LEGS + 1)
        numbers = zip(rng.uniform(0.02, 0.98, legs), rng.choice(SHARES, legs), rng.choice(HOLDS, legs), strict=True)
        scaled = tuple((float(a), float(b), float(c) / problem.band_hz) for a, b, c in numbers)
        designs.append(Design(float(rng.choice(loads)), float(rng.uniform(0.02, 0.98)), scaled))
    return designs


def varied(problem: Problem, design: Design, many: int, rng: np.random.Generator) -> list[Design]:
    """Designs that differ from one in a leg, or in the payload."""
    fresh = []
    for other in drawn(problem, many, rng):
        legs = list(design.legs)
        legs[rng.integers(len(legs))] = other.legs[0]
        load = other.payload_kg if rng.uniform() < 0.3 else design.payload_kg
        fresh.append(Design(load, design.start, tuple(legs)))
    return fresh


def planned_as(problem: Problem, seen: Seen, design: Design, longest_s: float, top: float) -> Planned | None:
    """The run of a design up to a top speed, None where it takes too long or a leg is too short for its speed.

    Each leg is a jog at its own speed that comes to rest: up to speed, on at it, down again.
    """
    span, limits = seen.high - seen.low, _limits(problem, seen, top)
    here, last, steps = seen.low + design.start * span, 0.0, list[Step]()
    begin, lasted = here, 2.0 * LEAD_PERIODS / problem.band_hz
    for place_, share, hold in design.legs:
        distance, speed = seen.low + place_ * span - here, share * top
        ramp = speed / limits.acceleration_m_s2 + limits.acceleration_m_s2 / limits.jerk_m_s3
        even = abs(distance) / speed - ramp
        if even <= 0.0:
            continue
        turns = distance * (last or distance) < 0.0
        pause, last = max(hold * bool(last), turns * LEAD_PERIODS / problem.band_hz), distance
        rest = [Step(dwell_s=round(pause, 2))] if pause > 0.0 else []
        steps += [*rest, Step(speed_m_s=math.copysign(round(speed, 6), distance), for_s=round(ramp + even, 3)),
                  Step(speed_m_s=0.0, for_s=round(1.05 * ramp + 0.01, 3))]  # fmt: skip
        lasted += 2.05 * ramp + even + pause
        here += distance
    if len(steps) < 2 or lasted > longest_s:
        return None
    unit = kind_of(problem.machine).moved.speed_unit
    speeds = sorted({abs(s.speed_m_s) for s in steps if s.speed_m_s})
    count = sum(1 for s in steps if s.speed_m_s)
    how = f"designed, {FASTER}" if max(speeds, default=0.0) > 1.001 * seen.speed else "designed"
    said = f"{how}: {count} leg{'s' if count > 1 else ''} at {listed([f'{v:.2g}' for v in speeds])} {unit}"
    try:
        planned = _planned(problem, seen, top, steps, design.payload_kg, begin, said)
    except InputError:
        return None
    run, kind = planned.run, kind_of(problem.machine)
    step = kind.transmission_of(problem.machine) * run.sample_time_s
    way = planned.start_position + np.cumsum(run[kind.plant.speeds[0]]) * step
    inside = seen.low - 0.02 * span <= np.min(way) and np.max(way) <= seen.high + 0.02 * span
    return planned if inside and planned.duration_s <= longest_s else None


def from_moves(
    problem: Problem, payload_kg: float, start: float, speed: float, moves: Sequence[Mapping[str, float]]
) -> Planned:
    """The run of moves as diagnosis.json holds them."""
    seen = seen_in(problem)
    return _planned(problem, seen, speed, [Step(**move) for move in moves], payload_kg, start, "as stated")


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
    nominal = kind_of(problem.machine).nominal_speed
    return Seen(low, high, speed, acceleration, 0.0 if nominal is None else nominal(problem.machine) * lift)


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
        """At rest wherever it turns: where friction turns over without a rest, no law of it is exact."""
        return [part for quarter in quarters for part in (Step(by_m=quarter * way / 4.0), hold)][:-1]

    return {
        "without a stop on the way": go(4, -4),
        "with reversals half way": go(2, -1, 1, 2, -2, 1, -1, -2),
        "with holds on the way": go(1, 1, 2, -1, -1, -2),
    }


def _limits(problem: Problem, seen: Seen, speed: float) -> Limits:
    return Limits(speed, seen.acceleration, 4.0 * seen.acceleration * problem.band_hz)


def _planned(
    problem: Problem, seen: Seen, speed: float, steps: Sequence[Step], payload: float, begin: float, words: str
) -> Planned:
    """The run as a log: exact motion, no torque, the tension of the weight at rest. InputError for no motion."""
    rest = LEAD_PERIODS / problem.band_hz
    limits = _limits(problem, seen, speed)
    span = seen.high - seen.low
    plan = plan_motion("ruckig", steps, begin, limits, (seen.low - span, seen.high + span), rest, rest)
    kind, machine = kind_of(problem.machine), problem.machine
    profile = plan.sample(1.0 / (SAMPLES[kind.floor] * problem.band_hz))
    n = len(profile.time_s)
    plant = kind.plant
    last = max(problem.runs, key=lambda run: run.start_time_s)
    after = last.start_time_s + last.duration_s + BETWEEN_S
    signals: dict[str, Array] = {plant.input: np.zeros(n)}
    signals[plant.speeds[0]] = profile.speed_m_s / kind.transmission_of(machine)
    if kind.moved.placed_by_log:
        signals[plant.positions[0]] = profile.position_m
    if kind.dead_line is not None:
        signals[kind.dead_line.signal] = np.full(n, kind.dead_line.at_rest(machine, payload))
    run = Run(f"{payload:g} {words}", profile.time_s, signals, payload, begin, after)
    return Planned(run, payload, words, tuple(steps), limits, begin, speed > 1.001 * seen.speed)
