"""What is known of a recorded machine: identified on all its runs, with tolerances that hold for what is identified."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np
from scipy.optimize import lsq_linear

from workbench.core.errors import InputError
from workbench.core.run import Array, Run, integrated
from workbench.diagnose.diagnose import diagnose
from workbench.effects import effects_for, sizes_of
from workbench.identify.identify import LATE, Identification, identify
from workbench.logs import Campaign, read_campaign
from workbench.machines import Axis, get_value, kind_of, with_values
from workbench.simulate.driven import InverseSimulation

KINDS = ("hoist", "axis-linear", "axis-rotary")
FEW, LONG_S = 4, 12.0  # fewer runs are cut into parts where they are that long
ALIKE = 0.15  # of the remainder: another cause that leaves less, base values refitted within 1 tolerance, is alike
SAMPLES = 3000  # of all moving ones, for these two
SURE = 0.9  # probability from which on an effect that is named is the machine's own
FLOOR = {"inertia": 0.01, "coulomb": 0.05, "viscous": 0.05, "gravity": 0.02}  # relative, one standard deviation


@dataclass(frozen=True)
class Recording:
    """A machine identified on all its runs, with tolerances that hold for what is identified."""

    name: str
    machine: Any
    runs: tuple[Run, ...]
    band_hz: float

    def __reduce__(self) -> tuple[Any, ...]:
        return Recording, (self.name, self.machine, self.runs, self.band_hz)  # a process finds the rest itself

    @cached_property
    def bench(self) -> InverseSimulation:
        return InverseSimulation(self.machine, self.runs, self.band_hz)

    @property
    def kind(self) -> str:
        return self.machine.kind

    @property
    def plant(self) -> str:
        return kind_of(self.machine).name

    @cached_property
    def moving(self) -> list[np.ndarray]:
        """Of each run the samples that count, thinned to SAMPLES in all."""
        step = max(sum(int(m.sum()) for m in self.bench.moving) // SAMPLES, 1)
        return [np.flatnonzero(moving)[::step] for moving in self.bench.moving]

    def residual(self, machine: Any, runs: Sequence[Run]) -> Array:
        """Measured less predicted input, low-passed to the recording's band, of the samples that count."""
        balances = InverseSimulation(machine, runs, self.band_hz).balances()
        return np.concatenate([b.residual[rows] for b, rows in zip(balances, self.moving, strict=True)])

    @cached_property
    def own(self) -> Array:
        """What the identified machine leaves."""
        return self.residual(self.machine, self.runs)

    @cached_property
    def remainder_rms(self) -> float:
        return rms(self.own)

    @cached_property
    def input_rms(self) -> float:
        """Of the input while moving, less its mean."""
        return float(np.std(np.concatenate([u[m] for u, m in zip(self.bench.inputs, self.moving, strict=True)])))

    @cached_property
    def tolerated(self) -> Array:
        """(samples, base values): the change of the residual by one tolerance of each base value."""
        kind, columns = kind_of(self.machine), []
        largest = kind.largest_input(self.runs)
        for value in kind.base:
            std = 0.0 if value.spread == "factor" else value.std(self.machine, largest)
            if std > 0.0:
                moved = with_values(self.machine, {value.key: get_value(self.machine, value.key) + std})
                columns.append(self.residual(moved, self.runs) - self.own)
        return np.array(columns).reshape(len(columns), -1).T

    @cached_property
    def responses(self) -> Mapping[str, tuple[Array, Array]]:
        """Listed effect of no shape -> (samples, amounts), the change of the residual by each amount at its start, and
        (2, amounts), the bounds of each in such parts."""
        sizes, columns = sizes_of(self.machine, self.runs), {}
        for name, effect in effects_for(self.plant).items():
            ranges = effect.ranges(sizes)
            if not effect.listed or name in self.machine.effects or any(r.vanishes_at is None for r in ranges):
                continue
            off = {r.name: float(r.vanishes_at or 0.0) for r in ranges}
            each, bounds = [], []
            for ranged in ranges:
                start = ranged.start - off[ranged.name]
                bounds.append([(edge - off[ranged.name]) / start for edge in (ranged.lowest, ranged.highest)])
                chosen = {**self.machine.effects, name: {**off, ranged.name: ranged.start}}
                changed = self.machine.model_copy(update={"effects": chosen})
                each.append(self.residual(changed, self.runs) - self.own)
            columns[name] = np.array(each).T, np.sort(np.array(bounds).T, axis=0)
        return columns

    def left(self, change: Array, tolerances: float, *causes: tuple[Array, Array]) -> float:
        """rms of what stays of a change when base values move within so many tolerances, and `responses` within their
        bounds."""
        within = np.full(self.tolerated.shape[1], tolerances)
        matrix = np.column_stack([self.tolerated, *(columns for columns, _ in causes)])
        low, high = np.hstack([np.array([-within, within]), *(bounds for _, bounds in causes)])
        scale = np.linalg.norm(matrix, axis=0)
        shows = scale > 0.0
        if not shows.any():
            return rms(change)
        matrix, scale = matrix[:, shows] / scale[shows], scale[shows]
        return rms(change - matrix @ lsq_linear(matrix, change, (low[shows] * scale, high[shows] * scale)).x)

    def alike(self, name: str, change: Array) -> tuple[str, ...]:
        """Listed effects, some joined by +, that explain a change as well as its own cause does. The freer law of the
        same friction is none."""
        limit, found = ALIKE * self.remainder_rms, list[str]()
        others = [other for other in self.responses if not other.startswith(name)]
        triples = [("inertia_error", "friction_viscous", "friction_coulomb")]  # all of an axis' equation: a gain
        for names in [*itertools.chain(*(itertools.combinations(others, k) for k in (1, 2))), *triples]:
            if not set(names) <= set(others):
                continue
            if any(set(known.split("+")) <= set(names) for known in found):
                continue
            if self.left(change, 1.0, *(self.responses[other] for other in names)) <= limit:
                found.append("+".join(sorted(names)))
        return tuple(found)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


