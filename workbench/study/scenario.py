"""What a scenario varies: `sweep`, over listed values and ranges, and `sample`, from distributions.
Draws of uncertain fields: evenly spread points of the unit cube, mapped by each field's distribution."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import Annotated, Any, Literal

import numpy as np
import pydantic
from pydantic import AfterValidator, ConfigDict, Field, JsonValue, PlainValidator, field_validator, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from workbench.control import SETTINGS, Events
from workbench.control.settings import AnyController
from workbench.core.errors import InputError, nearest
from workbench.core.record import Acceleration, Duration, Finite, Jerk, NotNegative, Position, Positive, Record, Speed
from workbench.core.run import Array
from workbench.machines import RECORDS, Machine, get_value, kind_of, of_kind
from workbench.machines.kinds.axis import LinearDrive, RotaryDrive
from workbench.machines.kinds.hoist import BY_NAME, Drive
from workbench.references import planned_kind, planned_kinds, recorded_kinds
from workbench.references.kind import ReferenceKind, usual_kinds
from workbench.references.shape import LimitPair, Limits, Step

MOST_VALUES = 100_000


def _plain(value: Any) -> Any:
    if isinstance(value, bool | str):
        return value
    if isinstance(value, int | float) and math.isfinite(value):
        return float(value)
    raise ValueError(f"{value!r}, expected a finite number, a word, true or false")


# One validator for all three, so that one wrong value is one complaint.
Value = Annotated[float | bool | str, PlainValidator(_plain, json_schema_input_type=float | bool | str)]


class RangeBlock(Record):
    """Numbers from `from` to `to`, both included: `steps` of them, or one every `step`; linear, or in equal ratios."""

    model_config = ConfigDict(serialize_by_alias=True)

    from_: Annotated[Finite, Field(alias="from")]
    to: Finite
    steps: Annotated[int, Field(ge=2, le=MOST_VALUES, strict=True)] | None = None
    step: Positive | None = None
    scale: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _whole(self) -> RangeBlock:
        if (self.steps is None) == (self.step is None):
            raise ValueError("expected either steps, how many numbers, or step, how far apart they lie")
        if self.from_ == self.to:
            raise ValueError(f"from and to are both {self.to:g}, expected two numbers")
        if self.scale == "log":
            if self.step is not None:
                raise ValueError("a logarithmic range goes in equal ratios: give steps in place of step")
            if min(self.from_, self.to) <= 0.0:
                raise ValueError(f"a logarithmic range from {self.from_:g} to {self.to:g}, expected numbers above 0")
        if self.step is not None:
            number = abs(self.to - self.from_) / self.step
            if number > MOST_VALUES:
                raise ValueError(f"holds {number:.3g} numbers, expected at most {MOST_VALUES}")
            if abs(number - round(number)) > 1e-6 * max(number, 1.0):
                raise ValueError(
                    f"steps of {self.step:g} from {self.from_:g} do not meet {self.to:g}; "
                    f"expected a whole number of steps, or steps: {round(number) + 1}"
                )
        return self

    def values(self) -> list[float]:
        """The numbers, rounded to twelve digits so that 0.1 · 3 reads 0.3; the ends are exact."""
        low, high = self.from_, self.to
        count = self.steps if self.steps is not None else round(abs(high - low) / (self.step or 1.0)) + 1
        spaced = np.geomspace if self.scale == "log" else np.linspace
        return [low, *(float(f"{value:.12g}") for value in spaced(low, high, count)[1:-1]), high]


def _some(values: tuple[Any, ...], most: int = MOST_VALUES) -> tuple[Any, ...]:
    if not 1 <= len(values) <= most:
        raise ValueError(f"holds {len(values)} values, expected 1 to {most}")
    return values


Listed = Annotated[tuple[Value, ...], AfterValidator(_some), Field(json_schema_extra={"minItems": 1})]
AxisValues = Annotated[
    Annotated[Listed, pydantic.Tag("list")] | Annotated[RangeBlock, pydantic.Tag("range")],
    pydantic.Discriminator(lambda value: "range" if isinstance(value, dict | RangeBlock) else "list"),
]


def listed(values: tuple[Value, ...] | RangeBlock) -> list[Value]:
    """The values of one axis."""
    return list(values.values()) if isinstance(values, RangeBlock) else list(values)


class SweepBlock(Record):
    """field: values, for every field that is swept; each is combined with each.

    Fields under `zip` are walked together: first values, second values, …; they are one axis.
    """

    model_config = ConfigDict(extra="allow", frozen=True)
    __pydantic_extra__: dict[str, AxisValues]

    zip: dict[str, AxisValues] = Field(default_factory=dict)

    @property
    def grid(self) -> dict[str, tuple[Value, ...] | RangeBlock]:
        return dict(self.__pydantic_extra__ or {})


_NEEDS = {
    "uniform": ("low", "high"),
    "normal": ("mean", "std"),
    "lognormal": ("median", "sigma"),
    "triangular": ("low", "mode", "high"),
}


class Distribution(Record):
    """One drawn field. With `relative: true` the number drawn multiplies the field's own value.

    uniform: low, high. normal: mean, std. lognormal: median, and sigma, the standard deviation of
    the logarithm. triangular: low, mode, high.
    """

    distribution: Literal["uniform", "normal", "lognormal", "triangular"]
    relative: bool = False
    low: Finite | None = None
    high: Finite | None = None
    mode: Finite | None = None
    mean: Finite | None = None
    std: Positive | None = None
    median: Positive | None = None
    sigma: Positive | None = None

    @model_validator(mode="after")
    def _whole(self) -> Distribution:
        needs = _NEEDS[self.distribution]
        given = [n for n in ("low", "high", "mode", "mean", "std", "median", "sigma") if getattr(self, n) is not None]
        for name in given:
            if name not in needs:
                raise ValueError(f"a {self.distribution} distribution has no {name}; {nearest(name, needs)}")
        if missing := [name for name in needs if name not in given]:
            raise ValueError(f"a {self.distribution} distribution needs {' and '.join(needs)}; missing: {missing[0]}")
        order = [getattr(self, name) for name in needs]
        if "low" in needs and not (order == sorted(order) and order[0] < order[-1]):
            raise ValueError(f"expected {' <= '.join(needs)}, got {', '.join(f'{x:g}' for x in order)}")
        return self


class SampleBlock(Record):
    """Draws from distributions; every draw runs at every point of the sweep, so that points compare.

    tolerances: draw what the machine's tolerances name, each normal about its nominal value.
    seed: the scenario's own when missing.
    """

    count: Annotated[int, Field(ge=1, le=MOST_VALUES * 10, strict=True)]
    method: Literal["latin_hypercube", "sobol"] = "latin_hypercube"
    seed: Annotated[int, Field(ge=0, strict=True)] | None = None
    tolerances: bool = False
    values: dict[str, Distribution] = Field(default_factory=dict)

    @field_validator("tolerances", mode="before")
    @classmethod
    def _a_switch(cls, value: object) -> object:
        if not isinstance(value, bool):
            raise ValueError(f"{value!r}, expected true or false")
        return value

    @model_validator(mode="after")
    def _whole(self) -> SampleBlock:
        if not self.tolerances and not self.values:
            raise ValueError("draws nothing; expected values: or tolerances: true")
        if self.method == "sobol" and self.count & (self.count - 1):
            below = 1 << (self.count.bit_length() - 1)
            raise ValueError(
                f"{self.count} draws of a Sobol sequence are not balanced; expected a power of two, "
                f"{below} or {2 * below}"
            )
        return self


def distributions(block: SampleBlock, machine: Machine) -> dict[str, Distribution]:
    """What is drawn: the machine's tolerances where asked for, and what `values` names, which goes over them."""
    drawn: dict[str, Distribution] = {}
    if block.tolerances:
        kind = kind_of(machine)
        for name in kind.looped.drawn:
            base = kind.base_value(name)
            std = getattr(machine.tolerances, base.tolerance) if base is not None else 0.0
            if std > 0.0 and get_value(machine, name) != 0.0:
                drawn[f"machine.{name}"] = Distribution(distribution="normal", relative=True, mean=1.0, std=std)
        if not drawn:
            raise InputError("every tolerance of the machine is 0, nothing to draw", place="sample.tolerances")
    return drawn | block.values


