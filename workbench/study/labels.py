"""Fields and metrics in words and units, as people read them.
What differs between the runs of a study: the axes of its sweep, the fields that were drawn."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

from workbench.core.names import listed, unit_of
from workbench.core.names import words_of as words_of_name
from workbench.core.templates import Sentences
from workbench.metrics import by_name
from workbench.references import BASELINE, planned_kinds
from workbench.study.rows import Row, with_payload

FAILS = "it fails"
NO_CHANGE = 0.005  # relative: less is no effect worth a sentence
# Keys of a move, as people say them.
_STEPS = {"by": "distance", "to": "target", "dwell": "rest", "for": "time"}
# Blocks of the machine whose values need no more words.
_SILENT = ("sensors", "motor", "bearing", "gearbox")


@dataclass(frozen=True)
class Label:
    """words, without the unit; unit as shown, "" for a bare number."""

    words: str
    unit: str

    @property
    def axis(self) -> str:
        return f"{self.words} ({self.unit})" if self.unit else self.words

    def of(self, value: float | str) -> str:
        """`jerk 0.8 m/s³`; a word says itself."""
        return f"{self.words} {shown(value)} {self.unit}".strip()


def shown(value: float | str) -> str:
    return value.replace("_", " ") if isinstance(value, str) else f"{value:.4g}"


@cache
def field_label(column: str) -> Label:
    """Of a column of the index that a sweep or a sample has set, such as `sweep.limits.jerk_m_s3`."""
    path = re.sub(r"^(sweep|sample)\.", "", column).split(".")
    words, unit = words_of_name(path[-1]), unit_of(path[-1])
    if (move := re.fullmatch(r"moves\[(\d+)\]", path[0])) is not None:
        words = f"move {int(move[1]) + 1} {_STEPS.get(words, words)}"
    elif len(path) > 2 and path[-2] not in _SILENT and path[-2] not in words:
        words = f"{path[-2]} {words}".replace("_", " ")
    return Label(words, unit)


def drawn_in(name: str) -> tuple[Label, float]:
    """A metric as figures draw it: its label with the unit shown, and what its values are multiplied by."""
    metric = by_name().get(name)
    return (metric_label(name), 1.0) if metric is None else (Label(metric.label, metric.shown_unit), metric.scale)


def metric_label(name: str) -> Label:
    """A metric's label and unit; of a column that is no declared metric, such as an older version's, from its name."""
    metric = by_name().get(name)
    if metric is None:
        return Label(words_of_name(name), unit_of(name))
    return Label(metric.label, metric.unit.replace("–", ""))


Point = tuple[float | str, ...]
SAMPLE = "sample."


@dataclass(frozen=True)
class SweptAxis:
    """Fields walked together, as a rule one; points: their values, numbers rising, words in the file's order."""

    columns: tuple[str, ...]
    points: tuple[Point, ...]

    @property
    def label(self) -> str:
        """The axis of a figure; of fields that go together the first."""
        return field_label(self.columns[0]).axis

    @cached_property
    def words(self) -> str:
        return _together([field_label(column).words for column in self.columns])

    @property
    def numeric(self) -> bool:
        return all(not isinstance(point[0], str) for point in self.points)

    def at(self, row: Row) -> Point:
        return tuple(row.assigned.get(column, "") for column in self.columns)

    def grouped(self, rows: Sequence[Row]) -> dict[Point, list[Row]]:
        """The rows at each point, points without rows left out."""
        groups: dict[Point, list[Row]] = {point: [] for point in self.points}
        for row in rows:
            groups[self.at(row)].append(row)
        return {point: own for point, own in groups.items() if own}

    def edge(self, row: Row) -> bool:
        """Whether a run, whose reference reads it, stands at an end of three values or more."""
        read = any(reads(row.reference, column) for column in self.columns)
        return read and self.numeric and len(self.points) > 2 and self.at(row) in (self.points[0], self.points[-1])

    def say(self, point: Point) -> str:
        """`lowering acceleration 0.4 m/s², lowering jerk 1.2 m/s³`; `feed forward inertia and weight 1`."""
        labels = [field_label(column) for column in self.columns]
        if len(set(point)) == len({label.unit for label in labels}) == 1:
            return replace(labels[0], words=self.words).of(point[0])
        return ", ".join(label.of(value) for label, value in zip(labels, point, strict=True))

    def short(self, point: Point) -> str:
        """The first value with its unit."""
        return f"{shown(point[0])} {field_label(self.columns[0]).unit}".strip()


