"""Recordings of a real machine as blind campaigns: one piece of what is known of the machine is bent, or one effect is
added to the logged input by its law with the real motion.

What the machine has of its own stays in the recording, as it does at every user's. Bends of machine.yaml leave the logs
as they are; bends of a sensor and added effects leave machine.yaml as it is.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import yaml
from scipy.optimize import lsq_linear

from workbench.blind.case import Label, Order
from workbench.effects import effects_for, find, logged, of, sizes_of
from workbench.errors import InputError
from workbench.identify.identify import Identification, identify
from workbench.kinds import kind_of
from workbench.logs import Campaign, read_campaign
from workbench.machine import Axis, get_value, save_machine, with_values
from workbench.run import Run
from workbench.simulate.driven import Bench

Array = npt.NDArray[np.float64]
SOURCE = "recorded"
KINDS = ("hoist", "axis-linear", "axis-rotary")
TURN = 2.0 * np.pi
PARTS, FEW, LONG_S = (3, 6), 4, 12.0  # fewer runs than FEW are cut into so many parts where they are that long
KEPT = (0.6, 1.0)  # share of the parts that a case holds
SHOWS = 0.3  # of the machine's own remainder: a smaller change, base values refitted within 2 tolerances, is not asked
ALIKE = 0.15  # of the remainder: another cause that leaves less, base values refitted within 1 tolerance, is alike
SAMPLES = 3000  # of all moving ones, for these two
FLOOR = {"inertia": 0.01, "coulomb": 0.05, "viscous": 0.05, "gravity": 0.02}  # relative, one standard deviation
HALVINGS, SAME_INERTIA = 5, 0.03
TRIES = 8  # sizes that are drawn before a bend is given up


@dataclass(frozen=True)
class Recording:
    """A machine identified on all its runs, with tolerances that hold for what is identified."""

    name: str
    machine: Any
    runs: tuple[Run, ...]
    band_hz: float

    @cached_property
    def bench(self) -> Bench:
        return Bench(self.machine, self.runs, self.band_hz)

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
        balances = Bench(machine, runs, self.band_hz).balances()
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
            if not effect.listed or any(r.vanishes_at is None for r in ranges):
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
    """The campaign in a folder, its machine identified on all runs. InputError where it cannot be read or fitted."""
    campaign = read_campaign(path)
    if kind_of(campaign.machine).name not in KINDS:
        raise InputError(f"a machine of kind '{campaign.machine.kind}'; recorded takes hoists and axes", file=path)
    found = _in_band(campaign)
    machine = found.machine.model_copy(update={"identified": {}})  # the record of the fit would tell what is bent
    if isinstance(machine, Axis):
        machine = with_values(machine, _tolerances(campaign, machine, found.after.band_hz))
    known = Recording(campaign.name, machine, campaign.runs, found.after.band_hz)
    if not sum(map(len, known.moving)):
        raise InputError("the machine stands still in every run", file=path)
    return known


def _identified(campaign: Campaign, band_hz: float | None = None) -> Identification:
    """By all that the kind's fit frees, and a rotary axis' gravity."""
    free: list[str] | None = None
    machine = campaign.machine
    if isinstance(machine, Axis) and machine.role("gravity_sine"):
        free = [*kind_of(machine).free, machine.value_of["gravity_sine"]]
    return identify(campaign, free=free, band_hz=band_hz)


def _in_band(campaign: Campaign) -> Identification:
    """In the largest band, from the usual one down by halves, in which the inertia of an axis is that of half the band:
    noise of a differentiated speed beyond that draws the fitted inertia towards zero."""
    found = _identified(campaign)
    for _ in range(HALVINGS if isinstance(campaign.machine, Axis) else 0):
        try:
            lower = _identified(campaign, 0.5 * found.after.band_hz)
        except InputError:  # so low a band leaves no motion
            break
        if abs(_inertia_of(found) / _inertia_of(lower) - 1.0) < SAME_INERTIA:
            break
        found = lower
    return found


def _inertia_of(found: Identification) -> float:
    machine = found.machine
    assert isinstance(machine, Axis)
    return machine.role("inertia")


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
    if height in run or speed is None:
        place = run[height]
    else:
        way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(run.time_s))])
        place = kind.place_of(machine, run.start_position_m, way)
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


# Bends: each gives what the campaign then holds, or None where the machine has no such thing.


@dataclass(frozen=True)
class Bent:
    """What is written: machine and runs. name: the effect that is missing. parameters: of it, as the library has them,
    so that the machine with it leaves what the identified one does; none of a cause that is in no library."""

    name: str
    subsystem: str
    regime: str
    machine: Any
    runs: tuple[Run, ...]
    parameters: Mapping[str, float]
    entry: str = ""


Bend = Callable[[np.random.Generator, Recording], Bent | None]


def _missing(known: Recording, name: str, machine: Any, parameters: Mapping[str, float]) -> Bent:
    """machine.yaml bent, so that the effect `name` is what it lacks."""
    effect = find(name, known.plant)
    return Bent(name, effect.subsystem(known.plant), effect.regime, machine, known.runs, parameters, name)


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _inertia(rng: np.random.Generator, known: Recording) -> Bent | None:
    """The inertia 10 to 30 % off; a hoist's rotors, of which only too little is an effect."""
    machine = known.machine
    if known.plant == "hoist":
        true = machine.motor.rotor_inertia_kg_m2
        believed = true * (1.0 - rng.uniform(0.1, 0.3))
        beyond = {"inertia_kg_m2": machine.motor.count * (true - believed)}
        bent = with_values(machine, {"motor.rotor_inertia_kg_m2": believed})
        return _missing(known, "gearbox_inertia", bent, beyond)
    off = 1.0 + _sign(rng) * rng.uniform(0.1, 0.3)
    bent = with_values(machine, {machine.value_of["inertia"]: off * machine.role("inertia")})
    return _missing(known, "inertia_error", bent, {"inertia_fraction": 1.0 / off - 1.0})


