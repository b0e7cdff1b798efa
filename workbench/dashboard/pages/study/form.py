"""The controls of the Study page, in the sidebar; a scenario file sets them all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import cast

import streamlit as st

from workbench.control.rigid import bandwidth_and_damping, shaft_inertia_kg_m2
from workbench.dashboard import controller, session
from workbench.dashboard.machines import choose_machine
from workbench.dashboard.pages.study.axis.desk import AxisDesk, axis_desk_of
from workbench.dashboard.pages.study.axis.form import DESK as AXIS_DESK
from workbench.dashboard.pages.study.controls import (
    BANDWIDTH,
    FED,
    GAINS,
    Controls,
    Desk,
    Four,
    Three,
    desk_of,
    gains,
    highest_move_m,
    with_controller,
    within,
)
from workbench.dashboard.pages.study.fields import forget_widgets, kept, slider
from workbench.dashboard.pages.study.shipped import SHIPPED_NONE, shipped_desk, shipped_files, shipped_names
from workbench.dashboard.widgets import problem, text
from workbench.errors import InputError
from workbench.figures.style import label
from workbench.kinds import studied
from workbench.machine import Axis, Hoist, shipped
from workbench.references import BASELINE, allowed_carriage_speed_m_s, planned_kinds
from workbench.study.load import read_standalone
from workbench.yaml_strict import Document, load

DESK, LOADED, SHIPS_ASKED = "study desk", "study file", "study ships asked"
_FED_WORDS = (*(f"Feed-forward of {what} (–)" for what in FED[:3]), "… that knows the wire (–)")
PAYLOADS = (0.0, 1500.0, 3000.0, 4500.0, 6000.0, 7500.0, 9000.0)
PLANTS = {"lumped": "lumped", "multibody": "multi-body"}
LEAST_MOVE_M = 0.5
ROOM_M = 1.0  # to move in, that the start leaves


# What a scenario calls a value, and the control that sets it.
CONTROLS = {
    "name": "Name of the study",
    "payloads_kg": "Payloads (kg)",
    "start_position_m": "Start height (m)",
    "moves": "Up and down by (m)",
    "speed_m_s": "Limit speed (m/s)",
    "acceleration_m_s2": "Limit acceleration (m/s²)",
    "jerk_m_s3": "Limit jerk (m/s³)",
    "references": f"Against the {BASELINE}",
    "kp_nm_s_per_rad": "kp (N m s/rad)",
    "ki_nm_per_rad": "ki (N m/rad)",
    "plant": "Model",
}


def named(error: InputError, called: Mapping[str, str] = CONTROLS) -> InputError:
    """The error under the name of the control that set the value."""
    parts = [part.partition("[")[0] for part in (error.place or "").split(".")]
    name = next((called[part] for part in reversed(parts) if part in called), error.place)
    return InputError(error.problem, file=error.file, line=error.line, place=name)


def controls(machine: Hoist, bad: list[InputError]) -> Desk:
    """Draws the controls; what they stand at. What is set stays when another page is looked at meanwhile.

    bad: takes what was entered and cannot be used; the control then stands at its last good value.
    """
    desk = session.get(DESK, Desk, Desk())
    if (elsewhere := controller.taken_over("study")) is not None:
        desk = with_controller(desk, elsewhere, machine)
        forget_widgets(("by", "kp", "ki", "bandwidth", "damping", "weight", *(f"ff {what}" for what in FED)))
    above, below = st.container(), st.container()
    with below:
        name = file_fields(desk.controls.name, machine)
        desk = replace(desk, controls=replace(desk.controls, name=name))
    fastest = _fastest_m_s(machine)
    c = within(desk.controls, machine, fastest)
    with above:
        payloads, references = _payloads(c, bad), _references(c)
        c = replace(c, payloads_kg=payloads, references=references)
        with st.expander("Motion", expanded=True, icon=":material/height:"):
            c = _limits(_motion(c, machine), fastest)
        with st.expander("Speed controller", expanded=True, icon=":material/tune:"):
            c = _controller(c, machine)
        plant = st.selectbox(
            "Model", list(PLANTS), key=kept("plant", c.plant), format_func=lambda name: PLANTS[name],
            help="The multi-body machine has rigid bodies, joints, rollers and wire; a run of it takes some seconds. "
            "The curves beside the study stay on the lumped model.",
        )  # fmt: skip
        c = replace(c, plant=plant)
    desk = replace(desk, controls=c)
    session.put(DESK, desk)
    return desk


def file_fields(name: str, machine: Hoist | Axis) -> str:
    """The study's name. A scenario file that is chosen anew sets the controls; one that cannot be read leaves them."""
    with st.expander("Scenario file", icon=":material/description:"):
        name = st.text_input("Name of the study", key=kept("name", name), max_chars=64)
        ships = st.selectbox(
            "One that ships", [SHIPPED_NONE, *shipped_names()], key="study ships", on_change=_ask_shipped
        )
        if session.get(SHIPS_ASKED, str, "") == ships != SHIPPED_NONE:
            session.put(SHIPS_ASKED, "")
            try:
                _set(*shipped_desk(ships, machine), machine)
            except InputError as refused:
                problem(refused)
        upload = st.file_uploader("Load a scenario", type=["yaml", "yml"], key="study upload", max_upload_size=1)
        before, error = session.get(LOADED, tuple, ("", None))
        if upload is not None and upload.file_id != before:
            try:
                read, error = _read(load(session.stored(upload, "scenario.yaml")), machine), None
            except InputError as refused:
                error = refused
            session.put(LOADED, (upload.file_id, error))
            if error is None:
                _set(read, "", machine)
        if upload is not None and error is not None:
            problem(error)
    return name


