"""What a campaign of an axis is made of: its machine, what ails it, its runs and its logger, drawn from a seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.campaigns.axis.listed import LISTED, OF_A_LOAD, OF_NO_LOAD, ROTARY_ONLY, drawn_pair, scales_of, usual
from benchmarks.campaigns.axis.machines import MOTIONS, Drawn, drawn_axis
from benchmarks.campaigns.axis.profiles import KINDS as PROFILES
from benchmarks.campaigns.axis.unlisted import UNLISTED
from benchmarks.campaigns.listed import Cause

AXES = ("axis", *MOTIONS)  # axis: either of them
RATES_HZ = (200.0, 250.0, 500.0, 1000.0, 2500.0, 5000.0)
SHARES = (0.14, 0.14, 0.24, 0.3, 0.1, 0.08)
QUICK_HZ = 2000.0  # quicker logs are shorter ones
OF_A_PLACE = ("position", "periodic")  # regimes that a log of the speed alone does not show
LOGS = (("position",), ("position", "speed"), ("speed",))


@dataclass(frozen=True)
class RunPlan:
    """One run: name and profile, where it starts, m (rad), when it began in the campaign, how long it lasts."""

    name: str
    profile: str
    start: float
    start_time_s: float
    duration_s: float


@dataclass(frozen=True)
class Content:
    """All that a campaign says and hides, but for what each run draws by itself.

    logs: of position, speed and reference those that are logged.
    """

    kind: str
    axis: Drawn
    causes: tuple[Cause, ...]
    runs: tuple[RunPlan, ...]
    rate_hz: float
    logs: tuple[str, ...]
    irregular: bool


def draw(seed: int | Sequence[int], kind: str, *, names: Sequence[str] | None = None, motion: str = "axis") -> Content:
    """A campaign's content from a seed. names: the effects, in place of drawn ones. motion: one of AXES.

    The machine, the runs and the causes come from streams of their own, so the same seed with another kind is
    the same machine with another ailment; but for an effect that asks for a turning axis, for a load or for none.
    """
    seeds = [seed] if isinstance(seed, int) else list(seed)
    of_machine, of_runs, of_causes = (np.random.default_rng([*seeds, k]) for k in (11, 12, 13))
    drawn_motion = str(of_machine.choice(MOTIONS))
    if names is None:
        names = _names(of_causes, kind, motion)
    if motion == "axis":  # a load that never changes tells little of what depends on it
        motion = "rotary" if set(names) & {*ROTARY_ONLY, *OF_A_LOAD} else drawn_motion
    loaded = True if set(names) & set(OF_A_LOAD) else False if set(names) & set(OF_NO_LOAD) else None
    axis = drawn_axis(of_machine, motion, loaded)
    rate_hz = float(of_runs.choice(RATES_HZ, p=SHARES))
    scales = scales_of(axis, rate_hz)
    causes = tuple({**LISTED, **UNLISTED}[name](of_causes, scales) for name in names)
    logs: tuple[str, ...] = LOGS[int(of_runs.choice(len(LOGS), p=(0.5, 0.35, 0.15)))]
    if axis.machine.role("gravity_sine") or any(cause.regime in OF_A_PLACE for cause in causes):
        logs = ("position", *(set(logs) - {"position"}))
    return Content(
        kind=kind,
        axis=axis,
        causes=causes,
        runs=_runs(of_runs, axis, rate_hz),
        rate_hz=rate_hz,
        logs=(*logs, "reference") if of_runs.random() < 0.7 else logs,
        irregular=bool(of_runs.random() < 0.15 and rate_hz <= 500.0),
    )


def _runs(rng: np.random.Generator, axis: Drawn, rate_hz: float) -> tuple[RunPlan, ...]:
    """Two to five; a quick and a slow one or one in steps of speed are always among them."""
    profiles = [str(rng.choice(["moves", "shuttle", "pulses"])), str(rng.choice(["slow", "steps"]))]
    others = [each for each in PROFILES if each not in profiles]
    profiles += [others[k] for k in rng.permutation(3)][: int(rng.integers(0, 4))]
    runs, clock = [], 0.0
    for profile in profiles:
        duration = round(rng.uniform(5.0, 8.0) if rate_hz > QUICK_HZ else rng.uniform(8.0, 20.0), 1)
        start = axis.low + 0.05 * axis.travel * rng.random()
        runs.append(RunPlan(profile, profile, start, round(clock, 2), duration))
        clock += duration + rng.uniform(15.0, 60.0)
    return tuple(runs)


def _names(rng: np.random.Generator, kind: str, motion: str) -> tuple[str, ...]:
    if kind == "none":
        return ()
    if kind == "singles":
        return (str(rng.choice(usual(motion))),)
    return (str(rng.choice(list(UNLISTED))),) if kind == "unknown" else drawn_pair(rng, motion)
