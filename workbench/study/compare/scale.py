"""The smallest visible change of a metric, and numbers with as many digits as that allows."""

from __future__ import annotations

import math

from workbench.metrics import by_name

_UNDECLARED = 1e-3  # of a column that is no declared metric, such as an older version's
_DIGITS = 5


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


def plain(metric: str, value: float, *, sign: bool = False, digits: int = _DIGITS) -> str:
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
