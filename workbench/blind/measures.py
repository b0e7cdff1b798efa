"""What is measured of answers, each with the cases it asks; by source and kind, and by the size of the gap."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from workbench.blind import criteria
from workbench.blind.criteria import Row, Share, right, right_as_stated, right_word

Test = Callable[[Row], bool]
# Of the gap over the noise: (name, from, below).
SIZES = (
    ("below the noise", 0.0, 1.0),
    ("just visible, 1 to 3", 1.0, 3.0),
    ("3 to 10", 3.0, 10.0),
    ("10 and more", 10.0, math.inf),
)


@dataclass(frozen=True)
class Measure:
    """name: in tables, over two lines in heads; key: in JSON. asks: the cases it speaks of. passes: of those. asked:
    kind -> what the project asks, in per cent. less: the fewer pass, the better."""

    key: str
    name: str
    asks: Test
    passes: Test
    asked: Mapping[str, float] = field(default_factory=dict)
    less: bool = False

    @property
    def line(self) -> str:
        """The name in one line."""
        return self.name.replace("\n", " ")

    def share(self, rows: Sequence[Row]) -> Share:
        return Share.counted(filter(self.asks, rows), self.passes)

    def asked_text(self, kind: str) -> str:
        limit = self.asked.get(kind)
        return "" if limit is None else f"{'≤' if self.less else '≥'} {limit:g}"


def _is(word: str) -> Test:
    return lambda row: row["word"] == word


def _unlisted(row: Row) -> bool:
    return criteria.unlisted(row) and not row.get("withheld")


def _no_gap(row: Row) -> bool:
    return right_word(row) == "no_gap"


def _with_oracle(row: Row) -> bool:
    return right_word(row) == "named" and criteria.of_the_oracle(row) is not None


def _cause(row: Row) -> bool:
    return bool(row["label"]["effects"])


def _corrected(row: Row) -> bool:
    return row["word"] in ("named", "unknown")


_BOTH = {"hoist": 2.0, "axis": 2.0}
_UNKNOWN = {"recorded": 80.0, "hoist": 90.0, "axis": 90.0}
MEASURES = (
    Measure("named", "single effect\nnamed", criteria.single, right, {"hoist": 95.0, "axis": 90.0}),
    Measure(
        "named_or_alike", "named, or\nsaid to be alike", criteria.single, criteria.right_or_alike, {"recorded": 85.0}
    ),
    Measure("detectable", "named or alike,\nof the detectable", criteria.detectable, criteria.right_or_alike),
    Measure("wrong", "single effect:\nwrong one named", criteria.single, criteria.wrong, {"recorded": 3.0}, True),
    Measure("first_three", "among the\nfirst three", criteria.single, criteria.among_first_three),
    Measure("pair_both", "pair:\nboth named", criteria.pair, right, {"hoist": 80.0, "axis": 80.0}),
    Measure("pair_one", "pair:\none or both", criteria.pair, criteria.one_of_them, {"hoist": 97.0, "axis": 97.0}),
    Measure("false_alarm", "no gap,\nbut named", _no_gap, _is("named"), {**_BOTH, "recorded": 5.0}, True),
    Measure("false_unknown", "no gap,\nbut unknown", _no_gap, _is("unknown"), {"hoist": 5.0, "axis": 5.0}, True),
    Measure("unknown_caught", "unlisted cause:\nunknown", _unlisted, _is("unknown"), _UNKNOWN),
    Measure("unknown_place", "unlisted cause:\nplace right", _unlisted, criteria.place_right),
    Measure("place", "place right,\nall causes", _cause, criteria.place_right, {"hoist": 95.0, "axis": 95.0}),
    Measure("event", "brief event\nfound", criteria.has_event, criteria.event_found),
    Measure("harmful", "correction\nharmful", _corrected, criteria.harmful, _BOTH, True),
)
# What a method that only names an answer can be measured by.
OF_A_METHOD = ("named", "first_three", "pair_both", "pair_one", "false_alarm", "false_unknown", "unknown_caught")


def measure(key: str) -> Measure:
    return next(known for known in MEASURES if known.key == key)


def kind_of(row: Row) -> str:
    """Kind of machine, and "recorded" of a real one, whatever its kind."""
    return "recorded" if criteria.recorded(row) else criteria.kind_of(row)


def groups(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """ "kind, source" -> its rows, of recorded machines "recorded, family"; then each kind's all where it has more
    than one."""
    grouped: dict[str, list[Row]] = {}
    for kind, of_kind in by_kind(rows).items():
        of_source: dict[str, list[Row]] = {}
        name = criteria.family_of if kind == "recorded" else criteria.source_of
        for row in sorted(of_kind, key=name):
            of_source.setdefault(f"{kind}, {name(row)}", []).append(row)
        grouped |= of_source
        if len(of_source) > 1:
            grouped[f"{kind}, all"] = of_kind
    return grouped


def by_kind(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Kind of machine -> its rows, recorded machines first."""
    kinds = sorted({kind_of(row) for row in rows}, key=lambda kind: (kind != "recorded", kind))
    return {kind: [row for row in rows if kind_of(row) == kind] for kind in kinds}


