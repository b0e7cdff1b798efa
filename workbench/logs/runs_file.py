"""runs.yaml: the list of runs, and how a log's columns map to signals."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, StringConstraints, field_validator, model_validator

from workbench.core.errors import InputError, nearest
from workbench.core.record import Finite, Payload, Position, Record, long_form
from workbench.core.yaml_strict import Document, dotted, load, validate
from workbench.machines import Axis, Hoist, kind_of

Fail = Callable[..., InputError]
Name = Annotated[str, StringConstraints(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f/\\]+$")]


class Column(Record):
    """signal = scale · column + offset"""

    column: Annotated[str, StringConstraints(min_length=1)]
    scale: Finite = 1.0
    offset: Finite = 0.0

    @field_validator("scale")
    @classmethod
    def _not_zero(cls, value: float) -> float:
        if value == 0.0:
            raise ValueError("0.0, expected a number other than 0: it would erase the signal")
        return value


class Entry(Record):
    """One run as runs.yaml lists it. Some kinds of machine need payload and start position; see `read_runs`."""

    name: Name
    file: Annotated[str, StringConstraints(min_length=1)]
    payload_kg: Payload | None = None
    start_position_m: Position | None = None
    start_time_s: Finite | None = None


class RunsFile(Record):
    """The whole of runs.yaml."""

    format: Literal[1] = 1
    columns: dict[str, Column] = Field(default_factory=dict)
    runs: Annotated[list[Entry], Field(min_length=1)]

    @model_validator(mode="before")
    @classmethod
    def _short_columns(cls, data: object) -> object:
        return long_form(data, "columns", "column")


def read_runs(file: Path, machine: Hoist | Axis, signals: tuple[str, ...]) -> tuple[RunsFile, Document]:
    """runs.yaml, checked against its machine. InputError names file, line and place."""
    document = load(file)
    runs = validate(RunsFile, document)

    def fail(problem: str, *place: str | int) -> InputError:
        return InputError(problem, file=file, line=document.line(place), place=dotted(place))

    for signal in runs.columns:
        if signal not in signals:
            raise fail(f"unknown signal '{signal}'; {nearest(signal, signals)}", "columns", signal)
    seen: dict[str, int] = {}
    for index, entry in enumerate(runs.runs):
        if entry.name in seen:
            first = document.line(("runs", seen[entry.name], "name"))
            raise fail(f"'{entry.name}' is used twice; it names the run on line {first} too", "runs", index, "name")
        seen[entry.name] = index
        _check_entry(entry, index, machine, fail)
    return runs, document


def _check_entry(entry: Entry, index: int, machine: Hoist | Axis, fail: Fail) -> None:
    """Check the keys that runs of this kind of machine need."""
    kind = kind_of(machine)
    if kind.payload and entry.payload_kg is None:
        raise fail(f"run '{entry.name}' needs payload_kg, in kg and at least 0", "runs", index, "payload_kg")
    if kind.start is None:
        return
    if entry.start_position_m is None:
        raise fail(
            f"run '{entry.name}' needs start_position_m, {kind.start.said}", "runs", index, "start_position_m"
        )  # fmt: skip
    low, high, top = kind.start.range(machine)
    if not low <= entry.start_position_m <= high:
        raise fail(
            f"{entry.start_position_m} m, expected {kind.start.noun} from {low:g} to {high} m, {top}",
            "runs", index, "start_position_m",
        )  # fmt: skip
