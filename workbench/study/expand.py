"""All runs of a scenario, made one by one when they are asked for."""

from __future__ import annotations

import hashlib
import itertools
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import overload

import numpy as np

from workbench.errors import InputError
from workbench.machine import Hoist
from workbench.references import motion_time_s
from workbench.run import Array
from workbench.study.axes import listed
from workbench.study.draw import distributions, draws
from workbench.study.fields import Fields, Parts
from workbench.study.scenario import Scenario
from workbench.study.spec import Recording, RunSpec, check_speed

Assigned = dict[str, float | bool | str]
MOST_RUNS = 1_000_000
MOST_MOTIONS = 5_000  # motions whose times are reckoned one by one
LONGEST_ID = 140
# Values of the machine that change which motions are possible.
_MOTION = (
    "machine.rail.",
    "machine.wire.segment_length_m",
    "machine.gearbox.",
    "machine.winch.drum_diameter_m",
    "machine.motor.nominal_speed_rad_s",
    "limits.",
    "moves[",
    "start_position_m",
    "lead_s",
    "settle_s",
)


@dataclass(frozen=True)
class Axis:
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


@dataclass(frozen=True)
class Expansion(Sequence[RunSpec]):
    """The runs of a scenario by number: sweep points, of each the draws, of each payloads, of each references.

    Numbers and ids follow from the scenario alone; any slice can be had without the rest.
    """

    fields: Fields
    axes: tuple[Axis, ...]
    recordings: Mapping[str, Recording]
    duration_s: float = math.nan
    _payloads: tuple[tuple[float | None, str], ...] = field(init=False)

    def __post_init__(self) -> None:
        payloads = self.scenario.payloads_kg
        labels = _labels(payloads) if payloads is not None else [""]
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
        rest, load = divmod(rest, len(self._payloads))
        at = []
        for axis in reversed(self.axes):
            rest, k = divmod(rest, len(axis))
            at.append(k)
        payload, label = self._payloads[load]
        swept, sampled = self.assigned(at[::-1], payload)
        problem = ""
        try:
            parts = self.fields.parts(swept | sampled)
        except InputError as error:
            # Each value fits by itself; these do not fit together. The run is a row that says so.
            parts, problem = self.fields.parts({}), str(error)
        return self._resolved(parts, at[::-1], kind, payload, label, swept, sampled, problem)

    def _resolved(
        self, parts: Parts, at: Sequence[int], kind: int, payload: float | None, label: str,
        swept: Assigned, sampled: Assigned, problem: str,
    ) -> RunSpec:  # fmt: skip
        scenario = self.scenario
        reference = scenario.kinds[kind]
        recording = self.recordings.get(reference)
        load = parts.payload_kg if parts.payload_kg is not None else payload
        start = recording.start_position_m if recording is not None else parts.start_position_m
        return RunSpec(
            run_id=self._run_id(label, reference, at),
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
            record_every=_record_every(scenario, parts),
            recording=recording,
            assigned={f"sweep.{name}": _column(value) for name, value in swept.items()}
            | {f"sample.{name}": _column(value) for name, value in sampled.items()},
            problem=problem,
        )

    def assigned(self, at: Sequence[int], payload: float | None) -> tuple[Assigned, Assigned]:
        """What sweep and sample set at a point of the axes; drawn factors are multiplied out."""
        return self._set(zip(self.axes, at, strict=True), payload)

    def _set(self, points: Iterable[tuple[Axis, int]], payload: float | None) -> tuple[Assigned, Assigned]:
        swept: Assigned = {}
        sampled: Assigned = {}
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

    def motion_parts(self, points: Iterable[tuple[Axis, int]]) -> Parts:
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


def expand(scenario: Scenario, machine: Hoist, recordings: Mapping[str, Recording] | None = None) -> Expansion:
    """The runs of a scenario on its machine (overrides, drive and effects in it), checked without running any.

    Raises InputError, with the field or `sweep.<field>` as place, for an unknown field, a value that fits
    nowhere, lists of unequal length under zip, too many runs, and a motion that is possible in no run.
    """
    fields = Fields(scenario, machine)
    axes = (*_swept(scenario, fields), *_sampled(scenario, fields, machine))
    specs = Expansion(fields, axes, recordings or {})
    if len(specs) > MOST_RUNS:
        place = "sweep" if scenario.sweep is not None else "sample"
        raise InputError(f"makes {len(specs):,} runs, expected at most {MOST_RUNS:,}", place=place)
    _check_values(axes, fields)
    return replace(specs, duration_s=_common_duration_s(specs))


