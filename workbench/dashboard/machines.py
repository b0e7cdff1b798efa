"""Which machine a page works on.

session_machine(key)        a select box and the drive's times: the session's one machine, the same on every page
                            that asks; an uploaded machine.yaml that is good joins the list and is chosen
hoist_of_session(key)       the same for a page that is for hoists only: it says so where the session's is another
choose_machine(name)        the session's machine from the next run of a page on
chosen_machine(key)         a machine for this page alone. Call inside `guarded()`.
keep_machine(name, machine) makes a machine choosable on every page of this session
kept_machines()             name -> machine
"""

from __future__ import annotations

from typing import TypeVar

import streamlit as st

from workbench.dashboard import session
from workbench.dashboard.widgets import plain, problem
from workbench.effects import check
from workbench.errors import InputError
from workbench.kinds import LOOPED, STUDIED, looped, of_kind, studied
from workbench.machine import Axis, Hoist, default_hoist, load_machine, shipped, shipped_hoist, with_values

DEFAULT, RINGING, AXIS = "default hoist", "lightly damped hoist", "ball-screw axis"
UPLOADED = "upload a machine.yaml"
DRIVE_TIMES = (
    ("Torque lag (ms)", "torque_lag_s"),
    ("Speed filter (ms)", "speed_filter_s"),
    ("Speed delay (ms)", "speed_delay_s"),
)
_KEPT, _CHOSEN, _ARRIVED, _DRIVE = "machines kept", "machine chosen", "machine arrived", "machine drive"
Kept = dict[str, Hoist | Axis]
AnyMachine = TypeVar("AnyMachine", Hoist, Hoist | Axis)


def kept_machines() -> Kept:
    """The machines that this session has kept, by name."""
    return session.get(_KEPT, dict, {})


def keep_machine(name: str, machine: Hoist | Axis) -> str:
    """Keeps a machine for this session; returns the name it is listed under (a taken one is numbered)."""
    kept = kept_machines()
    taken = {DEFAULT, RINGING, AXIS, UPLOADED, *(known for known, other in kept.items() if other != machine)}
    free, number = name, 2
    while free in taken:
        free, number = f"{name} ({number})", number + 1
    session.put(_KEPT, kept | {free: machine})
    return free


def _hoists() -> dict[str, Hoist]:
    """The hoists that the session knows, by name."""
    kept = {name: machine for name, any_kind in kept_machines().items() if (machine := studied(any_kind)) is not None}
    return {DEFAULT: default_hoist(), RINGING: shipped_hoist("lightly_damped"), **kept}


def _all_looped() -> Kept:
    """The machines that a study can run on, by name."""
    kept = {name: machine for name, any_kind in kept_machines().items() if (machine := looped(any_kind)) is not None}
    return {DEFAULT: default_hoist(), RINGING: shipped_hoist("lightly_damped"), AXIS: shipped("emps_axis"), **kept}


def choose_machine(name: str) -> None:
    session.put(_ARRIVED, name)


def session_machine(key: str) -> Hoist | Axis:
    """The machine that this session works on, with the drive's times that it has set.

    A file that is no machine is an error under its field and changes nothing.
    """
    return _with_drive(*_chosen(key, _all_looped()), key)


def hoist_of_session(key: str) -> Hoist:
    """The same on a page that is for hoists only; where the session's machine is another, one of this page's own."""
    offered = _hoists()
    chosen, name = _chosen(key, dict(offered))
    hoist = offered[name]
    assert chosen is hoist
    return _with_drive(hoist, name, key)


def _chosen(key: str, offered: Kept) -> tuple[Hoist | Axis, str]:
    """The machine that the select box names, which all pages then work on."""
    options = [*offered, UPLOADED]
    arrived = session.get(_ARRIVED, str, "")
    last = session.get(_CHOSEN, str, DEFAULT)
    other = last if last not in offered and last in _all_looped() else ""  # of a kind that this page is not for
    last = last if last in offered else DEFAULT
    if arrived in offered:
        st.session_state[key] = arrived
        session.put(_ARRIVED, "")
    elif st.session_state.get(key) not in options:
        st.session_state[key] = last
    choice = st.selectbox("Machine", options, key=key)
    if choice == UPLOADED:
        _take(key, hoists_only=AXIS not in offered)
        choice = last
    if other and choice == DEFAULT:
        st.info(f"This page is for hoists only; {plain(other)} stays chosen on Study and Loop.")
    else:
        session.put(_CHOSEN, choice)
    return offered[choice], choice


def _take(key: str, hoists_only: bool) -> None:
    """An uploaded machine, once it is there, is the one chosen."""
    try:
        machine = _uploaded(key, hoists_only)
    except InputError as error:
        problem(error)
        return
    if machine is not None:
        session.put(_ARRIVED, keep_machine(machine.name, machine))
        st.rerun()


def _with_drive(machine: AnyMachine, name: str, key: str) -> AnyMachine:
    """The machine behind the drive's times that are set here; its own to begin with."""
    own = {field: getattr(machine.drive, field) for _, field in DRIVE_TIMES}
    of, values = session.get(_DRIVE, tuple, (name, own))
    values = dict(values) if of == name else own
    with st.expander("Drive", expanded=False, icon=":material/bolt:"):
        for label, field in DRIVE_TIMES:
            widget = f"{key.partition(' ')[0]} {field} {1e3 * own[field]:g}"
            if widget not in st.session_state:
                st.session_state[widget] = 1e3 * values[field]
            values[field] = 1e-3 * st.number_input(label, 0.0, 200.0, step=0.5, key=widget, format="%g")
    session.put(_DRIVE, (name, values))
    return machine if values == own else with_values(machine, {f"drive.{field}": values[field] for field in values})


def _uploaded(key: str, hoists_only: bool) -> Hoist | Axis | None:
    """The uploaded machine; None before there is one. InputError for a file that is not one."""
    upload = st.file_uploader("machine.yaml", type=["yaml", "yml"], key=f"{key} file", max_upload_size=1)
    if upload is None:
        st.info("Choose a machine.yaml.", icon=":material/upload:")
        return None
    read = load_machine(session.stored(upload, "machine.yaml"), check_effects=check)
    machine = studied(read) if hoists_only else looped(read)
    if machine is None:
        expected = STUDIED if hoists_only else LOOPED
        raise InputError(f"is {of_kind(read)}; expected {expected}", file="machine.yaml", place="kind")
    return machine


def chosen_machine(key: str) -> Hoist | Axis:
    """The machine that the select box `key` names. InputError for a file that is not one."""
    offered = _all_looped()
    choice = st.selectbox("Machine", [*offered, UPLOADED], key=key)
    if choice != UPLOADED:
        return offered[choice]
    machine = _uploaded(key, hoists_only=False)
    if machine is None:
        st.stop()
    return machine
