"""Which machine and which campaign the session works with, the same on every page.

session_machine(key)        a select box and the drive's times; an uploaded machine.yaml that is good is kept and chosen
hoist_of_session(key)       the same for a page that is for hoists only
choose_machine(name)        the session's machine from the next run of a page on
keep_machine(name, machine) makes a machine choosable on every page of this session; kept_machines() lists them
keep_button(key, ...)       a button that does so
chosen_campaign(key)        a select box: the server's own campaigns, those this visitor has uploaded, and an upload;
                            returns the campaign. Call inside `guarded()`.
campaign_or_none(key)       the same, None as long as files are to be uploaded
last_campaign()             the campaign chosen last on any page, None before; last_name(): what the box calls it
sent_to_job(campaign)       what a job needs to read it: its folder as an argument, and what is copied

A browser chooses among names; no path that it sends is ever opened. An uploaded campaign lies in the visitor's own
folder, which the address names: a reload finds it again. Memory holds the one campaign that is worked on.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path

import streamlit as st
from streamlit.runtime.scriptrunner import get_script_run_ctx

from workbench import machines
from workbench.core.errors import InputError
from workbench.dashboard import session, uploads
from workbench.dashboard.jobs import INPUTS
from workbench.dashboard.uploads import Uploaded
from workbench.dashboard.widgets import fold, guarded, held, plain
from workbench.effects import check
from workbench.logs import Campaign, read_campaign
from workbench.logs.formats.opening import suffixes

DEFAULT, RINGING, AXIS = "default hoist", "lightly damped hoist", "ball-screw axis"
UPLOADED = "upload a machine.yaml"
DRIVE_TIMES = {
    "torque_lag_s": "Torque lag (ms)",
    "speed_filter_s": "Speed filter (ms)",
    "speed_delay_s": "Speed delay (ms)",
}
VARIABLE = "WORKBENCH_CAMPAIGNS"  # folders of campaigns that the server's owner lets people see
ROOT = Path(__file__).parents[2]
SHIPPED = (ROOT / "campaigns", ROOT / "scenarios" / "demo_campaign")
UPLOAD = "upload a campaign"
TYPES = ["zip", "yaml", *(suffix.removeprefix(".") for suffix in suffixes())]
_KEPT, _CHOSEN = "machines kept", "machine chosen"
_LAST, _READ, _SENT = "campaign chosen", "campaigns read", "campaigns sent"
Takes = Callable[[machines.Machine], machines.Machine | None]


def free_name(name: str, taken: Collection[str]) -> str:
    """The name, with a number where it is taken."""
    free, number = name, 2
    while free in taken:
        free, number = f"{name} ({number})", number + 1
    return free


# ---- machines -----------------------------------------------------------------------------------------------------


def kept_machines() -> dict[str, machines.Machine]:
    return session.get(_KEPT, dict, {})


def keep_machine(name: str, machine: machines.Machine) -> str:
    """Keeps a machine for this session; returns the name it is listed under (a taken one is numbered)."""
    kept = kept_machines()
    others = (known for known, other in kept.items() if other != machine)
    free = free_name(name, {DEFAULT, RINGING, AXIS, UPLOADED, *others})
    session.put(_KEPT, kept | {free: machine})
    return free


def keep_button(key: str, name: str, machine: Callable[[], machines.Machine]) -> None:
    def keep() -> None:  # runs before the page, whose lists of machines then hold it
        st.toast(f"Kept as {plain(keep_machine(name, machine()))}", icon=":material/check:")

    st.button("Keep the machine", key=key, icon=":material/save:", on_click=keep, width="stretch",
              help="It can then be chosen on the other pages.")  # fmt: skip


def choose_machine(name: str) -> None:
    session.put(_CHOSEN, name)


def session_machine(key: str, takes: Takes = machines.looped, expected: str = machines.LOOPED) -> machines.Machine:
    """The machine that this session works on, with the drive's times that it has set."""
    ships = {
        DEFAULT: machines.default_hoist(),
        RINGING: machines.shipped_hoist("lightly_damped"),
        AXIS: machines.shipped("emps_axis"),
    }
    known, last = ships | kept_machines(), session.get(_CHOSEN, str, DEFAULT)
    offered = {name: machine for name, machine in known.items() if takes(machine) is not None}
    here = last if last in offered else DEFAULT
    options = [*offered, UPLOADED]
    choice = st.selectbox("Machine", options, key=held(key, here, options))
    if choice == UPLOADED:
        upload = st.file_uploader("machine.yaml", type=["yaml", "yml"], key=f"{key} file", max_upload_size=1)
        if upload is None:
            st.info("Choose a machine.yaml.", icon=":material/upload:")
        with guarded(stop=False):  # a bad file changes nothing
            if upload is not None:
                read = machines.load_machine(session.stored(upload, "machine.yaml"), check_effects=check)
                if (machine := takes(read)) is None:
                    raise InputError(
                        f"is {machines.of_kind(read)}; expected {expected}", file="machine.yaml", place="kind"
                    )
                choose_machine(keep_machine(machine.name, machine))
                st.rerun()
        choice = here
    if last != here and last in known and machines.looped(known[last]) is not None and choice == DEFAULT:
        st.info(f"This page is for hoists only; {plain(last)} stays chosen on Study and Loop.")
    else:
        choose_machine(choice)
    machine = offered[choice]
    own = {field: 1e3 * getattr(machine.drive, field) for field in DRIVE_TIMES}
    values = {**session.get(f"drive of {choice}", dict, own)}
    if (part := fold("Drive", "drive", "bolt")).open:
        for field, label in DRIVE_TIMES.items():
            widget = held(f"{key.partition(' ')[0]} {field} {own[field]:g}", values[field])
            values[field] = part.number_input(label, 0.0, 200.0, step=0.5, key=widget, format="%g")
    session.put(f"drive of {choice}", values)
    changed = {f"drive.{field}": 1e-3 * value for field, value in values.items() if value != own[field]}
    return machines.with_values(machine, changed) if changed else machine


