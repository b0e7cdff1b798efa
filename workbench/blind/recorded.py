"""Recordings of a real machine as blind campaigns: one piece of what is known of the machine is bent, or one effect is
added to the logged input by its law with the real motion.

What the machine has of its own stays in the recording, as it does at every user's; effects that a diagnosis finds of it
are in its machine.yaml (`recording`). Bends of machine.yaml leave the logs as they are; bends of a sensor and added
effects leave machine.yaml as it is.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from workbench.blind.recording import FEW, Recording, cut, rms
from workbench.blind.seal import Label, Order
from workbench.core.errors import InputError
from workbench.core.record import LogTraits
from workbench.core.run import Array, Run
from workbench.effects import effects_for, find, of, ranges_of, sizes_of
from workbench.effects.active import logged
from workbench.machines import get_value, kind_of, save_machine, with_values
from workbench.simulate.driven import InverseSimulation

SOURCE = "recorded"
TURN = 2.0 * np.pi
KEPT = (0.6, 1.0)  # share of the parts that a case holds
SHOWS = 0.3  # of the machine's own remainder: a smaller change, base values refitted within 2 tolerances, is not asked
TRIES = 8  # sizes that are drawn before a bend is given up
PARTS = 3, 6  # into which each of a few runs is cut


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
    sound = known.machine.model_copy(update={"effects": {}, "log": LogTraits()})  # what the log has is in it already
    active = of(sound, {name: dict(parameters)})
    runs = tuple(logged(run, active) for run in known.runs)
    return replace(_missing(known, name, known.machine, parameters), runs=runs)


def _offset(rng: np.random.Generator, known: Recording) -> Bent | None:
    (name,) = (r.name for r in find("torque_offset", known.plant).ranges(sizes_of(known.machine, known.runs)))
    return _on_sensor(known, "torque_offset", {name: _sign(rng) * rng.uniform(0.04, 0.12) * known.input_rms})


def _samples_s(rng: np.random.Generator, known: Recording, low: float, high: float) -> float:
    step_s = float(np.median([run.sample_time_s for run in known.runs]))
    return step_s * float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _places(known: Recording) -> list[Array]:
    """Of each run, (n,): where the machine is, by its log where that says so."""
    kind, motions = kind_of(known.machine), known.bench.motions
    if kind.moved.placed_by_log:
        return [motion.position for motion in motions]
    starts = [run.start_position_m for run in known.runs]
    return [kind.place_of(known.machine, x, motion.position) for x, motion in zip(starts, motions, strict=True)]


def _shape(rng: np.random.Generator, known: Recording, name: str) -> dict[str, float]:
    """Drawn values of an effect's parameters that are no amounts, from the way and the time that the runs cover."""
    moving = [at[rows] for at, rows in zip(_places(known), known.moving, strict=True)]
    low, high = (float(edge) for edge in np.quantile(np.concatenate(moving), [0.02, 0.98]))
    span = min(high - low, TURN) if known.plant == "axis-rotary" else high - low
    ends = [run.start_time_s + run.duration_s for run in known.runs]
    drawn = {
        "centre": low + (high - low) * rng.uniform(0.25, 0.75),
        "position": low + (high - low) * rng.uniform(0.3, 0.7),
        "width": span * (rng.uniform(0.03, 0.1) if name == "friction_position_dependent" else 0.01),
        "waves_per": rng.uniform(4.0, 15.0) / span,
        "order_per_turn": float(rng.integers(1, 13 if known.plant == "axis-rotary" else 4)),
        "period": span / rng.uniform(2.5, 9.0),
        "phase": rng.uniform(0.0, TURN),
        "time_constant": max(ends) * rng.uniform(0.2, 0.8),
    }
    ranges = ranges_of(find(name, known.plant), known.machine, known.runs)  # slower than WAVES on the way is no wave
    return {
        r.name: next(float(max(value, r.lowest)) for word, value in drawn.items() if r.name.startswith(word))
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
    ailing = InverseSimulation(known.machine, known.runs, known.band_hz, of(known.machine, chosen))
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


# Causes that are in no library: (run's time, place from 0 to 1 of where the runs have been, speed, input; size in the
# input's unit) -> what they add.
OwnLaw = Callable[[np.random.Generator, Array, Array, Array, Array, float], Array]


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
        lambda rng, t, x, v, u, size: 3.0 * size * (x - 0.5),
    ),
    "blow": ("event: a blow against the load in each run", "event", _blow),
}  # fmt: skip


def _own(name: str, rng: np.random.Generator, known: Recording) -> Bent:
    text, regime, law = OWN_LAWS[name]
    size = max(rng.uniform(0.05, 0.15) * known.input_rms, known.remainder_rms)
    places = _places(known)
    low, high = (edge(np.concatenate(places)) for edge in (np.min, np.max))
    change = [
        law(rng, run.time_s, (at - low) / max(float(high - low), 1e-12), motion.speed, u, size)
        for run, at, motion, u in zip(known.runs, places, known.bench.motions, known.bench.inputs, strict=True)
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
    "gain": lambda rng, known: _on_sensor(known, "torque_scale", {"gain": 1.0 + 0.08 * _sign(rng)}),
    "offset": _offset,
    "speed_late": lambda rng, known: _on_sensor(known, "speed_delay", {"delay_s": _samples_s(rng, known, 2.0, 15.0)}),
    "torque_low_passed": lambda rng, known: _on_sensor(
        known, "torque_filter", {"time_constant_s": _samples_s(rng, known, 3.0, 25.0)}
    ),
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
        if made is None or made.entry in known.machine.effects:  # what it has already cannot be added
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
    entries, kind = [], kind_of(known.machine)
    for run in (parts[k] for k in chosen):
        entry: dict[str, Any] = {"name": run.name, "file": f"runs/{run.name}.csv", "payload_kg": run.payload_kg}
        if kind.payload or kind.plant.positions[-1] not in run:  # else the log says where each part begins
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
        truth={
            "remainder_rms": known.remainder_rms,
            "input_rms": known.input_rms,
            "detectability": (known.left(change, 1.0) / known.remainder_rms) ** 2 if made else 0.0,
        },
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