def draws(block: SampleBlock, chosen: Mapping[str, Distribution], seed: int) -> Array:
    """(count, fields): the numbers drawn, factors where a distribution is relative. The seed decides them."""
    from scipy import stats
    from scipy.stats import qmc

    if block.method == "sobol" and len(chosen) > qmc.Sobol.MAXDIM:
        raise InputError(f"{len(chosen)} fields, a Sobol sequence has at most {qmc.Sobol.MAXDIM}", place="sample")
    sequence = qmc.Sobol if block.method == "sobol" else qmc.LatinHypercube
    points = np.clip(sequence(len(chosen), rng=seed).random(block.count), 2.0**-53, 1.0 - 2.0**-53)
    made = {
        "normal": lambda d: stats.norm(d.mean, d.std),
        "lognormal": lambda d: stats.lognorm(d.sigma, scale=d.median),
        "uniform": lambda d: stats.uniform(d.low, d.high - d.low),
        "triangular": lambda d: stats.triang((d.mode - d.low) / (d.high - d.low), d.low, d.high - d.low),
    }
    columns = [made[d.distribution](d).ppf(points[:, k]) for k, d in enumerate(chosen.values())]
    return np.stack(columns, axis=-1)


class _Names:
    """Adds the names of the known kinds to the JSON schema, as they are when the schema is made."""

    def __init__(self, kinds: Callable[[], Mapping[str, ReferenceKind]]) -> None:
        self.kinds = kinds

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: pydantic.GetJsonSchemaHandler) -> JsonSchemaValue:
        return handler(core) | {"enum": list(self.kinds())}