def _viscous(rng: np.random.Generator, known: Recording) -> Bent | None:
    """The viscous friction left out; a machine whose record has none gets it by its law."""
    if known.plant == "hoist":
        return _by_law(rng, known, "friction_viscous")
    key, slope = known.machine.value_of["viscous"], known.machine.role("viscous")
    name = next(r.name for r in find("friction_viscous", known.plant).ranges(sizes_of(known.machine, known.runs)))
    return _missing(known, "friction_viscous", with_values(known.machine, {key: 0.0}), {name: slope}) if slope else None


def _levels(known: Recording) -> dict[str, float]:
    """Keys of the Coulomb levels, forward and backward, and their values."""
    kind = kind_of(known.machine)
    keys = [str(kind.plant.parameters[symbol]) for symbol in kind.friction.levels]
    return {key: get_value(known.machine, key) for key in keys}


def _coulomb(rng: np.random.Generator, known: Recording) -> Bent | None:
    """Half of the friction level is left out, both ways alike."""
    levels = _levels(known)
    level = min(0.25 * sum(levels.values()), *levels.values())
    bent = with_values(known.machine, {key: value - level for key, value in levels.items()})
    (name,) = (r.name for r in find("friction_coulomb", known.plant).ranges(sizes_of(known.machine, known.runs)))
    return _missing(known, "friction_coulomb", bent, {name: level})


def _coulomb_one_way(rng: np.random.Generator, known: Recording) -> Bent | None:
    """Half of one direction's friction level is left out."""
    levels, way = list(_levels(known).items()), int(rng.integers(2))
    key, value = levels[way]
    effect = find("friction_coulomb_asymmetric", known.plant)
    amounts = [0.5 * value if k == way else 0.0 for k in range(2)]
    names = [r.name for r in effect.ranges(sizes_of(known.machine, known.runs))]
    bent = with_values(known.machine, {key: 0.5 * value})
    return _missing(known, effect.id, bent, dict(zip(names, amounts, strict=True)))