def _set(desk: Desk | AxisDesk, other: str, machine: Hoist | Axis) -> None:
    """The controls stand as a file says from the next run of the page on, which begins at once; other: the machine to
    go over to."""
    forget_widgets()
    if other:
        choose_machine(other)
    if isinstance(desk, AxisDesk):
        session.put(AXIS_DESK, desk)
        whose = shipped("emps_axis") if other else machine
        controller.said("study", desk.controller, controller.owner(whose))
    else:
        session.put(DESK, desk)
        controller.said("study", desk.base.controller)
    st.rerun()  # the name stands above and is drawn already


def _ask_shipped() -> None:
    session.put(SHIPS_ASKED, st.session_state["study ships"])


def _read(document: Document, machine: Hoist | Axis) -> Desk | AxisDesk:
    """The controls as a file sets them. A machine that it names by file is the one chosen above."""
    if (hoist := studied(machine)) is None:
        axis = cast(Axis, machine)
        return axis_desk_of(read_standalone(document, axis, shipped_files()), axis)
    machine = hoist
    from workbench.machine import default_hoist

    chosen = None if machine == default_hoist() else machine
    return desk_of(read_standalone(document, chosen, shipped_files()), machine)


def _payloads(c: Controls, bad: list[InputError]) -> tuple[float, ...]:
    options = sorted({*PAYLOADS, *c.payloads_kg})
    chosen = st.multiselect(
        "Payloads (kg)", options, key=kept("payloads", list(c.payloads_kg)), format_func=_kg, accept_new_options=True,
        help="Type any other payload and press Enter.",
    )  # fmt: skip
    payloads = []
    for entry in cast(Sequence[float | str], chosen):
        try:
            payloads.append(float(entry))
        except ValueError:
            bad.append(InputError(f"'{entry}', expected a number in kg", place="payloads_kg"))
    return tuple(sorted(set(payloads)))


def _kg(payload: float | str) -> str:
    return payload if isinstance(payload, str) else f"{payload:g}"


def _references(c: Controls) -> tuple[str, ...]:
    others = {name: kind for name, kind in planned_kinds().items() if name != BASELINE}
    chosen = st.pills(
        f"Against the {BASELINE}", list(others), selection_mode="multi", key=kept("references", list(c.references)),
        format_func=label, help="\n".join(f"- {kind.label}: {kind.definition}" for kind in others.values()),
    )  # fmt: skip
    return tuple(name for name in others if name in chosen)


