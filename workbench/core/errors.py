"""The error for bad input, which the user can correct."""

from __future__ import annotations

import difflib
import unicodedata
from collections.abc import Collection, Iterable

_LONGEST_NAME, _MOST_NAMES = 200, 100
MOST = 2000  # characters of one error's sentence; what is longer loses its middle


class InputError(Exception):
    """Bad input, as one line: file, place, value, what was expected, the nearest valid name.

    `file` and `line` say where it stands, `place` which key, column or run it is.
    The command line prints it and ends with exit code 2; nothing has been written.
    Names out of a damaged file may hold anything: what cannot be printed is escaped, what is long is cut.
    """

    def __init__(self, problem: str, *, file: object = None, line: int | None = None, place: str | None = None):
        self.problem = one_line(problem)
        self.file = None if file is None else str(file)
        self.line = line
        self.place = None if place is None else one_line(place, 300)
        super().__init__(str(self))

    def __str__(self) -> str:
        where = one_line(self.file or "", 1000)
        if where and self.line is not None:
            where += f":{self.line}"
        return ": ".join(part for part in (where, self.place, self.problem) if part)


class UnwritableError(InputError):
    """Something cannot be written now, and can be when there is room again."""


def one_line(text: str, most: int = MOST) -> str:
    """The text as one line of at most `most` characters that can be printed: lines become parts of a sentence."""
    lines = [line.strip() for line in text[: 4 * most].splitlines()]
    plain = "".join(_printable(sign) for sign in "; ".join(line for line in lines if line))
    return plain if len(plain) <= most else f"{plain[: most * 3 // 4]} … {plain[-most // 5 :]}"


def _printable(sign: str) -> str:
    if sign.isprintable() or unicodedata.category(sign) == "Zs":  # a no-break space does no harm
        return sign
    return sign.encode("unicode_escape").decode("ascii")


def nearest(name: str, valid: Iterable[str]) -> str:
    """The end of a sentence that helps with a misspelt name: a suggestion, or the valid names, few of very many."""
    names = sorted(valid)
    # Comparing costs the product of both lengths: a word longer than any name is misspelt beyond help.
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.6) if len(name) <= _LONGEST_NAME else []
    if close:
        return f"did you mean '{close[0]}'?"
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return f"valid: {', '.join(names[:_MOST_NAMES])}{more}"


def check_known(problem: str, name: str, valid: Collection[str], *, file: object = None, place: str = "") -> None:
    """InputError with the nearest name for one that is not valid. problem: what stands before it: unknown signal."""
    if name not in valid:
        raise InputError(f"{problem} '{name}'; {nearest(name, valid)}", file=file, place=place or None)