def by_size(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Size of the gap over the noise -> the rows with a cause of that size; those of unknown size last."""
    sized = [(criteria.size_over_noise(row), row) for row in rows if _cause(row)]
    sizes = {name: [row for size, row in sized if low <= size < high] for name, low, high in SIZES}
    sizes["size not known"] = [row for size, row in sized if math.isnan(size)]
    return {name: which for name, which in sizes.items() if which}


@dataclass(frozen=True)
class Numbers:
    """parameter_errors: relative, of rightly named effects, in their order. covered: of true values, those inside the
    90 % interval. of_oracle: shrink over the true effect's, in their order; without_oracle: cases that lack it.
    calibration_error: mean distance of stated probability and share right (M. P. Naeini et al. 2015), None for no
    answers; calibration_by_chance: what it would be of answers that are right exactly as often as they say. cpu_s: in
    their order."""

    parameter_errors: tuple[float, ...]
    covered: Share
    of_oracle: tuple[float, ...]
    without_oracle: int
    calibration_error: float | None
    calibration_by_chance: float | None
    cpu_s: tuple[float, ...]


INSIDE_90 = 1.6449


def numbers(rows: Sequence[Row]) -> Numbers:
    within = [estimate for row in rows for estimate in criteria.estimates_within(row)]
    ratios = [criteria.of_the_oracle(row) for row in rows if right_word(row) == "named"]
    return Numbers(
        parameter_errors=tuple(sorted(error for _, error, _ in within)),
        covered=Share(sum(ratio <= INSIDE_90 for _, _, ratio in within), len(within)),
        of_oracle=tuple(sorted(ratio for ratio in ratios if ratio is not None)),
        without_oracle=sum(ratio is None for ratio in ratios),
        calibration_error=calibration_error(rows),
        calibration_by_chance=calibration_by_chance(rows),
        cpu_s=tuple(sorted(float(row["cpu_s"]) for row in rows)),
    )


def median(values: Sequence[float]) -> float:
    """values: in their order."""
    return values[len(values) // 2] if values else math.nan


def median_interval(values: Sequence[float]) -> tuple[float, float] | None:
    """The 95 % interval of the median of values in their order, between two of them whatever their distribution (W. R.
    Thompson 1936): x_j to x_(n+1-j), j the largest with P(Binomial(n, 1/2) < j) <= 2.5 %. None for fewer than six."""
    from scipy.stats import binom

    j = int(binom.ppf(0.025, len(values), 0.5)) if values else 0
    return (values[j - 1], values[len(values) - j]) if j > 0 else None


@dataclass(frozen=True)
class Bin:
    """Answers of about this probability: from, below, mean of what they said, and how many were right; the name of an
    exact twin is, for the probability is of both."""

    low: float
    high: float
    said: float
    right: Share


EDGES = (0.0, 0.4, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)


def reliability(rows: Sequence[Row]) -> list[Bin]:
    """The reliability curve: bins with answers in them."""
    return [
        Bin(low, high, sum(map(_said, which)) / len(which), Share.counted(which, right_as_stated))
        for low, high, which in _binned(rows)
    ]


def _binned(rows: Sequence[Row]) -> Iterator[tuple[float, float, list[Row]]]:
    for low, high in itertools.pairwise(EDGES):
        top = high if high < 1.0 else math.inf
        if which := [row for row in rows if row["ranking"] and low <= _said(row) < top]:
            yield low, high, which


def _said(row: Row) -> float:
    return float(row["ranking"][0][2])


def calibration_error(rows: Sequence[Row]) -> float | None:
    bins = reliability(rows)
    total = sum(b.right.of for b in bins)
    return sum(abs(b.right.of * b.said - b.right.count) for b in bins) / total if total else None


def calibration_by_chance(rows: Sequence[Row]) -> float | None:
    """The calibration error to expect of answers that are right exactly as often as they say: of few answers it is not
    small. The number right in a bin has then a Poisson binomial distribution."""
    total, expected = 0, 0.0
    for _, _, which in _binned(rows):
        of_count = np.ones(1)
        for p in map(_said, which):
            of_count = np.convolve(of_count, [1.0 - p, p])
        expected += float(of_count @ np.abs(np.arange(len(of_count)) - sum(map(_said, which))))
        total += len(which)
    return expected / total if total else None
