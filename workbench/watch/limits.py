"""Limits as a command line has them: KEY=VALUE."""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.errors import InputError


def read_limits(words: Sequence[str]) -> dict[str, float]:
    """InputError for any other form."""
    limits = {}
    for word in words:
        key, _, value = word.partition("=")
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not (key.strip() and math.isfinite(number)):
            raise InputError(f"'{word}', expected KEY=VALUE", place="limits")
        limits[key.strip()] = number
    return limits
