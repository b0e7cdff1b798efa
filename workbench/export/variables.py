"""The variables of an exported model: name, unit, range, meaning; parameters as machine.yaml declares them.

Units stand at the end of names: `rotor_inertia_kg_m2` is in kg m2. What endings and keys mean is in symbols.yaml.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import annotated_types as bounds
from pydantic import BaseModel

from workbench.core.yaml_strict import load

_BASE = {"N": "kg.m/s2", "Pa": "kg/m.s2", "Hz": "1/s"}  # units that FMI does not take as base units


@cache
def symbols() -> dict[str, dict[str, Any]]:
    """The tables of symbols.yaml."""
    data = load(Path(__file__).with_name("symbols.yaml")).data
    assert isinstance(data, dict)
    return data


def unit_of(name: str) -> str:
    """The unit that a name ends with, "" for a plain number."""
    last = "_" + name.rpartition(".")[2]
    return next((unit for ending, unit in symbols()["endings"].items() if last.endswith(f"_{ending}")), "")


def exponents(unit: str) -> dict[str, int]:
    """Base units with their exponents: {kg: 1, m: 2, s: -2} of N.m."""
    powers: Counter[str] = Counter()
    for sign, side in zip((1, -1), unit.partition("/")[::2], strict=True):
        for factor in (factor for factor in side.split(".") if factor not in ("", "1")):
            name = factor.rstrip("123")
            power = sign * int(factor[len(name) :] or 1)
            for base, inside in (exponents(_BASE[name]) if name in _BASE else {name: 1}).items():
                powers[base] += power * inside
    return {base: powers[base] for base in ("kg", "m", "s", "rad") if powers[base]}


def over_time(unit: str) -> str:
    """The unit of a derivative by time: of rad rad/s, of rad/s rad/s2; "" where there is no name for it."""
    wanted = exponents(f"{unit}.s" if "/" in unit else f"{unit}/s") if unit else {}
    return next((known for known in symbols()["endings"].values() if exponents(known) == wanted), "")


def meaning_of(key: str) -> str:
    """What a value of machine.yaml means. KeyError for one that is not described."""
    if key in symbols()["meanings"]:
        return str(symbols()["meanings"][key])
    block, _, last = key.rpartition(".")
    if not block.endswith("friction"):
        raise KeyError(key)
    what = next(meaning for start, meaning in symbols()["friction"].items() if last.startswith(start))
    side = block.removesuffix("friction").removesuffix(".")
    return f"{what}, of the {side}" if side else what


@dataclass(frozen=True)
class Range:
    """What a value may be; above: `lowest` itself is not allowed, below: nor is `highest`."""

    lowest: float = -math.inf
    highest: float = math.inf
    above: bool = False
    below: bool = False
    whole: bool = False


ANY, POSITIVE, NOT_NEGATIVE = Range(), Range(0.0, above=True), Range(0.0)


def range_of(record: type[BaseModel], key: str) -> Range:
    """What machine.yaml allows for a value, from its record's declaration."""
    inside: Any = record
    *blocks, last = key.split(".")
    for block in blocks:
        inside = inside.model_fields[block].annotation
    field = inside.model_fields[last]
    rules = {type(rule): rule for rule in field.metadata}
    above, below = bounds.Gt in rules, bounds.Lt in rules
    low = rules[bounds.Gt].gt if above else rules[bounds.Ge].ge if bounds.Ge in rules else -math.inf
    high = rules[bounds.Lt].lt if below else rules[bounds.Le].le if bounds.Le in rules else math.inf
    return Range(float(low), float(high), above, below, whole=field.annotation is int)


@dataclass(frozen=True)
class Variable:
    """One variable of the model. symbol: of a parameter, as the equations have it; derivative_of: a state's name."""

    name: str
    meaning: str
    causality: Literal["independent", "input", "parameter", "calculatedParameter", "output", "local"]
    start: float | None = None
    range: Range = ANY
    symbol: str = ""
    tunable: bool = False
    boolean: bool = False
    derivative_of: str | None = None

    @property
    def variability(self) -> str:
        if self.causality in ("parameter", "calculatedParameter"):
            return "tunable" if self.tunable else "fixed"
        return "discrete" if self.boolean else "continuous"

    @property
    def array(self) -> str:
        """The array of the C code where its value stands; its variables stand there in their order."""
        return {"independent": "TIME", "input": "INPUT", "parameter": "PARAMETER"}.get(self.causality, "SHOWN")

    @property
    def unit(self) -> str:
        if self.boolean or self.derivative_of is not None:
            return "" if self.boolean else over_time(unit_of(str(self.derivative_of)))
        return "s" if self.causality == "independent" else unit_of(self.name)
