"""The controls of the page Study, in the sidebar, drawn from the declared fields; a scenario file sets them all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import streamlit as st

from workbench.control.rigid import bandwidth_and_damping, shaft_inertia_kg_m2
from workbench.core.errors import InputError
from workbench.core.yaml_strict import load
from workbench.dashboard import session
from workbench.dashboard.machines import AXIS, DEFAULT, choose_machine, keep_machine, set_controller, taken_over
from workbench.dashboard.pages.batches import shipped as shipped_scenarios
from workbench.dashboard.pages.study_desk import (
    BANDWIDTH,
    CONTROLLER,
    GAINS,
    LIMITS,
    Desk,
    Field,
    fields_of,
    gains,
    read_desk,
    shipped_desk,
    usual_desk,
    with_controller,
    within,
)
from workbench.dashboard.widgets import problem, text
from workbench.machines import Axis, Hoist, kind_of, shipped
from workbench.references import BASELINE, planned_kinds
from workbench.view.style import label

LOADED, SHIPS_ASKED, NONE = "study file", "study ships asked", "choose one"
PAYLOADS = (0.0, 1500.0, 3000.0, 4500.0, 6000.0, 7500.0, 9000.0)
PLANTS = {"lumped": "lumped", "multibody": "multi-body"}


def desk_key(machine: Hoist | Axis) -> str:
    """Where the session keeps what is set for this kind of machine."""
    kind = kind_of(machine)
    return "study desk" if kind.payload else f"study desk {kind.name}"


def controls(machine: Hoist | Axis, bad: list[InputError]) -> Desk:
    """Draws the controls; what they stand at. What is set stays when another page is looked at meanwhile.

    bad: takes what was entered and cannot be used.
    """
    desk = st.session_state.get(desk_key(machine))
    if not isinstance(desk, Desk) or not desk.suits(machine):
        desk = usual_desk(machine)
        forget_widgets()
    if session.get("study of", str, desk_key(machine)) != desk_key(machine):
        forget_widgets()
    session.put("study of", desk_key(machine))
    if (elsewhere := taken_over("study", machine)) is not None:
        desk = with_controller(desk, elsewhere, machine)
        forget_widgets([*CONTROLLER, *(name for name in desk.values if name.startswith("ff "))])
    above, below = st.container(), st.container()
    with below:  # first: a file that is chosen sets all that stands above
        desk = desk.having(name=_file(desk.values["name"], machine))
    desk = within(desk, machine)
    hoists, v = bool(kind_of(machine).payload), desk.values
    with above:
        if hoists:
            desk = desk.having(payloads=_payloads(v["payloads"], bad))
        others = {name: kind for name, kind in planned_kinds().items() if name != BASELINE}
        chosen = st.pills(
            f"Against the {BASELINE}", list(others), selection_mode="multi",
            key=_key("references", list(v["references"])), format_func=label,
            help="\n".join(f"- {kind.label}: {kind.definition}" for kind in others.values()),
        )  # fmt: skip
        desk = desk.having(references=tuple(name for name in others if name in chosen))
        with st.expander("Motion", expanded=True, icon=":material/height:" if hoists else ":material/swap_horiz:"):
            desk = _motion(desk, machine)
        title = "Speed controller" if hoists else "Cascade: position over speed"
        with st.expander(title, expanded=True, icon=":material/tune:"):
            desk = _controller(desk, machine)
        if hoists:
            plant = st.selectbox(
                "Model", list(PLANTS), key=_key("plant", v["plant"]), format_func=PLANTS.__getitem__,
                help="The multi-body machine has rigid bodies, joints, rollers and wire; a run of it takes some "
                "seconds. The curves beside the study stay on the lumped model.",
            )  # fmt: skip
            desk = desk.having(plant=plant)
    session.put(desk_key(machine), desk)
    return desk


def _key(name: str, value: Any) -> str:
    return session.held(f"study.{name}", value)


def forget_widgets(names: Sequence[str] = ()) -> None:
    """Of all controls, or of some: they then begin at the desk's values."""
    keys = [f"study.{name}" for name in names] or [str(k) for k in st.session_state if str(k).startswith("study.")]
    for key in keys:
        st.session_state.pop(key, None)


def number(field: Field, value: float) -> float:
    """A slider whose range takes in the value it is given, with a field beside it in which others may be typed."""
    key = f"study.{field.name}"
    if not field.slides:
        return float(
            st.number_input(field.words, field.low, field.high, key=_key(field.name, float(value)), step=None,
                            format="%.4g")
        )  # fmt: skip
    now = float(st.session_state.get(key, value))
    typed, end = f"{key} typed", field.high if field.most is None else field.most
    reached = (value, now) if field.most is not None else (value,)
    low, high = min(field.low, *reached), max(field.high, *reached)
    st.session_state[key] = st.session_state[typed] = min(max(now, low), high)
    if low == high:  # nothing to slide
        return low

    def take() -> None:
        st.session_state[key] = float(st.session_state[typed])

    left, right = st.columns([1.4, 1.0], vertical_alignment="bottom")
    with right:
        st.number_input(
            f"{field.words}, typed", 0.0 if field.most is not None else low, max(end, high), key=typed, step=None,
            format="%.4g", on_change=take, label_visibility="collapsed",
        )  # fmt: skip
    with left:
        return float(
            st.slider(field.words, low, high, step=field.step, format=field.form, key=key, help=field.tip or None)
        )


