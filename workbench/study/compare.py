"""Two results of the same runs, metric by metric: changes, regressions beyond a limit, why no run is in both."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from workbench.core.errors import InputError, nearest
from workbench.core.shown import Shown
from workbench.metrics import by_name, metrics
from workbench.study.labels import field_label, shown
from workbench.study.rows import Row

_UNDECLARED = 1e-3  # of a column that is no declared metric, such as an older version's


def least(metric: str) -> float:
    """The smallest visible difference of a metric, in its unit."""
    declared = by_name().get(metric)
    return _UNDECLARED if declared is None else declared.visible


def percent(metric: str, a: float, b: float) -> float:
    """b against a in per cent of a: 0 where they differ by nothing visible from an a that is nothing itself,
    infinite where only a is nothing."""
    if abs(a) >= least(metric):
        return 100.0 * (b - a) / abs(a)
    return 0.0 if abs(b - a) < least(metric) else math.copysign(math.inf, b - a)


_UNIT = re.compile(r"_(rad_s2|rad_s|nm_s|nm_per_s|m_s3|m_s2|m_s|nm2_s|percent_s|percent|nm|rad|hz|db|kw|ws|w|j|n|m|s)$")


@dataclass(frozen=True)
class Pair:
    """One run in both results."""

    name: str
    a: Row
    b: Row


@dataclass(frozen=True)
class Change:
    """A metric over all pairs that have it: means, deltas (b − a) and the runs that moved most.

    mean_percent: the mean's delta relative to a; infinite where a was nothing that could be noticed.
    worst: the pairs that moved most, the most moved first.
    """

    metric: str
    runs: int
    mean_a: float
    mean_b: float
    mean_delta: float
    median_delta: float
    max_delta: float
    worst: tuple[Pair, ...]

    @property
    def mean_percent(self) -> float:
        return percent(self.metric, self.mean_a, self.mean_b)

    @property
    def noticeable(self) -> bool:
        """Whether any run moved by more than nothing."""
        return abs(self.max_delta) >= least(self.metric)


@dataclass(frozen=True)
class Limit:
    """How much worse a metric may get in any run: by `most`, in per cent of what it was or in its unit."""

    metric: str
    most: float
    relative: bool

    def __str__(self) -> str:
        return f"{self.metric}={self.most:g}{'%' if self.relative else ''}"


@dataclass(frozen=True)
class Regression:
    """A run that got worse than a limit allows; `worse` is by how much, in the limit's own measure."""

    limit: Limit
    pair: Pair
    worse: float


@dataclass(frozen=True, repr=False)
class Comparison(Shown):
    """changes: of every metric. only_a, only_b: runs without a partner. newly_failed: ok in a, failed in b."""

    pairs: tuple[Pair, ...]
    changes: tuple[Change, ...]
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]
    newly_failed: tuple[Pair, ...]
    newly_ok: tuple[Pair, ...]


def compare(a: Sequence[Row], b: Sequence[Row], most_moved: int = 3) -> Comparison:
    """Every metric of b against a, over the runs that both have and that both completed."""
    pairs, only_a, only_b = matched(a, b)
    good = [pair for pair in pairs if pair.a.ok and pair.b.ok]
    names = good[0].a.metrics if good else ()
    return Comparison(
        tuple(pairs),
        tuple(change for name in names if (change := _change(name, good, most_moved)) is not None),
        tuple(only_a),
        tuple(only_b),
        newly_failed=tuple(pair for pair in pairs if pair.a.ok and not pair.b.ok),
        newly_ok=tuple(pair for pair in pairs if pair.b.ok and not pair.a.ok),
    )


def _change(name: str, good: Sequence[Pair], most_moved: int) -> Change | None:
    have = [pair for pair in good if None not in (pair.a.metrics[name], pair.b.metrics.get(name))]
    if not have:
        return None
    a, b = (np.array([getattr(pair, side)[name] for pair in have]) for side in ("a", "b"))
    delta = b - a
    moved = np.argsort(-np.abs(delta), kind="stable")
    worst = tuple(have[i] for i in moved[:most_moved] if delta[i] != 0.0)
    mean_a, mean_b, mean = (float(np.mean(column)) for column in (a, b, delta))
    return Change(name, len(have), mean_a, mean_b, mean, float(np.median(delta)), float(delta[moved[0]]), worst)