def _load(rng: np.random.Generator, known: Recording) -> Bent | None:
    """The load of an axis 10 % off, or the mass of a hoist's carriage."""
    off = 1.0 + 0.1 * _sign(rng)
    if known.plant == "hoist":
        mass = known.machine.carriage.mass_kg
        bent = with_values(known.machine, {"carriage.mass_kg": off * mass})
        return _missing(known, "carriage_mass_error", bent, {"mass_kg": mass * (1.0 - off)})
    keys = [known.machine.value_of[role] for role in ("gravity_sine", "gravity_constant")]
    loads = {key: off * get_value(known.machine, key) for key in keys if key}
    if not any(loads.values()):
        return None
    return Bent("unlisted: the load is off", "axis", "load", with_values(known.machine, loads), known.runs, {})


def _payload(rng: np.random.Generator, known: Recording) -> Bent | None:
    """The payload is stated 10 % off."""
    if "payload_mass_error" not in effects_for(known.plant) or not any(run.payload_kg for run in known.runs):
        return None
    off = 1.0 + 0.1 * _sign(rng)
    runs = tuple(replace(run, payload_kg=off * run.payload_kg) for run in known.runs)
    return replace(_missing(known, "payload_mass_error", known.machine, {"payload_scale": 1.0 / off}), runs=runs)


def _on_sensor(known: Recording, name: str, parameters: Mapping[str, float]) -> Bent:
    """The logs as a sensor with the effect would have shown them."""
    active = of(known.machine.model_copy(update={"effects": {}}), {name: dict(parameters)})
    runs = tuple(logged(run, active) for run in known.runs)
    return replace(_missing(known, name, known.machine, parameters), runs=runs)


def _gain(rng: np.random.Generator, known: Recording) -> Bent | None:
    return _on_sensor(known, "torque_scale", {"gain": 1.0 + 0.08 * _sign(rng)})


def _offset(rng: np.random.Generator, known: Recording) -> Bent | None:
    (name,) = (r.name for r in find("torque_offset", known.plant).ranges(sizes_of(known.machine, known.runs)))
    return _on_sensor(known, "torque_offset", {name: _sign(rng) * rng.uniform(0.04, 0.12) * known.input_rms})


def _samples_s(rng: np.random.Generator, known: Recording, low: float, high: float) -> float:
    step_s = float(np.median([run.sample_time_s for run in known.runs]))
    return step_s * float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _late(rng: np.random.Generator, known: Recording) -> Bent | None:
    return _on_sensor(known, "speed_delay", {"delay_s": _samples_s(rng, known, 2.0, 15.0)})


def _filter(rng: np.random.Generator, known: Recording) -> Bent | None:
    return _on_sensor(known, "torque_filter", {"time_constant_s": _samples_s(rng, known, 3.0, 25.0)})


def _shape(rng: np.random.Generator, known: Recording, name: str) -> dict[str, float]:
    """Drawn values of an effect's parameters that are no amounts, from the way and the time that the runs cover."""
    places = np.concatenate([m.position[r] for m, r in zip(known.bench.motions, known.moving, strict=True)])
    if not kind_of(known.machine).moved.placed_by_log:
        places = np.concatenate(
            [
                kind_of(known.machine).place_of(known.machine, run.start_position_m, m.position)[r]
                for run, m, r in zip(known.runs, known.bench.motions, known.moving, strict=True)
            ]
        )
    low, high = (float(edge) for edge in np.quantile(places, [0.02, 0.98]))
    span = min(high - low, TURN) if known.plant == "axis-rotary" else high - low
    ends = [run.start_time_s + run.duration_s for run in known.runs]
    drawn = {
        "centre": low + (high - low) * rng.uniform(0.25, 0.75),
        "position": low + (high - low) * rng.uniform(0.3, 0.7),
        "width": span * (rng.uniform(0.03, 0.1) if name == "friction_position_dependent" else 0.01),
        "waves_per": rng.uniform(4.0, 15.0) / span,
        "order_per_turn": float(rng.integers(1, 4)),
        "period": span / rng.uniform(2.5, 9.0),
        "phase": rng.uniform(0.0, TURN),
        "time_constant": max(ends) * rng.uniform(0.2, 0.8),
    }
    ranges = find(name, known.plant).ranges(sizes_of(known.machine, known.runs))
    return {
        r.name: next(value for word, value in drawn.items() if r.name.startswith(word))
        for r in ranges
        if r.vanishes_at is None
    }