def _known_planned(name: str) -> str:
    try:
        return planned_kind(name).name
    except InputError as error:
        raise ValueError(error.problem) from error


def _known_recorded(name: str) -> str:
    if name not in recorded_kinds():
        known = " or ".join(f"'{kind}'" for kind in recorded_kinds())
        raise ValueError(f"'{name}', expected {known}")
    return name


# A length that is checked after the items, so that one wrong item is one complaint.
SOME: dict[str, JsonValue] = {"minItems": 1, "maxItems": 1000}


def _once(values: Sequence[object], what: str) -> None:
    _some(tuple(values), 1000)
    twice = [value for value, count in Counter(values).items() if count > 1]
    if twice:
        raise ValueError(f"{what} {twice[0]} stands there twice; once is enough")


LIMITS = ("speed_m_s", "acceleration_m_s2", "jerk_m_s3")
WAYS = ("hoisting", "lowering")
# Keys of a motion in radians, of a rotary axis -> those in metres.
IN_METRES = {
    "by_rad": "by_m",
    "to_rad": "to_m",
    "speed_rad_s": "speed_m_s",
    "acceleration_rad_s2": "acceleration_m_s2",
    "jerk_rad_s3": "jerk_m_s3",
    "start_position_rad": "start_position_m",
}


@dataclass(frozen=True)
class _OtherUnit:
    """Marks a key that says in radians what another one says in metres; a misspelt key hardly means it."""

    other_unit: bool = True


RAD = _OtherUnit()


def unit_of(key: str) -> str:
    """m or rad, of a motion's key; "" of any other."""
    return "rad" if key in IN_METRES else "m" if key in IN_METRES.values() else ""


def key_in(unit: str, key: str) -> str:
    """A motion's key, given in metres, in that unit."""
    return {metres: name for name, metres in IN_METRES.items()}.get(key, key) if unit == "rad" else key


class MoveBlock(Record):
    """One step: by_m metres up (or down), to_m a carriage height, dwell_s at rest, or a jog.

    A jog goes over to speed_m_s (up positive) and takes for_s until the next step, its ramp included. A rotary axis has
    by_rad, to_rad and speed_rad_s.
    """

    by_m: Position | None = None
    to_m: Position | None = None
    dwell_s: Duration | None = None
    speed_m_s: Finite | None = None
    for_s: Duration | None = None
    by_rad: Annotated[Finite | None, RAD] = None
    to_rad: Annotated[Finite | None, RAD] = None
    speed_rad_s: Annotated[Finite | None, RAD] = None

    @model_validator(mode="after")
    def _one_thing(self) -> MoveBlock:
        try:
            self.step()
        except InputError as error:
            raise ValueError(str(error)) from error
        return self

    def step(self) -> Step:
        """In the unit that the keys name."""
        given = {key: value for key, value in self.model_dump().items() if value is not None}
        if len({unit_of(key) for key in given} - {""}) > 1:
            raise InputError(f"{' and '.join(given)} mix metres and radians")
        return Step(**{IN_METRES.get(key, key): value for key, value in given.items()})


