"""Machines with two and three faults one after the other, before the watch: `python -m benchmarks.sequences`.

Half of the machines are hoists with payloads of 0, 4500 or 9000 kg, half are axes. Each fault begins 100 to 200 cycles
after the one before it, at once or growing within 50 to 150 cycles, and stays. It counts as visible from the cycle at
which it shifts the estimates by two standard deviations of a healthy cycle, by the linear shift of `estimate.shift`.
Reported: how many cycles after that its first alarm comes, whether its name is right, and alarms that are no fault's.
`--keep FILE` stores the cycles, so that the judge can be tried again without simulating them.
"""

from __future__ import annotations

import argparse
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.watch import Change, month
from workbench.core.run import Array, Run
from workbench.machines import Axis, Hoist, default_hoist, get_value, with_values
from workbench.machines.kinds.axis import LinearAxis
from workbench.serve.plant import LiveAxis
from workbench.watch.estimate import estimate, shift
from workbench.watch.judge import Alarm, Cycle, Judge, Rules

CYCLES, VISIBLE, SOON = 1000, 2.0, 10
SCATTER = 0.01  # of friction, from cycle to cycle
AXIS_STEP_S, AXIS_SAMPLES = 0.005, 400
FRICTION = {"coulomb_forward_n": 20.0, "coulomb_backward_n": 20.0, "viscous_n_s_per_m": 200.0}
AXIS = LinearAxis.model_validate({"mass_kg": 95.0, "friction": FRICTION})
HOIST = default_hoist()


@dataclass(frozen=True)
class Fault:
    """right: names that an alarm may give it; size: the range its full size is drawn from; made: factors of values and
    effects, by size. What looks alike in a machine's logs is of one family; a machine gets one of each at most."""

    name: str
    family: str
    right: tuple[str, ...]
    size: tuple[float, float]
    made: Callable[[float], tuple[Mapping[str, float], Mapping[str, Mapping[str, float]]]]


def _factors(*keys: str) -> Callable[[float], tuple[Mapping[str, float], Mapping[str, Mapping[str, float]]]]:
    return lambda size: (dict.fromkeys(keys, 1.0 + size), {})


def _effect(name: str, key: str) -> Callable[[float], tuple[Mapping[str, float], Mapping[str, Mapping[str, float]]]]:
    return lambda size: ({}, {name: {key: size}} if size else {})


LOAD = ("torque offset", "mass")
HOIST_FAULTS = (
    Fault("guide friction", "friction", ("friction both ways",), (0.15, 0.4),
          _factors("guide.coulomb_hoisting_n", "guide.coulomb_lowering_n")),
    Fault("viscous friction", "friction", ("friction both ways",), (1500.0, 3000.0),
          _effect("friction_viscous", "viscous_n_s_per_m")),
    Fault("brake drag", "friction", ("friction both ways",), (20.0, 60.0), _effect("brake_drag", "torque_nm")),
    Fault("torque offset", "load", LOAD, (4.0, 12.0), _effect("torque_offset", "offset_nm")),
    Fault("heavier carriage", "load", LOAD, (80.0, 240.0), _effect("carriage_mass_error", "mass_kg")),
    Fault("rotor inertia", "inertia", ("rotor inertia",), (0.01, 0.04), _factors("motor.rotor_inertia_kg_m2")),
)  # fmt: skip
AXIS_FAULTS = (
    Fault("coulomb friction", "coulomb", ("friction both ways",), (0.15, 0.4),
          _factors("friction.coulomb_forward_n", "friction.coulomb_backward_n")),
    Fault("viscous friction", "viscous", ("viscous",), (0.1, 0.3), _factors("friction.viscous_n_s_per_m")),
    Fault("constant load", "load", ("constant load or offset",), (2.0, 6.0), lambda size: ({"gravity": size}, {})),
    Fault("moving mass", "mass", ("mass",), (0.02, 0.06), _factors("mass_kg")),
)  # fmt: skip


@dataclass(frozen=True)
class Given:
    """A fault as a machine has it. over: cycles within which it grows; visible: the cycle from which it can be seen."""

    fault: Fault
    begins: int
    over: int
    size: float
    visible: int = 0

    def now(self, k: int) -> float:
        return self.size * float(np.clip((k - self.begins + 1) / max(self.over, 1), 0.0, 1.0))


def drawn(faults: Sequence[Fault], count: int, rng: np.random.Generator) -> list[Given]:
    """So many faults of different families, one after the other."""
    families = rng.permutation(sorted({fault.family for fault in faults}))[:count]
    begins, given = 0, list[Given]()
    for family in families:
        begins += int(rng.integers(150, 250)) if not given else int(rng.integers(100, 200))
        fault = [fault for fault in faults if fault.family == family]
        chosen = fault[int(rng.integers(len(fault)))]
        over = int(rng.choice(np.array([0, int(rng.integers(50, 150))])))
        given.append(Given(chosen, begins, over, float(rng.uniform(*chosen.size))))
    return given