def _by_law(rng: np.random.Generator, known: Recording, name: str) -> Bent:
    """The input that the effect takes by its law with the real motion, added to the log; its rms while moving is 4 to
    15 % of the input's, and no less than what the machine leaves by itself."""
    effect = find(name, known.plant)
    amounts = {r.name: r.start for r in effect.ranges(sizes_of(known.machine, known.runs)) if r.vanishes_at is not None}
    share = float(np.exp(rng.uniform(np.log(0.04), np.log(0.15))))
    target, shape = max(share * known.input_rms, known.remainder_rms), _shape(rng, known, name)
    for _ in range(2):  # an amount acts in proportion, or nearly so
        change = _required(known, {name: {**amounts, **shape}})
        size = rms(np.concatenate([c[rows] for c, rows in zip(change, known.moving, strict=True)]))
        if not size:
            break
        amounts = {key: value * target / size for key, value in amounts.items()}
    parameters = {**amounts, **shape}
    bent = added(known, _required(known, {name: parameters}))
    text = name if effect.listed else f"unlisted: {effect.meaning.rstrip('.')}"
    return Bent(text, effect.subsystem(known.plant), effect.regime, known.machine, bent, parameters, name)


def _required(known: Recording, chosen: Mapping[str, Mapping[str, float]]) -> list[Array]:
    """Of each run, (n,): the input that the motion requires with effects, less that without them."""
    ailing = Bench(known.machine, known.runs, known.band_hz, of(known.machine, chosen))
    both = zip(ailing.predict([ailing.base])[0], known.bench.predict([known.bench.base])[0], strict=True)
    gain, _ = kind_of(known.machine).sensor_of(known.machine)
    return [gain * (with_it - without) for (with_it, _), (without, _) in both]


def added(known: Recording, change: Sequence[Array]) -> tuple[Run, ...]:
    """The runs with more on the logged input; parts of the input share it evenly."""
    kind, runs = kind_of(known.machine), []
    for run, more in zip(known.runs, change, strict=True):
        parts = [name for name in kind.drive.parts if name in run]
        signals = {**run.signals, **{name: run[name] + more / len(parts) for name in parts}}
        runs.append(replace(run, signals={**signals, kind.plant.input: run[kind.plant.input] + more}))
    return tuple(runs)


# Causes that are in no library: (run's time, place, speed, input; size in the input's unit) -> what they add.
OwnLaw = Callable[[np.random.Generator, Array, Array, Array, Array, float], Array]


def _unit(x: Array) -> Array:
    return (x - np.min(x)) / max(float(np.ptp(x)), 1e-12)


def _walk(rng: np.random.Generator, t: Array, x: Array, v: Array, u: Array, size: float) -> Array:
    return size * np.cumsum(rng.normal(size=len(t)) * np.sqrt(np.gradient(t) / max(t[-1] - t[0], 1e-9)))


def _dead_band(rng: np.random.Generator, t: Array, x: Array, v: Array, u: Array, size: float) -> Array:
    kept, shown = np.empty_like(u), float(u[0])
    for k, value in enumerate(u):
        if abs(value - shown) > 3.0 * size:
            shown = float(value)
        kept[k] = shown
    return kept - u


def _blow(rng: np.random.Generator, t: Array, x: Array, v: Array, u: Array, size: float) -> Array:
    """One bump of a tenth of the run's length, where the machine moves."""
    at, half = float(rng.choice(t[np.abs(v) > 0.2 * np.max(np.abs(v))])), 0.05 * (t[-1] - t[0])
    return 3.0 * size * _sign(rng) * np.where(np.abs(t - at) < half, np.cos(np.pi * (t - at) / (2.0 * half)) ** 2, 0.0)


