"""How large a metric's change has to be to say something, and its numbers with as many digits."""

from __future__ import annotations

import math

from workbench.study.results.labels import metric_label

# By unit: less than this is nothing on any of these machines, whatever per cent it is of.
_LEAST = {
    "N m": 0.1,
    "N m/s": 1.0,
    "%": 0.01,
    "rad/s": 1e-3,
    "rad": 1e-3,
    "m": 1e-4,
    "m/s²": 1e-3,
    "m/s³": 1e-2,
    "N": 1.0,
    "J": 1.0,
    "kW": 0.01,
    "s": 1e-3,
}
_OTHER = 1e-3
_COUNTS = ("slack_events", "moves")
_DIGITS = 5


def least(metric: str) -> float:
    """The smallest noticeable size of a metric, in its unit."""
    return 1.0 if metric in _COUNTS else _LEAST.get(metric_label(metric).unit, _OTHER)


def percent(metric: str, a: float, b: float) -> float:
    """b against a in per cent of a: 0 where they differ by nothing noticeable from an a that is nothing itself,
    infinite where only a is nothing."""
    if abs(a) >= least(metric):
        return 100.0 * (b - a) / abs(a)
    return 0.0 if abs(b - a) < least(metric) else math.copysign(math.inf, b - a)


def plain(metric: str, value: float, *, sign: bool = False, digits: int = _DIGITS) -> str:
    """A value of a metric without an exponent, to so many digits and no finer than what is noticeable."""
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
