"""Records of YAML files: frozen, strict about keys, with quantities that know their bounds.

A number within its bounds is finite and physically possible; what lies beyond is another unit or a slip. The bounds
are wide, so that every machine stands, and that no arithmetic on them overflows. docs/bounds.md lists them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, GetJsonSchemaHandler, JsonValue
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

MM, MS = "is it in millimetres?", "is it in milliseconds?"
LARGEST = 1e15


@dataclass(frozen=True)
class Because:
    """Why a quantity's bounds are where they are, and what the slip may be when a value lies beyond them."""

    reason: str
    hint: str = ""


def within(least: float, largest: float, reason: str, hint: str = "") -> tuple[Any, ...]:
    """What the annotation of a finite number within bounds holds beside `float`; see `Because`."""
    return Field(ge=least, le=largest, strict=True, allow_inf_nan=False), Because(reason, hint)


# Any number of a file; what has bounds of its own has another type below.
_ANY = "the largest of any quantity here in SI units is a modulus of elasticity, 1e12 Pa"
Positive = Annotated[float, *within(1e-12, LARGEST, _ANY)]
NotNegative = Annotated[float, *within(0.0, LARGEST, _ANY)]
Finite = Annotated[float, *within(-LARGEST, LARGEST, _ANY)]

_LENGTH = "from a shim to several times the deepest hoist, which is 3 km", MM
Length = Annotated[float, *within(1e-4, 1e4, *_LENGTH)]
Gap = Annotated[float, *within(0.0, 1e4, *_LENGTH)]
Position = Annotated[float, *within(-1e4, 1e4, *_LENGTH)]
Start = Annotated[float, *within(-1e7, 1e7, "a height, or the angle of a motor after many turns", MM)]
Area = Annotated[float, *within(1e-9, 1.0, "from a hair to a wire that is a metre thick", "is it in mm²?")]
Mass = Annotated[float, *within(1e-6, 1e7, "from a milligram to ten thousand tonnes", "is it in kg?")]
Inertia = Annotated[float, *within(1e-9, 1e9, "from a watch's motor to a slewing crane", "is it in kg m²?")]
_FORCE = "the strongest machines give some 1e8 N or N m"
Force = Annotated[float, *within(1e-6, 1e9, _FORCE)]
Level = Annotated[float, *within(0.0, 1e9, _FORCE)]
Offset = Annotated[float, *within(-1e9, 1e9, _FORCE)]
Slope = Annotated[float, *within(0.0, 1e12, "the largest force at the smallest speed that is measured, 1e-3")]
Sharpness = Annotated[
    float,
    *within(1e-3, 1e7, "friction that turns within 1e-7 m/s is a step, one that turns within 1000 m/s is viscous"),
]
Standstill = Annotated[float, *within(1e-9, 1e3, "no encoder shows less, no machine here turns faster")]
Speed = Annotated[float, *within(1e-6, 1e5, "the fastest spindles turn at 1e5 rad/s, nothing here moves at 1e5 m/s")]
Ratio = Annotated[float, *within(1e-3, 1e5, "gearboxes of several stages reach some 1e4")]
Modulus = Annotated[float, *within(1e5, 1e13, "from rubber, 1e6 Pa, to diamond, 1e12 Pa", "is it in GPa or N/mm²?")]
Stiffness = Annotated[float, *within(1e-3, 1e14, "a modulus times an area over a length")]
Gravity = Annotated[float, *within(1e-3, 300.0, "the sun's is 274 m/s²")]
Gain = Annotated[float, *within(1e-3, 1e3, "a sensor that is off by more than a thousand is in another unit")]
Tolerance = Annotated[
    float,
    *within(0.0, 10.0, "relative: ten standard deviations of its own size leave a value open", "is it in per cent?"),
]
RollerPlay = Annotated[float, *within(0.0, 0.05, "a roller with five centimetres of play has left its rail", MM)]
FrictionCoefficient = Annotated[
    float,
    *within(0.0, 1.0, "rollers resist with some 0.001 to 0.05 of their load, a blocked one slides with less than 1"),
]
Overload = Annotated[
    float,
    *within(1e-3, 100.0, "short-time overloads of motors are below ten times the nominal torque", "is it in per cent?"),
]
Lag = Annotated[float, *within(0.0, 10.0, "lags of drives and of damping are milliseconds, seconds at most", MS)]
Delay = Annotated[
    float, *within(0.0, 0.2, "ten cycles of the slowest field bus; a speed loop is of no use behind more", MS)
]
Cycle = Annotated[float, *within(1e-3, 86400.0, "motors and drives warm up within a day", MS)]
Duration = Annotated[float, *within(0.0, 3600.0, "a run takes an hour at most", MS)]
Moment = Annotated[float, *within(0.0, 1e9, "thirty years", MS)]
Backlash = Annotated[float, *within(0.0, 10.0, "more than a turn is no play", "is it in degrees?")]
Acceleration = Annotated[float, *within(1e-6, 1e5, "ten thousand times gravity")]
Jerk = Annotated[float, *within(1e-6, 1e9, "the largest acceleration within a tenth of a millisecond")]
Frequency = Annotated[float, *within(1e-6, 1e6, "a hundred times the fastest controller's rate")]
KpGain = Annotated[float, *within(1e-9, 1e9, "the largest torque at an error of 1 rad/s")]
KiGain = Annotated[float, *within(0.0, 1e13, "the largest proportional gain, reset at every sample of 0.1 ms")]
RateLimit = Annotated[float, *within(1e-6, 1e13, "the largest torque within a sample of 0.1 ms")]
TrackingTime = Annotated[
    float, *within(1e-4, 1e6, "below a sample of 0.1 ms the integral would be driven beyond its aim", MS)
]
Payload = Annotated[float, *within(0.0, 1e6, "no hoist lifts a thousand tonnes", "is it in kg?")]


