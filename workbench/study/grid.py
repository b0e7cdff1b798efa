"""The runs of a scenario: its fields under dotted names, and the grid of sweep, sample, payloads and references."""

from __future__ import annotations

import hashlib
import itertools
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from pydantic import BaseModel

from workbench.control import Events, Settings
from workbench.core.errors import InputError, nearest
from workbench.core.record import Duration, Finite, Payload, Record
from workbench.core.run import Array
from workbench.core.yaml_strict import Place, checked, put
from workbench.machines import AnyKind, Machine, kind_of, load_of
from workbench.references import Plan, RecordedPlan, motion_time_s, plan_motion, planned_kind
from workbench.references.plan import StoppedPlan
from workbench.references.shape import LimitPair, Step
from workbench.study.scenario import IN_METRES, LIMITS, WAYS, Scenario, distributions, draws, key_in, listed

Value = float | bool | str
Assigned = Mapping[str, Value]
PARTS = ("numbers", "machine", "moves", "limits", "controller", "events", "solver")
ROOTS = ("limits", "moves", "controller", "drive", "machine", "events", "effects", "solver")
NO_FIELDS = (
    "format", "kind", "name", "identified", "tolerances", "effects", "allowances", "measured_correction", "log",
)  # fmt: skip
# Fields that change which motions are possible.
MOTION = (
    "machine.rail.", "machine.wire.segment_length_m", "machine.gearbox.", "machine.winch.drum_diameter_m",
    "machine.motor.nominal_speed_rad_s", "limits.", "moves[", "start_position", "lead_s", "settle_s",
)  # fmt: skip
MOST_CACHED, MOST_RUNS, LONGEST_ID = 4096, 1_000_000, 140
MOST_MOTIONS = 5_000  # motions whose times are reckoned one by one
LONGEST_S = 3600.0


class Numbers(Record):
    """The fields of a run that stand in no block."""

    payload_kg: Payload | None = None
    start_position_m: Finite | None = None
    lead_s: Duration
    settle_s: Duration


NUMBERS = tuple(Numbers.model_fields)


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
        kind, hoist = kind_of(self.machine), kind_of(self.machine).payload
        limits = [key_in(kind.moved.unit, name) for name in LIMITS]
        blocks = {
            "limits": [*limits, *(f"{way}.{name}" for way in WAYS for name in limits if hoist)],
            **{f"moves[{i}]": list(move.model_dump(exclude_none=True)) for i, move in enumerate(self.scenario.moves)},
            "controller": _leaves(type(self.scenario.controller)),
            "drive": _leaves(type(self.machine.drive)),
            "machine": _leaves(type(self.machine)),
            "events": _leaves(Events) if hoist else [],
            "effects": [f"{effect}.{name}" for effect, values in self.machine.effects.items() for name in values],
            "solver": ["step_s"],
        }
        numbers = [key_in(kind.moved.unit, name) for name in NUMBERS[0 if hoist else 1 :]]
        return (*numbers, *(f"{root}.{name}" for root, own in blocks.items() for name in own))

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
            hint = f"fields are {', '.join(NUMBERS)} and those of {', '.join(ROOTS)}"
        raise InputError(f"unknown field '{name}'; {hint}")

    def value(self, name: str) -> float | None:
        """A field's own number; None where it has none, or not one only."""

        def own() -> float | None:
            root, path = split(name)
            value: Any = self.parts({})[root]
            if value is None:
                return None
            if root == "limits":
                key = IN_METRES.get(str(path[-1]), str(path[-1]))
                both = {getattr(getattr(value, str(way)), key) for way in (path[:-1] or WAYS)}
                return both.pop() if len(both) == 1 else None
            value = [m.model_dump() for m in self.scenario.moves] if root == "moves" else value.model_dump()
            for part in path:
                value = None if value is None else value[part]
            return float(value) if isinstance(value, int | float) else None

        number: float | None = self._kept(("value", name), own)
        return number

    def parts(self, assigned: Assigned) -> dict[str, Any]:
        """By PARTS, with these fields set. InputError with the field's name as place where one does not fit."""
        by_root: dict[str, tuple[tuple[str, Value], ...]] = dict.fromkeys(PARTS, ())
        for name, value in assigned.items():
            by_root[split(name)[0]] += ((name, value),)
        return {root: self._kept((root, items), lambda: self._part(root, items)) for root, items in by_root.items()}  # noqa: B023

    def _kept(self, key: tuple[Any, ...], make: Callable[[], Any]) -> Any:
        if key not in self._cache:
            if len(self._cache) >= MOST_CACHED:
                self._cache.clear()
            self._cache[key] = make()
        return self._cache[key]

    def _part(self, root: str, items: Sequence[tuple[str, Any]]) -> Any:
        scenario = self.scenario
        changes = [(name, split(name)[1], value) for name, value in items]
        if root == "moves":
            moves = list(scenario.moves)
            for name, (number, *key), value in changes:
                moves[int(number)] = _changed(moves[int(number)], [(name, tuple(key), value)])
            return tuple(move.step() for move in moves)
        if root == "numbers":
            own = Numbers(start_position_m=scenario.start, lead_s=scenario.lead_s, settle_s=scenario.settle_s)
            return _changed(own, changes)
        if root == "limits":  # a field without a direction sets both, one with a direction goes over it
            changes.sort(key=lambda change: len(change[1]))
            cleared = [(name, (way, *path), None) for name, path, _ in changes if len(path) == 1 for way in WAYS]
            return _changed(scenario.limits, [*cleared, *changes]).pair()
        return _changed(self.machine if root == "machine" else getattr(scenario, root), changes)