def _swept(scenario: Scenario, fields: Fields) -> Iterator[Axis]:
    if scenario.sweep is None:
        return
    grid = scenario.sweep.grid
    together = {name: listed(values) for name, values in scenario.sweep.zip.items()}
    for name in (*grid, *together):
        try:
            fields.check_name(name)
        except InputError as error:
            raise InputError(error.problem, place=_place(name, name in together)) from error
    if both := [name for name in together if name in grid]:
        raise InputError("is swept by itself too", place=_place(both[0], True))
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
) -> Axis:
    points = list(zip(*columns, strict=True))
    twice = [point for point, count in Counter(points).items() if count > 1]
    if twice:
        place = _place(one, False) if one else "sweep.zip"
        raise InputError(f"{', '.join(map(_words, twice[0]))} stands there twice; once is enough", place=place)
    words = [_labels(column) for column in columns]
    labels = [
        "_".join(f"{short[n]}_{column[k]}" for n, column in zip(names, words, strict=True)) for k in range(len(points))
    ]
    return Axis(names, points, labels)


def _sampled(scenario: Scenario, fields: Fields, machine: Hoist) -> Iterator[Axis]:
    block = scenario.sample
    if block is None:
        return
    swept = {name for axis in _swept(scenario, fields) for name in axis.names}
    chosen = distributions(block, machine)
    for name, each in chosen.items():
        try:
            fields.check_name(name)
            if name in swept and not each.relative:
                raise InputError("is swept too; drawn about the swept value it needs relative: true")
            if each.relative and name not in swept and not _has_value(name, scenario, fields):
                raise InputError("has no value of its own to be multiplied; draw it without relative")
            if name == "payload_kg" and not each.relative and scenario.payloads_kg is not None:
                raise InputError("payloads_kg lists payloads; leave it out, or draw with relative: true")
        except InputError as error:
            raise InputError(error.problem, place=f"sample.values.{name}") from error
    seed = scenario.seed if block.seed is None else block.seed
    values: Array = draws(block, chosen, seed)
    digits = len(str(block.count - 1))
    yield Axis(
        tuple(chosen),
        values.tolist(),
        [f"s{k:0{digits}d}" for k in range(block.count)],
        sampled=True,
        relative=tuple(each.relative for each in chosen.values()),
    )


def _has_value(name: str, scenario: Scenario, fields: Fields) -> bool:
    return scenario.payloads_kg is not None if name == "payload_kg" else fields.value(name) is not None


def _check_values(axes: Sequence[Axis], fields: Fields) -> None:
    """Each value by itself, the rest as the file has it; of drawn ones the smallest and the largest."""
    for axis in axes:
        for column, name in enumerate(axis.names):
            if not axis.sampled:
                for k, point in enumerate(axis.values):
                    _try({name: point[column]}, fields, f"{_place(name, len(axis.names) > 1)}[{k}]", name)
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


def _common_duration_s(specs: Expansion) -> float:
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
            place = "sweep.zip" if together else f"{_place(axis.names[0], False)}[{k}]"
            said = why.problem if why.place in axis.names or together else f"{why.place}: {why.problem}"
            raise InputError(said, place=place) from why
    # A slip of a zero would fill the memory: the longest sensible duty cycle is an hour.
    if longest > 3600.0:
        raise InputError(f"the moves take {longest:.0f} s, expected at most 3600 s", place="moves")
    return longest


def _time_s(specs: Expansion, parts: Parts) -> float:
    scenario, machine = specs.scenario, parts.machine
    rail = (machine.rail.lowest_position_m, machine.highest_position_m)
    times = [r.time_s[-1] - r.time_s[0] + r.smoothing_s for r in specs.recordings.values()]
    if kinds := scenario.planned_kinds:
        if parts.limits is None or parts.start_position_m is None:
            raise InputError("is missing", place="limits" if parts.limits is None else "start_position_m")
        check_speed(parts.limits, machine)
        times.append(motion_time_s(kinds, parts.moves, parts.start_position_m, parts.limits, rail))
    return parts.lead_s + float(max(times)) + parts.settle_s


def _ends(axis: Axis) -> list[int]:
    """The points at which a field of the axis is smallest or largest."""
    found = {0, len(axis) - 1}
    for column in range(len(axis.names)):
        values = [point[column] for point in axis.values]
        if all(isinstance(value, float) for value in values):
            found |= {int(np.argmin(np.array(values))), int(np.argmax(np.array(values)))}
    return sorted(found)


def _record_every(scenario: Scenario, parts: Parts) -> int:
    outputs = scenario.outputs
    if outputs.signals == "none":
        return 0
    return 1 if outputs.signals == "full" else max(1, round(outputs.every_s / parts.controller.sample_time_s))


def _column(value: float | bool | str) -> float | str:
    """Index columns hold numbers or words."""
    return value if isinstance(value, str) else float(value)


def _place(name: str, together: bool) -> str:
    return f"sweep.zip.{name}" if together else f"sweep.{name}"


def _words(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _labels(values: Sequence[float | bool | str]) -> list[str]:
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
    found: dict[str, str] = {}
    for name, parts in words.items():
        for count in range(1, len(parts) + 1):
            tail = parts[-count:]
            if all(other == name or each[-count:] != tail for other, each in words.items()):
                break
        found[name] = "-".join(tail)
    return found
