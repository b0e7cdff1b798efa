"""Simulated months before the watch: `python -m benchmarks.watch [--cycles 2000]`.

A machine does the same two short moves again and again, with a payload of 0, 4500 or 9000 kg; friction scatters by 1 %
from cycle to cycle, the payload by 0.1 %, and the sensors have noise. Four months: healthy; guide friction that grows
by 40 % within 200 cycles; a brake that begins to drag; a torque sensor whose offset drifts. Reported: false alarms, the
delay to the first alarm, the named cause; beside them a 3-sigma limit on the friction estimates of each cycle.
"""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from workbench.control import PiSettings
from workbench.core.run import Run
from workbench.effects import of
from workbench.effects.active import logged
from workbench.logs import Campaign
from workbench.machines import Hoist, default_hoist, get_value, with_values
from workbench.references import Limits, Step, motor_speed_rad_s, plan_motion
from workbench.simulate.loop import LoopCase, simulate_loop
from workbench.watch.cause import diagnosed
from workbench.watch.estimate import WINDOW, estimate, watched_keys
from workbench.watch.judge import Cycle, Judge, Rules

SAMPLE_TIME_S, DURATION_S, REST_S = 0.02, 9.0, 60.0
TORQUE_NOISE_NM, SPEED_NOISE_RAD_S = 4.0, 0.02
SCATTER = {"guide.coulomb_hoisting_n": 0.01, "guide.coulomb_lowering_n": 0.01}
PAYLOAD_SCATTER = 0.001
PAYLOADS = (0.0, 4500.0, 9000.0)
GAINS = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)
AT_ONCE = 64

Change = Callable[[int], tuple[Mapping[str, float], Mapping[str, Mapping[str, float]]]]


def healthy(k: int) -> tuple[Mapping[str, float], Mapping[str, Mapping[str, float]]]:
    return {}, {}


def friction_grows(begins: int, over: int = 200, by: float = 0.4) -> Change:
    def change(k: int) -> tuple[Mapping[str, float], Mapping[str, Mapping[str, float]]]:
        part = 1.0 + by * min(max(k - begins, 0) / over, 1.0)
        return {"guide.coulomb_hoisting_n": part, "guide.coulomb_lowering_n": part}, {}

    return change


def brake_drags(begins: int, torque_nm: float = 60.0) -> Change:
    return lambda k: ({}, {"brake_drag": {"torque_nm": torque_nm}} if k >= begins else {})


def sensor_drifts(begins: int, nm_per_cycle: float = 0.05) -> Change:
    return lambda k: ({}, {"torque_offset": {"offset_nm": nm_per_cycle * (k - begins)}} if k > begins else {})


def month(machine: Hoist, cycles: int, change: Change, seed: int) -> Iterator[tuple[Run, float]]:
    """Runs with the time at which each began."""
    rng = np.random.default_rng(seed)
    limits = Limits(speed_m_s=0.7, acceleration_m_s2=0.6, jerk_m_s3=3.0)
    steps = [Step(by_m=1.4), Step(dwell_s=0.8), Step(by_m=-1.4)]
    plan = plan_motion("ruckig", steps, 9.0, limits, (0.0, 25.0), lead_s=0.6)
    speed = motor_speed_rad_s(
        plan.sample(GAINS.sample_time_s, DURATION_S).speed_m_s, machine.gearbox.ratio, machine.winch.drum_diameter_m
    )
    for first in range(0, cycles, AT_ONCE):
        cases, stated, starts = [], [], []
        for k in range(first, min(first + AT_ONCE, cycles)):
            factors, effects = change(k)
            values = {
                key: get_value(machine, key) * factors.get(key, 1.0) * (1.0 + scatter * rng.normal())
                for key, scatter in {**dict.fromkeys(factors, 0.0), **SCATTER}.items()
            }
            true = with_values(machine, values).model_copy(update={"effects": dict(effects)})
            payload = float(rng.choice(PAYLOADS))
            carried = payload * (1.0 + PAYLOAD_SCATTER * rng.normal())
            start = k * (DURATION_S + REST_S)
            cases.append(LoopCase(f"cycle_{k:05d}", true, carried, 9.0, GAINS, speed, start_time_s=start))
            stated.append(payload)
            starts.append(start)
        for result, payload, start in zip(
            simulate_loop(cases, record_every=round(SAMPLE_TIME_S / GAINS.sample_time_s)), stated, starts, strict=True
        ):
            run = logged(result.run, of(result.case.machine))
            n = len(run.time_s)
            signals = {
                "torque_motor_nm": run["torque_motor_nm"] + TORQUE_NOISE_NM * rng.normal(size=n),
                "speed_motor_rad_s": run["speed_motor_rad_s"] + SPEED_NOISE_RAD_S * rng.normal(size=n),
            }
            yield replace(run, signals=signals, payload_kg=payload), start


