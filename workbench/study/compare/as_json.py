"""A comparison as JSON: what a program reads of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from workbench.study.compare.compare import Change, Comparison, Limit, Pair, Regression


def as_json(comparison: Comparison, limits: Sequence[Limit], worse_runs: Sequence[Regression]) -> dict[str, Any]:
    """Plain values; null stands for a per cent of nothing."""
    return {
        "format": 1,
        "runs": len(comparison.pairs),
        "only_a": list(comparison.only_a),
        "only_b": list(comparison.only_b),
        "newly_failed": [{"run": pair.name, "reason": pair.b.reason} for pair in comparison.newly_failed],
        "newly_ok": [{"run": pair.name, "reason": pair.a.reason} for pair in comparison.newly_ok],
        "metrics": {change.metric: _change(change) for change in comparison.changes},
        "limits": [{"metric": limit.metric, "most": limit.most, "relative": limit.relative} for limit in limits],
        "regressions": [
            {"limit": str(run.limit), "worse": _finite(run.worse)} | _pair(run.limit.metric, run.pair)
            for run in worse_runs
        ],
    }


def _change(change: Change) -> dict[str, Any]:
    return {
        "runs": change.runs,
        "mean_a": change.mean_a,
        "mean_b": change.mean_b,
        "mean_delta": change.mean_delta,
        "mean_percent": _finite(change.mean_percent),
        "median_delta": change.median_delta,
        "max_delta": change.max_delta,
        "moved_most": [_pair(change.metric, pair) for pair in change.worst],
    }


def _pair(metric: str, pair: Pair) -> dict[str, Any]:
    return {"run": pair.name, "a": pair.a[metric], "b": pair.b[metric]}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