def _leaves(model: type[BaseModel], prefix: str = "") -> list[str]:
    """Dotted names of a record's values, those of optional blocks included."""
    names: list[str] = []
    for name, info in model.model_fields.items():
        kinds = (info.annotation, *getattr(info.annotation, "__args__", ()))
        block = next((kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)), None)
        if prefix or name not in NO_FIELDS:
            names += _leaves(block, f"{prefix}{name}.") if block is not None else [f"{prefix}{name}"]
    return names


@lru_cache(maxsize=MOST_CACHED)
def split(name: str) -> tuple[str, Place]:
    """The part a field belongs to and its place in that: drive.overload is machine's drive, overload."""
    root, _, rest = name.partition(".")
    if not rest:
        return "numbers", (IN_METRES.get(name, name),)
    if root in ("drive", "effects"):
        return "machine", (root, *rest.split("."))
    if root.startswith("moves["):
        return "moves", (int(root[6:-1]), rest)
    return root, tuple(rest.split("."))


def _changed(record: Any, items: Sequence[tuple[str, Place, Any]]) -> Any:
    """A record with fields (name, place, value) set to other values, checked as the file is."""
    if not items:
        return record
    data = record.model_dump()
    for _, path, value in items:
        put(data, path, value)
    try:
        return checked(type(record), data)
    except InputError as error:
        ends = error.place or ""
        named = next((name for name, *_ in items if ends and name.endswith(ends)), items[0][0])
        raise InputError(error.problem if named.endswith(ends) else f"{ends}: {error.problem}", place=named) from error


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
    step_s: float = 0.001
    plant: str = "lumped"
    record_every: int = 10
    recording: Recording | None = None
    assigned: Mapping[str, float | str] = field(default_factory=dict)
    problem: str = ""

    @property
    def bounds(self) -> LimitPair:
        """The limits of a planned motion, which has some."""
        assert self.limits is not None
        return self.limits

    def plan(self) -> Plan:
        """The motion; equal motions are planned once. InputError where it is not possible."""
        if self.problem:
            raise InputError(self.problem)
        rail, events = kind_of(self.machine).looped.rail(self.machine), self.events
        plan: Plan
        if self.recording is not None:
            plan = _recorded_plan(self.recording, rail, self.lead_s, self.settle_s)
        else:
            check_speed(self.bounds, self.machine)
            kind = planned_kind(self.reference)
            load = load_of(self.machine, self.payload_kg) if kind.needs_load or kind.uses_load else None
            plan = _planned(
                self.reference, self.moves, self.start_position_m, self.bounds, rail, self.lead_s, self.settle_s, load
            )
        if events.emergency_stop_s is None or events.emergency_deceleration_m_s2 is None:
            return plan
        return _stopped(plan, events.emergency_stop_s, events.emergency_deceleration_m_s2)


_planned = lru_cache(maxsize=256)(plan_motion)
_stopped = lru_cache(maxsize=256)(StoppedPlan)


@lru_cache(maxsize=16)
def _recorded_plan(recording: Recording, rail: tuple[float, float], lead_s: float, settle_s: float) -> RecordedPlan:
    r = recording
    return RecordedPlan(
        r.label, r.time_s, r.speed_m_s, r.start_position_m, rail, lead_s=lead_s, settle_s=settle_s,
        smoothing_s=r.smoothing_s,
    )  # fmt: skip


