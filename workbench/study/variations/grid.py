"""The axes of a study's grid of runs: swept fields, fields walked together, drawn fields."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from workbench.errors import InputError
from workbench.machine import Axis, Hoist
from workbench.run import Array
from workbench.study.scenario.fields import Fields
from workbench.study.scenario.record import Scenario
from workbench.study.variations.axes import listed
from workbench.study.variations.sampling import distributions, draws

# Values of the machine that change which motions are possible.
_MOTION = (
    "machine.rail.",
    "machine.wire.segment_length_m",
    "machine.gearbox.",
    "machine.winch.drum_diameter_m",
    "machine.motor.nominal_speed_rad_s",
    "limits.",
    "moves[",
    "start_position",
    "lead_s",
    "settle_s",
)


@dataclass(frozen=True)
class GridAxis:
    """One direction of the grid of runs: fields that change together, and their values point by point.

    values: (points, fields). labels: how a run's id names each point.
    """

    names: tuple[str, ...]
    values: Sequence[Sequence[float | bool | str]]
    labels: Sequence[str]
    sampled: bool = False
    relative: tuple[bool, ...] = ()

    def __len__(self) -> int:
        return len(self.values)

    @property
    def moves(self) -> bool:
        """Whether it changes the motion."""
        return any(name.startswith(_MOTION) for name in self.names)


def swept(scenario: Scenario, fields: Fields) -> Iterator[GridAxis]:
    """One axis for each swept field, and one for all under `zip`. InputError names the field that does not fit."""
    if scenario.sweep is None:
        return
    grid = scenario.sweep.grid
    together = {name: listed(values) for name, values in scenario.sweep.zip.items()}
    for name in (*grid, *together):
        try:
            fields.check_name(name)
        except InputError as error:
            raise InputError(error.problem, place=place_of(name, name in together)) from error
    if both := [name for name in together if name in grid]:
        raise InputError("is swept by itself too", place=place_of(both[0], True))
    lengths = {name: len(values) for name, values in together.items()}
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise InputError(f"lists of unequal length cannot be walked together: {said}", place="sweep.zip")
    short = _short_names((*grid, *together))
    for name, values in grid.items():
        yield _axis((name,), [listed(values)], short, name)
    if together:
        yield _axis(tuple(together), list(together.values()), short, None)


def _axis(
    names: tuple[str, ...], columns: list[list[float | bool | str]], short: Mapping[str, str], one: str | None
) -> GridAxis:
    points = list(zip(*columns, strict=True))
    twice = [point for point, count in Counter(points).items() if count > 1]
    if twice:
        place = place_of(one, False) if one else "sweep.zip"
        raise InputError(f"{', '.join(map(_words, twice[0]))} stands there twice; once is enough", place=place)
    words = [labels_of(column) for column in columns]
    labels = [
        "_".join(f"{short[n]}_{column[k]}" for n, column in zip(names, words, strict=True)) for k in range(len(points))
    ]
    return GridAxis(names, points, labels)


def sampled(scenario: Scenario, fields: Fields, machine: Hoist | Axis) -> Iterator[GridAxis]:
    """The axis of the draws, if there are any. InputError names the field that cannot be drawn."""
    block = scenario.sample
    if block is None:
        return
    taken = {name for axis in swept(scenario, fields) for name in axis.names}
    chosen = distributions(block, machine)
    for name, distribution in chosen.items():
        try:
            fields.check_name(name)
            if name in taken and not distribution.relative:
                raise InputError("is swept too; drawn about the swept value it needs relative: true")
            if distribution.relative and name not in taken and not _has_value(name, scenario, fields):
                raise InputError("has no value of its own to be multiplied; draw it without relative")
            if name == "payload_kg" and not distribution.relative and scenario.payloads_kg is not None:
                raise InputError("payloads_kg lists payloads; leave it out, or draw with relative: true")
        except InputError as error:
            raise InputError(error.problem, place=f"sample.values.{name}") from error
    seed = scenario.seed if block.seed is None else block.seed
    values: Array = draws(block, chosen, seed)
    digits = len(str(block.count - 1))
    yield GridAxis(
        tuple(chosen),
        values.tolist(),
        [f"s{k:0{digits}d}" for k in range(block.count)],
        sampled=True,
        relative=tuple(distribution.relative for distribution in chosen.values()),
    )


def _has_value(name: str, scenario: Scenario, fields: Fields) -> bool:
    return scenario.payloads_kg is not None if name == "payload_kg" else fields.value(name) is not None


def place_of(name: str, together: bool) -> str:
    """Where a swept field stands in the scenario."""
    return f"sweep.zip.{name}" if together else f"sweep.{name}"


def _words(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def labels_of(values: Sequence[float | bool | str]) -> list[str]:
    """Short words for values, safe in file names and different for different values."""
    for digits in (6, 12, 17):
        words = [
            re.sub(r"[^A-Za-z0-9.+-]", "-", value) if isinstance(value, str) else
            str(value).lower() if isinstance(value, bool) else f"{value:.{digits}g}"
            for value in values
        ]  # fmt: skip
        if len(set(words)) == len(set(values)):
            return words
    return [f"{k}" for k in range(len(values))]


def _short_names(names: Sequence[str]) -> dict[str, str]:
    """Each field by its last words, as many as tell it from the others."""
    words = {name: re.findall(r"[A-Za-z0-9_]+", name) for name in names}
    short: dict[str, str] = {}
    for name, parts in words.items():
        for count in range(1, len(parts) + 1):
            tail = parts[-count:]
            if all(other == name or other_parts[-count:] != tail for other, other_parts in words.items()):
                break
        short[name] = "-".join(tail)
    return short
