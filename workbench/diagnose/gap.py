"""How large the gap is once the base parameters took what their tolerances allow, and no more."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.diagnose.base import base_knobs
from workbench.diagnose.fits import Fitted, fit_knobs
from workbench.diagnose.knobs import Setting, Value
from workbench.diagnose.machines import refitted_machine
from workbench.diagnose.problem import Problem
from workbench.diagnose.records import Gap
from workbench.diagnose.search import Found
from workbench.logs import Campaign
from workbench.machine import Axis, Hoist, LinearAxis
from workbench.run import Array
from workbench.simulate.replay import replay_runs

LIMIT = 3.0  # tolerances: what lies further off its nominal value is no tolerance any more
EXCESS = 1.0  # of the noise, rms beside it: a machine without a gap stays below (no model is exact)
STRETCHED = 4.0  # tolerances: the furthest of ten honest values lies further off once in 1,600 machines
MOST = 30  # evaluations


@dataclass(frozen=True)
class Within:
    """A base parameter's knob, kept within `limit` tolerances; what no tolerance holds is free as it was."""

    knob: Value
    limit: float

    @property
    def logarithmic(self) -> bool:
        return self.knob.logarithmic

    @property
    def lowest(self) -> tuple[float, ...]:
        return (max(self.knob.lowest[0], -self._reach),)

    @property
    def highest(self) -> tuple[float, ...]:
        return (min(self.knob.highest[0], self._reach),)

    @property
    def prior_std(self) -> tuple[float, ...]:
        return self.knob.prior_std

    @property
    def _reach(self) -> float:
        return math.inf if self.knob.logarithmic else self.limit * self.knob.std

    def values(self, z: Sequence[float]) -> Setting:
        return self.knob.values(z)


def base_within(
    problem: Problem, keys: Mapping[str, Value], start: Fitted | None = None, limit: float = LIMIT
) -> Fitted:
    """The best base parameters that lie within `limit` tolerances; `start` itself where it does.

    A fit that tolerances merely hold may stretch one to ten times itself, and hide a gap there.
    """
    knobs = [Within(knob, limit) for knob in keys.values()]
    if start is not None and not start.effects and float(_stretch(knobs, start.z)) <= limit + 1e-9:
        return start
    z = np.zeros(len(knobs)) if start is None else start.z[: len(knobs)]
    sigma = problem.noise if start is None else start.sigma
    return fit_knobs(problem, (), knobs, z, sigma, MOST, base=len(knobs))


def _stretch(knobs: Sequence[Within], z: Array) -> float:
    held = [abs(float(x)) / knob.knob.std for knob, x in zip(knobs, z, strict=True) if not knob.logarithmic]
    return max(held, default=0.0)


def gap_of(problem: Problem, found: Found, campaign: Campaign, within: Fitted | None = None) -> Gap:
    """The gap of a campaign. within: what `base_within` gives, where it is known already."""
    base, keys = found.base, base_knobs(problem.machine, problem.runs)
    bounded = base_within(problem, keys, base) if within is None else within
    nominal = float(np.sqrt(np.mean(problem.residuals([{}])[0][: problem.inputs] ** 2)))
    left = bounded.rms(problem.inputs)
    machine = refitted_machine(problem, keys, bounded)
    refitted, plain = (replay_runs(each, campaign.runs, problem.band_hz) for each in (machine, problem.machine))
    worst = worst_tolerance(keys, base)
    excess = math.sqrt(max(left**2 - problem.noise**2, 0.0))
    stretched = abs(worst[1]) > STRETCHED
    lift = problem.machine.lift_m_per_rad if isinstance(problem.machine, Hoist) else None
    gap = Gap(
        residual_rms=left,
        noise_rms=problem.noise,
        band_hz=problem.band_hz,
        force_rms_n=None if lift is None else left / lift,
        speed_rmse_percent=refitted.speed_rmse_percent,
        nominal_residual_rms=nominal,
        nominal_speed_rmse_percent=plain.speed_rmse_percent,
        worst_tolerance=worst,
        significant=excess > EXCESS * problem.noise or stretched,
        sentences=(),
    )
    return replace(gap, sentences=tuple(_sentences(gap, unit_of(problem.machine))))


def worst_tolerance(keys: Mapping[str, Value], base: Fitted) -> tuple[str, float]:
    """The key of the base parameter that the fit moved furthest, and by how many of its tolerances."""
    moved = {
        key: float(z) / knob.std for (key, knob), z in zip(keys.items(), base.z, strict=False) if not knob.logarithmic
    }
    key = max(moved, key=lambda k: abs(moved[k]), default="")
    return key, moved.get(key, 0.0)


def unit_of(machine: Hoist | Axis) -> str:
    """The unit of the input that the residual is in."""
    return "N" if isinstance(machine, LinearAxis) else "N m"


def _sentences(gap: Gap, unit: str) -> list[str]:
    times = gap.residual_rms / gap.noise_rms
    force = "" if gap.force_rms_n is None else f", {gap.force_rms_n:.3g} N on the carriage"
    found = [
        f"As the machine is written down, measured and predicted input differ by {gap.nominal_residual_rms:.3g} {unit} "
        f"rms below {gap.band_hz:.3g} Hz.",
        f"With the base parameters refitted within {LIMIT:g} tolerances {gap.residual_rms:.3g} {unit} rms remain"
        f"{force}: {times:.1f} times the sensors' noise of {gap.noise_rms:.2g} {unit}.",
        f"Replayed in open loop, the speed is off by {gap.speed_rmse_percent:.3g} % "
        f"({gap.nominal_speed_rmse_percent:.3g} % before the refit).",
    ]
    key, count = gap.worst_tolerance
    if abs(count) > STRETCHED:
        found.append(
            f"Left to itself the refit moves {key} by {abs(count):.1f} tolerances: more than an honest nominal value "
            "is off."
        )
    found.append(
        "There is a gap." if gap.significant else "Noise and tolerances account for what remains: no significant gap."
    )
    return found
