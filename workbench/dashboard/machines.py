"""Which machine and which controller the session works with, the same on every page.

session_machine(key)        a select box and the drive's times; an uploaded machine.yaml that is good is kept and chosen
hoist_of_session(key)       the same for a page that is for hoists only; where the session's machine is none, its own
chosen_machine(key)         a machine for this page alone. Call inside `guarded()`.
choose_machine(name)        the session's machine from the next run of a page on
keep_machine(name, machine) makes a machine choosable on every page of this session; kept_machines() lists them
controller(machine)         the controller as any page has set it last; None before. All hoists share one; an axis has
                            its own.
set_controller(page, ...)   a page says what its controls stand at
taken_over(page, machine)   what another page has set since this one said so last
"""

from __future__ import annotations

from collections.abc import Callable

import streamlit as st

from workbench.control import Settings
from workbench.core.errors import InputError
from workbench.dashboard import session
from workbench.dashboard.widgets import plain, problem
from workbench.effects import check
from workbench.machines import (
    LOOPED,
    STUDIED,
    Axis,
    Hoist,
    default_hoist,
    kind_of,
    load_machine,
    looped,
    of_kind,
    shipped,
    shipped_hoist,
    studied,
    with_values,
)

DEFAULT, RINGING, AXIS = "default hoist", "lightly damped hoist", "ball-screw axis"
UPLOADED = "upload a machine.yaml"
DRIVE_TIMES = {
    "torque_lag_s": "Torque lag (ms)",
    "speed_filter_s": "Speed filter (ms)",
    "speed_delay_s": "Speed delay (ms)",
}
_KEPT, _CHOSEN, _ARRIVED, _DRIVE = "machines kept", "machine chosen", "machine arrived", "machine drive"
Kept = dict[str, Hoist | Axis]


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


def choose_machine(name: str) -> None:
    session.put(_ARRIVED, name)


def _offered(takes: Callable[[Hoist | Axis], Hoist | Axis | None]) -> Kept:
    """The machines that a page takes, by name."""
    all_: Kept = {DEFAULT: default_hoist(), RINGING: shipped_hoist("lightly_damped"), AXIS: shipped("emps_axis")}
    return {name: machine for name, machine in (all_ | kept_machines()).items() if takes(machine) is not None}


def session_machine(key: str) -> Hoist | Axis:
    """The machine that this session works on, with the drive's times that it has set."""
    return _with_drive(*_chosen(key, looped, LOOPED), key)


def hoist_of_session(key: str) -> Hoist:
    machine = studied(_with_drive(*_chosen(key, studied, STUDIED), key))
    assert machine is not None
    return machine


def _chosen(key: str, takes: Callable[[Hoist | Axis], Hoist | Axis | None], expected: str) -> tuple[Hoist | Axis, str]:
    """The machine that the select box names, which all pages then work on."""
    offered = _offered(takes)
    options = [*offered, UPLOADED]
    arrived, last = session.get(_ARRIVED, str, ""), session.get(_CHOSEN, str, DEFAULT)
    other = last if last not in offered and last in _offered(looped) else ""  # of a kind that this page is not for
    last = last if last in offered else DEFAULT
    if arrived in offered:
        st.session_state[key] = arrived
        session.put(_ARRIVED, "")
    elif st.session_state.get(key) not in options:
        st.session_state[key] = last
    choice = st.selectbox("Machine", options, key=session.held(key, last))
    if choice == UPLOADED:
        try:
            machine = _uploaded(key, takes, expected)
        except InputError as error:  # it changes nothing
            problem(error)
        else:
            if machine is not None:
                session.put(_ARRIVED, keep_machine(machine.name, machine))
                st.rerun()
        choice = last
    if other and choice == DEFAULT:
        st.info(f"This page is for hoists only; {plain(other)} stays chosen on Study and Loop.")
    else:
        session.put(_CHOSEN, choice)
    return offered[choice], choice


def _with_drive(machine: Hoist | Axis, name: str, key: str) -> Hoist | Axis:
    """The machine behind the drive's times that are set here; its own to begin with."""
    own = {field: getattr(machine.drive, field) for field in DRIVE_TIMES}
    of, values = session.get(_DRIVE, tuple, (name, own))
    values = dict(values) if of == name else own
    with st.expander("Drive", expanded=False, icon=":material/bolt:"):
        for field, label in DRIVE_TIMES.items():
            widget = session.held(f"{key.partition(' ')[0]} {field} {1e3 * own[field]:g}", 1e3 * values[field])
            values[field] = 1e-3 * st.number_input(label, 0.0, 200.0, step=0.5, key=widget, format="%g")
    session.put(_DRIVE, (name, values))
    return machine if values == own else with_values(machine, {f"drive.{field}": values[field] for field in values})


def _uploaded(key: str, takes: Callable[[Hoist | Axis], Hoist | Axis | None], expected: str) -> Hoist | Axis | None:
    """The uploaded machine; None before there is one. InputError for a file that is not one."""
    upload = st.file_uploader("machine.yaml", type=["yaml", "yml"], key=f"{key} file", max_upload_size=1)
    if upload is None:
        st.info("Choose a machine.yaml.", icon=":material/upload:")
        return None
    read = load_machine(session.stored(upload, "machine.yaml"), check_effects=check)
    if (machine := takes(read)) is None:
        raise InputError(f"is {of_kind(read)}; expected {expected}", file="machine.yaml", place="kind")
    return machine


def chosen_machine(key: str) -> Hoist | Axis:
    """The machine that the select box `key` names. InputError for a file that is not one."""
    offered = _offered(looped)
    choice = st.selectbox("Machine", [*offered, UPLOADED], key=session.held(key, DEFAULT))
    machine = offered.get(choice) or _uploaded(key, looped, LOOPED)
    if machine is None:
        st.stop()
    return machine


def _whose(machine: Hoist | Axis) -> str:
    kind = kind_of(machine)
    return "" if kind.payload else f" {kind.name} {machine.name}"


def controller(machine: Hoist | Axis) -> Settings | None:
    """The controller as any page has set it last."""
    now = session.get(f"controller now{_whose(machine)}", tuple, ())
    return now[0] if now else None


def set_controller(page: str, settings: Settings, machine: Hoist | Axis) -> None:
    """The page's controls stand at these settings, which all pages now share."""
    session.put(f"controller now{_whose(machine)}", (settings,))
    session.put(f"controller seen by {page}{_whose(machine)}", (settings,))


def taken_over(page: str, machine: Hoist | Axis) -> Settings | None:
    """What another page has set since `page` was drawn last; None where nothing is new."""
    now = controller(machine)
    seen = session.get(f"controller seen by {page}{_whose(machine)}", tuple, ())
    return None if now is None or seen == (now,) else now