@dataclass(frozen=True)
class Watched:
    """What the watch made of a month. first: the first alarm after `begins`, sigma_first: of the 3-sigma limit; false:
    alarms before it, of either."""

    judge: Judge
    begins: int
    alarms: tuple[int, ...]
    sigma_alarms: tuple[int, ...]
    last: tuple[Run, ...]

    def false(self, alarms: tuple[int, ...]) -> int:
        return sum(k < self.begins for k in alarms)

    def delay(self, alarms: tuple[int, ...]) -> int | None:
        return next((k - self.begins for k in alarms if k >= self.begins), None)


def watched(machine: Hoist, cycles: int, change: Change, begins: int, seed: int, rules: Rules) -> Watched:
    """begins: the cycle of the change; `cycles` where there is none."""
    judge = Judge(rules)
    friction: list[np.ndarray] = []
    limit: tuple[np.ndarray, np.ndarray] | None = None
    sigma_alarms, alarms = [], []
    last: deque[Run] = deque(maxlen=12)
    for k, (run, start) in enumerate(month(machine, cycles, change, seed)):
        made = estimate(machine, run)
        last.append(run)
        judged = judge.add(Cycle(run.name, run.payload_kg, start, run.duration_s, made))
        if judged.alarm is not None:
            alarms.append(k)
        friction.append(made.values[:2])
        if k + 1 == rules.healthy:
            limit = np.mean(friction, axis=0), np.std(friction, axis=0, ddof=1)
        elif limit is not None and np.any(np.abs(made.values[:2] - limit[0]) > 3.0 * limit[1]):
            sigma_alarms.append(k)
    return Watched(judge, begins, tuple(alarms), tuple(sigma_alarms), tuple(last))


def report(name: str, made: Watched, cycles: int) -> list[str]:
    judge = made.judge
    lines = [
        f"{name}: {cycles} cycles",
        f"  the test: {made.false(made.alarms)} false alarms, delay {made.delay(made.alarms)} cycles",
        f"  3-sigma limit: {made.false(made.sigma_alarms)} false alarms, delay {made.delay(made.sigma_alarms)} cycles",
    ]
    after = [alarm for alarm in judge.alarms if alarm.cycle >= made.begins]
    if after:
        first, last = after[0], after[-1]
        for word, alarm in (("first", first), ("last", last)):
            causes = ", ".join(f"{c.name} {100.0 * c.share:.0f} %" for c in alarm.causes[:3])
            lines.append(f"  {word} alarm at {alarm.cycle}, since {alarm.onset}: {causes}")
        if judge.baseline is not None:
            lines.append(f"  diagnosis of the last cycles: {diagnosis(made)['sentence']}")
    return lines


def diagnosis(made: Watched) -> dict[str, object]:
    """Of the last cycle of each payload, against the healthy baseline."""
    assert made.judge.baseline is not None
    newest = {run.payload_kg: run for run in made.last}
    campaign = Campaign("last cycles", Path("."), default_hoist(), tuple(newest.values()))
    judge = made.judge
    onset = next(alarm.onset for alarm in judge.alarms if alarm.cycle >= made.begins)
    since = [judge.cycles[k] for k in judge.counted if k >= onset][-WINDOW:]
    return diagnosed(campaign, made.judge.baseline, since, {})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cycles", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    machine, rules = default_hoist(), Rules()
    print(f"watched: {', '.join(watched_keys(machine))}; a false alarm every {rules.cycles_between:g} cycles is wished")
    for line in report(
        "healthy", watched(machine, given.cycles, healthy, given.cycles, given.seed, rules), given.cycles
    ):
        print(line, flush=True)
    begins = 250
    for name, change in (
        ("guide friction +40 % within 200 cycles", friction_grows(begins)),
        ("brake begins to drag", brake_drags(begins)),
        ("torque sensor drifts by 0.05 N m a cycle", sensor_drifts(begins)),
    ):
        for line in report(name, watched(machine, 500, change, begins, given.seed, rules), 500):
            print(line, flush=True)


if __name__ == "__main__":
    main()
