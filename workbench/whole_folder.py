"""A folder of results: written whole or not at all, never over what is there."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from workbench.errors import InputError


def is_free(folder: Path) -> bool:
    """Not there, or an empty folder."""
    return not os.path.lexists(folder) or (folder.is_dir() and not any(folder.iterdir()))


def what_is_in(folder: Path) -> str:
    """Why a folder that is not free cannot be written to."""
    return "is not empty" if folder.is_dir() else "is a file, expected a folder to be made"


def check_free(folder: Path) -> None:
    """InputError where the folder holds something, or cannot be looked into."""
    try:
        free = is_free(folder)
    except OSError as error:
        raise InputError(f"no results can be written there: {error.strerror or error}", file=folder) from error
    if not free:
        raise InputError(f"{what_is_in(folder)}; nothing is overwritten, choose another folder", file=folder)


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """A hidden folder to write to; it is renamed to `folder` when the block ends without an error.

    What stops in the middle leaves no results. Enter it before long work: a place that cannot be
    written is known at once. `folder` is free (see `check_free`). InputError where a file cannot be written.
    """
    target = folder.resolve()
    if target == Path.cwd():  # the new folder would take its name, and whoever stands in it would see the old one
        raise InputError("is the current folder; name one to be made", file=folder)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        hidden = Path(tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".part", dir=target.parent))
    except (FileExistsError, NotADirectoryError) as error:
        raise InputError(
            "no results can be written there: a file stands where a folder must be", file=folder
        ) from error
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


def write_json(path: Path, data: object) -> None:
    """One JSON file, on the disk when this returns. ValueError for a number that JSON does not know (NaN)."""
    with path.open("w", encoding="utf-8") as stream:
        json.dump(data, stream, indent=1, ensure_ascii=False, allow_nan=False)
        stream.write("\n")
        stream.flush()
        os.fsync(stream.fileno())
