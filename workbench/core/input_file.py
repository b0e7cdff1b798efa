"""The one way to open a file that a user names: regular, of a size that its kind may have, before a byte is read.

A pipe or a device would keep the reader waiting for ever, or never end; a sparse file may claim any size.
"""

from __future__ import annotations

import difflib
import os
import stat
from collections.abc import Mapping
from io import BufferedReader
from pathlib import Path

from workbench.core.errors import InputError

MB = 1_000_000
# Kind of file -> (most bytes, what a larger one may be).
MOST_BYTES: Mapping[str, tuple[int, str]] = {
    "key": (10_000, ""),
    "settings": (5 * MB, "; is it a log?"),
    "python": (1 * MB, "; expected Python with effects"),
    "json": (200 * MB, ""),
    "diagnosis": (2_000 * MB, ""),
    "table": (8_000 * MB, ""),
    "drive log": (1_000 * MB, "; cut it"),
    "log": (20_000 * MB, "; cut it"),
}


def open_input(path: str | os.PathLike[str], kind: str) -> BufferedReader:
    """The open file. InputError for what is not there, no regular file, too large for its kind, or not readable."""
    file = Path(path)
    try:
        _check(file, os.stat(file), kind)
        # What is checked is what is opened: another file may have taken the name meanwhile. A pipe does not block.
        handle = os.open(file, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        try:
            _check(file, os.fstat(handle), kind)
            return os.fdopen(handle, "rb")
        except InputError:
            os.close(handle)
            raise
    except FileNotFoundError as error:
        if file.is_symlink():
            raise InputError("is a link that leads nowhere, or to itself; expected a file", file=file) from error
        raise InputError(f"no such file{similar(file)}", file=file) from error
    except ValueError as error:
        raise InputError(f"is not a path: {error}", file=repr(str(path))) from error
    except OSError as error:
        if file.is_symlink() and not file.exists():
            raise InputError("is a link that leads nowhere, or to itself; expected a file", file=file) from error
        raise InputError(f"cannot be read: {error.strerror}", file=file) from error


def read_input(path: str | os.PathLike[str], kind: str) -> bytes:
    """The whole content. InputError as `open_input`, and where the disk fails."""
    try:
        with open_input(path, kind) as stream:
            return stream.read(MOST_BYTES[kind][0])
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", file=path) from error


def readable_file(path: str | os.PathLike[str], kind: str = "log") -> Path:
    """The path of a file that `open_input` opens, for a parser that takes a path; otherwise its InputError."""
    open_input(path, kind).close()
    return Path(path)


def _check(file: Path, state: os.stat_result, kind: str) -> None:
    if stat.S_ISDIR(state.st_mode):
        raise InputError("is a folder; expected a file", file=file)
    if not stat.S_ISREG(state.st_mode):
        raise InputError("is not a regular file", file=file)
    most, hint = MOST_BYTES[kind]
    if state.st_size > most:
        raise InputError(f"is larger than {most / MB:g} MB{hint}", file=file)


def similar(file: Path) -> str:
    """Help with a misspelt path: a close name in the same folder, else the few names that are there."""
    folder = file.parent
    if not folder.is_dir():
        return f"; there is no folder {folder}"
    names = sorted(entry.name for entry in folder.iterdir())
    # A common ending makes no likeness: axis.yaml is no misspelt machine.yaml, nor is a folder runs a runs.yaml.
    stems = {Path(name).stem: name for name in names if not (file.suffix and (folder / name).is_dir())}
    close = difflib.get_close_matches(file.stem, stems, n=1, cutoff=0.6)
    if close:
        return f"; did you mean '{stems[close[0]]}'?"
    if not names:
        return "; its folder is empty"
    return f"; its folder holds {', '.join(names[:8])}{', …' if len(names) > 8 else ''}"
