"""A folder of results: written whole or not at all, never over what is there."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from workbench.core.errors import InputError, UnwritableError
from workbench.core.input_file import read_input

if sys.platform != "win32":  # there, what a killed writer leaves stays
    import fcntl

_HIDDEN = re.compile(r"\..+\.new-[a-z0-9_]{8}\.part")


def is_free(folder: Path) -> bool:
    """Not there, or an empty folder."""
    return not os.path.lexists(folder) or (folder.is_dir() and not any(folder.iterdir()))


def what_is_in(folder: Path) -> str:
    """The reason why a folder that is not free cannot be written to."""
    return "is not empty" if folder.is_dir() else "is a file, expected a folder to be made"


def check_free(folder: Path | None) -> None:
    """InputError where the folder holds something, or cannot be looked into; None is a result that is not kept."""
    try:
        if folder is None or is_free(folder):
            return
    except OSError as error:
        raise InputError(f"no results can be written there: {error.strerror or error}", file=folder) from error
    raise InputError(f"{what_is_in(folder)}; nothing is overwritten, choose another folder", file=folder)


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """A hidden folder to write to; it is renamed to `folder` when the block ends without an error.

    What stops in the middle leaves no results. Enter it before long work: a place that cannot be
    written is known at once. InputError where `folder` is not free or a file cannot be written.
    """
    check_free(folder)
    target = folder.resolve()
    if target == Path.cwd():  # the new folder would take its name, and whoever stands in it would see the old one
        raise InputError("is the current folder; name one to be made", file=folder)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        sweep(target.parent)
        hidden, lock = _locked(target)
    except (FileExistsError, NotADirectoryError) as error:
        said = "no results can be written there: a file stands where a folder must be"
        raise InputError(said, file=folder) from error
    except OSError as error:
        raise InputError(f"no results can be written there: {error.strerror or error}", file=folder) from error
    try:
        yield hidden
        hidden.chmod(0o755)  # mkdtemp makes folders only their owner can enter
        hidden.rename(target)
    except OSError as error:
        raise InputError(f"no results written: {error.strerror or error}", file=folder) from error
    finally:
        shutil.rmtree(hidden, ignore_errors=True)
        os.close(lock)


def sweep(parent: Path) -> None:
    """Remove hidden folders whose writer was killed: the lock that each writer holds on its own goes with it."""
    if sys.platform == "win32":
        return
    for left in parent.iterdir():
        if _HIDDEN.fullmatch(left.name):
            with contextlib.suppress(OSError):  # another writer holds it, removes it too, or it is not ours to remove
                handle = os.open(left, os.O_RDONLY)
                try:
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    shutil.rmtree(left, ignore_errors=True)
                finally:
                    os.close(handle)


def _locked(target: Path) -> tuple[Path, int]:
    """A hidden folder beside `target`, and the open handle that holds its lock (of the null device without locks)."""
    while True:
        hidden = Path(tempfile.mkdtemp(prefix=f".{target.name}.new-", suffix=".part", dir=target.parent))
        if sys.platform == "win32":
            return hidden, os.open(os.devnull, os.O_RDONLY)
        handle = os.open(hidden, os.O_RDONLY)
        with contextlib.suppress(OSError):  # a file system without locks: then nobody else gets one either
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.lexists(hidden):  # else it was swept before it was locked
            return hidden, handle
        os.close(handle)


def replace_json(path: Path, data: Mapping[str, object], mark: str) -> None:
    """Write a JSON file, whole or not at all. An existing file is replaced only if it has the same key `mark`.

    InputError where something else stands there, or it cannot be written. What is no number becomes null.
    """
    check_replaceable(path, mark)
    replace_text(path, json.dumps(_with_nulls(data), indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def replace_text(path: Path, text: str) -> None:
    """Write a file, whole or not at all, over what is there. InputError when it cannot be written."""
    temporary: str | None = None
    try:
        with writable(path):
            handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
            with os.fdopen(handle, "w", encoding="utf-8") as stream:
                stream.write(text)
                stream.flush()
                os.fsync(stream.fileno())
            os.chmod(temporary, 0o644)  # mkstemp makes files only their owner can read
            os.replace(temporary, path)
            temporary = None
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A hidden file to write to; it takes the place of `path` when the block ends without an error, else it goes.

    UnwritableError where it cannot be written.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        with writable(path):
            yield part
            part.replace(path)
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


@contextmanager
def writable(path: Path) -> Iterator[None]:
    """UnwritableError where the system does not let it be written."""
    try:
        yield
    except OSError as error:
        raise UnwritableError(f"cannot be written: {error.strerror or error}", file=path) from error


def check_replaceable(path: Path, mark: str) -> None:
    """InputError unless nothing stands there, an empty file, or a JSON file with the key `mark`."""
    if not os.path.lexists(path):
        return
    if not path.is_file():
        raise InputError("is no file that can be replaced", file=path)
    try:
        content = read_input(path, "json")
        existing = json.loads(content) if content else {mark: None}
    except (ValueError, RecursionError):
        existing = None
    if not (isinstance(existing, dict) and mark in existing):
        raise InputError("is there and was not written by this command; nothing is overwritten", file=path)


def _with_nulls(value: object) -> object:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {key: _with_nulls(inner) for key, inner in value.items()}
    return [_with_nulls(inner) for inner in value] if isinstance(value, list | tuple) else value


def write_json(path: Path, data: object) -> None:
    """One JSON file, on the disk when this returns. ValueError for a number that JSON does not know (NaN)."""
    write_whole(path, f"{json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)}\n".encode())


def write_whole(path: Path, data: bytes) -> None:
    """The file is on the disk when this returns."""
    with path.open("wb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())
