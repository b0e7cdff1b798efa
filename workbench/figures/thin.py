"""Fewer points for a plotted line, with its peaks kept."""

from __future__ import annotations

import numpy as np

from workbench.run import Array

MOST_POINTS = 1500


def thin(time_s: Array, values: Array, most: int = MOST_POINTS) -> tuple[Array, Array]:
    """At most about `most` of the (n,) points: the smallest and the largest of each stretch, first and last.

    The extremes of the line survive at their own times. A stretch without any finite value
    is kept as a gap.
    """
    n = len(values)
    if n <= most:
        return time_s, values
    stretches = max(most // 2 - 1, 1)
    edges = np.linspace(0, n, stretches + 1).astype(np.int64)
    length = int(np.diff(edges).max())
    # Stretches differ by a point at most; the shorter ones repeat their last, which changes no extreme.
    index = np.minimum(edges[:-1, None] + np.arange(length)[None, :], edges[1:, None] - 1)
    block = values[index]
    low = np.argmin(np.where(np.isfinite(block), block, np.inf), axis=1)
    high = np.argmax(np.where(np.isfinite(block), block, -np.inf), axis=1)
    rows = np.arange(stretches)
    keep = np.unique(np.concatenate(([0], index[rows, low], index[rows, high], [n - 1])))
    return time_s[keep], values[keep]
