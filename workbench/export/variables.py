"""The variables of an exported model: name, unit, range, meaning; parameters as machine.yaml declares them.

Units stand at the end of names: `rotor_inertia_kg_m2` is in kg m2. As FMI takes them: exponents of base units.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from operator import attrgetter
from types import MappingProxyType
from typing import Any, Literal

import annotated_types as bounds
from pydantic import BaseModel

from workbench.effects import Effect, sizes_of
from workbench.machines import Axis, Hoist

Exponents = Mapping[str, int]

# Ending of a name -> (unit, exponents of its base units). Longer endings stand before those that they end with.
ENDINGS: Mapping[str, tuple[str, Exponents]] = MappingProxyType(
    {
        "nm_s_per_rad": ("N.m.s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
        "nm_per_rad": ("N.m/rad", {"kg": 1, "m": 2, "s": -2, "rad": -1}),
        "nm_per_s": ("N.m/s", {"kg": 1, "m": 2, "s": -3}),
        "nm_s2": ("N.m.s2", {"kg": 1, "m": 2}),
        "n_per_s": ("N/s", {"kg": 1, "m": 1, "s": -3}),
        "n_s_per_m": ("N.s/m", {"kg": 1, "s": -1}),
        "n_s2_per_m2": ("N.s2/m2", {"kg": 1, "m": -1}),
        "n_per_m": ("N/m", {"kg": 1, "s": -2}),
        "kg_per_m": ("kg/m", {"kg": 1, "m": -1}),
        "s_per_m": ("s/m", {"s": 1, "m": -1}),
        "per_m": ("1/m", {"m": -1}),
        "per_rad": ("1/rad", {"rad": -1}),
        "per_s": ("1/s", {"s": -1}),
        "kg_m2": ("kg.m2", {"kg": 1, "m": 2}),
        "rad_s2": ("rad/s2", {"rad": 1, "s": -2}),
        "rad_s": ("rad/s", {"rad": 1, "s": -1}),
        "m_s3": ("m/s3", {"m": 1, "s": -3}),
        "m_s2": ("m/s2", {"m": 1, "s": -2}),
        "m_s": ("m/s", {"m": 1, "s": -1}),
        "nm": ("N.m", {"kg": 1, "m": 2, "s": -2}),
        "kg": ("kg", {"kg": 1}),
        "hz": ("Hz", {"s": -1}),
        "pa": ("Pa", {"kg": 1, "m": -1, "s": -2}),
        "m2": ("m2", {"m": 2}),
        "rad": ("rad", {"rad": 1}),
        "n": ("N", {"kg": 1, "m": 1, "s": -2}),
        "m": ("m", {"m": 1}),
        "s": ("s", {"s": 1}),
    }
)
BASE: Mapping[str, Exponents] = MappingProxyType(dict(ENDINGS.values()))


# Unit -> (what a person reads, how much of it is one of the unit).
DISPLAYED: Mapping[str, tuple[str, float]] = MappingProxyType(
    {
        "rad/s": ("rpm", 30.0 / math.pi), "rad": ("deg", 180.0 / math.pi), "N": ("kN", 1e-3), "Pa": ("GPa", 1e-9),
        "N/m": ("kN/m", 1e-3),
    }
)  # fmt: skip


def unit_of(name: str) -> str:
    """The unit that a name ends with, "" for a plain number."""
    last = name.rpartition(".")[2]
    for ending, (unit, _) in ENDINGS.items():
        if last == ending or last.endswith(f"_{ending}"):
            return unit
    return ""


def over_time(unit: str) -> str:
    """The unit of a derivative by time: of rad rad/s, of rad/s rad/s2; "" where there is no name for it."""
    if unit not in BASE:
        return ""
    wanted = {**BASE[unit], "s": BASE[unit].get("s", 0) - 1}
    wanted = {base: power for base, power in wanted.items() if power}
    return next((name for name, exponents in BASE.items() if dict(exponents) == wanted), "")


Causality = Literal["independent", "input", "parameter", "calculatedParameter", "output", "local"]
Variability = Literal["continuous", "discrete", "tunable", "fixed"]

# What the values of machine.yaml mean, by their key; keys as docs/formats.md has them.
MEANINGS: Mapping[str, str] = MappingProxyType(
    {
        "motor.count": "number of equal motors on the gearbox",
        "motor.rotor_inertia_kg_m2": "inertia of one motor's rotor",
        "gearbox.ratio": "motor speed over drum speed",
        "winch.drum_diameter_m": "diameter of the drum",
        "winch.pin_diameter_m": "diameter of the drum's pin",
        "winch.inertia_kg_m2": "inertia of what turns with the drum",
        "winch.mass_kg": "mass of what turns with the drum",
        "sheave.diameter_m": "diameter of the sheave on the carriage",
        "sheave.pin_diameter_m": "diameter of the sheave's pin",
        "sheave.inertia_kg_m2": "inertia of the sheave",
        "sheave.mass_kg": "mass of the sheave",
        "bearing.pin_friction_coefficient": "friction coefficient of both pins",
        "wire.youngs_modulus_pa": "Young's modulus of the wire",
        "wire.effective_area_m2": "metallic area of the wire",
        "wire.segment_length_m": "height of the dead anchor above carriage height 0",
        "wire.damping_time_s": "damping over stiffness of the wire",
        "carriage.mass_kg": "mass of the empty carriage",
        "guide.coulomb_hoisting_n": "friction level of the guide, hoisting",
        "guide.coulomb_lowering_n": "friction level of the guide, lowering",
        "guide.atan_slope_s_per_m": "how fast the guide's friction turns over at standstill",
        "gravity_m_s2": "gravity",
        "sensors.payload_scale": "true over stated payload",
        "payload_kg": "stated payload",
        "mass_kg": "mass of the axis",
        "inertia_kg_m2": "inertia of the axis",
        "gravity.constant_n": "constant load, against forward motion positive",
        "gravity.constant_nm": "constant load, against forward motion positive",
        "gravity.sine_nm": "load in proportion to the sine of the angle",
        "motor.inertia_kg_m2": "inertia of what turns with the motor",
        "coupling.stiffness_nm_per_rad": "stiffness of the coupling",
        "coupling.damping_nm_s_per_rad": "damping of the coupling",
        "coupling.backlash_rad": "play of the coupling, from flank to flank",
        "load.inertia_kg_m2": "inertia of the load, as the motor feels it",
        "boom.inertia_kg_m2": "inertia of the boom about the slewing ring's axis",
        "payload.mass_kg": "mass that the boom holds",
        "payload.radius_m": "distance of the payload from the slewing ring's axis",
        "load.gravity.sine_nm": "load in proportion to the sine of the load's angle",
        "load.gravity.constant_nm": "constant load, against forward motion positive",
    }
)
# The same three values of every friction block.
_FRICTION = {
    "coulomb_forward": "Coulomb friction, forward",
    "coulomb_backward": "Coulomb friction, backward",
    "viscous": "viscous friction",
    "standstill_speed": "speed below which the Coulomb friction falls to zero",
}


@dataclass(frozen=True)
class Range:
    """What a value may be; above: `lowest` itself is not allowed, below: nor is `highest`."""

    lowest: float = -math.inf
    highest: float = math.inf
    above: bool = False
    below: bool = False
    whole: bool = False


ANY = Range()
POSITIVE = Range(0.0, above=True)
NOT_NEGATIVE = Range(0.0)
_DOMAINS = {"any": ANY, "positive": POSITIVE, "not_negative": NOT_NEGATIVE}


@dataclass(frozen=True)
class Variable:
    """One variable. kind and index: the array of the C code where its value stands, and where there.

    unit: as in `units`; None is taken from the name. derivative_of: the state that it is the derivative of.
    """

    name: str
    meaning: str
    causality: Causality
    variability: Variability
    kind: Literal["TIME", "INPUT", "PARAMETER", "SHOWN"]
    index: int
    start: float | None = None
    range: Range = ANY
    boolean: bool = False
    given_unit: str | None = None
    derivative_of: str | None = None

    @property
    def unit(self) -> str:
        if self.boolean:
            return ""
        return unit_of(self.name) if self.given_unit is None else self.given_unit


@dataclass(frozen=True)
class Value:
    """A parameter before it has its place: the symbol of the equations, and the name, start and range outside."""

    symbol: str
    name: str
    meaning: str
    start: float
    range: Range = ANY
    tunable: bool = False


def machine_value(machine: Hoist | Axis, symbol: str, key: str, payload_kg: float) -> Value:
    """A parameter of the plant; its range is the one that machine.yaml has."""
    if key == "payload_kg":
        return Value(symbol, key, meaning_of(key), payload_kg, NOT_NEGATIVE, tunable=True)
    return Value(symbol, key, meaning_of(key), float(attrgetter(key)(machine)), range_of(type(machine), key))


def meaning_of(key: str) -> str:
    """What a value of machine.yaml means. KeyError for one that is not described."""
    if key in MEANINGS:
        return MEANINGS[key]
    block, _, last = key.rpartition(".")
    if not block.endswith("friction"):
        raise KeyError(key)
    what = next(meaning for start, meaning in _FRICTION.items() if last.startswith(start))
    side = block.removesuffix("friction").removesuffix(".")
    return f"{what}, of the {side}" if side else what


def range_of(record: type[BaseModel], key: str) -> Range:
    """What machine.yaml allows for a value, from its record's declaration."""
    inside: Any = record
    *blocks, last = key.split(".")
    for block in blocks:
        inside = inside.model_fields[block].annotation
    field = inside.model_fields[last]
    low, high, above, below = -math.inf, math.inf, False, False
    for rule in field.metadata:
        match rule:
            case bounds.Gt(gt):
                low, above = float(gt), True  # type: ignore[arg-type]
            case bounds.Ge(ge):
                low = float(ge)  # type: ignore[arg-type]
            case bounds.Lt(lt):
                high, below = float(lt), True  # type: ignore[arg-type]
            case bounds.Le(le):
                high = float(le)  # type: ignore[arg-type]
    return Range(low, high, above, below, whole=field.annotation is int)


def effect_values(machine: Hoist | Axis, effect: Effect, kind: str, values: Mapping[str, float]) -> list[Value]:
    """The parameters of an effect at work; values: by symbol."""
    names = {ranged.symbol: ranged.name for ranged in effect.ranges(sizes_of(machine))}
    return [
        Value(
            effect.symbol(parameter, kind),
            f"effects.{effect.id}.{names[effect.symbol(parameter, kind)]}",
            f"{effect.id.replace('_', ' ')}: {parameter.meaning}",
            float(values[effect.symbol(parameter, kind)]),
            _DOMAINS[parameter.domain],
        )
        for parameter in effect.parameters
    ]
