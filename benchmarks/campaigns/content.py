"""What a campaign is made of: its machine, what ails it, its runs and its logger, drawn from a seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.campaigns.listed import LISTED, USUAL, Cause, Scales, scales_of
from benchmarks.campaigns.machines import drawn_machine, practice_machine
from benchmarks.campaigns.unlisted import UNLISTED
from workbench.machine import Hoist

KINDS = ("singles", "none", "pairs", "unknown")
MACHINES = ("mixed", "practice", "drawn")
# Of two effects at once: these are alike by nature, so no log says which of them it holds.
_ALIKE = (
    {"torque_offset", "carriage_mass_error", "friction_coulomb_asymmetric", "friction_coulomb"},
    {"torque_scale", "carriage_mass_error", "payload_mass_error"},
    {"gearbox_efficiency", "friction_load_dependent", "friction_coulomb"},
    {"torque_filter", "speed_delay", "gearbox_inertia"},
)


@dataclass(frozen=True)
class RunPlan:
    """One run: name and profile, stated payload, height at its start, when it began in the campaign."""

    name: str
    profile: str
    payload_kg: float
    start_position_m: float
    start_time_s: float


@dataclass(frozen=True)
class Content:
    """All that a campaign says and hides, but for what each run draws by itself."""

    kind: str
    machine: Hoist
    full_kg: float
    causes: tuple[Cause, ...]
    runs: tuple[RunPlan, ...]
    duration_s: float = 49.76
    rate_hz: float = 100.0
    full_signals: bool = False
    sum_only: bool = False
    with_reference: bool = True


def draw(
    seed: int | Sequence[int], kind: str = "mixed", *, names: Sequence[str] | None = None, machines: str = "mixed"
) -> Content:
    """A campaign's content from a seed. names: the effects, in place of drawn ones.

    The machine, the runs and the causes come from streams of their own, so the same seed with another
    kind is the same machine with another ailment.
    """
    seeds = [seed] if isinstance(seed, int) else list(seed)
    of_machine, of_runs, of_causes = (np.random.default_rng([*seeds, k]) for k in (1, 2, 3))
    machine, full_kg = _machine(of_machine, machines)
    usual = of_runs.random() < 0.7
    duration = 49.76 if usual else float(of_runs.choice([40.0, 49.76, 60.0, 75.0]))
    runs = _runs(of_runs, machine, full_kg, usual, duration)
    kind = str(of_causes.choice(KINDS, p=[0.66, 0.17, 0.10, 0.07])) if kind == "mixed" else kind
    starts = float(np.mean([run.start_position_m for run in runs]))
    scales = scales_of(machine, full_kg, starts - travel_m(machine, duration), starts)
    if names is None:
        names = _names(of_causes, kind)
    return Content(
        kind=kind,
        machine=machine,
        full_kg=full_kg,
        causes=tuple(_cause(name, of_causes, scales) for name in names),
        runs=runs,
        duration_s=duration,
        rate_hz=100.0 if usual else float(of_runs.choice([50.0, 100.0, 200.0])),
        full_signals=bool(of_runs.random() < (0.08 if usual else 0.35)),
        sum_only=bool(not usual and of_runs.random() < 0.25),
        with_reference=bool(usual or of_runs.random() < 0.6),
    )


def travel_m(machine: Hoist, duration_s: float) -> float:
    """How far down a long move goes: by the time there is, and by a quarter of the wire's length."""
    top = machine.motor.nominal_speed_rad_s * machine.lift_m_per_rad
    return float(min(0.24 * machine.wire.segment_length_m, 0.15 * top * duration_s))


def _machine(rng: np.random.Generator, which: str) -> tuple[Hoist, float]:
    shares = {"mixed": (0.35, 0.25), "practice": (0.6, 0.4), "drawn": (0.0, 0.0)}[which]
    number = rng.random()
    if number < shares[0]:
        return practice_machine(0)
    return practice_machine(1) if number < sum(shares) else drawn_machine(rng)


def _runs(
    rng: np.random.Generator, machine: Hoist, full_kg: float, usual: bool, duration_s: float
) -> tuple[RunPlan, ...]:
    plan = [("empty", "fast"), ("empty", "steps"), ("half", "fast"), ("half", "slow"), ("full", "steps")]
    plan.append(("full", "fast"))
    if not usual:
        plan += [("half", "steps"), ("full", "slow")]
        plan = plan[: int(rng.choice([4, 5, 6, 7, 8]))]
        if len(plan) < 6:  # three payloads and a slow run all the same
            plan = [("empty", "steps"), ("half", "slow"), ("full", "fast"), ("half", "fast"), ("empty", "fast")][
                : len(plan)
            ]
    payloads = {"empty": 0.0, "half": full_kg / 2.0, "full": full_kg}
    if not usual and rng.random() < 0.5:
        payloads["half"] = round(full_kg * rng.uniform(0.3, 0.7), -1)
    middle = 0.36 * machine.wire.segment_length_m
    runs, clock = [], 0.0
    for load, profile in plan:
        start = round(middle + rng.uniform(-0.5, 0.5), 3)
        runs.append(RunPlan(f"{load}_{profile}", profile, payloads[load], start, round(clock, 2)))
        clock += duration_s + rng.uniform(30.0, 82.0)
    return tuple(runs)


def _names(rng: np.random.Generator, kind: str) -> tuple[str, ...]:
    if kind == "none":
        return ()
    if kind == "singles":
        return (str(rng.choice(USUAL)),)
    if kind == "unknown":
        return (str(rng.choice(list(UNLISTED))),)
    return drawn_pair(rng)


def drawn_pair(rng: np.random.Generator, first: str | None = None) -> tuple[str, str]:
    """Two usual effects of different subsystems that are not alike by nature."""
    while True:
        a = first or str(rng.choice(USUAL))
        b = str(rng.choice(USUAL))
        if a != b and _subsystem(a) != _subsystem(b) and not any({a, b} <= group for group in _ALIKE):
            return a, b


def _subsystem(name: str) -> str:
    one = Scales(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 9.0, (1.0, 1.0), 1.0)
    return LISTED[name](np.random.default_rng(0), one).subsystem


def _cause(name: str, rng: np.random.Generator, scales: Scales) -> Cause:
    return (LISTED[name] if name in LISTED else UNLISTED[name])(rng, scales)
