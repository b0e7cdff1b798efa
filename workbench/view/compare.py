"""A comparison of two results as people and programs read it: table, lines of text, JSON, the view for notebooks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from workbench.core.shown import View
from workbench.core.table import Column, Table, words
from workbench.study.compare import Change, Comparison, Limit, Pair, Regression, least

TIE = "\N{NO-BREAK SPACE}"
MOST_LINES = 10
DIGITS = 5
_FIGURES = ("runs", "mean_a", "mean_b", "mean_delta", "mean_percent", "median_delta", "max_delta")


def plain(metric: str, value: float, *, sign: bool = False, digits: int = DIGITS) -> str:
    """A value of a metric without an exponent, to so many digits and no finer than what is visible."""
    if not math.isfinite(value):
        return "–"
    finest = -math.floor(math.log10(least(metric)) + 1e-9)
    wanted = digits - 1 - math.floor(math.log10(abs(value))) if value else finest
    decimals = max(min(wanted, finest), 0)
    number = round(value, decimals) + 0.0  # no minus before nothing
    return f"{number:{'+' if sign and number else ''}.{decimals}f}"


def plain_percent(value: float) -> str:
    """Per cent with its sign; a dash where there was nothing to compare with."""
    if not math.isfinite(value):
        return "–"
    decimals = 2 if abs(value) < 100.0 else 0
    number = round(value, decimals) + 0.0
    return f"{number:{'+' if number else ''}.{decimals}f}"


def changes_table(comparison: Comparison) -> Table:
    """The metrics that moved by more than nothing."""
    rows = []
    for c in comparison.changes:
        if c.noticeable:
            mean, median, largest = (
                plain(c.metric, value, sign=True, digits=3) for value in (c.mean_delta, c.median_delta, c.max_delta)
            )
            means = plain(c.metric, c.mean_a), plain(c.metric, c.mean_b)
            rows.append([c.metric, *means, mean, plain_percent(c.mean_percent), median, largest])
    heads = ("mean A", "mean B", "mean Δ", "%", "median Δ", "largest Δ")
    return Table([words("metric"), *map(Column, heads)], rows, f"{len(comparison.pairs)} runs are in both.")


def paragraphs(comparison: Comparison) -> Iterator[tuple[str, list[str], int]]:
    """(title, lines, how many of them are shown) below the table, in order."""
    moved = [change for change in comparison.changes if change.noticeable]
    lines = [f"{c.metric}: " + ", ".join(_values(c.metric, pair) for pair in c.worst) for c in moved]
    yield "Largest changes:", lines, len(lines)
    yield "", [f"{len(comparison.pairs)} runs compared; {_unmoved(comparison)}."], 1
    yield "Only in A:", list(comparison.only_a), MOST_LINES
    yield "Only in B:", list(comparison.only_b), MOST_LINES
    yield "Failed in B only:", [f"{pair.name}: {pair.b.reason}" for pair in comparison.newly_failed], MOST_LINES
    yield "Failed in A only:", [f"{pair.name}: {pair.a.reason}" for pair in comparison.newly_ok], MOST_LINES


def _unmoved(comparison: Comparison) -> str:
    """The number of equal metrics, and those that changed by less than the least visible difference."""
    if not comparison.changes:
        return "none of them ran to its end in both"
    same = [change for change in comparison.changes if not change.worst]
    hardly = [change.metric for change in comparison.changes if change.worst and not change.noticeable]
    text = f"{len(same)} of {len(comparison.changes)} metrics are the same in all"
    return f"{text}, and these change by next to nothing: {', '.join(hardly)}" if hardly else text


def regression_lines(comparison: Comparison, worse: Sequence[Regression]) -> list[str]:
    """What is worse than a limit allows, then the runs that fail in B only."""
    lines = []
    for one in worse:
        unit = " %" if one.limit.relative else ""
        by = "from nothing" if math.isinf(one.worse) else f"by {one.worse:.3g}{unit}"
        lines.append(f"{_values(one.limit.metric, one.pair)}: worse {by}, allowed {one.limit}")
    return [*lines, *(f"{pair.name} failed: {pair.b.reason}" for pair in comparison.newly_failed)]


def _values(metric: str, pair: Pair) -> str:
    before, after = (plain(metric, row[metric]) for row in (pair.a, pair.b))
    return f"{pair.name}{TIE}{before}{TIE}→{TIE}{after}"


def as_json(comparison: Comparison, limits: Sequence[Limit], worse: Sequence[Regression]) -> dict[str, Any]:
    """Plain values; null stands for a per cent of nothing."""

    def pair_json(metric: str, pair: Pair) -> dict[str, Any]:
        return {"run": pair.name, "a": pair.a[metric], "b": pair.b[metric]}

    def change_json(change: Change) -> dict[str, Any]:
        numbers = {name: getattr(change, name) for name in _FIGURES}
        numbers["mean_percent"] = _finite(change.mean_percent)
        return numbers | {"moved_most": [pair_json(change.metric, pair) for pair in change.worst]}

    return {
        "format": 1,
        "runs": len(comparison.pairs),
        "only_a": list(comparison.only_a),
        "only_b": list(comparison.only_b),
        "newly_failed": [{"run": pair.name, "reason": pair.b.reason} for pair in comparison.newly_failed],
        "newly_ok": [{"run": pair.name, "reason": pair.a.reason} for pair in comparison.newly_ok],
        "metrics": {change.metric: change_json(change) for change in comparison.changes},
        "limits": [vars(limit) for limit in limits],
        "regressions": [
            {"limit": str(one.limit), "worse": _finite(one.worse)} | pair_json(one.limit.metric, one.pair)
            for one in worse
        ],
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _columns(comparison: Comparison) -> Mapping[str, Sequence[Any]]:
    return {name: [getattr(change, name) for change in comparison.changes] for name in ("metric", *_FIGURES)}


VIEW = View({"changes": changes_table}, {}, _columns, index="metric")
