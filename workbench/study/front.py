"""The front of two costs, and its knee.

The knee of a front: its costs are brought to 0…1, from the best to the worst on the front; the chord joins its two
ends; the knee is the run farthest below the chord. A front of fewer than three runs, or one that nowhere lies below its
chord, has no knee. (Distance to the chord: I. Das, "On characterizing the 'knee' of the Pareto curve", Structural
Optimization 18, 1999, for two costs.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from workbench.core.run import Array
from workbench.study.rows import Row, metrics_of


@dataclass(frozen=True)
class Front:
    """The front of one group of runs. rows: from the smallest first cost to the largest; knee: one of them or None."""

    payload_kg: float
    costs: tuple[str, str]
    rows: tuple[Row, ...]
    knee: Row | None


def non_dominated(first: Array, second: Array) -> npt.NDArray[np.intp]:
    """Indices of the non-dominated points, by rising `first`. Of equal points the earliest is kept.

    first, second: (n,) costs, finite.
    """
    order = np.lexsort((np.arange(len(first)), second, first))
    falling = second[order]
    below = np.concatenate(([True], falling[1:] < np.minimum.accumulate(falling)[:-1])) if len(order) else order > 0
    return order[below]


def knee(first: Array, second: Array) -> int | None:
    """The place of the knee on a front: (n,) rising and (n,) falling costs. None where there is none."""
    if len(first) < 3:
        return None
    x = (first - first[0]) / (first[-1] - first[0])
    y = (second - second[-1]) / (second[0] - second[-1])
    depth = (1.0 - x - y) / np.sqrt(2.0)  # below the chord from (0, 1) to (1, 0)
    at = int(np.argmax(depth))
    return at if depth[at] > 1e-9 else None


def fronts(rows: Sequence[Row], second: str = "") -> list[Front]:
    """The front of each payload: the runs that no other is at least as good as in both costs and better in one.

    The costs: the move time and `second`, without one the largest torque or force. Failed runs are left out.
    InputError for a metric that the rows do not have.
    """
    costs, found = ("move_time_s", second or metrics_of(rows).peak), []
    for payload in sorted({row.payload_kg for row in rows if row.ok}):
        own = [row for row in rows if row.ok and row.payload_kg == payload]
        x, y = (np.array([row[name] for row in own]) for name in costs)
        known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
        chosen = known[non_dominated(x[known], y[known])]
        at = knee(x[chosen], y[chosen])
        front = tuple(own[i] for i in chosen)
        found.append(Front(payload, costs, front, None if at is None else front[at]))
    return found
