"""Which campaign a page works on.

chosen_campaign(key)   a select box: the server's own campaigns, those this session has uploaded, and
                       an upload; returns the campaign. Call inside `guarded()`. The choice is the
                       same on every page.
last_campaign()        the campaign chosen last on any page, None before
offered()              the server's campaigns: those in the folders that the environment variable
                       WORKBENCH_CAMPAIGNS lists, and in `campaigns/` beside app.py

A browser chooses among names; no path that it sends is ever opened.
"""

from __future__ import annotations

import os
from pathlib import Path

import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.uploads import KEPT, Uploaded, read_uploaded
from workbench.effects import check
from workbench.logs import Campaign, read_campaign

VARIABLE = "WORKBENCH_CAMPAIGNS"
SHIPPED = Path(__file__).parents[2] / "campaigns"
UPLOAD = "upload a campaign"
TYPES = ["zip", "yaml", "csv", "parquet", "pq", "mat"]
_UPLOADED, _LAST, _READ = "campaigns uploaded", "campaign chosen", "campaigns read"


def offered() -> dict[str, Path]:
    """Name -> folder of each campaign that the server's owner lets people see."""
    listed = [Path(part) for part in os.environ.get(VARIABLE, "").split(os.pathsep) if part]
    found: dict[str, Path] = {}
    for root in [*listed, SHIPPED]:
        for folder in [root, *(sorted(root.iterdir()) if root.is_dir() else [])]:
            if (folder / "runs.yaml").is_file() and folder not in found.values():
                name, number = folder.resolve().name, 2
                while name in found:
                    name, number = f"{folder.resolve().name} ({number})", number + 1
                found[name] = folder
    return found


def last_campaign() -> Campaign | None:
    known = session.get(_READ, dict, {})
    campaign = known.get(session.get(_LAST, str, ""))
    return campaign if isinstance(campaign, Campaign) else None


def chosen_campaign(key: str) -> Campaign:
    """The campaign that the select box `key` names. InputError for files that are not one."""
    here, uploaded = offered(), session.get(_UPLOADED, dict, {})
    options = [*here, *(f"{name} (uploaded)" for name in uploaded), UPLOAD]
    last = session.get(_LAST, str, "")
    choice = st.selectbox("Campaign", options, index=options.index(last) if last in options else 0, key=key)
    if choice == UPLOAD:
        choice, campaign = _from_browser(key)
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


def _from_browser(key: str) -> tuple[str, Campaign]:
    files = st.file_uploader(
        "A zip of the campaign's folder, or machine.yaml, runs.yaml and the logs",
        type=TYPES, accept_multiple_files=True, key=f"{key} files",
    )  # fmt: skip
    if not files:
        st.info("A campaign is machine.yaml, runs.yaml and the logs that it names.", icon=":material/upload:")
        st.stop()
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