EffectValues = Mapping[str, Mapping[str, Finite]]
Identified = Mapping[str, JsonValue]


class Record(BaseModel):
    """A block of a YAML file. An unknown key, a number as text or a value out of range is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


class LogTraits(Record):
    """What belongs to the recording and not to the machine.

    speed_late_s: by how much the logged motion is later than the logged input, s. of_runs: run -> effect -> parameters
    that are each run's own, such as the phase of a heave.
    """

    speed_late_s: Duration = 0.0
    of_runs: Mapping[str, Mapping[str, Mapping[str, Finite]]] = Field(default_factory=dict)


def long_form(data: object, block: str, key: str) -> object:
    """`name: word` in a block is short for `name: {key: word}`."""
    if not isinstance(data, dict) or not isinstance(short := data.get(block), dict):
        return data
    return {**data, block: {name: {key: value} if isinstance(value, str) else value for name, value in short.items()}}


def renamed(data: object, other: str, canonical: str) -> object:
    """A mapping with key `other` under its canonical name. Both at once is a ValueError."""
    if not isinstance(data, dict) or other not in data:
        return data
    if canonical in data:
        raise ValueError(f"'{other}' and '{canonical}' mean the same; give one of them")
    return {canonical if key == other else key: value for key, value in data.items()}


@dataclass(frozen=True, eq=False)
class _Named:
    """The name stands for the block, in the file and in its JSON schema."""

    blocks: Mapping[str, BaseModel]

    def block(self, value: Any) -> Any:
        if not isinstance(value, str):
            return value
        if value not in self.blocks:
            raise ValueError(f"'{value}', expected a block or one of {', '.join(self.blocks)}")
        return self.blocks[value].model_dump()

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"anyOf": [{"enum": list(self.blocks)}, handler(core)]}


def by_name(blocks: Mapping[str, BaseModel]) -> tuple[Any, ...]:
    """What a field's annotation holds beside its type."""
    named = _Named(blocks)
    return BeforeValidator(named.block), named