def changed(given: Sequence[Given]) -> Change:
    def change(k: int) -> tuple[Mapping[str, float], Mapping[str, Mapping[str, float]]]:
        factors: dict[str, float] = {}
        effects: dict[str, Mapping[str, float]] = {}
        for one in given:
            if k >= one.begins:
                its_factors, its_effects = one.fault.made(one.now(k))
                factors.update(its_factors)
                effects.update(its_effects)
        return factors, effects

    return change


def axis_with(factors: Mapping[str, float], scatter: Sequence[float] = (0.0, 0.0)) -> Axis:
    values = {"friction.coulomb_forward_n": 20.0 * (1.0 + scatter[0]),
              "friction.coulomb_backward_n": 20.0 * (1.0 + scatter[1])}  # fmt: skip
    nominal = {"friction.viscous_n_s_per_m": 200.0, "mass_kg": 95.0}
    for key, factor in factors.items():
        if key == "gravity":
            values["gravity.constant_n"] = factor
        else:
            values[key] = values.get(key, nominal.get(key, 0.0)) * factor
    return with_values(AXIS, values)


def axis_cycle(axis: Axis, rng: np.random.Generator) -> Run:
    """Two seconds forward and back under a proportional loop with the load and friction fed forward."""
    plant = LiveAxis(axis, AXIS_STEP_S)
    time_s: Array = np.asarray(AXIS_STEP_S * np.arange(AXIS_SAMPLES), dtype=float)
    wished = 0.25 * np.sin(np.pi * np.clip(time_s - 0.2, 0.0, None))
    force, place = np.empty(AXIS_SAMPLES), np.empty(AXIS_SAMPLES)
    for k in range(AXIS_SAMPLES):
        seen = plant.signals
        place[k] = seen["position_m"]
        force[k] = plant.hold + 20.0 * np.tanh(100.0 * wished[k]) + 2000.0 * (wished[k] - seen["velocity_m_s"])
        plant.step(float(force[k]))
    noise = rng.normal(size=(2, AXIS_SAMPLES))
    return Run("axis", time_s, {"force_n": force + 0.3 * noise[0], "position_m": place + 2e-6 * noise[1]})


def axis_month(cycles: int, change: Change, seed: int) -> Iterator[tuple[Run, float]]:
    rng = np.random.default_rng(seed)
    for k in range(cycles):
        yield axis_cycle(axis_with(change(k)[0], (SCATTER * rng.normal(size=2)).tolist()), rng), 60.0 * k


@dataclass(frozen=True)
class Watched:
    """A machine's cycles and what was wrong with it."""

    kind: str
    seed: int
    cycles: tuple[Cycle, ...]
    given: tuple[tuple[str, int, int, float, int, tuple[str, ...]], ...]  # name, begins, over, size, visible, right


def simulated(kind: str, seed: int, cycles: int, count: int) -> Watched:
    """A machine of a seed; count: of its faults, 0 for a healthy one."""
    rng = np.random.default_rng([seed, count])
    machine, faults = (HOIST, HOIST_FAULTS) if kind == "hoist" else (AXIS, AXIS_FAULTS)
    given = drawn(faults, count, rng) if count else []
    runs = month(HOIST, cycles, changed(given), seed) if kind == "hoist" else axis_month(cycles, changed(given), seed)
    made: list[Any] = []
    samples: dict[Any, Any] = {}
    for k, (run, start) in enumerate(runs):
        made.append(Cycle(f"c{k}", run.payload_kg, start, run.duration_s, estimate(machine, run)))
        samples.setdefault(run.payload_kg, run)
    before = made[: given[0].begins] if given else made
    known = []
    for one in given:
        visible = visible_from(machine, one, before, list(samples.values()))
        known.append((one.fault.name, one.begins, one.over, one.size, visible, one.fault.right))
    return Watched(kind, seed, tuple(made), tuple(known))


