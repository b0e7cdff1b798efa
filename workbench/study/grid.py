"""The fields of a scenario under dotted names, and runs built with some of them set to other values."""

from __future__ import annotations

import hashlib
import itertools
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, overload

import numpy as np
from pydantic import BaseModel, ValidationError

from workbench.control import Events, Settings
from workbench.core.errors import InputError, nearest
from workbench.core.run import Array
from workbench.core.yaml_strict import Place, dotted, problem_lines
from workbench.machines import AnyKind, Axis, Hoist, kind_of, load_of
from workbench.references import (
    LimitPair,
    Limits,
    Plan,
    RecordedPlan,
    Step,
    StoppedPlan,
    motion_time_s,
    plan_motion,
    planned_kind,
)
from workbench.study.scenario import (
    IN_METRES,
    MoveBlock,
    Scenario,
    check_payload_kg,
    distributions,
    draws,
    key_in,
    listed,
)

Assigned = Mapping[str, float | bool | str]
_NUMBERS = ("payload_kg", "start_position_m", "lead_s", "settle_s")
_LIMITS = ("speed_m_s", "acceleration_m_s2", "jerk_m_s3")
_NO_FIELDS = (
    "format", "kind", "name", "identified", "tolerances", "effects", "allowances", "measured_correction", "log",
)  # fmt: skip
# Root of a field's name -> the part of a run that it belongs to.
_PARTS = {name: name for name in (*_NUMBERS, "machine", "moves", "limits", "controller", "events")} | {
    "solver": "step_s"
}
MOST_CACHED = 4096


@dataclass(frozen=True)
class Parts:
    """The parts of a run that sweeps and samples may change."""

    machine: AnyKind
    payload_kg: float | None
    start_position_m: float | None
    lead_s: float
    settle_s: float
    moves: tuple[Step, ...]
    limits: LimitPair | None
    controller: Settings
    events: Events
    step_s: float


