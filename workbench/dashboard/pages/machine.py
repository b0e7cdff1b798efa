"""The page Machine: the machine as a drawing that moves with a run, or with two beside each other."""

from __future__ import annotations

from dataclasses import dataclass, replace

import streamlit as st

from workbench.analysis.usual import usual_controller
from workbench.control import PiSettings
from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.dashboard import session
from workbench.dashboard.campaigns import last_campaign
from workbench.dashboard.machines import controller, hoist_of_session
from workbench.dashboard.pages.compare import kept
from workbench.dashboard.widgets import guarded, is_dark, plain
from workbench.figures.film import HEIGHT, film
from workbench.figures.scene import scene_of
from workbench.machines import STUDIED, Hoist, load_of, of_kind, studied
from workbench.machines.files import machine_text
from workbench.references import (
    Limits,
    Step,
    allowed_carriage_speed_m_s,
    motor_speed_rad_s,
    plan_motion,
    planned_kinds,
)
from workbench.simulate.loop import LoopCase, Outcome, simulate_loop
from workbench.view.style import label

LARGE = 900
ALONE = "no other"
QUICK, STUDY, MEASURED = "a quick move", "a run kept from Study", "a run of the campaign"


@dataclass(frozen=True, eq=False)
class Shown:
    """name: what the page calls the run."""

    name: str
    machine: Hoist
    run: Run


def show() -> None:
    """Draws the page."""
    with st.sidebar, guarded():
        shown = _chosen()
        large = st.toggle("Large", key=session.held("machine large", False), help="For a large screen or a projector.")
    with guarded():
        scenes = [replace(scene_of(drawn.machine, drawn.run), name=drawn.name) for drawn in shown]
    machine, height = shown[0].machine, LARGE if large else HEIGHT
    st.markdown(f"#### {plain(machine.name)} · {plain(' beside '.join(drawn.name for drawn in shown))}")
    st.iframe(film(machine, scenes, is_dark(), height), height=height + 8)
    st.caption(
        "Heights are to scale; drum, sheave, arm and pipe are drawn larger and turn as the drawn wire runs. "
        f"Wire coloured by tension at the top of each fall, dashed while slack. Tension: {scenes[0].tension_of}; "
        f"height: {scenes[0].height_of}. Up and hoisting are positive; torque of the harder-worked motor at its shaft."
    )


def _chosen() -> list[Shown]:
    """The side bar's choice: one run, or two of one machine beside each other. InputError for what cannot be shown."""
    campaign = last_campaign()
    studies = {name: study for name, study in kept().items() if studied(study.machine) is not None}
    there = [QUICK, *([STUDY] if studies else []), *([MEASURED] if campaign is not None else [])]
    if st.session_state.get("machine source") not in there:
        st.session_state["machine source"] = QUICK
    what = st.radio("Run", there, key=session.held("machine source", QUICK))
    if what == QUICK or (what == MEASURED and campaign is None):
        return _quick()
    if what == MEASURED and campaign is not None:
        machine = studied(campaign.machine)
        if machine is None:
            said = f"is {of_kind(campaign.machine)}; this drawing is of {STUDIED}"
            raise InputError(said, file="machine.yaml", place="kind")
        name = st.selectbox("Run of the campaign", [run.name for run in campaign.runs], key="machine measured")
        return [Shown(f"{campaign.name}, {name}", machine, campaign.run(name))]
    study = st.selectbox("Study", list(studies), key="machine study")
    result = studies[study].result
    names = {f"{row.reference}, {row.payload_kg:g} kg": row.run_id for row in result.rows if row.run_id in result.runs}
    if not names:
        raise InputError("no run of it has come to its end; there is nothing to show", place=study)
    # Several runs may be alike in payload and reference, where a sweep varied something else.
    if len(names) < len(result.runs):
        names = {run_id: run_id for run_id in result.runs}
    name = st.selectbox("Run of the study", list(names), key="machine study run")
    beside = st.selectbox("Beside it", [ALONE, *(n for n in names if n != name)], key="machine study beside")
    both = [name] if beside == ALONE else [name, beside]
    return [Shown(f"{study}, {run}", result.study.machine, result.runs[names[run]]) for run in both]


def _quick() -> list[Shown]:
    machine = hoist_of_session("machine machine")
    payload = st.slider("Payload (kg)", 0, 12000, step=250, key=session.held("machine payload", 4500))
    kinds = list(planned_kinds())
    reference = st.selectbox("Reference", kinds, key=session.held("machine reference", kinds[0]), format_func=label)
    beside = st.selectbox(
        "Beside it", [ALONE, *(kind for kind in kinds if kind != reference)], key="machine beside",
        format_func=lambda kind: kind if kind == ALONE else label(kind),
    )  # fmt: skip
    ramp = st.slider("Ramp time (s)", 0.3, 3.0, step=0.1, key=session.held("machine ramp", 1.2),
                     help="From rest to full speed.")  # fmt: skip
    now = controller(machine)
    settings = now if isinstance(now, PiSettings) else usual_controller(machine)
    said = f"{machine_text(machine)}{settings.model_dump_json()}"
    both = [reference] if beside == ALONE else [reference, beside]
    return [
        Shown(f"{label(kind)}, {payload:g} kg", machine, _moved(said, payload, kind, ramp, machine, settings))
        for kind in both
    ]


@st.cache_resource(max_entries=50, show_spinner=False)
def _moved(said: str, payload_kg: float, reference: str, ramp_s: float, _machine: Hoist, _settings: PiSettings) -> Run:
    """Up over half of the rail and down again at nine tenths of nominal speed; `said`: machine and controller."""
    low, high = _machine.rail.lowest_position_m, min(_machine.highest_position_m, 0.95 * _machine.wire.segment_length_m)
    ratio, drum = _machine.gearbox.ratio, _machine.winch.drum_diameter_m
    speed = 0.9 * allowed_carriage_speed_m_s(_machine.motor.nominal_speed_rad_s, ratio, drum)
    start, way = low + 0.2 * (high - low), 0.5 * (high - low)
    limits = Limits(speed, speed / ramp_s, 2.0 * speed / ramp_s**2)
    steps = [Step(by_m=way), Step(dwell_s=1.5), Step(by_m=-way)]
    load = load_of(_machine, payload_kg)
    plan = plan_motion(reference, steps, start, limits, (low, high), lead_s=1.0, settle_s=2.0, load=load)
    motor = motor_speed_rad_s(plan.sample(_settings.sample_time_s, plan.duration_s).speed_m_s, ratio, drum)
    (result,) = simulate_loop([LoopCase(reference, _machine, payload_kg, start, _settings, motor)])
    if result.outcome is Outcome.DIVERGED:
        raise InputError(f"{result.outcome.value}, {result.at}; try a lighter payload", place="payload")
    return result.run
