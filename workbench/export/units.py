"""Units out of names: `rotor_inertia_kg_m2` is in kg m2. As FMI takes them: exponents of base units."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

Exponents = Mapping[str, int]

# Ending of a name -> (unit, exponents of its base units). Longer endings stand before those that they end with.
ENDINGS: Mapping[str, tuple[str, Exponents]] = MappingProxyType(
    {
        "nm_s_per_rad": ("N.m.s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
        "nm_per_rad": ("N.m/rad", {"kg": 1, "m": 2, "s": -2, "rad": -1}),
        "nm_per_s": ("N.m/s", {"kg": 1, "m": 2, "s": -3}),
        "nm_s2": ("N.m.s2", {"kg": 1, "m": 2}),
        "n_per_s": ("N/s", {"kg": 1, "m": 1, "s": -3}),
        "n_s_per_m": ("N.s/m", {"kg": 1, "s": -1}),
        "n_s2_per_m2": ("N.s2/m2", {"kg": 1, "m": -1}),
        "n_per_m": ("N/m", {"kg": 1, "s": -2}),
        "kg_per_m": ("kg/m", {"kg": 1, "m": -1}),
        "s_per_m": ("s/m", {"s": 1, "m": -1}),
        "per_m": ("1/m", {"m": -1}),
        "per_rad": ("1/rad", {"rad": -1}),
        "per_s": ("1/s", {"s": -1}),
        "kg_m2": ("kg.m2", {"kg": 1, "m": 2}),
        "rad_s2": ("rad/s2", {"rad": 1, "s": -2}),
        "rad_s": ("rad/s", {"rad": 1, "s": -1}),
        "m_s3": ("m/s3", {"m": 1, "s": -3}),
        "m_s2": ("m/s2", {"m": 1, "s": -2}),
        "m_s": ("m/s", {"m": 1, "s": -1}),
        "nm": ("N.m", {"kg": 1, "m": 2, "s": -2}),
        "kg": ("kg", {"kg": 1}),
        "hz": ("Hz", {"s": -1}),
        "pa": ("Pa", {"kg": 1, "m": -1, "s": -2}),
        "m2": ("m2", {"m": 2}),
        "rad": ("rad", {"rad": 1}),
        "n": ("N", {"kg": 1, "m": 1, "s": -2}),
        "m": ("m", {"m": 1}),
        "s": ("s", {"s": 1}),
    }
)
BASE: Mapping[str, Exponents] = MappingProxyType(dict(ENDINGS.values()))


def unit_of(name: str) -> str:
    """The unit that a name ends with, "" for a plain number."""
    last = name.rpartition(".")[2]
    for ending, (unit, _) in ENDINGS.items():
        if last == ending or last.endswith(f"_{ending}"):
            return unit
    return ""


def over_time(unit: str) -> str:
    """The unit of a derivative by time: of rad rad/s, of rad/s rad/s2; "" where there is no name for it."""
    if unit not in BASE:
        return ""
    wanted = {**BASE[unit], "s": BASE[unit].get("s", 0) - 1}
    wanted = {base: power for base, power in wanted.items() if power}
    return next((name for name, exponents in BASE.items() if dict(exponents) == wanted), "")
