"""The fields of a scenario under dotted names, and runs built with some of them set to other values."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from pydantic import BaseModel, ValidationError

from workbench.control import Events, Settings
from workbench.core.errors import InputError, nearest
from workbench.core.yaml_strict import Place, dotted, problem_lines
from workbench.machines import AnyKind, Axis, Hoist, kind_of
from workbench.references import LimitPair, Limits, Step
from workbench.study.scenario import IN_METRES, MoveBlock, Scenario, check_payload_kg, key_in

Assigned = Mapping[str, float | bool | str]
_NUMBERS = ("payload_kg", "start_position_m", "lead_s", "settle_s")
_LIMITS = ("speed_m_s", "acceleration_m_s2", "jerk_m_s3")
_NO_FIELDS = (
    "format", "kind", "name", "identified", "tolerances", "effects", "allowances", "measured_correction", "log",
)  # fmt: skip
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
        by_root: dict[str, list[tuple[str, float | bool | str]]] = {}
        for name, value in assigned.items():
            by_root.setdefault(_split(name)[0], []).append((name, value))

        def part(root: str, build: Callable[[Sequence[tuple[str, Any]]], Any]) -> Any:
            items = tuple(by_root.get(root, ()))
            key = (root, items)
            if key not in self._cache:
                if len(self._cache) >= MOST_CACHED:
                    self._cache.clear()
                self._cache[key] = build(items)
            return self._cache[key]

        numbers = {name: part(name, partial(self._number, name)) for name in _NUMBERS}
        return Parts(
            **numbers,
            machine=part("machine", self._machine),
            moves=part("moves", self._moves),
            limits=part("limits", self._limits),
            controller=part("controller", lambda items: _changed(self.scenario.controller, items)),
            events=part("events", lambda items: _changed(self.scenario.events, items)),
            step_s=part("solver", lambda items: _changed(self.scenario.solver, items).step_s),
        )

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

    def _machine(self, items: Sequence[tuple[str, Any]]) -> Hoist | Axis:
        return _changed(self.machine, items) if items else self.machine

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
