"""Units as drives write them, with their quantity and factor to SI."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

# unit, lower case and without blanks, dots and asterisks -> (quantity, factor to SI)
UNITS: Mapping[str, tuple[str, float]] = MappingProxyType(
    {
        "s": ("time", 1.0), "sec": ("time", 1.0), "ms": ("time", 1e-3), "µs": ("time", 1e-6), "us": ("time", 1e-6),
        "nm": ("torque", 1.0), "knm": ("torque", 1e3), "mnm": ("torque", 1e-3),
        "rad/s": ("turning", 1.0), "1/s": ("turning", 2.0 * math.pi), "deg/s": ("turning", math.pi / 180.0),
        "°/s": ("turning", math.pi / 180.0), "rpm": ("turning", math.pi / 30.0), "1/min": ("turning", math.pi / 30.0),
        "min-1": ("turning", math.pi / 30.0), "u/min": ("turning", math.pi / 30.0),
        "r/min": ("turning", math.pi / 30.0),
        "m": ("length", 1.0), "mm": ("length", 1e-3), "cm": ("length", 1e-2), "µm": ("length", 1e-6),
        "m/s": ("speed", 1.0), "mm/s": ("speed", 1e-3), "m/min": ("speed", 1.0 / 60.0),
        "mm/min": ("speed", 1e-3 / 60.0),
        "n": ("force", 1.0), "kn": ("force", 1e3), "dan": ("force", 10.0), "t": ("force", 9806.65),
        "rad": ("angle", 1.0), "deg": ("angle", math.pi / 180.0), "°": ("angle", math.pi / 180.0),
        "rev": ("angle", 2.0 * math.pi),
    }
)  # fmt: skip
# The ending of a signal's name -> the quantity that it is.
OF_SIGNALS: Mapping[str, str] = MappingProxyType(
    {
        "_rad_s": "turning",
        "_m_s": "speed",
        "_nm": "torque",
        "_rad": "angle",
        "_n": "force",
        "_m": "length",
        "_s": "time",
    }
)


def unit_of(text: str) -> tuple[str, float] | None:
    """(quantity, factor) of a unit as written; None where it is not known."""
    plain = text.strip().lower()
    for sign in (" ", "·", "*", "⋅"):
        plain = plain.replace(sign, "")
    return UNITS.get(plain)


def quantity_of(signal: str) -> str:
    """What a signal is, by the unit in its name."""
    ending = max((e for e in OF_SIGNALS if signal.endswith(e)), key=len)
    return OF_SIGNALS[ending]
