"""How a quantity goes on from cycle to cycle, and when it meets a limit at that rate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LEAST = 5  # cycles that a trend takes
CLEAR = 2.0  # standard errors that a slope must be away from zero


@dataclass(frozen=True)
class Trend:
    """A straight line through the amounts since a change. rate: per cycle. left: cycles until the limit at that rate,
    with its 95 % interval; None where there is no limit ahead, or the rate is not clear."""

    now: float
    rate: float
    rate_error: float
    left: float | None
    left_ci95: tuple[float, float] | None


def trend(amounts: Sequence[float], limit: float | None) -> Trend | None:
    """amounts: one a cycle. None where they are too few. Times to a limit by the line's slope and its error."""
    n = len(amounts)
    if n < LEAST:
        return None
    x = np.arange(n, dtype=float) - 0.5 * (n - 1)
    y = np.asarray(amounts, dtype=float)
    sxx = float(x @ x)
    rate = float(x @ y) / sxx
    rest = y - y.mean() - rate * x
    sigma2 = float(rest @ rest) / (n - 2)
    error = math.sqrt(sigma2 / sxx)
    now = float(y.mean() + rate * x[-1])
    if limit is None or abs(rate) < CLEAR * error or (limit - now) * rate <= 0.0:
        return Trend(now, rate, error, None, None)
    way = limit - now
    fast, slow = abs(rate) + 1.96 * error, abs(rate) - 1.96 * error
    latest = abs(way) / slow if slow > 0.0 else math.inf
    return Trend(now, rate, error, way / rate, (abs(way) / fast, latest))