def check_speed(limits: LimitPair, machine: Machine) -> None:
    """InputError where a speed limit is beyond what the machine allows."""
    kind = kind_of(machine)
    top, key = kind.looped.top_speed(machine), key_in(kind.moved.unit, "speed_m_s")
    for way in WAYS:
        speed = getattr(limits, way).speed_m_s
        if speed > top.speed * (1.0 + 1e-9):
            most = f"expected at most {int(top.speed * 1000.0) / 1000.0:g} {kind.moved.speed_unit}"
            place = f"limits.{key}" if limits.hoisting == limits.lowering else f"limits.{way}.{key}"
            raise InputError(f"{top.reason.format(limit=speed)}; {most}", place=place)


@dataclass(frozen=True)
class GridAxis:
    """One direction of the grid of runs: fields that change together, and their values point by point.

    values: (points, fields). labels: how a run's id names each point. relative: of drawn fields, whether the value is
    a factor.
    """

    names: tuple[str, ...]
    values: Sequence[Sequence[Value]]
    labels: Sequence[str]
    relative: tuple[bool, ...] = ()

    def __len__(self) -> int:
        return len(self.values)

    @property
    def sampled(self) -> bool:
        return bool(self.relative)

    @cached_property
    def worded(self) -> tuple[str, ...]:
        """Fields of which some value is a word."""
        columns = zip(self.names, zip(*self.values, strict=True), strict=True)
        return tuple(name for name, values in columns if any(isinstance(value, str) for value in values))

    @property
    def moves(self) -> bool:
        """Whether it changes the motion."""
        return any(name.startswith(MOTION) for name in self.names)

    def place(self, name: str, number: int | None = None) -> str:
        """Where a field stands in the scenario, or one of its values."""
        if self.sampled:
            return f"sample.values.{name}"
        return f"sweep.{'zip.' if len(self.names) > 1 else ''}{name}{'' if number is None else f'[{number}]'}"

    def ends(self) -> list[int]:
        """The points at which a field of the axis is smallest or largest."""
        points = {0, len(self) - 1}
        for column in zip(*self.values, strict=True):
            if all(isinstance(value, float) for value in column):
                points |= {int(np.argmin(column)), int(np.argmax(column))}
        return sorted(points)


def swept(scenario: Scenario, fields: Fields) -> Iterator[GridAxis]:
    """One axis for each swept field, and one for all under `zip`. InputError names the field that does not fit."""
    if scenario.sweep is None:
        return
    grid = {name: listed(values) for name, values in scenario.sweep.grid.items()}
    together = {name: listed(values) for name, values in scenario.sweep.zip.items()}
    for name in (*grid, *together):
        place = f"sweep.{'zip.' if name in together else ''}{name}"
        try:
            fields.check_name(name)
        except InputError as error:
            raise InputError(error.problem, place=place) from error
        if name in grid and name in together:
            raise InputError("is swept by itself too", place=f"sweep.zip.{name}")
    if len({len(values) for values in together.values()}) > 1:
        said = ", ".join(f"{name} {len(values)}" for name, values in together.items())
        raise InputError(f"lists of unequal length cannot be walked together: {said}", place="sweep.zip")
    short = _short_names((*grid, *together))
    for columns in ({name: values} for name, values in grid.items()):
        yield _axis(columns, short, f"sweep.{next(iter(columns))}")
    if together:
        yield _axis(together, short, "sweep.zip")


def _axis(columns: Mapping[str, list[Value]], short: Mapping[str, str], place: str) -> GridAxis:
    points = list(zip(*columns.values(), strict=True))
    if twice := [point for point, count in Counter(points).items() if count > 1]:
        words = ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in twice[0])
        raise InputError(f"{words} stands there twice; once is enough", place=place)
    labels = zip(*([f"{short[name]}_{x}" for x in labels_of(values)] for name, values in columns.items()), strict=True)
    return GridAxis(tuple(columns), points, ["_".join(parts) for parts in labels])