def _together(names: Sequence[str]) -> str:
    """`feed forward inertia, weight and friction`: the first word or two that all share are said once."""
    split = [name.split() for name in names]
    shared = next((k for k in (2, 1) if len({tuple(s[:k]) for s in split}) == 1 and min(map(len, split)) > k), 0)
    return listed([names[0], *(" ".join(s[shared:]) for s in split[1:])])


def reads(reference: str, column: str) -> bool:
    """Whether a reference's motion depends on a swept field: a trapezoid knows no jerk."""
    kind = planned_kinds().get(reference)
    return kind is None or kind.needs_jerk or "jerk" not in column


def set_in(row: Row) -> str:
    """What a run was set to, in words: `acceleration 0.42 m/s², jerk 2 m/s³`; without what its reference ignores."""
    said = {name: value for name, value in row.assigned.items() if reads(row.reference, name)}
    return ", ".join(field_label(name).of(value) for name, value in said.items())


def swept_axes(rows: Sequence[Row]) -> list[SweptAxis]:
    """The axes along which the rows differ, in the order of the file."""
    columns = [name for name in _differing(rows) if not name.startswith(SAMPLE)]
    axes: list[list[str]] = []
    for name in columns:
        together = next((names for names in axes if _one_to_one(rows, names[0], name)), None)
        if together is None:
            axes.append([name])
        else:
            together.append(name)
    return [SweptAxis(tuple(names), _points(rows, names)) for names in axes]


def drawn_columns(rows: Sequence[Row]) -> list[str]:
    """The fields that were drawn from distributions."""
    return [name for name in _differing(rows) if name.startswith(SAMPLE)]


def words_of(reference: str) -> str:
    """As a sentence calls a reference of this name."""
    kind = planned_kinds().get(reference)
    if kind is None:
        return reference
    return kind.label if kind.same_time_as and kind.words == "ruckig" else kind.words


def run_in_words(row: Row, axes: Sequence[SweptAxis]) -> str:
    """A run in words: `9000 kg, ruckig, jerk 0.8 m/s³`; of a sample with the end of its id.

    A reference whose key is no word, `ruckig_equal_time`, is called as sentences call it.
    """
    load = [f"{row.payload_kg:g} kg"] if with_payload(row) else []
    reference = words_of(row.reference) if "_" in row.reference else row.reference
    words = [*load, reference, *(axis.say(axis.at(row)) for axis in axes)]
    if any(name.startswith(SAMPLE) for name in row.assigned):
        words.append(f"draw {row.run_id.rpartition('_s')[2]}")
    return ", ".join(words)


def _differing(rows: Sequence[Row]) -> list[str]:
    names = dict.fromkeys(name for row in rows for name in row.assigned)
    return [name for name in names if len({row.assigned.get(name) for row in rows}) > 1]


def _one_to_one(rows: Sequence[Row], a: str, b: str) -> bool:
    pairs = {(row.assigned.get(a), row.assigned.get(b)) for row in rows}
    return len(pairs) == len({pair[0] for pair in pairs}) == len({pair[1] for pair in pairs})


def _points(rows: Sequence[Row], names: Sequence[str]) -> tuple[Point, ...]:
    points = dict.fromkeys(tuple(row.assigned.get(name, "") for name in names) for row in rows)
    if all(not isinstance(point[0], str) for point in points):
        return tuple(sorted(points, key=lambda point: float(point[0])))
    return tuple(points)


def some(names: Sequence[str]) -> list[str]:
    """The first three, and how many more."""
    return [*names[:3], *([f"{len(names) - 3} more"] if len(names) > 3 else [])]


said = Sentences("study/study_words.j2", listed=listed, some=some, words_of=words_of, BASELINE=BASELINE, FAILS=FAILS)