# What is known.


def recording(path: Path) -> Recording:
    """The campaign in a folder, its machine identified on all runs: its values, and the effects that the diagnosis
    names of it or that explain an unknown cause, for those it has whatever is bent. InputError where it cannot be read
    or fitted."""
    campaign = read_campaign(path)
    if kind_of(campaign.machine).name not in KINDS:
        raise InputError(f"a machine of kind '{campaign.machine.kind}'; recorded takes hoists and axes", file=path)
    known = _known(campaign, path)
    found = diagnose(replace(campaign, machine=known.machine), study=False)
    likely = {n: sum(r.probability for r in found.verdict.ranking if n in r.effects) for n in found.verdict.effects}
    own = {
        name: values
        for name, values in found.corrected.effects.items()
        if likely.get(name, float(found.verdict.word == "unknown")) > SURE
    }
    if not own:
        return known
    effects = {**campaign.machine.effects, **own}
    return _known(replace(campaign, machine=campaign.machine.model_copy(update={"effects": effects})), path)


def _known(campaign: Campaign, path: Path) -> Recording:
    found = _identified(campaign)
    machine = found.machine.model_copy(update={"identified": {}})  # the record of the fit would tell what is bent
    if kind_of(machine).whole:  # an axis
        machine = with_values(machine, _tolerances(campaign, cast(Axis, machine), found.after.band_hz))
    known = Recording(campaign.name, machine, campaign.runs, found.after.band_hz)
    if not sum(map(len, known.moving)):
        raise InputError("the machine stands still in every run", file=path)
    return known


def _identified(campaign: Campaign, band_hz: float | None = None) -> Identification:
    """By all that the kind's fit frees, and a rotary axis' gravity."""
    free: list[str] | None = None
    machine = campaign.machine
    if kind_of(machine).whole and (axis := cast(Axis, machine)).role("gravity_sine"):
        free = [*kind_of(machine).free, axis.value_of["gravity_sine"], LATE]
    return identify(campaign, free=free, band_hz=band_hz)


def _tolerances(campaign: Campaign, machine: Axis, band_hz: float) -> dict[str, float]:
    """One standard deviation of each identified value of an axis: twice the jackknife's over parts of the runs (B.
    Efron 1981), which holds what the machine has of its own too, and at least FLOOR; the gain is what the values are
    relative to. None where the runs cannot be parted: those of machine.yaml hold."""
    count = 3 if len(campaign.runs) < FEW else 1
    parts = [part for run in campaign.runs for part in cut(campaign.machine, run, count)]
    without: list[Axis] = []
    for k in range(len(parts) if len(parts) > 1 else 0):
        with suppress(InputError):  # the part that was taken out is the one that moves
            rest = replace(campaign, runs=(*parts[:k], *parts[k + 1 :]))
            without.append(cast(Axis, _identified(rest, band_hz).machine))
    if len(without) < 2:
        return {}  # as stated
    roles = {"inertia": "inertia", "viscous": "viscous", "coulomb": "coulomb_forward", "gravity": "gravity_sine"}

    def spread(role: str) -> float:
        values = np.array([other.role(role) for other in without])
        return float(np.sqrt((len(values) - 1.0) * np.var(values)))

    found = {}
    for name, role in roles.items():
        value = abs(machine.role(role))
        found[f"tolerances.{name}"] = float(np.clip(2.0 * spread(role) / value if value else 0.0, FLOOR[name], 0.5))
    linear = machine.input_signal == "force_n"
    largest = kind_of(machine).largest_input(campaign.runs)
    offset = max(2.0 * spread("gravity_constant"), 0.001 * largest)
    found[f"tolerances.{'force_offset_n' if linear else 'torque_offset_nm'}"] = offset
    found[f"tolerances.{'force_gain' if linear else 'torque_gain'}"] = 0.005
    return {key: float(f"{value:.4g}") for key, value in found.items()}


def cut(machine: Any, run: Run, parts: int, rng: np.random.Generator | None = None) -> list[Run]:
    """The run in so many parts of about the same length, each a run that begins when and where the part does."""
    if parts <= 1 or run.duration_s < LONG_S:
        return [run]
    at = np.arange(1, parts) + (rng.uniform(-0.2, 0.2, parts - 1) if rng else 0.0)
    ends = np.searchsorted(run.time_s, run.time_s[0] + run.duration_s * at / parts)
    kind = kind_of(machine)
    height, speed = kind.plant.positions[-1], run.signals.get(kind.plant.speeds[0])
    way = None if height in run or speed is None else integrated(speed, run.time_s)
    place = run[height] if way is None else kind.place_of(machine, run.start_position_m, way)
    edges = [0, *map(int, ends), len(run.time_s)]
    return [
        replace(
            run,
            name=f"{run.name}_{k}",
            time_s=run.time_s[a:b],
            signals={name: values[a:b] for name, values in run.signals.items()},
            start_position_m=float(place[a]),
            start_time_s=run.start_time_s + float(run.time_s[a] - run.time_s[0]),
        )
        for k, (a, b) in enumerate(itertools.pairwise(edges), start=1)
    ]
