"""Which campaign a page works on.

chosen_campaign(key)   a select box: the server's own campaigns, those this session has uploaded, and
                       an upload; returns the campaign. Call inside `guarded()`. The choice is the
                       same on every page.
campaign_or_none(key)  the same, None as long as files are to be uploaded
last_campaign()        the campaign chosen last on any page, None before
last_name()            what the select box calls it, "" before
prefer(name)           which campaign a session that has chosen none begins with
offered()              the server's campaigns: those in the folders that the environment variable
                       WORKBENCH_CAMPAIGNS lists, those in `campaigns/` beside app.py, and the
                       demonstration that ships

A browser chooses among names; no path that it sends is ever opened.
"""

from __future__ import annotations

import os
from pathlib import Path

import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.uploads.campaign import KEPT, Uploaded, read_uploaded
from workbench.effects import check
from workbench.log_formats import suffixes
from workbench.logs import Campaign, read_campaign

VARIABLE = "WORKBENCH_CAMPAIGNS"
ROOT = Path(__file__).parents[2]
SHIPPED = (ROOT / "campaigns", ROOT / "scenarios" / "demo_campaign")
UPLOAD = "upload a campaign"
TYPES = ["zip", "yaml", *(suffix.removeprefix(".") for suffix in suffixes())]
_UPLOADED, _LAST, _READ = "campaigns uploaded", "campaign chosen", "campaigns read"


def offered() -> dict[str, Path]:
    """Name -> folder of each campaign that the server's owner lets people see."""
    listed = [Path(part) for part in os.environ.get(VARIABLE, "").split(os.pathsep) if part]
    folders: dict[str, Path] = {}
    for root in [*listed, *SHIPPED]:
        for folder in [root, *(sorted(root.iterdir()) if root.is_dir() else [])]:
            if (folder / "runs.yaml").is_file() and folder not in folders.values():
                name, number = folder.resolve().name, 2
                while name in folders:
                    name, number = f"{folder.resolve().name} ({number})", number + 1
                folders[name] = folder
    return folders


def last_campaign() -> Campaign | None:
    known = session.get(_READ, dict, {})
    campaign = known.get(last_name())
    return campaign if isinstance(campaign, Campaign) else None


def last_name() -> str:
    return session.get(_LAST, str, "")


def prefer(name: str) -> None:
    if not last_name():
        session.put(_LAST, name)


def chosen_campaign(key: str) -> Campaign:
    """The campaign that the select box `key` names. InputError for files that are not one."""
    campaign = campaign_or_none(key)
    if campaign is None:
        st.stop()
    return campaign


def campaign_or_none(key: str) -> Campaign | None:
    """The same; None, which the page says, as long as files are to be uploaded."""
    here, uploaded = offered(), session.get(_UPLOADED, dict, {})
    options = [*here, *(f"{name} (uploaded)" for name in uploaded), UPLOAD]
    last = last_name()
    choice = st.selectbox("Campaign", options, index=options.index(last) if last in options else 0, key=key)
    campaign: Campaign
    if choice == UPLOAD:
        sent = _from_browser(key)
        if sent is None:
            return None
        choice, campaign = sent
    elif choice in here:
        campaign = _from_server(choice, here[choice])
    else:
        campaign = uploaded[choice.removesuffix(" (uploaded)")]
    session.put(_LAST, choice)
    session.put(_READ, {choice: campaign})  # one at a time: campaigns can be large
    return campaign


def _from_server(name: str, folder: Path) -> Campaign:
    known = session.get(_READ, dict, {}).get(name)
    if isinstance(known, Campaign) and known.path == folder:
        return known
    with st.spinner("Reading the logs"):
        return read_campaign(folder, confined=True, check_effects=check)


def _from_browser(key: str) -> tuple[str, Campaign] | None:
    files = st.file_uploader(
        "A zip of the campaign's folder, or machine.yaml, runs.yaml and the logs",
        type=TYPES, accept_multiple_files=True, key=f"{key} files",
    )  # fmt: skip
    if not files:
        st.info("A campaign is machine.yaml, runs.yaml and the logs that it names.", icon=":material/upload:")
        return None
    token, uploaded = tuple(file.file_id for file in files), session.get(_UPLOADED, dict, {})
    before = session.get("campaign upload", tuple, ())
    if before[:1] == (token,) and before[1] in uploaded:
        return f"{before[1]} (uploaded)", uploaded[before[1]]
    with st.spinner("Reading the logs"):
        campaign = read_uploaded([Uploaded(file.name, file.getvalue()) for file in files], session.workspace())
    name, number = campaign.name, 2
    while name in uploaded:
        name, number = f"{campaign.name} ({number})", number + 1
    kept = {**uploaded, name: campaign}
    session.put(_UPLOADED, dict(list(kept.items())[-KEPT:]))
    session.put("campaign upload", (token, name))
    return f"{name} (uploaded)", campaign
