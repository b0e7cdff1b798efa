"""What a command line chooses for an export: effects with values, platforms, a ramp's limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from workbench.errors import InputError
from workbench.export.drives import RampLimits
from workbench.study.scenario.record import LimitsBlock
from workbench.yaml_strict import Document, load, validate


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


def ramp_of(path: Path) -> RampLimits | None:
    """The limits of a scenario's motion, both ways alike; None for a file without them."""
    document = load(path)
    block = document.data.get("limits") if isinstance(document.data, dict) else None
    if not isinstance(block, dict):
        return None
    inside = {place[1:]: line for place, line in document.lines.items() if place[:1] == ("limits",)}
    limits = validate(LimitsBlock, Document(document.file, block, inside))
    if limits.speed_m_s is None or limits.acceleration_m_s2 is None:
        return None
    return RampLimits(limits.speed_m_s, limits.acceleration_m_s2, limits.jerk_m_s3)
