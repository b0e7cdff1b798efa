"""What an unquoted YAML word means: the YAML 1.2 core schema.

PyYAML follows YAML 1.1, in which 1e5 is text, yes is true, 1:30 is ninety and
010 is eight. Here 1e5 is a number, yes, 1:30 and dates are text, 010 is ten.
"""

from __future__ import annotations

import re

_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_HEX = re.compile(r"0x[0-9a-fA-F]{1,15}")
_OCTAL = re.compile(r"0o[0-7]{1,15}")
_INFINITE = re.compile(r"([-+]?)\.(inf|Inf|INF)")
_WORDS: dict[str, bool | None] = {
    "": None, "~": None, "null": None, "Null": None, "NULL": None,
    "true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False,
}  # fmt: skip
_LONGEST_INTEGER = 18  # digits; longer ones become a float, so that no text can cost unbounded time


def meaning(word: str) -> str | int | float | bool | None:
    """The value of an unquoted scalar."""
    if word in _WORDS:
        return _WORDS[word]
    if _INTEGER.fullmatch(word) and len(word) <= _LONGEST_INTEGER:
        return int(word)
    if _FLOAT.fullmatch(word):
        return float(word)
    if _HEX.fullmatch(word) or _OCTAL.fullmatch(word):
        return int(word, 0)
    if infinite := _INFINITE.fullmatch(word):
        return float(infinite[1] + "inf")
    if word in (".nan", ".NaN", ".NAN"):
        return float("nan")
    return word