OWN_LAWS: Mapping[str, tuple[str, str, OwnLaw]] = {
    "gain_by_direction": (
        "the gain of the torque sensor differs between the directions", "load",
        lambda rng, t, x, v, u, size: size / rms(u) * np.where(v > 0.0, u, 0.0),
    ),
    "sensor_walk": ("the torque sensor wanders", "time", _walk),
    "dead_band": ("the log keeps its last torque until that has changed by more than a dead band", "all", _dead_band),
    "sensor_bend": (
        "the torque sensor is bent: an error with the square of the torque", "load",
        lambda rng, t, x, v, u, size: size * (u / rms(u)) ** 2,
    ),
    "spring": (
        "a cable chain pulls back like a spring", "position",
        lambda rng, t, x, v, u, size: 3.0 * size * (_unit(x) - 0.5),
    ),
    "blow": ("event: a blow against the load in each run", "event", _blow),
}  # fmt: skip


def _own(name: str, rng: np.random.Generator, known: Recording) -> Bent:
    text, regime, law = OWN_LAWS[name]
    size = max(rng.uniform(0.05, 0.15) * known.input_rms, known.remainder_rms)
    change = [
        law(rng, run.time_s, motion.position, motion.speed, u, size)
        for run, motion, u in zip(known.runs, known.bench.motions, known.bench.inputs, strict=True)
    ]
    place = "torque_sensor" if name in ("gain_by_direction", "sensor_walk", "dead_band", "sensor_bend") else "axis"
    place = "guide" if place == "axis" and known.plant == "hoist" else place
    return Bent(f"unlisted: {text}", place, regime, known.machine, added(known, change), {})


def _law(name: str) -> Bend:
    return lambda rng, known: _by_law(rng, known, name) if name in effects_for(known.plant) else None


SINGLES: dict[str, Bend] = {
    "inertia": _inertia,
    "viscous": _viscous,
    "coulomb": _coulomb,
    "coulomb_one_way": _coulomb_one_way,
    "load": _load,
    "payload": _payload,
    "gain": _gain,
    "offset": _offset,
    "speed_late": _late,
    "torque_low_passed": _filter,
    "tight_stretch": _law("friction_position_dependent"),
    "ripple": _law("torque_ripple"),
    "drift": _law("friction_thermal_drift"),
}
UNLISTED: dict[str, Bend] = {
    **{name: _law(f"friction_{name}") for name in ("step", "quadratic", "periodic")},
    **{name: partial(_own, name) for name in OWN_LAWS},
}


# Cases.


def bent(name: str, seed: Sequence[int], known: Recording) -> tuple[Bent, Array] | None:
    """The bend of that name with a drawn size, and the change of the residual that it makes. None where the machine
    has no such thing, and where it cannot show: base values within twice their tolerances take it up."""
    rng = np.random.default_rng([*seed, 1])
    for _ in range(TRIES):
        made = (SINGLES | UNLISTED)[name](rng, known)
        if made is None:
            return None
        change = known.residual(made.machine, made.runs) - known.own
        if known.left(change, 2.0) >= SHOWS * known.remainder_rms:
            return made, change
    return None


def cases(seed: int, known: Recording, count: int, only: str | None = None) -> Iterator[tuple[str, str]]:
    """(case, bend) of each campaign: two thirds one listed effect each, a sixth an unlisted one, a sixth none; each
    bend that shows as often as the others. InputError where none shows."""
    rng = np.random.default_rng([seed, 0])
    asked: dict[str, list[str]] = {}
    for case, bends in {"singles": SINGLES, "unknown": UNLISTED}.items():
        shown = [name for name in bends if bent(name, (seed, 0), known) is not None]
        for name in shown:  # a load of an axis is no listed effect
            asked.setdefault("unknown" if _unlisted(name, seed, known) else case, []).append(name)
    few = round(count / 6.0)
    of_case = [only] * count if only else ["none"] * few + ["unknown"] * few + ["singles"] * (count - 2 * few)
    for case in {*of_case} - {"none", *asked}:
        raise InputError(f"nothing of case '{case}' can show in these recordings", place="runs")
    turns = {case: itertools.cycle(rng.permutation(names)) for case, names in asked.items()}
    for case in rng.permutation(of_case):
        yield (str(case), str(next(turns[case])) if case in turns else "")