def sampled(scenario: Scenario, fields: Fields, machine: Machine) -> Iterator[GridAxis]:
    """The axis of the draws, if there are any. InputError names the field that cannot be drawn."""
    block = scenario.sample
    if block is None:
        return
    taken = {name for axis in swept(scenario, fields) for name in axis.names}
    chosen = distributions(block, machine)
    for name, distribution in chosen.items():
        listed_payloads = name == "payload_kg" and scenario.payloads_kg is not None
        try:
            fields.check_name(name)
            if name in taken and not distribution.relative:
                raise InputError("is swept too; drawn about the swept value it needs relative: true")
            if distribution.relative and not (name in taken or listed_payloads or fields.value(name) is not None):
                raise InputError("has no value of its own to be multiplied; draw it without relative")
            if listed_payloads and not distribution.relative:
                raise InputError("payloads_kg lists payloads; leave it out, or draw with relative: true")
        except InputError as error:
            raise InputError(error.problem, place=f"sample.values.{name}") from error
    values = draws(block, chosen, scenario.seed if block.seed is None else block.seed).tolist()
    digits = len(str(block.count - 1))
    relative = tuple(distribution.relative for distribution in chosen.values())
    yield GridAxis(tuple(chosen), values, [f"s{k:0{digits}d}" for k in range(block.count)], relative)


def labels_of(values: Sequence[Value]) -> list[str]:
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


def _word(value: Value) -> str:
    return value if isinstance(value, str) else f"{value:.15g}"


def _short_names(names: Sequence[str]) -> dict[str, str]:
    """Each field by its last words, as many as tell it from the others."""
    words = {name: re.findall(r"[A-Za-z0-9_]+", name) for name in names}
    short: dict[str, str] = {}
    for name, parts in words.items():
        others = [other for key, other in words.items() if key != name]
        known = (k for k in range(1, len(parts)) if all(other[-k:] != parts[-k:] for other in others))
        short[name] = "-".join(parts[-next(known, len(parts)) :])
    return short


