"""The base of all records of machine.yaml: frozen, strict about keys and numbers."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import BaseModel, ConfigDict, JsonValue

from workbench.machine.quantities import Finite

EffectValues = Mapping[str, Mapping[str, Finite]]
Identified = Mapping[str, JsonValue]


class Record(BaseModel):
    """A block of machine.yaml. An unknown key, a number as text or a value out of range is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


def renamed(data: object, other: str, canonical: str) -> object:
    """A mapping with key `other` under its canonical name. Both at once is a ValueError."""
    if not isinstance(data, dict) or other not in data:
        return data
    if canonical in data:
        raise ValueError(f"'{other}' and '{canonical}' mean the same; give one of them")
    return {canonical if key == other else key: value for key, value in data.items()}