def hoist_of_session(key: str) -> machines.Hoist:
    machine = machines.studied(session_machine(key, machines.studied, machines.STUDIED))
    assert machine is not None
    return machine


# ---- campaigns ----------------------------------------------------------------------------------------------------


def offered() -> dict[str, Path]:
    """Name -> folder of each campaign that the server's owner lets people see: in the folders that the environment
    variable lists, in `campaigns/` beside app.py, and the demonstration."""
    listed = [Path(part) for part in os.environ.get(VARIABLE, "").split(os.pathsep) if part]
    folders: dict[str, Path] = {}
    for root in [*listed, *SHIPPED]:
        for folder in [root, *(sorted(root.iterdir()) if root.is_dir() else [])]:
            if (folder / "runs.yaml").is_file() and folder not in folders.values():
                folders[free_name(folder.resolve().name, folders)] = folder
    return folders


def uploaded() -> dict[str, Path]:
    """Name -> folder of each campaign that this visitor has uploaded."""
    workspace, folders = session.work_folder(), dict[str, Path]()
    for folder in [] if workspace is None else uploads.stored_campaigns(workspace):
        folders[free_name(f"{uploads.name_of(folder)} (uploaded)", folders)] = folder
    return folders


def last_campaign() -> Campaign | None:
    return session.get(_READ, dict, {}).get(last_name())


def last_name() -> str:
    return session.get(_LAST, str, "")


def choose_campaign(name: str) -> None:
    session.put(_LAST, name)


def sent_to_job(campaign: Campaign) -> tuple[str, dict[str, Path]]:
    """The folder that a job reads it from, and what is copied for it: an uploaded one, which may go meanwhile; the
    server's own stay where they are."""
    workspace = session.work_folder()
    if workspace is not None and campaign.path.is_relative_to(workspace):
        return f"{INPUTS}/campaign", {"campaign": campaign.path}
    return str(campaign.path.resolve()), {}


def chosen_campaign(key: str) -> Campaign:
    """The campaign that the select box `key` names. InputError for files that are not one."""
    return campaign_or_none(key) or st.stop()


def campaign_or_none(key: str) -> Campaign | None:
    """The same; None, which the page says, as long as files are to be uploaded."""
    here, own = offered(), uploaded()
    options = [*here, *own, UPLOAD]
    usual = [*own][-1] if own and not last_name() else options[0]  # after a reload the upload stays chosen
    last = last_name() if last_name() in options else usual
    choice = st.selectbox("Campaign", options, key=held(key, last, options))
    if choice == UPLOAD:
        sent = session.get(_SENT, int, 0)
        files = st.file_uploader(
            "A zip of the campaign's folder, or machine.yaml, runs.yaml and the logs",
            type=TYPES, accept_multiple_files=True, key=f"{key} files {sent}",
        )  # fmt: skip
        if not files:
            st.info("A campaign is machine.yaml, runs.yaml and the logs that it names.", icon=":material/upload:")
            return None
        with st.spinner("Reading the logs"):
            arrived([Uploaded(file.name, file.getvalue()) for file in files])
        let_go([file.file_id for file in files])
        session.put(_SENT, sent + 1)  # a new field: the old one's files are gone
        st.rerun()
    choose_campaign(choice)
    known, folder = last_campaign(), here.get(choice) or own[choice]
    if known is not None and known.path == folder:
        return known
    session.put(_READ, {})  # the one before is let go first: campaigns can be large
    with st.spinner("Reading the logs"):
        reads = uploads.read_stored if choice in own else partial(read_campaign, confined=True, check_effects=check)
        campaign = reads(folder)
    session.put(_READ, {choice: campaign})
    return campaign


def arrived(files: list[Uploaded]) -> None:
    """The campaign in these files becomes this visitor's own, and the one that all pages work on. InputError for what
    is none."""
    campaign = uploads.read_uploaded(files, session.new_work_folder())
    name = next(name for name, folder in uploaded().items() if folder == campaign.path)
    session.put(_READ, {name: campaign})
    choose_campaign(name)


def let_go(file_ids: Collection[str]) -> None:
    """Frees the server's copy of what was sent. Streamlit has no public way: it keeps files until the session ends."""
    context = get_script_run_ctx()
    remove = getattr(context and context.uploaded_file_mgr, "remove_file", None)
    for file_id in file_ids:
        if context is not None and remove is not None:
            remove(context.session_id, file_id)
