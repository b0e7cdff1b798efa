"""What one visitor keeps: private folders and the session's state.

    workspace()                 folder of this session, mode 0700, gone when the session ends
    stored(upload, name, most)  an uploaded file's bytes under the page's own name, size-limited
    work_folder()               folder of jobs and uploaded campaigns that the address names, `?work=…`
    own_jobs(kind)              the jobs in it, the newest first
    get(key, kind, default)     typed read of the session's state; put(key, value) writes
    once(key, question, make)   what was made last, as long as the question is the same

Two sessions share nothing but caches of pure functions of values. The id in the address is one that nobody guesses:
whoever has the address sees its work, and nobody else does.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import streamlit as st
from streamlit.runtime.uploaded_file_manager import UploadedFile

from workbench.core.errors import InputError
from workbench.dashboard.jobs import KEEP_S, Job, clean, is_id, jobs_of, new_id

T = TypeVar("T")
MB = 1_000_000
WORK = "work"
_WORKSPACE, _WORK_ID = "workbench workspace", "workbench jobs id"


@cache
def app_folder() -> Path:
    """This user's private folder of the dashboard under the system's temporary one; InputError if another's."""
    path = Path(tempfile.gettempdir()) / f"workbench-{os.getuid()}"
    path.mkdir(mode=0o700, exist_ok=True)
    status = path.lstat()
    # The temporary folder is everybody's: a link or a folder laid there by another user is not taken.
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid():
        raise InputError("is not this user's own folder; remove it or set TMPDIR", file=path)
    path.chmod(0o700)
    sweep(path)
    return path


def sweep(root: Path, older_than_s: float = KEEP_S) -> None:
    """Removes what sessions of servers that no longer run have left, and work that nobody has touched for a week."""
    for folder in root.glob("session-*"):
        with contextlib.suppress(ValueError, PermissionError):  # no process' number; another user's process
            try:
                os.kill(int(folder.name.split("-")[1]), 0)
            except ProcessLookupError:
                shutil.rmtree(folder, ignore_errors=True)
    for folder in root.glob("work-*"):
        clean(folder, older_than_s)
        with contextlib.suppress(OSError):
            newest = max(path.stat().st_mtime for path in (folder, *folder.iterdir()))
            if not jobs_of(folder) and time.time() - newest > older_than_s:
                shutil.rmtree(folder, ignore_errors=True)


def workspace() -> Path:
    """The session's own folder; it goes when the session's state does, or when Python ends."""
    folder = st.session_state.get(_WORKSPACE)
    if folder is None or not Path(folder.name).is_dir():
        name = f"session-{os.getpid()}-"
        folder = tempfile.TemporaryDirectory(prefix=name, dir=app_folder(), ignore_cleanup_errors=True)
        st.session_state[_WORKSPACE] = folder
    return Path(folder.name)


def stored(upload: UploadedFile, name: str, most_bytes: int = 1 * MB) -> Path:
    """The uploaded bytes in a file of the session, under the name the page gives it. InputError for a larger one,
    ValueError for a name with folders in it."""
    if name != Path(name).name or name in ("", ".", ".."):
        raise ValueError(f"{name!r} is not a plain file name")
    if upload.size > most_bytes:
        raise InputError(f"{upload.size / MB:.1f} MB, expected at most {most_bytes / MB:g} MB", file=name)
    path = workspace() / name
    path.write_bytes(upload.getvalue())
    return path


def work_folder() -> Path | None:
    """The folder that this visitor's address names; None before there is one."""
    for number in (st.session_state.get(_WORK_ID), st.query_params.get(WORK)):
        if is_id(number) and (folder := app_folder() / f"work-{number}").is_dir():
            st.session_state[_WORK_ID] = number
            if st.query_params.get(WORK) != number:  # another page's link has dropped it
                st.query_params[WORK] = number
            return folder
    return None


def new_work_folder() -> Path:
    """The same, made where there is none; its id goes into the page's address."""
    folder = work_folder()
    if folder is None:
        number = new_id()
        folder = app_folder() / f"work-{number}"
        folder.mkdir(mode=0o700)
        st.session_state[_WORK_ID] = st.query_params[WORK] = number
    return folder


def own_jobs(kind: str) -> list[Job]:
    return jobs_of(work_folder(), kind)


def get(key: str, kind: type[T], default: T) -> T:
    """The session's value of `key`; `default`, which is then kept, where there is none of this kind."""
    value = st.session_state.get(key)
    if not isinstance(value, kind):
        st.session_state[key] = value = default
    return value


def put(key: str, value: Any) -> None:
    st.session_state[key] = value


def once(key: str, question: Any, make: Callable[[], T]) -> T:
    """What the question was answered with, made anew only where another one was asked last. The last answer is let go
    before the next is made: it may be large."""
    if get(key, tuple, ())[:1] != (question,):
        put(key, ())
        put(key, (question, make()))
    answer: T = get(key, tuple, ())[1]
    return answer
