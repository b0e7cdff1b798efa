"""Edits of one run that can still be read: what people and recorders do to logs. The same seed makes the same edit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from workbench.core.run import Array, Run
from workbench.machines import Axis, Hoist, kind_of

ROWS = 50
SEEN = 15.0  # times its noise: by so much the speed before and after the rows differs
Edit = Callable[["Hoist | Axis", Run, np.random.Generator], "Run | None"]


def edited(machine: Hoist | Axis, run: Run, edit: str, seed: int) -> Run | None:
    """The run after an edit; None where it changes nothing, such as a payload of an empty run."""
    return EDITS[edit](machine, run, np.random.default_rng(seed))


def _changed(run: Run, names: Iterable[str], change: Callable[[Array], Array]) -> Run:
    return replace(run, signals={**run.signals, **{name: change(run[name]) for name in names if name in run}})


def _input(change: Callable[[Run, Array], Array]) -> Edit:
    """An edit of the input and its parts."""
    return lambda machine, run, _: _changed(run, kind_of(machine).inputs, lambda v: change(run, v))


def _payload(factor: float) -> Edit:
    return lambda _, run, __: replace(run, payload_kg=factor * run.payload_kg) if run.payload_kg else None


def _speed_reversed(machine: Hoist | Axis, run: Run, _: object) -> Run:
    plant = kind_of(machine).plant
    return _changed(run, (plant.positions[0], plant.speeds[0]), lambda v: v[::-1].copy())


def _motor_copied(machine: Hoist | Axis, run: Run, _: object) -> Run | None:
    kind = kind_of(machine)
    if not all(name in run for name in kind.drive.parts[:2]) or not kind.drive.parts:
        return None
    first, second = kind.drive.parts[:2]
    return replace(run, signals={**run.signals, second: run[first], kind.plant.input: 2.0 * run[first]})


def _offset(machine: Hoist | Axis, run: Run, _: object) -> Run | None:
    kind = kind_of(machine)
    return _changed(run, (kind.plant.input,), lambda v: v + 60.0) if kind.holds_load else None


def _noise(machine: Hoist | Axis, run: Run, chance: np.random.Generator) -> Run:
    def louder(values: Array) -> Array:
        size = 1.4826 * float(np.median(np.abs(np.diff(values, 2)))) / np.sqrt(6.0)
        return values + chance.normal(0.0, 9.9 * size, len(values))

    return _changed(run, (kind_of(machine).plant.input,), louder)


def _rows(run: Run, chance: np.random.Generator, rows: Callable[[Array, int, int], Array]) -> Run:
    """All signals with ROWS rows from a place on replaced; other: where they may come from."""
    count = len(run.time_s)
    at = int(chance.integers(count // 5, 4 * count // 5 - ROWS))
    other = (at + count // 3) % (count - ROWS)
    return _changed(run, run.signals, lambda v: np.concatenate([v[:at], rows(v, at, other), v[at + ROWS :]]))


def _turned(machine: Hoist | Axis, run: Run, chance: np.random.Generator) -> Run | None:
    """ROWS rows in reverse order, where the speed before and after them differs: elsewhere noise looks the same."""
    name = kind_of(machine).plant.speeds[0]
    if name not in run:
        return None
    means = np.convolve(run[name], np.full(4, 0.25), mode="valid")
    noise = 1.4826 * float(np.median(np.abs(np.diff(run[name], 2)))) / np.sqrt(6.0)
    places = np.flatnonzero(np.abs(means[ROWS - 4 :] - means[: 4 - ROWS]) > SEEN * noise)
    places = places[(places > 50) & (places < len(run.time_s) - ROWS - 50)]
    if not len(places):
        return None
    at = int(chance.choice(places))
    return _changed(run, run.signals, lambda v: np.concatenate([v[:at], v[at : at + ROWS][::-1], v[at + ROWS :]]))


def _start(machine: Hoist | Axis, run: Run, _: object) -> Run | None:
    return replace(run, start_position_m=run.start_position_m - 3.0) if kind_of(machine).start is not None else None


EDITS: Mapping[str, Edit] = MappingProxyType(
    {
        "payload 0": _payload(0.0),
        "payload in tonnes": _payload(1e-3),
        "torque late by 1 s": _input(lambda run, v: np.interp(run.time_s - 1.0, run.time_s, v)),
        "speed reversed in time": _speed_reversed,
        "motor 2 a copy of motor 1": _motor_copied,
        "torque x 1.3": _input(lambda _, v: 1.3 * v),
        "torque + 60 N m": _offset,
        "noise x 10": _noise,
        "start position 3 m off": _start,
        "time x 1.2": lambda _, run, __: replace(run, time_s=run.time_s[0] + 1.2 * (run.time_s - run.time_s[0])),
        "50 rows in reverse order": _turned,
        "50 rows of elsewhere": lambda _, run, chance: _rows(run, chance, lambda v, at, other: v[other : other + ROWS]),
    }
)


def sound_runs(machine: Hoist, chance: np.random.Generator) -> list[Run]:
    """Six runs of a rigid hoist whose values are off as honest ones are: three payloads, lifting and lowering."""
    kind = kind_of(machine)
    gain, offset, friction, slope = chance.normal([1.0, 0.0, 30.0, 0.1], [0.01, 3.0, 3.0, 0.02])
    time_s = np.arange(0.0, 30.0, 0.01)
    runs = []
    for number, payload_kg in enumerate((0.0, 0.0, 4500.0, 4500.0, 9000.0, 9000.0)):
        top = chance.uniform(0.4, 0.9) * machine.motor.nominal_speed_rad_s
        # Trapezoids up and down, with corners rounded over half a second.
        corners_s = np.array([0.0, 2.0, 4.0, 10.0, 12.0, 17.0, 19.0, 25.0, 27.0, 30.0]) + chance.uniform(0.0, 1.0)
        speed = np.interp(time_s, corners_s, top * np.array([0, 0, 1, 1, 0, 0, -1, -1, 0, 0], dtype=float))
        speed = np.convolve(np.pad(speed, 25, mode="edge"), np.full(51, 1.0 / 51.0), mode="valid")
        body = kind.rigid(machine, payload_kg)
        torque = body.hold + body.inertia * np.gradient(speed, time_s) + friction * np.tanh(speed / 2.0) + slope * speed
        halves = [0.5 * (gain * torque + offset) + chance.normal(0.0, 2.0, len(time_s)) for _ in range(2)]
        signals = dict(zip(kind.drive.parts, (half.round(1) for half in halves), strict=True))
        signals[kind.plant.input] = np.sum([*signals.values()], axis=0)
        signals[kind.plant.speeds[0]] = (speed + chance.normal(0.0, 0.03, len(time_s))).round(2)
        runs.append(Run(f"run_{number}", time_s, signals, payload_kg, 9.0, 60.0 * number))
    return runs