def matched(a: Sequence[Row], b: Sequence[Row]) -> tuple[list[Pair], list[str], list[str]]:
    """Runs of the same id; where the ids differ, runs of the same payload, reference and assigned values."""
    of_b = {row.run_id: row for row in b}
    pairs = {row.run_id: Pair(row.run_id, row, of_b[row.run_id]) for row in a if row.run_id in of_b}
    rest_a, rest_b = ([row for row in rows if row.run_id not in pairs] for rows in (a, b))
    counts = Counter(map(values_of, rest_a)), Counter(map(values_of, rest_b))
    alone = {values_of(row): row for row in rest_b if counts[0][values_of(row)] == counts[1][values_of(row)] == 1}
    pairs |= {row.run_id: Pair(row.run_id, row, alone[values_of(row)]) for row in rest_a if values_of(row) in alone}
    taken = {pair.b.run_id for pair in pairs.values()}
    left_a = [row.run_id for row in a if row.run_id not in pairs]
    left_b = [row.run_id for row in b if row.run_id not in taken]
    return [pairs[row.run_id] for row in a if row.run_id in pairs], left_a, left_b


def judged() -> tuple[str, ...]:
    """The metrics that can get worse."""
    return tuple(metric.name for metric in metrics() if metric.better is not None)


def parse_limits(texts: Sequence[str], names: Iterable[str]) -> list[Limit]:
    """`peak_torque=5%` or `peak_torque_motor_nm=20`: InputError for an unknown metric or no number."""
    limits, known = [], list(names)
    for text in texts:
        name, equals, most = text.partition("=")
        number = re.fullmatch(r"\s*(\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)\s*(%?)\s*", most)
        if not equals or number is None:
            said = f"'{text}', expected a metric and how much worse it may get: peak_torque=5% or peak_torque=20"
            raise InputError(said, place="limits")
        try:
            metric = metric_named(name.strip(), known)
        except InputError as error:
            raise InputError(error.problem, place="limits") from error
        if metric not in judged():
            problem = f"{metric} says what a run was, not how good it was; {nearest(metric, judged())}"
            raise InputError(problem, place="limits")
        limits.append(Limit(metric, float(number[1]), number[2] == "%"))
    return limits


def metric_named(name: str, names: Iterable[str]) -> str:
    """The metric of this name, or of this name without its unit. InputError with the nearest one."""
    known = list(names)
    if name in known:
        return name
    short = {_UNIT.sub("", metric): metric for metric in reversed(known)}
    if name in short:
        return short[name]
    raise InputError(f"unknown metric '{name}'; {nearest(name, {*known, *short})}")


def regressions(comparison: Comparison, limits: Sequence[Limit]) -> list[Regression]:
    """Where a run got worse than a limit allows, the worst first; which way is worse is the metric's own."""
    good = [pair for pair in comparison.pairs if pair.a.ok and pair.b.ok]
    every = [Regression(limit, pair, _worse(limit, pair)) for limit in limits for pair in good]
    broken = [one for one in every if one.worse > one.limit.most]
    return sorted(broken, key=lambda one: -one.worse / max(one.limit.most, 1e-12))


def values_of(row: Row) -> tuple[object, ...]:
    """The values that identify a run apart from its id: payload, reference and assigned values."""
    return row.payload_kg, row.reference, *sorted((name, str(value)) for name, value in row.assigned.items())


def _worse(limit: Limit, pair: Pair) -> float:
    """By how much b is worse than a, negative where it is better."""
    a, b = pair.a.metrics.get(limit.metric), pair.b.metrics.get(limit.metric)
    if a is None or b is None:
        return -math.inf
    metric = by_name()[limit.metric]
    if not limit.relative:
        return metric.worse_by(a, b)
    if metric.better == "zero":
        a, b = abs(a), abs(b)
    change = percent(limit.metric, a, b)
    return -change if metric.better == "higher" else change


MOST_VALUES = 4


def why_unmatched(a: Sequence[Row], b: Sequence[Row]) -> str:
    """Of payload, reference and varied fields those that have no value in common in the runs of a and of b."""
    looks: dict[str, Callable[[Row], str]] = {
        "payload": lambda row: f"{row.payload_kg:g} kg", "reference": lambda row: row.reference
    }  # fmt: skip
    for field in dict.fromkeys(name for row in (*a, *b) for name in row.assigned):
        looks[field_label(field).words] = partial(_assigned, field, field_label(field).unit)
    reasons = []
    for words, of in looks.items():
        ours, theirs = (list(dict.fromkeys(of(row) for row in rows)) for rows in (a, b))
        if not set(ours) & set(theirs):
            reasons.append(f"{words} is {_some(ours)} in A and {_some(theirs)} in B")
    return "; ".join(reasons) or "their ids differ, and payload, reference and varied values do not pair them"


def _assigned(field: str, unit: str, row: Row) -> str:
    return f"{shown(row.assigned[field])} {unit}".strip() if field in row.assigned else "not varied"


def _some(values: Sequence[str]) -> str:
    more = len(values) - MOST_VALUES
    return ", ".join(values[:MOST_VALUES]) + (f" and {more} more" if more > 0 else "")
