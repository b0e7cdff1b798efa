"""What a command line chooses for an export: effects with values, platforms."""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.errors import InputError


def chosen_effects(words: Sequence[str]) -> dict[str, dict[str, float]]:
    """`friction_viscous.viscous_n_s_per_m=4210` as machine.yaml's `effects` has it. InputError for any other form."""
    chosen: dict[str, dict[str, float]] = {}
    for word in words:
        name, _, value = word.partition("=")
        effect, _, parameter = name.strip().partition(".")
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not (effect and parameter and math.isfinite(number)):
            raise InputError(f"'{word}', expected NAME.PARAMETER=VALUE", place="--effect")
        chosen.setdefault(effect, {})[parameter] = number
    return chosen


def chosen_platforms(text: str | None) -> tuple[str, ...] | None:
    """Names with commas between; `none`: no binaries; None stays None: all that can be compiled."""
    if text is None:
        return None
    if text.strip() == "none":
        return ()
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise InputError(f"'{text}', expected names with commas between, or 'none'", place="--platforms")
    return names