class DirectionLimits(Record):
    """What is other in one direction."""

    speed_m_s: Speed | None = None
    acceleration_m_s2: Acceleration | None = None
    jerk_m_s3: Jerk | None = None
    speed_rad_s: Annotated[Speed | None, RAD] = None
    acceleration_rad_s2: Annotated[Acceleration | None, RAD] = None
    jerk_rad_s3: Annotated[Jerk | None, RAD] = None

    def given(self) -> dict[str, float]:
        """What is given, by the keys in metres."""
        return {IN_METRES.get(k, k): v for k, v in self.model_dump().items() if isinstance(v, float)}


class LimitsBlock(DirectionLimits):
    """Limits of the motion, both ways; what stands in `hoisting` or `lowering` goes over it there.

    The trapezoid does without the jerk. Limits of a rotary axis are in radians.
    """

    hoisting: DirectionLimits = DirectionLimits()
    lowering: DirectionLimits = DirectionLimits()

    def pair(self) -> LimitPair | None:
        """Of both directions; None where nothing is given."""
        both = [self.given() | getattr(self, way).given() for way in WAYS]
        if not any(both):
            return None
        for way, given in zip(WAYS, both, strict=True):
            if lacking := [name for name in LIMITS[:2] if name not in given]:
                raise InputError(f"has no {lacking[0]} for {way}", place="limits")
        try:
            return LimitPair(*(Limits(**given) for given in both))
        except InputError as error:
            raise InputError(error.problem, place=f"limits.{error.place}") from error


class RecordedBlock(Record):
    """A reference out of a campaign: the run's set-point, or its measured speed where none was logged.

    recorded follows it as it is; s_curve follows its moving average over smoothing_s.
    name: as the results call it; the kind when missing.
    """

    kind: Annotated[str, AfterValidator(_known_recorded), _Names(recorded_kinds)]
    campaign: Annotated[str, Field(min_length=1)]
    run: Annotated[str, Field(min_length=1)]
    smoothing_s: Annotated[float, Field(ge=0.001, le=60.0, strict=True, allow_inf_nan=False)] | None = None
    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,39}$")] | None = None

    @model_validator(mode="after")
    def _whole(self) -> RecordedBlock:
        smoothed = [name for name, kind in recorded_kinds().items() if kind.smoothed]
        if (self.kind in smoothed) != (self.smoothing_s is not None):
            only = "that one" if len(smoothed) == 1 else "those"
            raise ValueError(f"smoothing_s belongs to kind {', '.join(smoothed)}, and to {only} only")
        return self

    @property
    def label(self) -> str:
        return self.name or self.kind


PlannedName = Annotated[str, AfterValidator(_known_planned), _Names(planned_kinds)]
Reference = Annotated[
    Annotated[PlannedName, pydantic.Tag("kind")] | Annotated[RecordedBlock, pydantic.Tag("recorded")],
    pydantic.Discriminator(lambda value: "recorded" if isinstance(value, dict | RecordedBlock) else "kind"),
]

# Every key of the drive, none of them needed: what is not given is the machine's.
DriveChanges = pydantic.create_model(
    "DriveChanges",
    __base__=Record,
    __doc__="Changes of the machine's drive, key by key; which keys there are is its kind's.",
    **{
        name: (field.rebuild_annotation() | None, None)
        for drive in (Drive, LinearDrive, RotaryDrive)
        for name, field in drive.model_fields.items()
    },  # type: ignore[call-overload]
)


class CriterionBlock(Record):
    """A criterion of the decision. most, least: limits that nothing may break; weight: 0 leaves it out of the sum."""

    most: Finite | None = None
    least: Finite | None = None
    weight: NotNegative | None = None