@dataclass(frozen=True)
class Fields:
    """A scenario on its machine, whose values can be set by name. Parts that stay alike are built once."""

    scenario: Scenario
    machine: AnyKind
    _cache: dict[tuple[Any, ...], Any] = field(default_factory=dict, compare=False, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return {"scenario": self.scenario, "machine": self.machine, "_cache": {}}

    def names(self) -> tuple[str, ...]:
        """All that can be swept or sampled, in the order of the file."""
        effects = [f"effects.{e}.{p}" for e, values in self.machine.effects.items() for p in values]
        kind = kind_of(self.machine)
        unit = kind.moved.unit
        limits = [key_in(unit, name) for name in _LIMITS]
        ways, events = (("hoisting", "lowering"), _leaves(Events)) if kind.payload else ((), ())
        return (
            *(
                key_in(unit, name) if name == "start_position_m" else name
                for name in _NUMBERS
                if kind.payload or name != "payload_kg"
            ),
            *(f"limits.{name}" for name in limits),
            *(f"limits.{way}.{name}" for way in ways for name in limits),
            *(f"moves[{i}].{key}" for i, move in enumerate(self.scenario.moves) for key in _given(move)),
            *(f"controller.{name}" for name in _leaves(type(self.scenario.controller))),
            *(f"drive.{name}" for name in _leaves(type(self.machine.drive))),
            *(f"machine.{name}" for name in _leaves(type(self.machine))),
            *(f"events.{name}" for name in events),
            *effects,
            "solver.step_s",
        )

    def check_name(self, name: str) -> None:
        """InputError for what is no field, with the nearest one."""
        names = self.names()
        if name in names:
            return
        if name in ("payloads_kg", "references"):
            said = f"'{name}' is a list already, each of which is run"
            raise InputError(f"{said}; sweep payload_kg in its place" if name == "payloads_kg" else said)
        tails = {full.rsplit(".", 1)[-1]: full for full in reversed(names)}
        hint = f"did you mean '{tails[name]}'?" if name in tails else nearest(name, names)
        if hint.startswith("valid"):
            hint = f"fields are {', '.join(_NUMBERS)} and those of {', '.join(_ROOTS)}"
        raise InputError(f"unknown field '{name}'; {hint}")

    def value(self, name: str) -> float | None:
        """A field's own number; None where it has none, or not one only."""
        if ("value", name) not in self._cache:
            self._cache["value", name] = self._value(name)
        value: float | None = self._cache["value", name]
        return value

    def _value(self, name: str) -> float | None:
        parts = self.parts({})
        root, path = _split(name)
        if root in _NUMBERS:
            return getattr(parts, root)
        if root == "limits":
            pair = parts.limits
            chosen = [] if pair is None else [pair.hoisting, pair.lowering]
            if len(path) == 2 and pair is not None:
                chosen = [getattr(pair, str(path[0]))]
            values = {getattr(limits, IN_METRES.get(str(path[-1]), str(path[-1]))) for limits in chosen}
            return values.pop() if len(values) == 1 else None
        value: Any = {
            "moves": [move.model_dump() for move in self.scenario.moves],
            "controller": parts.controller.model_dump(),
            "machine": parts.machine.model_dump(),
            "events": parts.events.model_dump(),
            "solver": {"step_s": parts.step_s},
        }[root]
        for part in path:
            value = None if value is None else value[part]
        return float(value) if isinstance(value, int | float) else None

    def parts(self, assigned: Assigned) -> Parts:
        """The parts with these fields set. InputError with the field's name as place where one does not fit."""
        by_root: dict[str, tuple[tuple[str, float | bool | str], ...]] = dict.fromkeys(_PARTS, ())
        for name, value in assigned.items():
            by_root[_split(name)[0]] += ((name, value),)
        made: dict[str, Any] = {}
        for root, items in by_root.items():
            if (root, items) not in self._cache:
                if len(self._cache) >= MOST_CACHED:
                    self._cache.clear()
                self._cache[root, items] = self._part(root, items)
            made[_PARTS[root]] = self._cache[root, items]
        return Parts(**made)

    def _part(self, root: str, items: Sequence[tuple[str, Any]]) -> Any:
        if root in _NUMBERS:
            return self._number(root, items)
        if root in ("moves", "limits"):
            return self._moves(items) if root == "moves" else self._limits(items)
        changed = _changed(self.machine if root == "machine" else getattr(self.scenario, root), items)
        return changed.step_s if root == "solver" else changed

    def _number(self, name: str, items: Sequence[tuple[str, Any]]) -> float | None:
        if not items:
            start = name == "start_position_m"
            return None if name == "payload_kg" else self.scenario.start if start else getattr(self.scenario, name)
        ((_, value),) = items
        lowest = None if name == "start_position_m" else 0.0
        if isinstance(value, bool | str) or (lowest is not None and value < lowest):
            raise InputError(f"{value!r}, expected a number{' of at least 0' if lowest == 0.0 else ''}", place=name)
        if name == "payload_kg":
            try:
                check_payload_kg(value)
            except ValueError as error:
                raise InputError(str(error), place=name) from error
        return float(value)

    def _moves(self, items: Sequence[tuple[str, Any]]) -> tuple[Step, ...]:
        moves = list(self.scenario.moves)
        for name, value in items:
            number = int(_split(name)[1][0])
            moves[number] = _changed(moves[number], [(name, value)])
        return tuple(move.step() for move in moves)

    def _limits(self, items: Sequence[tuple[str, Any]]) -> LimitPair | None:
        """Both directions. A field without a direction sets both, one with a direction goes over it."""
        block = self.scenario.limits
        common: dict[str, float | None] = {**dict.fromkeys(_LIMITS), **block.given()}
        ways = {way: common | getattr(block, way).given() for way in ("hoisting", "lowering")}
        for name, value in sorted(items, key=lambda item: item[0].count(".")):
            path = _split(name)[1]
            for way in ways if len(path) == 1 else (path[0],):
                ways[str(way)][IN_METRES.get(str(path[-1]), str(path[-1]))] = _positive(name, value)
        if all(value is None for values in ways.values() for value in values.values()):
            return None
        return LimitPair(*(_limits_of(way, values) for way, values in ways.items()))


def _limits_of(way: str, values: Mapping[str, float | None]) -> Limits:
    for name in ("speed_m_s", "acceleration_m_s2"):
        if values[name] is None:
            raise InputError(f"has no {name} for {way}", place="limits")
    given = {name: value for name, value in values.items() if value is not None}
    try:
        return Limits(**given)
    except InputError as error:
        raise InputError(error.problem, place=f"limits.{error.place}") from error


def _positive(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, float | int) or not value > 0.0:
        raise InputError(f"{value!r}, expected a number greater than 0", place=name)
    return float(value)


_ROOTS = ("limits", "moves", "controller", "drive", "machine", "events", "effects", "solver")


def _given(move: MoveBlock) -> list[str]:
    return [key for key in MoveBlock.model_fields if getattr(move, key) is not None]


def _leaves(model: type[BaseModel], prefix: str = "") -> Iterable[str]:
    """Dotted names of a record's values, those of optional blocks included."""
    for name, info in model.model_fields.items():
        blocks = [
            annotation
            for annotation in (info.annotation, *getattr(info.annotation, "__args__", ()))
            if isinstance(annotation, type) and issubclass(annotation, BaseModel)
        ]
        if not prefix and name in _NO_FIELDS:
            continue
        if blocks:
            yield from _leaves(blocks[0], f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}"


def _split(name: str) -> tuple[str, Place]:
    """The part a field belongs to and its place in that: drive.overload is machine's drive, overload."""
    root, _, rest = IN_METRES.get(name, name).partition(".")
    if root in ("drive", "effects"):
        return "machine", (root, *rest.split("."))
    if root.startswith("moves["):
        return "moves", (int(root[6:-1]), rest)
    return root, tuple(rest.split(".")) if rest else ()


def _changed(record: Any, items: Sequence[tuple[str, Any]]) -> Any:
    """A record with fields set to other values, checked as the file is."""
    if not items:
        return record
    data = record.model_dump()
    for name, value in items:
        path = _split(name)[1]
        if isinstance(path[0], int):
            path = path[1:]
        block = data
        for part in path[:-1]:
            if block.get(part) is None:
                block[part] = {}
            block = block[part]
        old = block.get(path[-1])
        whole = isinstance(old, int) and not isinstance(old, bool) and isinstance(value, float) and value.is_integer()
        block[path[-1]] = int(value) if whole else value
    try:
        return type(record).model_validate(data)
    except ValidationError as error:
        place, problem = problem_lines(type(record), error, data)[0]
        ends = dotted(place)
        named = next((name for name, _ in items if ends and name.endswith(ends)), items[0][0])
        raise InputError(problem if named.endswith(ends) else f"{ends}: {problem}", place=named) from error


@dataclass(frozen=True, eq=False)
class Recording:
    """A recorded motion of a carriage: (n,) times and speeds (up positive), and how it is followed.

    smoothing_s: 0 as it is, above 0 as its moving average over that time. digest: of the samples.
    """

    label: str
    time_s: Array
    speed_m_s: Array
    start_position_m: float
    smoothing_s: float
    digest: str


@dataclass(frozen=True)
class RunSpec:
    """One run. run_id: unique in the study, stable, safe as the name of a file.

    machine: overrides, drive and effects are in it. reference: its name in the results, a planned
    kind, or the label of `recording`. duration_s: all runs of a study are held at rest until then.
    record_every: keep each n-th sample of the controller, 0 none. assigned: index column -> what
    sweep and sample have set. problem: why this run cannot take place; "" for one that can.
    """

    run_id: str
    scenario: str
    machine: AnyKind
    payload_kg: float
    start_position_m: float
    reference: str
    moves: tuple[Step, ...]
    limits: LimitPair | None
    lead_s: float
    settle_s: float
    duration_s: float
    controller: Settings
    events: Events = field(default_factory=Events)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    step_s: float = 0.001
    plant: str = "lumped"
    record_every: int = 10
    recording: Recording | None = None
    assigned: Mapping[str, float | str] = field(default_factory=dict)
    problem: str = ""

    def plan(self) -> Plan:
        """The motion; equal motions are planned once. InputError where it is not possible."""
        if self.problem:
            raise InputError(self.problem)
        plan, events = self._undisturbed(), self.events
        if events.emergency_stop_s is None or events.emergency_deceleration_m_s2 is None:
            return plan
        return _stopped(plan, events.emergency_stop_s, events.emergency_deceleration_m_s2)

    def _undisturbed(self) -> Plan:
        rail = kind_of(self.machine).looped.rail(self.machine)
        if self.recording is not None:
            return _recorded_plan(self.recording, rail, self.lead_s, self.settle_s)
        assert self.limits is not None
        check_speed(self.limits, self.machine)
        kind = planned_kind(self.reference)
        load = load_of(self.machine, self.payload_kg) if kind.needs_load or kind.uses_load else None
        return _planned(
            self.reference, self.moves, self.start_position_m, self.limits, rail, self.lead_s, self.settle_s, load
        )


_planned = lru_cache(maxsize=256)(plan_motion)
_stopped = lru_cache(maxsize=256)(StoppedPlan)


@lru_cache(maxsize=16)
def _recorded_plan(recording: Recording, rail: tuple[float, float], lead_s: float, settle_s: float) -> RecordedPlan:
    return RecordedPlan(
        kind=recording.label,
        time_s=recording.time_s,
        speed_recorded_m_s=recording.speed_m_s,
        start_position_m=recording.start_position_m,
        rail_m=rail,
        lead_s=lead_s,
        settle_s=settle_s,
        smoothing_s=recording.smoothing_s,
    )


def check_speed(limits: LimitPair, machine: Hoist | Axis) -> None:
    """InputError where a speed limit is beyond what the machine allows."""
    kind = kind_of(machine)
    top = kind.looped.top_speed(machine)
    key = "speed_rad_s" if kind.moved.unit == "rad" else "speed_m_s"
    for name, way_limits in (("hoisting", limits.hoisting), ("lowering", limits.lowering)):
        if way_limits.speed_m_s > top.speed * (1.0 + 1e-9):
            raise InputError(
                f"{top.reason.format(limit=way_limits.speed_m_s)}; "
                f"expected at most {int(top.speed * 1000.0) / 1000.0:g} {kind.moved.speed_unit}",
                place=f"limits.{key}" if limits.hoisting == limits.lowering else f"limits.{name}.{key}",
            )


# Values of the machine that change which motions are possible.
_MOTION = (
    "machine.rail.",
    "machine.wire.segment_length_m",
    "machine.gearbox.",
    "machine.winch.drum_diameter_m",
    "machine.motor.nominal_speed_rad_s",
    "limits.",
    "moves[",
    "start_position",
    "lead_s",
    "settle_s",
)


@dataclass(frozen=True)
class GridAxis:
    """One direction of the grid of runs: fields that change together, and their values point by point.

    values: (points, fields). labels: how a run's id names each point.
    """

    names: tuple[str, ...]
    values: Sequence[Sequence[float | bool | str]]
    labels: Sequence[str]
    sampled: bool = False
    relative: tuple[bool, ...] = ()

    def __len__(self) -> int:
        return len(self.values)

    @property
    def moves(self) -> bool:
        """Whether it changes the motion."""
        return any(name.startswith(_MOTION) for name in self.names)


def swept(scenario: Scenario, fields: Fields) -> Iterator[GridAxis]:
    """One axis for each swept field, and one for all under `zip`. InputError names the field that does not fit."""
    if scenario.sweep is None:
        return
    grid = scenario.sweep.grid
    together = {name: listed(values) for name, values in scenario.sweep.zip.items()}
    for name in (*grid, *together):
        try:
            fields.check_name(name)
        except InputError as error:
            raise InputError(error.problem, place=place_of(name, name in together)) from error
    if both := [name for name in together if name in grid]:
        raise InputError("is swept by itself too", place=place_of(both[0], True))
    lengths = {name: len(values) for name, values in together.items()}
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise InputError(f"lists of unequal length cannot be walked together: {said}", place="sweep.zip")
    short = _short_names((*grid, *together))
    for name, values in grid.items():
        yield _axis((name,), [listed(values)], short, name)
    if together:
        yield _axis(tuple(together), list(together.values()), short, None)


def _axis(
    names: tuple[str, ...], columns: list[list[float | bool | str]], short: Mapping[str, str], one: str | None
) -> GridAxis:
    points = list(zip(*columns, strict=True))
    twice = [point for point, count in Counter(points).items() if count > 1]
    if twice:
        place = place_of(one, False) if one else "sweep.zip"
        raise InputError(f"{', '.join(map(_words, twice[0]))} stands there twice; once is enough", place=place)
    words = [labels_of(column) for column in columns]
    labels = [
        "_".join(f"{short[n]}_{column[k]}" for n, column in zip(names, words, strict=True)) for k in range(len(points))
    ]
    return GridAxis(names, points, labels)


def sampled(scenario: Scenario, fields: Fields, machine: Hoist | Axis) -> Iterator[GridAxis]:
    """The axis of the draws, if there are any. InputError names the field that cannot be drawn."""
    block = scenario.sample
    if block is None:
        return
    taken = {name for axis in swept(scenario, fields) for name in axis.names}
    chosen = distributions(block, machine)
    for name, distribution in chosen.items():
        try:
            fields.check_name(name)
            if name in taken and not distribution.relative:
                raise InputError("is swept too; drawn about the swept value it needs relative: true")
            if distribution.relative and name not in taken and not _has_value(name, scenario, fields):
                raise InputError("has no value of its own to be multiplied; draw it without relative")
            if name == "payload_kg" and not distribution.relative and scenario.payloads_kg is not None:
                raise InputError("payloads_kg lists payloads; leave it out, or draw with relative: true")
        except InputError as error:
            raise InputError(error.problem, place=f"sample.values.{name}") from error
    seed = scenario.seed if block.seed is None else block.seed
    values: Array = draws(block, chosen, seed)
    digits = len(str(block.count - 1))
    yield GridAxis(
        tuple(chosen),
        values.tolist(),
        [f"s{k:0{digits}d}" for k in range(block.count)],
        sampled=True,
        relative=tuple(distribution.relative for distribution in chosen.values()),
    )


def _has_value(name: str, scenario: Scenario, fields: Fields) -> bool:
    return scenario.payloads_kg is not None if name == "payload_kg" else fields.value(name) is not None


def place_of(name: str, together: bool) -> str:
    """Where a swept field stands in the scenario."""
    return f"sweep.zip.{name}" if together else f"sweep.{name}"


def _words(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def labels_of(values: Sequence[float | bool | str]) -> list[str]:
    """Short words for values, safe in file names and different for different values."""
    for digits in (6, 12, 17):
        words = [
            re.sub(r"[^A-Za-z0-9.+-]", "-", value) if isinstance(value, str) else
            str(value).lower() if isinstance(value, bool) else f"{value:.{digits}g}"
            for value in values
        ]  # fmt: skip
        if len(set(words)) == len(set(values)):
            return words
    return [f"{k}" for k in range(len(values))]


def _short_names(names: Sequence[str]) -> dict[str, str]:
    """Each field by its last words, as many as tell it from the others."""
    words = {name: re.findall(r"[A-Za-z0-9_]+", name) for name in names}
    short: dict[str, str] = {}
    for name, parts in words.items():
        for count in range(1, len(parts) + 1):
            tail = parts[-count:]
            if all(other == name or other_parts[-count:] != tail for other, other_parts in words.items()):
                break
        short[name] = "-".join(tail)
    return short


LONGEST_ID = 140


@dataclass(frozen=True)
class RunList(Sequence[RunSpec]):
    """The runs of a scenario by number: sweep points, of each the draws, of each payloads, of each references.

    Numbers and ids follow from the scenario alone; any slice can be had without the rest.
    """

    fields: Fields
    axes: tuple[GridAxis, ...]
    recordings: Mapping[str, Recording]
    duration_s: float = math.nan
    _payloads: tuple[tuple[float | None, str], ...] = field(init=False)

    def __post_init__(self) -> None:
        payloads = self.scenario.payloads_kg
        labels = labels_of(payloads) if payloads is not None else [""]
        object.__setattr__(self, "_payloads", tuple(zip(payloads or (None,), labels, strict=True)))

    @property
    def scenario(self) -> Scenario:
        return self.fields.scenario

    def __len__(self) -> int:
        return math.prod((*map(len, self.axes), len(self._payloads), len(self.scenario.references)))

    @overload
    def __getitem__(self, index: int) -> RunSpec: ...
    @overload
    def __getitem__(self, index: slice) -> list[RunSpec]: ...
    def __getitem__(self, index: int | slice) -> RunSpec | list[RunSpec]:
        if isinstance(index, slice):
            return [self._spec(i) for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"run {index} of {len(self)}")
        return self._spec(index % len(self))

    def _spec(self, index: int) -> RunSpec:
        rest, kind = divmod(index, len(self.scenario.references))
        rest, place = divmod(rest, len(self._payloads))
        at = []
        for axis in reversed(self.axes):
            rest, k = divmod(rest, len(axis))
            at.append(k)
        payload, label = self._payloads[place]
        swept, sampled = self.assigned(at[::-1], payload)
        problem = ""
        try:
            parts = self.fields.parts(swept | sampled)
        except InputError as error:
            # Each value fits by itself; these do not fit together. The run is a row that says so.
            parts, problem = self.fields.parts({}), str(error)
        scenario = self.scenario
        reference = scenario.kinds[kind]
        recording = self.recordings.get(reference)
        load = parts.payload_kg if parts.payload_kg is not None else payload
        start = recording.start_position_m if recording is not None else parts.start_position_m
        return RunSpec(
            run_id=self._run_id(label, reference, at[::-1]),
            scenario=scenario.name,
            machine=parts.machine,
            payload_kg=0.0 if load is None else load,
            start_position_m=0.0 if start is None else start,
            reference=reference,
            moves=parts.moves,
            limits=parts.limits,
            lead_s=parts.lead_s,
            settle_s=parts.settle_s,
            duration_s=self.duration_s,
            controller=parts.controller,
            events=parts.events,
            effects=parts.machine.effects,
            step_s=parts.step_s,
            plant=scenario.plant,
            record_every=_record_every(scenario, parts),
            recording=recording,
            assigned={f"sweep.{name}": _column(value) for name, value in swept.items()}
            | {f"sample.{name}": _column(value) for name, value in sampled.items()},
            problem=problem,
        )

    def assigned(self, at: Sequence[int], payload: float | None) -> tuple[dict[str, Any], dict[str, Any]]:
        """What sweep and sample set at a point of the axes; drawn factors are multiplied out."""
        return self._set(zip(self.axes, at, strict=True), payload)

    def _set(
        self, points: Iterable[tuple[GridAxis, int]], payload: float | None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        swept: dict[str, Any] = {}
        sampled: dict[str, Any] = {}
        for axis, k in points:
            if not axis.sampled:
                swept.update(zip(axis.names, axis.values[k], strict=True))
                continue
            for name, value, relative in zip(axis.names, axis.values[k], axis.relative, strict=True):
                if relative:
                    own = swept.get(name, payload if name == "payload_kg" else self.fields.value(name))
                    value = float(value) * float(own) if own is not None else math.nan
                sampled[name] = value
        return swept, sampled

    def motion_parts(self, points: Iterable[tuple[GridAxis, int]]) -> Parts:
        """The parts with only these axes set, the rest as the file has it."""
        swept, sampled = self._set(points, None)
        return self.fields.parts(swept | sampled)

    def _run_id(self, label: str, reference: str, at: Sequence[int]) -> str:
        parts = [axis.labels[k] for axis, k in zip(self.axes, at, strict=True)]
        name = "_".join(part for part in (f"{label}kg" if label else "", reference, *parts) if part)
        if len(name) > LONGEST_ID:
            digest = hashlib.sha256(name.encode()).hexdigest()[:16]
            name = "_".join(part for part in (f"{label}kg" if label else "", reference, digest) if part)
        return name


def _record_every(scenario: Scenario, parts: Parts) -> int:
    outputs = scenario.outputs
    if outputs.signals == "none":
        return 0
    return 1 if outputs.signals == "full" else max(1, round(outputs.every_s / parts.controller.sample_time_s))


def _column(value: float | bool | str) -> float | str:
    """Index columns hold numbers or words."""
    return value if isinstance(value, str) else float(value)


MOST_RUNS = 1_000_000
MOST_MOTIONS = 5_000  # motions whose times are reckoned one by one


def plan_runs(scenario: Scenario, machine: Hoist | Axis, recordings: Mapping[str, Recording] | None = None) -> RunList:
    """The runs of a scenario on its machine (overrides, drive and effects in it), checked without running any.

    Raises InputError, with the field or `sweep.<field>` as place, for an unknown field, a value that fits
    nowhere, lists of unequal length under zip, too many runs, and a motion that is possible in no run.
    """
    fields = Fields(scenario, machine)
    axes = (*swept(scenario, fields), *sampled(scenario, fields, machine))
    specs = RunList(fields, axes, recordings or {})
    if len(specs) > MOST_RUNS:
        place = "sweep" if scenario.sweep is not None else "sample"
        raise InputError(f"makes {len(specs):,} runs, expected at most {MOST_RUNS:,}", place=place)
    _check_values(axes, fields)
    return replace(specs, duration_s=_common_duration_s(specs))


def _check_values(axes: Sequence[GridAxis], fields: Fields) -> None:
    """Each value by itself, the rest as the file has it; of drawn ones the smallest and the largest."""
    for axis in axes:
        for column, name in enumerate(axis.names):
            if not axis.sampled:
                for k, point in enumerate(axis.values):
                    _try({name: point[column]}, fields, f"{place_of(name, len(axis.names) > 1)}[{k}]", name)
                continue
            drawn = np.array([point[column] for point in axis.values], dtype=float)
            for k in (int(np.argmin(drawn)), int(np.argmax(drawn))):
                own = fields.value(name) if axis.relative[column] else 1.0
                if own is not None:
                    _try({name: float(drawn[k]) * own}, fields, f"sample.values.{name}", name, f" (draw {k})")


def _try(assigned: Assigned, fields: Fields, place: str, name: str, note: str = "") -> None:
    try:
        fields.parts(assigned)
    except InputError as error:
        if error.place == name:
            raise InputError(error.problem + note, place=place) from error
        # Something else does not fit with it; other swept values may yet mend that.


def _common_duration_s(specs: RunList) -> float:
    """How long each run is: as the slowest of all motions.

    Up to 5,000 different motions are reckoned one by one, of more those at the ends of each axis; a run
    that should take longer still is longer. A value that no run can move with, and a motion that is
    possible in no run, are an InputError.
    """
    moving = [axis for axis in specs.axes if axis.moves]
    many = math.prod(map(len, moving)) > MOST_MOTIONS
    ends = [_ends(axis) if many else range(len(axis)) for axis in moving]
    longest, first = -math.inf, None
    works: list[set[int]] = [set() for _ in moving]
    errors: dict[tuple[int, int], InputError] = {}
    for at in itertools.product(*ends):
        try:
            parts = specs.motion_parts(zip(moving, at, strict=True))
        except InputError as error:  # does not fit with the file's own values; other swept ones may mend that
            first, parts = first or error, None
        try:
            longest = longest if parts is None else max(longest, _time_s(specs, parts))
        except InputError as error:
            first = first or error
            for i, k in enumerate(at):
                errors.setdefault((i, k), error)
            continue
        for done, k in zip(works, at, strict=True):
            done.add(k)
    if first is not None and longest == -math.inf:
        raise first
    for (i, k), why in sorted(errors.items(), key=lambda item: item[0]):
        axis = moving[i]
        if k not in works[i] and not axis.sampled:
            together = len(axis.names) > 1
            place = "sweep.zip" if together else f"{place_of(axis.names[0], False)}[{k}]"
            said = why.problem if why.place in axis.names or together else f"{why.place}: {why.problem}"
            raise InputError(said, place=place) from why
    # A slip of a zero would fill the memory: the longest sensible duty cycle is an hour.
    if longest > 3600.0:
        raise InputError(f"the moves take {longest:.0f} s, expected at most 3600 s", place="moves")
    return longest


def _time_s(specs: RunList, parts: Parts) -> float:
    scenario, machine = specs.scenario, parts.machine
    rail = kind_of(machine).looped.rail(machine)
    times = [r.time_s[-1] - r.time_s[0] + r.smoothing_s for r in specs.recordings.values()]
    if kinds := scenario.planned_kinds:
        if parts.limits is None or parts.start_position_m is None:
            start = f"start_position_{kind_of(machine).moved.unit}"
            raise InputError("is missing", place="limits" if parts.limits is None else start)
        check_speed(parts.limits, machine)
        # The heaviest load swings slowest, and what is shaped for it takes longest.
        payload = max(scenario.payloads_kg or (0.0,)) if parts.payload_kg is None else parts.payload_kg
        load = load_of(machine, payload)
        times.append(motion_time_s(kinds, parts.moves, parts.start_position_m, parts.limits, rail, load))
    return parts.lead_s + float(max(times)) + parts.settle_s


def _ends(axis: GridAxis) -> list[int]:
    """The points at which a field of the axis is smallest or largest."""
    points = {0, len(axis) - 1}
    for column in range(len(axis.names)):
        values = [point[column] for point in axis.values]
        if all(isinstance(value, float) for value in values):
            points |= {int(np.argmin(np.array(values))), int(np.argmax(np.array(values)))}
    return sorted(points)
