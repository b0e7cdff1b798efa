"""Whether a path is a file that can be read, and if not, why."""

from __future__ import annotations

import difflib
import os
from pathlib import Path

from workbench.errors import InputError


def readable_file(path: str | os.PathLike[str]) -> Path:
    """The path, when a regular readable file is there; otherwise an InputError that says what is there instead."""
    file = Path(path)
    try:
        if file.is_dir():
            raise InputError("is a folder; expected a file", file=file)
        if file.is_symlink() and not file.exists():
            raise InputError("is a link that leads nowhere, or to itself; expected a file", file=file)
        if not file.exists():
            raise InputError(f"no such file{_similar(file)}", file=file)
        if not file.is_file():
            raise InputError("is not a regular file", file=file)
        with file.open("rb"):
            pass
    except ValueError as error:
        raise InputError(f"is not a path: {error}", file=repr(str(path))) from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=file) from error
    return file


def _similar(file: Path) -> str:
    """Help with a misspelt path: a close name in the same folder, else the few names that are there."""
    folder = file.parent
    if not folder.is_dir():
        return f"; there is no folder {folder}"
    names = sorted(entry.name for entry in folder.iterdir())
    close = difflib.get_close_matches(file.name, names, n=1, cutoff=0.6)
    if close:
        return f"; did you mean '{close[0]}'?"
    if not names:
        return "; its folder is empty"
    return f"; its folder holds {', '.join(names[:8])}{', …' if len(names) > 8 else ''}"
