"""Numbers as people read them: so many digits, a value with its error, a change with its sign."""

from __future__ import annotations

import math

NOTHING = "–"
LEAST, MOST = 1e-5, 1e6  # between them a number reads well without an exponent


def figures(value: float, digits: int = 3) -> str:
    """So many significant digits, without an exponent where that reads well."""
    if not math.isfinite(value):
        return NOTHING
    if value == 0.0:
        return "0"
    near = float(f"{value:.{digits - 1}e}")  # rounding may carry: 9.9996 is 10.0, not 10.00
    decimals = digits - 1 - _magnitude(near)
    return f"{value:.{max(decimals, 0)}f}" if LEAST <= abs(near) < MOST else _scaled(value, _exponent(near), decimals)


def with_error(value: float, error: float) -> tuple[str, str]:
    """A value and its standard error, both to the error's second digit: 3942 and 26, 89.0e9 and 2.6e9."""
    if not (math.isfinite(error) and error > 0.0):
        return f"{value:.4g}" if LEAST <= abs(value) < 1e4 else figures(value, 4), NOTHING
    error = float(f"{error:.1e}")
    largest = max(abs(value), error)
    decimals = 1 - _magnitude(error)
    exponent = _exponent(largest) if not LEAST <= largest < MOST else 0
    return _scaled(value, exponent, decimals), _scaled(error, exponent, decimals)


def change_percent(nominal: float, value: float) -> str:
    """By how much a value differs from its nominal one; nothing to compare with where that is zero."""
    if nominal == 0.0:
        return NOTHING
    return signed(100.0 * (value - nominal) / abs(nominal), 1)


def signed(value: float, decimals: int) -> str:
    """With its sign, but for a zero; nothing of what is no number."""
    if not math.isfinite(value):
        return NOTHING
    text = f"{value:+.{decimals}f}"
    return text if float(text) else text[1:]


def whole_percent(share: float) -> str:
    """An estimated share, 0 to 1, in whole per cent: no estimate says that it is all."""
    return "over 99 %" if share >= 0.995 else f"{100.0 * share:.0f} %"


def _magnitude(value: float) -> int:
    return math.floor(math.log10(abs(value)))


def _exponent(value: float) -> int:
    """The next multiple of three below."""
    return 3 * (_magnitude(value) // 3)


def _scaled(value: float, exponent: int, decimals: int) -> str:
    """`decimals` of the unscaled value, fewer than none rounds before the point."""
    shown = decimals + exponent
    number = round(value / 10.0**exponent, shown)
    text = f"{number:.{max(shown, 0)}f}"
    return f"{text}e{exponent}" if exponent else text