def _unlisted(name: str, seed: int, known: Recording) -> bool:
    made = (SINGLES | UNLISTED)[name](np.random.default_rng([seed, 0, 1]), known)
    return made is not None and made.name.startswith("unlisted")


def write_case(folder: Path, known: Recording, made: Bent | None, seed: Sequence[int]) -> None:
    """machine.yaml, runs.yaml and runs/*.csv of one case: some of the parts of the recordings."""
    rng = np.random.default_rng([*seed, 2])
    runs = known.runs if made is None else made.runs
    few = len(runs) < FEW
    parts = [p for run in runs for p in cut(known.machine, run, int(rng.integers(*PARTS)) if few else 1, rng)]
    count = max(round(len(parts) * rng.uniform(*KEPT)), min(len(parts), 3))
    chosen = sorted(rng.permutation(len(parts))[:count])
    (folder / "runs").mkdir(parents=True)
    save_machine(known.machine if made is None else made.machine, folder / "machine.yaml")
    entries = []
    for run in (parts[k] for k in chosen):
        entry: dict[str, Any] = {"name": run.name, "file": f"runs/{run.name}.csv", "payload_kg": run.payload_kg}
        if kind_of(known.machine).payload:
            entry["start_position_m"] = round(run.start_position_m, 6)
        entries.append({**entry, "start_time_s": round(run.start_time_s, 6)})
        _write_log(folder / entry["file"], known.machine, run)
    (folder / "runs.yaml").write_text(yaml.safe_dump({"runs": entries}, sort_keys=False), encoding="utf-8")


def _write_log(file: Path, machine: Any, run: Run) -> None:
    kind = kind_of(machine)
    parts = [name for name in kind.drive.parts if name in run]
    names = [n for n in run.signals if not (parts and n == kind.plant.input)]
    table = np.column_stack([run.time_s - run.time_s[0], *(run[name] for name in names)])
    np.savetxt(file, table, delimiter=",", header=",".join(["time_s", *names]), comments="", fmt="%.9g")


def made(known: Recording, folder: Path, order: Order) -> tuple[Order, Label]:
    """One campaign in `folder`/NAME, and its label."""
    found = bent(order.names[0], order.seed, known) if order.names else None
    if order.names and found is None:  # it shows with other sizes only: those of the first trial
        found = bent(order.names[0], (order.seed[0], 0), known)
    write_case(folder / order.name, known, found[0] if found else None, order.seed)
    return order, _label(known, order, *(found or (None, np.zeros(1))))


def _label(known: Recording, order: Order, made: Bent | None, change: Array) -> Label:
    listed = made is not None and not made.name.startswith("unlisted")
    parameters = {name: float(f"{value:.7g}") for name, value in made.parameters.items()} if made else {}
    return Label(
        effects=(made.name,) if made else (),
        events=(),
        values=parameters,
        where=({"subsystem": made.subsystem, "regime": made.regime},) if made else (),
        alike=known.alike(made.name, change) if made and listed else (),
        signals="+".join(known.runs[0].signals),
        parameters={made.entry: parameters} if made and made.entry else {},
        case=order.case,
        kind=known.kind,
        family=known.name,
        machine=known.machine.name,
        seed=tuple(order.seed),
        truth={"remainder_rms": known.remainder_rms, "input_rms": known.input_rms},
        source=SOURCE,
        torque_change_rms_nm=float(f"{rms(change):.4g}"),
    )


def ordered(seed: int, known: Recording, count: int, only: str | None = None) -> list[Order]:
    """The campaigns to make; only: all of one case."""
    drawn = cases(seed, known, count, only)
    return [
        Order(n, (seed, n), SOURCE, known.name, case, (name,) if name else ())
        for n, (case, name) in enumerate(drawn, start=1)
    ]
