"""What one browser session keeps: its private folder and its state.

    workspace()                 folder of this session, mode 0700, gone when the session ends
    file_in_workspace(name)     a path in it; `name` is the page's own choice, never an uploaded name
    stored(upload, name, most)  an uploaded file's bytes under the page's own name, size-limited
    get(key, kind, default)     typed read of the session's state; put(key, value) writes

Two sessions share nothing but caches of pure functions of values. `app_folder()` is the
server's own private folder, for what must outlive a session (batches).
"""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
import weakref
from functools import cache
from pathlib import Path
from typing import Any, Protocol, TypeVar

import streamlit as st

from workbench.errors import InputError

T = TypeVar("T")
MB = 1_000_000
_WORKSPACE = "workbench workspace"


class Upload(Protocol):
    """What is used of streamlit's uploaded file."""

    size: int

    def getvalue(self) -> bytes: ...


class _Folder:
    """A folder that goes when nobody holds this object any more, or when Python ends."""

    def __init__(self, path: Path):
        self.path = path
        self._end = weakref.finalize(self, shutil.rmtree, path, ignore_errors=True)


@cache
def app_folder() -> Path:
    """This user's private folder of the dashboard under the system's temporary one; InputError if another's."""
    path = Path(tempfile.gettempdir()) / f"workbench-{os.getuid()}" if hasattr(os, "getuid") else _without_owner()
    path.mkdir(mode=0o700, exist_ok=True)
    status = path.lstat()
    # The temporary folder is everybody's: a link or a folder laid there by another user is not taken.
    if not stat.S_ISDIR(status.st_mode) or (hasattr(os, "getuid") and status.st_uid != os.getuid()):
        raise InputError("is not this user's own folder; remove it or set TMPDIR", file=path)
    path.chmod(0o700)
    _sweep(path)
    return path


def _without_owner() -> Path:
    return Path(tempfile.gettempdir()) / "workbench-dashboard"  # Windows: the temporary folder is the user's own


def _sweep(root: Path) -> None:
    """Removes what sessions of servers that no longer run have left behind."""
    for folder in root.glob("session-*"):
        number = folder.name.split("-")[1]
        if number.isdecimal() and not _runs(int(number)):
            shutil.rmtree(folder, ignore_errors=True)


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True  # another user's
    return True


def workspace() -> Path:
    """The session's own folder."""
    folder = st.session_state.get(_WORKSPACE)
    if folder is None or not folder.path.is_dir():
        folder = _Folder(Path(tempfile.mkdtemp(prefix=f"session-{os.getpid()}-", dir=app_folder())))
        st.session_state[_WORKSPACE] = folder
    path: Path = folder.path
    return path


def file_in_workspace(name: str) -> Path:
    """A path in the session's folder. ValueError for a name with folders in it."""
    if name != Path(name).name or name in ("", ".", ".."):
        raise ValueError(f"{name!r} is not a plain file name")
    return workspace() / name


def stored(upload: Upload, name: str, most_bytes: int = 1 * MB) -> Path:
    """The uploaded bytes in a file of the session, under the name the page gives it.

    InputError for a file larger than most_bytes.
    """
    if upload.size > most_bytes:
        raise InputError(f"{upload.size / MB:.1f} MB, expected at most {most_bytes / MB:g} MB", file=name)
    path = file_in_workspace(name)
    path.write_bytes(upload.getvalue())
    return path


def get(key: str, kind: type[T], default: T) -> T:
    """The session's value of `key`; `default`, which is then kept, where there is none of this kind."""
    value = st.session_state.get(key)
    if not isinstance(value, kind):
        st.session_state[key] = value = default
    return value


def put(key: str, value: Any) -> None:
    st.session_state[key] = value
