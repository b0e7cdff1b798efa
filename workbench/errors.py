"""What goes wrong in a way the user can mend."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(Exception):
    """Bad input, as one line: file, place, value, what was expected, the nearest valid name.

    `file` and `line` say where it stands, `place` which key, column or run it is.
    The command line prints it and ends with exit code 2; nothing has been written.
    """

    def __init__(self, problem: str, *, file: object = None, line: int | None = None, place: str | None = None):
        self.problem = problem
        self.file = None if file is None else str(file)
        self.line = line
        self.place = place
        super().__init__(str(self))

    def __str__(self) -> str:
        where = self.file or ""
        if where and self.line is not None:
            where += f":{self.line}"
        return ": ".join(part for part in (where, self.place, self.problem) if part)


def nearest(name: str, valid: Iterable[str]) -> str:
    """The end of a sentence that helps with a misspelt name: a suggestion, or all valid names."""
    names = sorted(valid)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    return f"did you mean '{close[0]}'?" if close else f"valid: {', '.join(names)}"