def _numbers(desk: Desk, machine: Hoist | Axis, names: Sequence[str]) -> Desk:
    """Draws these fields; the desk with what they stand at."""
    for name in names:
        field = fields_of(machine, desk)[name]  # anew: a start decides how far a move can go
        value = desk.values[name] if field.most is not None else min(desk.values[name], field.high)
        desk = desk.having(**{name: number(field, value)})
    return desk


def _motion(desk: Desk, machine: Hoist | Axis) -> Desk:
    desk = _numbers(desk, machine, ["start"])
    if desk.values["own_moves"]:
        own = st.toggle("Moves as in the file", key=_key("own", True))
        desk = desk.having(own_moves=own)
    if not desk.values["own_moves"]:
        desk = _numbers(desk, machine, ["way"] if kind_of(machine).payload else ["way", "dwell"])
    desk = _numbers(desk, machine, list(LIMITS))
    if not kind_of(machine).payload:
        return desk
    was = desk.values["split"]
    split = st.toggle("Lower under other limits", key=_key("split", was))
    down = [f"down {name}" for name in LIMITS]
    if split != was or not split:
        desk = desk.having(split=split, **{f"down {name}": desk.values[name] for name in LIMITS})
    return _numbers(desk, machine, down) if split else desk


def _controller(desk: Desk, machine: Hoist | Axis) -> Desk:
    fed = [name for name in desk.values if name.startswith("ff ")]
    if not kind_of(machine).payload:
        return _numbers(desk, machine, ["kv", "kp", "ki", "weight", *fed])
    by = st.segmented_control(
        "Set by", (BANDWIDTH, GAINS), key=_key("by", desk.values["by"]), label_visibility="collapsed", required=True,
        width="stretch",
    )  # fmt: skip
    desk = desk.having(by=by or desk.values["by"])
    if desk.values["by"] == BANDWIDTH:
        desk = _numbers(desk, machine, ["bandwidth", "damping"])
        kp, ki = gains(desk, machine)
        st.caption(f"kp {text(kp)} N m s/rad, ki {text(ki)} N m/rad: empty gripper, rigid drive.")
    else:
        desk = _numbers(desk, machine, ["kp", "ki"])
        inertia = shaft_inertia_kg_m2(cast(Hoist, machine))
        hz, damping = bandwidth_and_damping(inertia, desk.values["kp"], desk.values["ki"])
        st.caption(f"Bandwidth {text(hz, 2)} Hz, damping {text(damping, 2)}: empty gripper, rigid drive.")
    return _numbers(desk, machine, ["weight", *fed])


def _payloads(now: Sequence[float], bad: list[InputError]) -> tuple[float, ...]:
    options = sorted({*PAYLOADS, *now})
    chosen = st.multiselect(
        "Payloads (kg)", options, key=_key("payloads", list(now)), accept_new_options=True,
        format_func=lambda kg: kg if isinstance(kg, str) else f"{kg:g}",
        help="Type any other payload and press Enter.",
    )  # fmt: skip
    payloads = []
    for entry in cast(Sequence[float | str], chosen):
        try:
            payloads.append(float(entry))
        except ValueError:
            bad.append(InputError(f"'{entry}', expected a number in kg", place="payloads_kg"))
    return tuple(sorted(set(payloads)))


def _file(name: str, machine: Hoist | Axis) -> str:
    """The study's name. A scenario file that is chosen anew sets the controls; one that cannot be read leaves them."""
    with st.expander("Scenario file", icon=":material/description:"):
        name = st.text_input("Name of the study", key=_key("name", name), max_chars=64)
        ships = st.selectbox(
            "One that ships", [NONE, *shipped_scenarios()], key="study ships",
            on_change=lambda: session.put(SHIPS_ASKED, st.session_state["study ships"]),
        )  # fmt: skip
        if session.get(SHIPS_ASKED, str, "") == ships != NONE:
            session.put(SHIPS_ASKED, "")
            try:
                set_desk(*shipped_desk(ships, machine), machine)
                st.rerun()
            except InputError as refused:
                problem(refused)
        upload = st.file_uploader("Load a scenario", type=["yaml", "yml"], key="study upload", max_upload_size=1)
        before, error = session.get(LOADED, tuple, ("", None))
        if upload is not None and upload.file_id != before:
            try:
                desk, error = read_desk(load(session.stored(upload, "scenario.yaml")), machine), None
            except InputError as refused:
                error = refused
            session.put(LOADED, (upload.file_id, error))
            if error is None:
                set_desk(desk, None, machine)
                st.rerun()  # the name stands above and is drawn already
        if upload is not None and error is not None:
            problem(error)
    return name


def set_desk(desk: Desk, other: Hoist | Axis | None, machine: Hoist | Axis) -> None:
    """The controls stand so from the next run of the page on. other: the machine to go over to."""
    forget_widgets()
    if other is not None:
        name = AXIS if other == shipped("emps_axis") else DEFAULT if kind_of(other).payload else ""
        choose_machine(name or keep_machine(other.name, other))
    whose = other if other is not None else machine
    session.put(desk_key(whose), desk)
    set_controller("study", desk.base.controller, whose)
