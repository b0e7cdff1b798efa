"""Fewer points for a plotted line, with its peaks kept."""

from __future__ import annotations

import numpy as np

from workbench.core.run import Array

Index = np.ndarray[tuple[int], np.dtype[np.int64]]

MOST_POINTS = 1500
STRAIGHT = 1e-4  # of a line's extent in each pass: a tenth of a pixel on a wide screen
PASSES = 4  # each takes every other point at most, so that a sixteenth is left for the pointer to find


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


def straightened(x: Array, y: Array, within: float = STRAIGHT) -> tuple[Array, Array]:
    """The (n,) points without those that lie between their neighbours on a straight line, or nearly.

    within: how far a point may lie off, as a share of the line's extent, in each of a few passes. The first and the
    last stay, and so do gaps. Most of a move is straight: speed at its limit, a hanging load.
    """
    across, up = (values / (_extent(values) or 1.0) for values in (x, y))
    kept = np.arange(len(x))
    for _ in range(PASSES):
        if len(kept) < 3:
            break
        before, point, after = kept[:-2:2], kept[1:-1:2], kept[2::2]
        off = _off_the_line(across, up, before, point, after[: len(point)])
        stays = np.ones(len(kept), dtype=bool)
        stays[1:-1:2] = ~(off <= within)  # NaN stays
        kept = kept[stays]
    return x[kept], y[kept]


def _extent(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.max() - known.min()) if len(known) else 0.0


def _off_the_line(x: Array, y: Array, before: Index, point: Index, after: Index) -> Array:
    """How far these points lie off the stretch between their neighbours."""
    along_x, along_y = x[after] - x[before], y[after] - y[before]
    away_x, away_y = x[point] - x[before], y[point] - y[before]
    length = np.maximum(along_x * along_x + along_y * along_y, 1e-30)
    share = np.minimum(np.maximum((along_x * away_x + along_y * away_y) / length, 0.0), 1.0)
    return np.asarray(np.hypot(away_x - share * along_x, away_y - share * along_y))
