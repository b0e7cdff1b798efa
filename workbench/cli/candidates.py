"""The effects that a diagnosis is asked to weigh, by name."""

from __future__ import annotations

from workbench.effects import effects_for
from workbench.errors import InputError, nearest
from workbench.machine import Axis, Hoist
from workbench.plants import plant_of

ALL = "all"


def chosen_candidates(text: str | None, machine: Hoist | Axis) -> tuple[str, ...] | None:
    """Names with commas between; `all`: every effect there is for the machine, unlisted ones too. None stays None.

    InputError for an unknown or a repeated name, with the nearest valid one.
    """
    if text is None:
        return None
    known = effects_for(plant_of(machine).kind)
    if text.strip() == ALL:
        return tuple(known)
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names:
        raise InputError(f"no effect is named, expected names with commas between, or '{ALL}'", place="--candidates")
    for name in names:
        if name not in known:
            raise InputError(f"unknown effect '{name}'; {nearest(name, known)}", place="--candidates")
    if repeated := [name for name in names if names.count(name) > 1]:
        raise InputError(f"'{repeated[0]}' is named twice, expected each effect once", place="--candidates")
    return tuple(names)
