"""Why two results have no run in common, in a sentence."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from workbench.study.compare.compare import values_of
from workbench.study.results.labels import field_label, shown
from workbench.study.results.row import Row

MOST_VALUES = 4


def why_unmatched(a: Sequence[Row], b: Sequence[Row]) -> str:
    """Which of payload, reference and varied fields differ between the runs of a and those of b."""
    reasons = [
        *_fields(a, b),
        *_apart("payload", a, b, _payload),
        *_apart("reference", a, b, lambda row: row.reference),
    ]
    for name in _varied(a):
        if name in _varied(b):
            reasons += _apart(field_label(name).words, a, b, lambda row, name=name: _assigned(row, name))  # type: ignore[misc]
    if reasons:
        return "; ".join(reasons)
    if {values_of(row) for row in a} & {values_of(row) for row in b}:
        return "several runs have the same payload, reference and varied values, and their ids differ"
    return "no combination of payload, reference and varied values stands in both"


def _fields(a: Sequence[Row], b: Sequence[Row]) -> list[str]:
    """Fields that only one of the two varies."""
    texts = []
    for one, name_of_one, other in ((a, "A", b), (b, "B", a)):
        if own := [field_label(name).words for name in _varied(one) if name not in _varied(other)]:
            texts.append(f"only {name_of_one} varies {_listed(own)}")
    return texts


def _apart(words: str, a: Sequence[Row], b: Sequence[Row], of: Callable[[Row], str]) -> list[str]:
    """Nothing where one value is in both."""
    ours, theirs = (list(dict.fromkeys(of(row) for row in rows)) for rows in (a, b))
    if set(ours) & set(theirs):
        return []
    return [f"{words} is {_listed(ours)} in A and {_listed(theirs)} in B"]


def _payload(row: Row) -> str:
    return f"{row.payload_kg:g} kg"


def _assigned(row: Row, name: str) -> str:
    return f"{shown(row.assigned.get(name, ''))} {field_label(name).unit}".strip()


def _varied(rows: Sequence[Row]) -> dict[str, None]:
    return dict.fromkeys(name for row in rows for name in row.assigned)


def _listed(values: Sequence[str]) -> str:
    more = len(values) - MOST_VALUES
    return ", ".join(values[:MOST_VALUES]) + (f" and {more} more" if more > 0 else "")
