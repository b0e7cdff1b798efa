"""Which machine a page works on.

chosen_machine(key, kind)   a select box: the hoist that ships, an uploaded machine.yaml, or one
                            that another page kept; returns the machine. Call inside `guarded()`.
keep_machine(name, machine) makes a machine choosable on every page of this session
kept_machines()             name -> machine
"""

from __future__ import annotations

import streamlit as st

from workbench.dashboard import session
from workbench.effects import check
from workbench.errors import InputError
from workbench.kinds import STUDIED, of_kind, studied
from workbench.machine import Axis, Hoist, default_hoist, load_machine

DEFAULT, UPLOADED = "default hoist", "upload a machine.yaml"
_KEPT = "machines kept"
Kept = dict[str, Hoist | Axis]


def kept_machines() -> Kept:
    """The machines that this session has kept, by name."""
    return session.get(_KEPT, dict, {})


def keep_machine(name: str, machine: Hoist | Axis) -> str:
    """Keeps a machine for this session; returns the name it is listed under (a taken one is numbered)."""
    kept = kept_machines()
    taken = {DEFAULT, UPLOADED, *(known for known, other in kept.items() if other != machine)}
    free, number = name, 2
    while free in taken:
        free, number = f"{name} ({number})", number + 1
    session.put(_KEPT, kept | {free: machine})
    return free


def _uploaded(key: str) -> Hoist | Axis:
    upload = st.file_uploader("machine.yaml", type=["yaml", "yml"], key=f"{key} file", max_upload_size=1)
    if upload is None:
        st.info("Choose a machine.yaml.", icon=":material/upload:")
        st.stop()
    return load_machine(session.stored(upload, "machine.yaml"), check_effects=check)


def chosen_machine(key: str) -> Hoist:
    """The hoist that the select box `key` names. InputError for a file that is not one."""
    kept = {name: machine for name, any_kind in kept_machines().items() if (machine := studied(any_kind)) is not None}
    choice = st.selectbox("Machine", [DEFAULT, *kept, UPLOADED], key=key)
    if choice != UPLOADED:
        return default_hoist() if choice == DEFAULT else kept[choice]
    read = _uploaded(key)
    machine = studied(read)
    if machine is None:
        raise InputError(f"is {of_kind(read)}; expected {STUDIED}", file="machine.yaml", place="kind")
    return machine
