"""Bounds of the quantities of such machines: one type for each, with the reason for its bounds.

Wider than any machine that is built, so that no honest value is refused; narrow enough that a slip of units or a
damaged file is refused where it stands, and that no arithmetic on them overflows. docs/bounds.md lists them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

MM, MS = "is it in millimetres?", "is it in milliseconds?"
LARGEST = 1e15


@dataclass(frozen=True)
class Because:
    """Why a quantity's bounds are where they are, and what the slip may be when a value lies beyond them."""

    reason: str
    hint: str = ""


# Any number of a file; what has bounds of its own has another type below.
_ANY = Because("the largest of any quantity here in SI units is a modulus of elasticity, 1e12 Pa")
Positive = Annotated[float, Field(ge=1e-12, le=LARGEST, strict=True, allow_inf_nan=False), _ANY]
NotNegative = Annotated[float, Field(ge=0.0, le=LARGEST, strict=True, allow_inf_nan=False), _ANY]
Finite = Annotated[float, Field(ge=-LARGEST, le=LARGEST, strict=True, allow_inf_nan=False), _ANY]

_LENGTH = Because("from a shim to several times the deepest hoist, which is 3 km", MM)
Length = Annotated[float, Field(ge=1e-4, le=1e4, strict=True, allow_inf_nan=False), _LENGTH]
Gap = Annotated[float, Field(ge=0.0, le=1e4, strict=True, allow_inf_nan=False), _LENGTH]
Position = Annotated[float, Field(ge=-1e4, le=1e4, strict=True, allow_inf_nan=False), _LENGTH]
Area = Annotated[
    float, Field(ge=1e-9, le=1.0, strict=True, allow_inf_nan=False),
    Because("from a hair to a wire that is a metre thick", "is it in mm²?"),
]  # fmt: skip
Mass = Annotated[
    float, Field(ge=1e-6, le=1e7, strict=True, allow_inf_nan=False),
    Because("from a milligram to ten thousand tonnes", "is it in kg?"),
]  # fmt: skip
Inertia = Annotated[
    float, Field(ge=1e-9, le=1e9, strict=True, allow_inf_nan=False),
    Because("from a watch's motor to a slewing crane", "is it in kg m²?"),
]  # fmt: skip
_FORCE = Because("the strongest machines give some 1e8 N or N m")
Force = Annotated[float, Field(ge=1e-6, le=1e9, strict=True, allow_inf_nan=False), _FORCE]
Level = Annotated[float, Field(ge=0.0, le=1e9, strict=True, allow_inf_nan=False), _FORCE]
Offset = Annotated[float, Field(ge=-1e9, le=1e9, strict=True, allow_inf_nan=False), _FORCE]
Slope = Annotated[
    float, Field(ge=0.0, le=1e12, strict=True, allow_inf_nan=False),
    Because("the largest force at the smallest speed that is measured, 1e-3"),
]  # fmt: skip
Sharpness = Annotated[
    float, Field(ge=1e-3, le=1e7, strict=True, allow_inf_nan=False),
    Because("friction that turns within 1e-7 m/s is a step, one that turns within 1000 m/s is viscous"),
]  # fmt: skip
Standstill = Annotated[
    float, Field(ge=1e-9, le=1e3, strict=True, allow_inf_nan=False),
    Because("no encoder shows less, no machine here turns faster"),
]  # fmt: skip
Speed = Annotated[
    float, Field(ge=1e-6, le=1e5, strict=True, allow_inf_nan=False),
    Because("the fastest spindles turn at 1e5 rad/s, nothing here moves at 1e5 m/s"),
]  # fmt: skip
Ratio = Annotated[
    float, Field(ge=1e-3, le=1e5, strict=True, allow_inf_nan=False),
    Because("gearboxes of several stages reach some 1e4"),
]  # fmt: skip
Modulus = Annotated[
    float, Field(ge=1e5, le=1e13, strict=True, allow_inf_nan=False),
    Because("from rubber, 1e6 Pa, to diamond, 1e12 Pa", "is it in GPa or N/mm²?"),
]  # fmt: skip
Stiffness = Annotated[
    float, Field(ge=1e-3, le=1e14, strict=True, allow_inf_nan=False),
    Because("a modulus times an area over a length"),
]  # fmt: skip
Gravity = Annotated[
    float, Field(ge=1e-3, le=300.0, strict=True, allow_inf_nan=False),
    Because("the sun's is 274 m/s²"),
]  # fmt: skip
Gain = Annotated[
    float, Field(ge=1e-3, le=1e3, strict=True, allow_inf_nan=False),
    Because("a sensor that is off by more than a thousand is in another unit"),
]  # fmt: skip
Tolerance = Annotated[
    float, Field(ge=0.0, le=10.0, strict=True, allow_inf_nan=False),
    Because("relative: ten standard deviations of its own size leave a value open", "is it in per cent?"),
]  # fmt: skip
RollerPlay = Annotated[
    float, Field(ge=0.0, le=0.05, strict=True, allow_inf_nan=False),
    Because("a roller with five centimetres of play has left its rail", MM),
]  # fmt: skip
FrictionCoefficient = Annotated[
    float, Field(ge=0.0, le=1.0, strict=True, allow_inf_nan=False),
    Because("rollers resist with some 0.001 to 0.05 of their load, a blocked one slides with less than 1"),
]  # fmt: skip
Overload = Annotated[
    float, Field(ge=1e-3, le=100.0, strict=True, allow_inf_nan=False),
    Because("short-time overloads of motors are below ten times the nominal torque", "is it in per cent?"),
]  # fmt: skip
Lag = Annotated[
    float, Field(ge=0.0, le=10.0, strict=True, allow_inf_nan=False),
    Because("lags of drives and of damping are milliseconds, seconds at most", MS),
]  # fmt: skip
Delay = Annotated[
    float, Field(ge=0.0, le=0.2, strict=True, allow_inf_nan=False),
    Because("ten cycles of the slowest field bus; a speed loop is of no use behind more", MS),
]  # fmt: skip
Cycle = Annotated[
    float, Field(ge=1e-3, le=86400.0, strict=True, allow_inf_nan=False),
    Because("motors and drives warm up within a day", MS),
]  # fmt: skip
Duration = Annotated[
    float, Field(ge=0.0, le=3600.0, strict=True, allow_inf_nan=False),
    Because("a run takes an hour at most", MS),
]  # fmt: skip
Moment = Annotated[
    float, Field(ge=0.0, le=1e9, strict=True, allow_inf_nan=False),
    Because("thirty years", MS),
]  # fmt: skip
Backlash = Annotated[
    float, Field(ge=0.0, le=10.0, strict=True, allow_inf_nan=False),
    Because("more than a turn is no play", "is it in degrees?"),
]  # fmt: skip
Acceleration = Annotated[
    float, Field(ge=1e-6, le=1e5, strict=True, allow_inf_nan=False),
    Because("ten thousand times gravity"),
]  # fmt: skip
Jerk = Annotated[
    float, Field(ge=1e-6, le=1e9, strict=True, allow_inf_nan=False),
    Because("the largest acceleration within a tenth of a millisecond"),
]  # fmt: skip
Frequency = Annotated[
    float, Field(ge=1e-6, le=1e6, strict=True, allow_inf_nan=False),
    Because("a hundred times the fastest controller's rate"),
]  # fmt: skip
KpGain = Annotated[
    float, Field(ge=1e-9, le=1e9, strict=True, allow_inf_nan=False),
    Because("the largest torque at an error of 1 rad/s"),
]  # fmt: skip
KiGain = Annotated[
    float, Field(ge=0.0, le=1e13, strict=True, allow_inf_nan=False),
    Because("the largest proportional gain, reset at every sample of 0.1 ms"),
]  # fmt: skip
RateLimit = Annotated[
    float, Field(ge=1e-6, le=1e13, strict=True, allow_inf_nan=False),
    Because("the largest torque within a sample of 0.1 ms"),
]  # fmt: skip
TrackingTime = Annotated[
    float, Field(ge=1e-4, le=1e6, strict=True, allow_inf_nan=False),
    Because("below a sample of 0.1 ms the integral would be driven beyond its aim", MS),
]  # fmt: skip
Payload = Annotated[
    float, Field(ge=0.0, le=1e6, strict=True, allow_inf_nan=False),
    Because("no hoist lifts a thousand tonnes", "is it in kg?"),
]  # fmt: skip
