"""A share of campaigns with its 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

Z_95 = 1.959963984540054  # two-sided, normal


@dataclass(frozen=True)
class Share:
    """count of `of`; `of` may be zero, then nothing was asked."""

    count: int
    of: int

    @classmethod
    def counted(cls, rows: Iterable[Mapping[str, Any]], test: Callable[[Mapping[str, Any]], bool]) -> Share:
        passed = [test(row) for row in rows]
        return cls(sum(passed), len(passed))

    def interval(self) -> tuple[float, float]:
        """Wilson's score interval, 95 %, of the share (E. B. Wilson 1927); (0, 1) where nothing was asked."""
        if not self.of:
            return 0.0, 1.0
        n, p, z2 = self.of, self.count / self.of, Z_95**2
        middle = (p + z2 / (2.0 * n)) / (1.0 + z2 / n)
        half = Z_95 / (1.0 + z2 / n) * math.sqrt(p * (1.0 - p) / n + z2 / (4.0 * n * n))
        return max(middle - half, 0.0), min(middle + half, 1.0)

    def text(self) -> str:
        """As 17/18 (74–99), the interval in per cent; – where nothing was asked."""
        if not self.of:
            return "–"
        low, high = self.interval()
        return f"{self.count}/{self.of} ({100.0 * low:.0f}–{100.0 * high:.0f})"

    def percent(self) -> str:
        """As 94 (74–99), in per cent; – where nothing was asked."""
        if not self.of:
            return "–"
        low, high = self.interval()
        return f"{100.0 * self.count / self.of:.0f} ({100.0 * low:.0f}–{100.0 * high:.0f})"
