"""What a kind of machine calls its quantities, and what is said of a log alike in every report."""

from __future__ import annotations

import math
from dataclasses import dataclass

from workbench.logs import Campaign
from workbench.machines import Axis, Hoist, kind_of

NOTHING = "–"
LEAST, MOST = 1e-4, 1e6  # between them a number reads well without an exponent


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
    change = round(100.0 * (value - nominal) / abs(nominal), 1)
    return f"{change:+.1f}" if change else "0.0"


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


# What a kind of machine calls its quantities, and what is said of a log alike in every report.


MOST_NOTES = 5


@dataclass(frozen=True)
class Words:
    """quantity: what drives the machine; unit: for people; suffix: for JSON keys; scale: what speeds are judged by."""

    quantity: str
    unit: str
    suffix: str
    scale: str


def words_of(machine: Hoist | Axis) -> Words:
    kind = kind_of(machine)
    return Words(kind.drive.quantity, kind.drive.unit, kind.drive.suffix, kind.speed_scale[0])


def direction_names(machine: Hoist | Axis) -> tuple[str, str]:
    return kind_of(machine).directions.names


def brief_notes(campaign: Campaign) -> list[str]:
    """The first few of the reader's notes."""
    notes = list(campaign.all_notes)
    if len(notes) <= MOST_NOTES:
        return notes
    return [*notes[:MOST_NOTES], f"and {len(notes) - MOST_NOTES} more notes like these"]