def visible_from(machine: Hoist | Axis, given: Given, cycles: Sequence[Cycle], runs: Sequence[Run]) -> int:
    """The cycle from which a fault shifts the estimates by VISIBLE standard deviations, in the mean over payloads."""
    values = np.array([cycle.estimate.values for cycle in cycles])
    payloads = np.array([cycle.payload_kg for cycle in cycles])
    keys = cycles[0].estimate.keys
    line = np.column_stack([np.ones(len(values)), payloads])
    covariance = np.cov((values - line @ np.linalg.lstsq(line, values, rcond=None)[0]).T)
    factors, effects = given.fault.made(given.size)
    if set(factors) <= set(keys) and factors:  # what is estimated itself moves by its column
        amounts = np.array([get_value(machine, key) * (factors.get(key, 1.0) - 1.0) for key in keys])
        moved = [np.mean([cycle.estimate.resolution for cycle in cycles], axis=0) @ amounts]
    else:
        other = machine.model_copy(update={"effects": dict(effects)}) if effects else axis_with(factors)
        moved = [shift(machine, run, other, keys) for run in runs]
    sizes = [float(np.sqrt(d @ np.linalg.pinv(covariance, rcond=1e-10, hermitian=True) @ d)) for d in moved]
    whole = float(np.mean(sizes))
    if whole <= VISIBLE:
        return CYCLES
    return given.begins + int(np.ceil(max(given.over, 1) * VISIBLE / whole)) - 1


@dataclass(frozen=True)
class Found:
    """delay: cycles from visible to the fault's alarm, None where it has none; name: the alarm's."""

    machine: str
    fault: str
    number: int
    delay: int | None
    name: str
    right: bool


def judged(watched: Watched, rules: Rules) -> tuple[list[Found], int, int]:
    """What the judge makes of a machine's faults, how many alarms are nobody's, and how many tell a known change under
    another name."""
    judge = Judge(rules)
    alarms: list[tuple[Alarm, bool]] = []
    for cycle in watched.cycles:
        result = judge.add(cycle)
        if result.alarm is not None:
            alarms.append((result.alarm, result.again))
    told = [alarm for alarm, again in alarms if not again]
    new = [alarm for k, alarm in enumerate(told) if all(alarm.onset != before.onset for before in told[:k])]
    found, false = [], sum(1 for alarm in new if not watched.given or alarm.cycle < watched.given[0][1])
    for i, (name, begins, _, _, visible, right) in enumerate(watched.given):
        ends = watched.given[i + 1][1] if i + 1 < len(watched.given) else len(watched.cycles)
        mine = [alarm for alarm in new if begins <= alarm.cycle < ends]
        false += max(0, len(mine) - 1)
        said = mine[0].causes[0].name if mine else ""
        delay = mine[0].cycle - visible if mine else None
        found.append(Found(f"{watched.kind} {watched.seed}", name, i + 1, delay, said, said in right))
    return found, false, len(told) - len(new)


def report(machines: Sequence[Watched], rules: Rules) -> list[str]:
    results = [judged(watched, rules) for watched in machines]
    found = [one for some, _, _ in results for one in some]
    seen = [one for one in found if one.delay is not None]
    soon = [one for one in seen if one.delay is not None and one.delay <= SOON]
    cycles = sum(len(watched.cycles) - rules.healthy for watched in machines)
    false, renamed = sum(n for _, n, _ in results), sum(n for _, _, n in results)
    lines = [
        f"{len(machines)} machines, {cycles} judged cycles, {len(found)} faults",
        f"  alarm within {SOON} cycles of being visible: {len(soon)} of {len(found)}; later {len(seen) - len(soon)}",
        f"  right name: {sum(one.right for one in found)} of {len(found)}",
        f"  alarms that no fault explains: {false}; stated: {cycles / rules.cycles_between:.1f}",
        f"  a known change told under another name: {renamed}",
    ]
    for number in sorted({one.number for one in found}):
        some = [one for one in found if one.number == number]
        in_time = sum(one in soon for one in some)
        lines.append(f"  fault {number}: {in_time} of {len(some)} soon, {sum(one.right for one in some)} named right")
    lines += [f"  {one}" for one in found if one not in soon or not one.right]
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=40)
    parser.add_argument("--cycles", type=int, default=CYCLES)
    parser.add_argument("--healthy", type=int, default=0, help="machines without a fault, beside them")
    parser.add_argument("--first-seed", type=int, default=0, help="of the machines; of the healthy ones 1000 more")
    parser.add_argument("--keep", type=Path, help="file for the cycles; read where it is there")
    given = parser.parse_args()
    machines: list[Watched] = pickle.loads(given.keep.read_bytes()) if given.keep and given.keep.exists() else []
    wanted = [("hoist" if i % 2 else "axis", given.first_seed + i, 2 + (i // 2) % 2) for i in range(given.machines)]
    wanted += [("hoist" if i % 2 else "axis", given.first_seed + 1000 + i, 0) for i in range(given.healthy)]
    for kind, seed, count in wanted[len(machines) :]:
        machines.append(simulated(kind, seed, given.cycles, count))
        if given.keep:
            given.keep.write_bytes(pickle.dumps(machines))
    for line in report(machines, Rules()):
        print(line, flush=True)


if __name__ == "__main__":
    main()