class SolverBlock(Record):
    """step_s: the longest step of the plant between two samples of the controller."""

    step_s: Annotated[float, Field(ge=1e-5, le=0.01, strict=True, allow_inf_nan=False)] = 0.001


class OutputsBlock(Record):
    """Which signals each run keeps: none, every sample, or thinned to one sample every `every_s`."""

    signals: Literal["none", "thinned", "full"] = "thinned"
    every_s: Annotated[float, Field(gt=0.0, le=10.0, strict=True, allow_inf_nan=False)] = 0.01


# The name becomes that of a folder.
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]


class Scenario(Record):
    """A scenario, whole. Every payload is run with every reference at every point of sweep and sample.

    machine: `default`, `lightly_damped`, or a machine.yaml, sought beside the file. machine_overrides: its values by
    dotted name or in blocks. plant: the lumped equations, or rigid bodies and joints. drive: the machine's
    drive, key by key. lead_s, settle_s: held at rest before the first and after the last move. extends: another
    scenario that this one goes on from. decide: metric, or torque_reserve_percent, -> its limits and weight in the
    decision. ask: the number that the study is for, sought beside its runs.
    """

    format: Literal[1] = 1
    extends: Annotated[str, Field(min_length=1)] | None = None
    name: Name
    description: str = ""
    machine: Annotated[str, Field(min_length=1)] = "default"
    machine_overrides: dict[str, Any] = Field(default_factory=dict)
    plant: Literal["lumped", "multibody"] = "lumped"
    drive: Annotated[DriveChanges | None, *BY_NAME] = None
    payloads_kg: Annotated[tuple[NotNegative, ...], Field(json_schema_extra=SOME)] | None = None
    start_position_m: Position | None = None
    start_position_rad: Annotated[Finite | None, RAD] = None
    moves: Annotated[tuple[MoveBlock, ...], Field(max_length=1000)] = ()
    limits: LimitsBlock = LimitsBlock()
    references: Annotated[tuple[Reference, ...], Field(json_schema_extra=SOME, default_factory=usual_kinds)]
    controller: AnyController
    events: Events = Events()
    effects: dict[str, dict[str, Finite]] = Field(default_factory=dict)
    lead_s: Duration = 1.0
    settle_s: Duration = 2.0
    solver: SolverBlock = SolverBlock()
    outputs: OutputsBlock = OutputsBlock()
    seed: Annotated[int, Field(ge=0, strict=True)] = 0
    sweep: SweepBlock | None = None
    sample: SampleBlock | None = None
    decide: dict[str, CriterionBlock] = Field(default_factory=dict)
    ask: Literal["largest payload", "highest deceleration", "smallest motor"] | None = None

    @field_validator("payloads_kg")
    @classmethod
    def _payloads_differ(cls, payloads: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if payloads is not None:
            _once(payloads, "payload")
            if max(payloads) > 1e6:
                raise ValueError(f"payload {max(payloads):g} kg is more than a thousand tonnes; is it in kg?")
        return payloads

    @field_validator("references")
    @classmethod
    def _references_differ(cls, references: tuple[str | RecordedBlock, ...]) -> tuple[str | RecordedBlock, ...]:
        _once([reference if isinstance(reference, str) else reference.label for reference in references], "reference")
        return references

    @property
    def start(self) -> float | None:
        """Where it begins, m or rad."""
        return self.start_position_m if self.start_position_rad is None else self.start_position_rad

    @property
    def kinds(self) -> tuple[str, ...]:
        """The references' names, as results carry them."""
        return tuple(item if isinstance(item, str) else item.label for item in self.references)

    @property
    def planned_kinds(self) -> tuple[str, ...]:
        """Those that are planned from moves and limits."""
        return tuple(item for item in self.references if isinstance(item, str))


def check_kind(scenario: Scenario, machine: Machine, varied: set[str]) -> None:
    """InputError, with its place, for what this kind of machine does not have. varied: swept and drawn fields."""
    kind, who = kind_of(machine), of_kind(machine)
    for place in (*_keys(scenario), *sorted(varied)):
        key = place.rpartition(".")[2]
        if unit_of(key) not in ("", kind.moved.unit) and not place.startswith(("machine.", "drive.")):
            expected = key_in(kind.moved.unit, IN_METRES.get(key, key))
            raise InputError(f"{who} moves in {kind.moved.unit}; expected {expected}", place=place)
    own, expected_of = scenario.controller, SETTINGS[kind.name]
    one_way = next((way for way in WAYS if getattr(scenario.limits, way).given()), "")
    wrong: dict[str, tuple[bool, str]] = {
        "controller": (
            not isinstance(own, expected_of),
            f"is of {own.kind!r} with {' and '.join(own.GAINS)}; {who} takes kind: "
            f"{expected_of.model_fields['kind'].default} with {' and '.join(expected_of.GAINS)}",
        )
    }
    if not kind.payload:
        wrong |= {
            "ask": (
                scenario.ask in ("largest payload", "smallest motor"),
                f"'{scenario.ask}' is a question for a hoist; expected 'highest deceleration'",
            ),
            "payloads_kg": (
                scenario.payloads_kg is not None,
                f"{who} carries no payload; leave it out, and sweep machine.{kind.free[0]} for other loads",
            ),
            "events": (scenario.events != Events(), f"{who} has no events; they are of a hoist's motors and brake"),
            "plant": (scenario.plant != "lumped", f"'{scenario.plant}', expected 'lumped' for {who}"),
            f"limits.{one_way}": (bool(one_way), f"{who} has the same limits both ways"),
        }
    for place, (is_so, problem) in wrong.items():
        if is_so:
            raise InputError(problem, place=place)


def _keys(scenario: Scenario) -> Iterator[str]:
    """Places of the motion's keys that are given."""
    blocks: dict[str, Record] = {f"moves[{number}]": move for number, move in enumerate(scenario.moves)}
    blocks |= {"limits": scenario.limits} | {f"limits.{way}": getattr(scenario.limits, way) for way in WAYS}
    for name, block in blocks.items():
        yield from (f"{name}.{key}" for key in block.model_dump(exclude_none=True, exclude={*WAYS}))
    yield from (key for key in ("start_position_m", "start_position_rad") if getattr(scenario, key) is not None)


DIALECT = "https://json-schema.org/draft/2020-12/schema"
KINDS = ("scenario", "machine", "runs")


def json_schema(kind: str) -> dict[str, Any]:
    """The schema of one kind of file, for editors and other tools. kind: one of KINDS."""
    schema = {"scenario": _scenario, "machine": _machine, "runs": _runs}[kind]()
    return {"$schema": DIALECT} | schema | {"title": f"workbench {kind}"}


def _scenario() -> dict[str, Any]:
    schema = Scenario.model_json_schema()
    schema["properties"]["references"]["default"] = list(usual_kinds())
    # A file that extends another has what it needs from there; blocks are then filled from both.
    needed = schema.pop("required")
    schema["if"] = {"required": ["extends"]}
    schema["else"] = {"required": needed}
    forms = schema["$defs"]["PiSettings"], schema["$defs"]["LinearCascade"], schema["$defs"]["RotaryCascade"]
    gains = [form.pop("required") for form in forms]
    schema["properties"]["controller"]["anyOf"] = schema["properties"]["controller"].pop("oneOf")
    needs = [list(names) for names in dict.fromkeys(map(tuple, gains))]
    schema["else"]["properties"] = {"controller": {"anyOf": [{"required": names} for names in needs]}}
    return schema


def _machine() -> dict[str, Any]:
    union: Any = reduce(or_, RECORDS)
    schema = pydantic.TypeAdapter(union).json_schema()
    # `kind` may be left out of the first only, and tells editors which form is meant.
    for name in (record.__name__ for record in RECORDS[1:]):
        record = schema["$defs"][name]
        record["required"] = [*record.get("required", ()), *(k for k in ("kind",) if k not in record["required"])]
    return schema


def _runs() -> dict[str, Any]:
    from workbench.logs.campaign import RunsFile

    schema = RunsFile.model_json_schema()
    # `signal: column` is short for `signal: {column: column}`.
    columns = schema["properties"]["columns"]
    columns["additionalProperties"] = {"anyOf": [{"type": "string"}, columns["additionalProperties"]]}
    return schema
