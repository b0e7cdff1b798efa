"""Where a session's jobs are kept, so that it finds them again after its page was reloaded.

A reload makes a new session, which knows only its address. So the address holds an id that nobody
guesses, `?work=…`, and that id names a folder. Whoever has the address sees its jobs; nobody else does.
"""

from __future__ import annotations

import contextlib
import shutil
import time
from functools import cache
from pathlib import Path

import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.jobs.record import KEEP_S, clean, is_id, jobs_of, new_id

KEY = "work"
_STATE = "workbench jobs id"


def jobs_workspace() -> Path | None:
    """The folder of this session's jobs; None as long as it has started none. Call it on every page that has jobs."""
    number = _known()
    if number is None:
        return None
    if st.query_params.get(KEY) != number:  # another page's link has dropped it
        st.query_params[KEY] = number
    return _folder(number)


def new_jobs_workspace() -> Path:
    """The folder of this session's jobs, made when it is the first; its id goes into the page's address."""
    folder = jobs_workspace()
    if folder is None:
        number = new_id()
        folder = _folder(number)
        folder.mkdir(mode=0o700)
        st.session_state[_STATE] = st.query_params[KEY] = number
    return folder


def _known() -> str | None:
    """The id of this session: its own, or that of its address; only if its folder is there."""
    for number in (st.session_state.get(_STATE), st.query_params.get(KEY)):
        if is_id(number) and _folder(number).is_dir():
            st.session_state[_STATE] = number
            return number
    return None


def _folder(number: str) -> Path:
    return _root() / f"work-{number}"


@cache
def _root() -> Path:
    root = session.app_folder()
    sweep(root)
    return root


def sweep(root: Path, older_than_s: float = KEEP_S) -> None:
    """Remove what nobody has touched for a week."""
    for folder in root.glob("work-*"):
        clean(folder, older_than_s)
        if jobs_of(folder):
            continue
        with contextlib.suppress(OSError):
            newest = max(path.stat().st_mtime for path in (folder, *folder.iterdir()))
            if time.time() - newest > older_than_s:
                shutil.rmtree(folder, ignore_errors=True)
