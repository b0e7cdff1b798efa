"""The scenario file: which machine, what it carries, how it shall move, under which controller."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from workbench.control import PiSettings
from workbench.errors import InputError, nearest
from workbench.machine.record import Finite, NotNegative, Positive, Record
from workbench.references import KINDS, Limits, Step


def _known_reference(name: str) -> str:
    if name not in KINDS:
        raise ValueError(f"unknown reference '{name}'; {nearest(name, KINDS)}")
    return name


def _once(values: Sequence[object], what: str) -> None:
    twice = [value for value, count in Counter(values).items() if count > 1]
    if twice:
        raise ValueError(f"{what} {twice[0]} stands there twice; once is enough")


class MoveBlock(Record):
    """One step: by_m metres up (or down), to_m a carriage height, or dwell_s at rest."""

    by_m: Finite | None = None
    to_m: Finite | None = None
    dwell_s: NotNegative | None = None

    @model_validator(mode="after")
    def _one_thing(self) -> MoveBlock:
        try:
            self.step()
        except InputError as error:
            raise ValueError(str(error)) from error
        return self

    def step(self) -> Step:
        return Step(self.by_m, self.to_m, self.dwell_s)


class LimitsBlock(Record):
    """Limits of the carriage's motion; the trapezoid uses the first two."""

    speed_m_s: Positive
    acceleration_m_s2: Positive
    jerk_m_s3: Positive

    def limits(self) -> Limits:
        return Limits(self.speed_m_s, self.acceleration_m_s2, self.jerk_m_s3)


# The name becomes that of a folder.
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]


class Scenario(Record):
    """A scenario, whole. Every payload is run with every reference.

    machine: `default`, or a machine.yaml, sought beside the scenario file. lead_s, settle_s: held at
    rest before the first and after the last move.
    """

    format: Literal[1] = 1
    name: Name
    description: str = ""
    machine: str = "default"
    payloads_kg: Annotated[tuple[NotNegative, ...], Field(min_length=1, max_length=1000)]
    start_position_m: Finite
    moves: Annotated[tuple[MoveBlock, ...], Field(min_length=1, max_length=1000)]
    limits: LimitsBlock
    references: Annotated[tuple[Annotated[str, AfterValidator(_known_reference)], ...], Field(min_length=1)] = tuple(
        KINDS
    )
    controller: PiSettings
    lead_s: NotNegative = 1.0
    settle_s: NotNegative = 2.0

    @field_validator("payloads_kg")
    @classmethod
    def _payloads_differ(cls, payloads: tuple[float, ...]) -> tuple[float, ...]:
        _once(payloads, "payload")
        # A payload heavier than any hoist lifts is grams or newtons given as kilograms.
        heaviest = max(payloads)
        if heaviest > 1e6 or not math.isfinite(heaviest):
            raise ValueError(f"payload {heaviest:g} kg is more than a thousand tonnes; is it in kg?")
        return payloads

    @field_validator("references")
    @classmethod
    def _references_differ(cls, references: tuple[str, ...]) -> tuple[str, ...]:
        _once(references, "reference")
        return references
