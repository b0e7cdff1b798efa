"""Which campaign a page works on.

chosen_campaign(key)   a select box: the server's own campaigns, those this visitor has uploaded, and an upload;
                       returns the campaign. Call inside `guarded()`. The choice is the same on every page.
campaign_or_none(key)  the same, None as long as files are to be uploaded
last_campaign()        the campaign chosen last on any page, None before
last_name()            what the select box calls it, "" before
prefer(name)           which campaign a session that has chosen none begins with
offered()              the server's campaigns: those in the folders that the environment variable
                       WORKBENCH_CAMPAIGNS lists, those in `campaigns/` beside app.py, and the demonstration

A browser chooses among names; no path that it sends is ever opened. An uploaded campaign lies in the visitor's own
folder, which the address names: a reload finds it again. Memory holds the one campaign that is worked on.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import streamlit as st
from streamlit.runtime.scriptrunner import get_script_run_ctx

from workbench.dashboard import session
from workbench.dashboard.session import new_work_folder, work_folder
from workbench.dashboard.uploads import Uploaded, name_of, read_stored, read_uploaded, stored_campaigns
from workbench.effects import check
from workbench.logs import Campaign, read_campaign
from workbench.logs.formats.known import suffixes

if TYPE_CHECKING:
    from streamlit.runtime.uploaded_file_manager import UploadedFile

VARIABLE = "WORKBENCH_CAMPAIGNS"
ROOT = Path(__file__).parents[2]
SHIPPED = (ROOT / "campaigns", ROOT / "scenarios" / "demo_campaign")
UPLOAD = "upload a campaign"
TYPES = ["zip", "yaml", *(suffix.removeprefix(".") for suffix in suffixes())]
_LAST, _READ, _SENT = "campaign chosen", "campaigns read", "campaigns sent"


def offered() -> dict[str, Path]:
    """Name -> folder of each campaign that the server's owner lets people see."""
    listed = [Path(part) for part in os.environ.get(VARIABLE, "").split(os.pathsep) if part]
    folders: dict[str, Path] = {}
    for root in [*listed, *SHIPPED]:
        for folder in [root, *(sorted(root.iterdir()) if root.is_dir() else [])]:
            if (folder / "runs.yaml").is_file() and folder not in folders.values():
                folders[_free(folder.resolve().name, folders)] = folder
    return folders


def uploaded() -> dict[str, Path]:
    """Name -> folder of each campaign that this visitor has uploaded."""
    workspace, folders = work_folder(), dict[str, Path]()
    for folder in [] if workspace is None else stored_campaigns(workspace):
        folders[_free(f"{name_of(folder)} (uploaded)", folders)] = folder
    return folders


def _free(name: str, taken: dict[str, Path]) -> str:
    number = 2
    free = name
    while free in taken:
        free, number = f"{name} ({number})", number + 1
    return free


def last_campaign() -> Campaign | None:
    campaign = session.get(_READ, dict, {}).get(last_name())
    return campaign if isinstance(campaign, Campaign) else None


def last_name() -> str:
    return session.get(_LAST, str, "")


def prefer(name: str) -> None:
    if not last_name():
        session.put(_LAST, name)


def is_own(campaign: Campaign) -> bool:
    """Whether it was uploaded: a job gets a copy of it."""
    workspace = work_folder()
    return workspace is not None and campaign.path.is_relative_to(workspace)


def chosen_campaign(key: str) -> Campaign:
    """The campaign that the select box `key` names. InputError for files that are not one."""
    campaign = campaign_or_none(key)
    if campaign is None:
        st.stop()
    return campaign


def campaign_or_none(key: str) -> Campaign | None:
    """The same; None, which the page says, as long as files are to be uploaded."""
    here, own = offered(), uploaded()
    options = [*here, *own, UPLOAD]
    # An upload has to be the choice; a widget that was drawn keeps its own.
    if last_name() in options and session.get(f"{key} of", str, "") != last_name():
        st.session_state[key] = last_name()
    elif st.session_state.get(key) not in options:
        st.session_state.pop(key, None)
    choice = st.selectbox("Campaign", options, key=key)
    if choice == UPLOAD:
        _upload(key)
        return None
    session.put(f"{key} of", choice)
    session.put(_LAST, choice)
    known = session.get(_READ, dict, {}).get(choice)
    folder = here.get(choice) or own[choice]
    if isinstance(known, Campaign) and known.path == folder:
        return known
    session.put(_READ, {})  # the one before is let go first: campaigns can be large
    with st.spinner("Reading the logs"):
        campaign = read_stored(folder) if choice in own else read_campaign(folder, confined=True, check_effects=check)
    session.put(_READ, {choice: campaign})
    return campaign


def _upload(key: str) -> None:
    """Stores what is sent as a campaign of this visitor, chooses it and draws the page anew."""
    sent = session.get(_SENT, int, 0)
    files = st.file_uploader(
        "A zip of the campaign's folder, or machine.yaml, runs.yaml and the logs",
        type=TYPES, accept_multiple_files=True, key=f"{key} files {sent}",
    )  # fmt: skip
    if not files:
        st.info("A campaign is machine.yaml, runs.yaml and the logs that it names.", icon=":material/upload:")
        return
    with st.spinner("Reading the logs"):
        campaign = read_uploaded([Uploaded(file.name, file.getvalue()) for file in files], new_work_folder())
    _let_go(files)
    name = next(name for name, folder in uploaded().items() if folder == campaign.path)
    session.put(_SENT, sent + 1)  # a new field: the old one's files are gone
    session.put(_READ, {name: campaign})
    session.put(_LAST, name)
    st.rerun()


def _let_go(files: Sequence[UploadedFile]) -> None:
    """Frees the server's copy of what was sent. Streamlit has no public way: it keeps files until the session ends."""
    context = get_script_run_ctx()
    remove = getattr(context and context.uploaded_file_mgr, "remove_file", None)
    for file in files:
        if context is not None and remove is not None:
            remove(context.session_id, file.file_id)