@dataclass(frozen=True)
class RunList(Sequence[RunSpec]):
    """The runs of a scenario by number: sweep points, of each the draws, of each payloads, of each references.

    Numbers and ids follow from the scenario alone; any slice can be had without the rest.
    """

    fields: Fields
    axes: tuple[GridAxis, ...]
    recordings: Mapping[str, Recording]
    duration_s: float = math.nan

    @property
    def scenario(self) -> Scenario:
        return self.fields.scenario

    @cached_property
    def payloads(self) -> list[tuple[float | None, str]]:
        """Each with its name in ids."""
        loads = self.scenario.payloads_kg
        return [(None, "")] if loads is None else [(x, f"{word}kg") for x, word in zip(loads, labels_of(loads))]  # noqa: B905

    @cached_property
    def shape(self) -> tuple[int, ...]:
        return (*map(len, self.axes), len(self.payloads), len(self.scenario.references))

    def __len__(self) -> int:
        return math.prod(self.shape)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self._spec(i) for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"run {index} of {len(self)}")
        return self._spec(index % len(self))

    def _spec(self, index: int) -> RunSpec:
        *at, place, kind = map(int, np.unravel_index(index, self.shape))
        points = list(zip(self.axes, at, strict=True))
        payload, label = self.payloads[place]
        swept, sampled = self.assigned(points, payload)
        problem = ""
        try:
            parts = self.fields.parts(swept | sampled)
        except InputError as error:
            # Each value fits by itself; these do not fit together. The run is a row that says so.
            parts, problem = self.fields.parts({}), str(error)
        scenario, reference, own = self.scenario, self.scenario.kinds[kind], parts["numbers"]
        recording, outputs = self.recordings.get(reference), self.scenario.outputs
        start = own.start_position_m if recording is None else recording.start_position_m
        thinned = max(1, round(outputs.every_s / parts["controller"].sample_time_s))
        run_id = "_".join(filter(None, [label, reference, *(axis.labels[k] for axis, k in points)]))
        if len(run_id) > LONGEST_ID:
            run_id = "_".join(filter(None, (label, reference, hashlib.sha256(run_id.encode()).hexdigest()[:16])))
        # A column of the index holds numbers, or words where any of its values is one.
        words = {name for axis in self.axes if not axis.sampled for name in axis.worded}
        assigned = {f"sweep.{name}": _word(x) if name in words else float(x) for name, x in swept.items()}
        assigned |= {f"sample.{name}": float(value) for name, value in sampled.items()}
        return RunSpec(
            run_id=run_id,
            scenario=scenario.name,
            payload_kg=(payload or 0.0) if own.payload_kg is None else own.payload_kg,
            start_position_m=start or 0.0,
            reference=reference,
            lead_s=own.lead_s,
            settle_s=own.settle_s,
            duration_s=self.duration_s,
            step_s=parts["solver"].step_s,
            plant=scenario.plant,
            record_every={"none": 0, "full": 1}.get(outputs.signals, thinned),
            recording=recording,
            assigned=assigned,
            problem=problem,
            **{part: parts[part] for part in ("machine", "moves", "limits", "controller", "events")},
        )

    def assigned(
        self, points: Iterable[tuple[GridAxis, int]], payload: float | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """What sweep and sample set at points of axes; drawn factors are multiplied out."""
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


def plan_runs(scenario: Scenario, machine: Machine, recordings: Mapping[str, Recording] | None = None) -> RunList:
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
    for axis in axes:
        for name, *column in zip(axis.names, *axis.values, strict=True):
            _check_values(axis, name, column, fields)
    return replace(specs, duration_s=_common_duration_s(specs))


def _check_values(axis: GridAxis, name: str, column: Sequence[Any], fields: Fields) -> None:
    """Each value by itself, the rest as the file has it; of drawn ones the smallest and the largest."""
    chosen: Iterable[int] = range(len(column))
    factor: float | None = 1.0
    if axis.sampled:
        chosen = (int(np.argmin(column)), int(np.argmax(column)))
        factor = fields.value(name) if axis.relative[axis.names.index(name)] else 1.0
    for k in chosen if factor is not None else ():
        try:
            fields.parts({name: column[k] * factor if axis.sampled else column[k]})
        except InputError as error:
            # Where something else does not fit with it, other swept values may yet mend that.
            if error.place == name:
                note = f" (draw {k})" if axis.sampled else ""
                raise InputError(error.problem + note, place=axis.place(name, k)) from error


def _common_duration_s(specs: RunList) -> float:
    """How long each run is: as the slowest of all motions.

    Up to 5,000 different motions are reckoned one by one, of more those at the ends of each axis; a run
    that should take longer still is longer. A value that no run can move with, and a motion that is
    possible in no run, are an InputError.
    """
    moving = [axis for axis in specs.axes if axis.moves]
    many = math.prod(map(len, moving)) > MOST_MOTIONS
    times: list[float] = []
    works: set[tuple[int, int]] = set()  # (axis, point)
    errors: dict[tuple[int, int], InputError] = {}
    first: InputError | None = None
    for at in itertools.product(*(axis.ends() if many else range(len(axis)) for axis in moving)):
        swept, sampled = specs.assigned(zip(moving, at, strict=True))
        parts = None
        try:
            parts = specs.fields.parts(swept | sampled)
            times.append(_time_s(specs, parts))
        except InputError as error:
            first = first or error
            if parts is not None:
                errors = dict.fromkeys(enumerate(at), error) | errors
                continue  # else it does not fit with the file's own values; other swept ones may mend that
        works.update(enumerate(at))
    if first is not None and not times:
        raise first
    for i, k in sorted(errors.keys() - works):
        axis, why = moving[i], errors[i, k]
        if not axis.sampled:
            together = len(axis.names) > 1
            said = why.problem if why.place in axis.names or together else f"{why.place}: {why.problem}"
            raise InputError(said, place="sweep.zip" if together else axis.place(axis.names[0], k)) from why
    # A slip of a zero would fill the memory: the longest sensible duty cycle is an hour.
    if max(times) > LONGEST_S:
        raise InputError(f"the moves take {max(times):.0f} s, expected at most {LONGEST_S:.0f} s", place="moves")
    return max(times)


def _time_s(specs: RunList, parts: Mapping[str, Any]) -> float:
    scenario, machine, limits, own = specs.scenario, parts["machine"], parts["limits"], parts["numbers"]
    times = [r.time_s[-1] - r.time_s[0] + r.smoothing_s for r in specs.recordings.values()]
    if kinds := scenario.planned_kinds:
        start = own.start_position_m
        if limits is None or start is None:
            key = key_in(kind_of(machine).moved.unit, "start_position_m")
            raise InputError("is missing", place="limits" if limits is None else key)
        check_speed(limits, machine)
        # The heaviest load swings slowest, and what is shaped for it takes longest.
        payload = max(scenario.payloads_kg or (0.0,)) if own.payload_kg is None else own.payload_kg
        rail = kind_of(machine).looped.rail(machine)
        times.append(motion_time_s(kinds, parts["moves"], start, limits, rail, load_of(machine, payload)))
    return float(own.lead_s + float(max(times)) + own.settle_s)