def _motion(c: Controls, machine: Hoist) -> Controls:
    low, high = machine.rail.lowest_position_m, machine.highest_position_m
    start = slider("Start height (m)", "start", c.start_position_m, low, high - ROOM_M, 0.5)
    if c.own_moves:
        own = st.toggle("Moves as in the file", key=kept("own", True))
        c = replace(c, own_moves=own)
        if own:
            return replace(c, start_position_m=start)
    most = highest_move_m(machine, start)
    height = slider("Up and down by (m)", "height", min(c.height_m, most), LEAST_MOVE_M, most, 0.5)
    return replace(c, start_position_m=start, height_m=height)


def _limits(c: Controls, fastest: float) -> Controls:
    hoisting = _three("" if not c.split else "hoisting ", "up", c.hoisting, fastest)
    split = st.toggle("Lower under other limits", key=kept("split", c.split))
    lowering = _three("lowering ", "down", c.lowering if c.split else hoisting, fastest) if split else hoisting
    return replace(c, hoisting=hoisting, split=split, lowering=lowering)


def _three(way: str, key: str, at: Three, fastest: float) -> Three:
    speed = slider(f"Limit {way}speed (m/s)", f"{key}.speed", min(at[0], fastest), 0.1, fastest, 0.01)
    acceleration = slider(f"Limit {way}acceleration (m/s²)", f"{key}.acceleration", at[1], 0.1, 1.5, 0.05, most=20.0)
    jerk = slider(
        f"Limit {way}jerk (m/s³)", f"{key}.jerk", at[2], 0.1, 5.0, 0.1, tip="The trapezoid has none.", most=1e3
    )
    return speed, acceleration, jerk


def _fastest_m_s(machine: Hoist) -> float:
    """What the motor's nominal speed allows, rounded down to what the slider shows."""
    motor = machine.motor.nominal_speed_rad_s
    allowed = allowed_carriage_speed_m_s(motor, machine.gearbox.ratio, machine.winch.drum_diameter_m)
    return max(int(allowed * 100.0) / 100.0, min(allowed, 0.1))


def _controller(c: Controls, machine: Hoist) -> Controls:
    by = st.segmented_control(
        "Set by",
        (BANDWIDTH, GAINS),
        key=kept("by", c.by),
        label_visibility="collapsed",
        required=True,
        width="stretch",
    )
    c = replace(c, by=by or c.by)
    inertia = shaft_inertia_kg_m2(machine)
    if c.by == BANDWIDTH:
        bandwidth = slider("Bandwidth (Hz)", "bandwidth", c.bandwidth_hz, 0.5, 6.0, 0.1, most=500.0)
        damping = slider("Damping (–)", "damping", c.damping, 0.4, 2.0, 0.05, tip="1 is ki = kp·ω/4.")
        c = replace(c, bandwidth_hz=bandwidth, damping=damping)
        kp, ki = gains(c, machine)
        st.caption(f"kp {text(kp)} N m s/rad, ki {text(ki)} N m/rad: empty gripper, rigid drive.")
    else:
        kp = slider("kp (N m s/rad)", "kp", c.kp_nm_s_per_rad, 2.0, 80.0, 0.5, "%.4g", most=1e6)
        ki = slider("ki (N m/rad)", "ki", c.ki_nm_per_rad, 0.0, 600.0, 1.0, "%.4g", most=1e6)
        hz, damping = bandwidth_and_damping(inertia, kp, ki)
        st.caption(f"Bandwidth {text(hz, 2)} Hz, damping {text(damping, 2)}: empty gripper, rigid drive.")
        c = replace(c, kp_nm_s_per_rad=kp, ki_nm_per_rad=ki)
    weight = slider("Set-point weight (–)", "weight", c.set_point_weight, 0.0, 1.0, 0.05)
    ff = tuple(
        slider(words, f"ff {what}", value, 0.0, 1.0, 0.05)
        for what, words, value in zip(FED, _FED_WORDS, c.feed_forward, strict=True)
    )
    return replace(c, set_point_weight=weight, feed_forward=cast(Four, ff))
