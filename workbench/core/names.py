"""The words of a value's name, the unit at its end, a small number as people write it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from decimal import Decimal

# Longer endings stand before those that they end with.
UNITS = {
    "n_s2_per_m2": "N s²/m²", "nm_s2_per_rad2": "N m s²/rad²", "n_s_per_m": "N s/m", "nm_s_per_rad": "N m s/rad",
    "nm_per_rad": "N m/rad", "nm_per_s": "N m/s", "n_per_s": "N/s", "n_per_m": "N/m", "kg_per_m": "kg/m",
    "s_per_m": "s/m", "per_m": "1/m", "per_rad": "1/rad", "per_s": "1/s", "nm_s2": "N m s²", "kg_m2": "kg m²",
    "rad_s3": "rad/s³", "rad_s2": "rad/s²", "rad_s": "rad/s", "m_s3": "m/s³", "m_s2": "m/s²", "m_s": "m/s",
    "percent": "%", "rad": "rad", "nm": "N m", "kg": "kg", "hz": "Hz", "pa": "Pa", "m2": "m²", "kw": "kW", "m": "m",
    "w": "W", "n": "N", "j": "J", "s": "s",
}  # fmt: skip


def unit_of(name: str) -> str:
    """The unit at the end of a name; "" where it is none of UNITS."""
    return next((unit for ending, unit in UNITS.items() if name.endswith(f"_{ending}")), "")


def words_of(name: str) -> str:
    """`guide.coulomb_hoisting_n` as `coulomb hoisting`."""
    last = name.rpartition(".")[2]
    ending = next((ending for ending in UNITS if last.endswith(f"_{ending}")), "")
    return last.removesuffix(f"_{ending}").replace("_", " ")


def listed(names: Sequence[str]) -> str:
    """a; a and b; a, b and c; "" for none."""
    return "".join(names) if len(names) < 2 else f"{', '.join(names[:-1])} and {names[-1]}"


_POWER = re.compile(r"(?<![\w.])(\d+(?:\.\d+)?)e([+-]?\d+)(?!\w)")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def powers(text: str) -> str:
    """A text whose numbers in Python's way of writing, 8.2e-05, stand as people write them, 82·10⁻⁶: in powers of a
    thousand, as many digits as before; plainly between a ten-thousandth and a million."""
    return _POWER.sub(_power, text)


def _power(number: re.Match[str]) -> str:
    exponent = int(number[2])
    thousands = 3 * (exponent // 3)
    if -4 <= exponent < 6:
        return f"{Decimal(number[1]).scaleb(exponent):f}"
    return f"{Decimal(number[1]).scaleb(exponent - thousands):f}·10{str(thousands).translate(_RAISED)}"
