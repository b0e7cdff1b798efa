"""The page Loop: margins of the sampled speed loop over payloads and heights; gains by slider or by tuning."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import streamlit as st

from workbench.analysis.linearise import Motion
from workbench.analysis.margins import Member, weakest
from workbench.analysis.tune import STEPS, Goal, TuneProgress, Weights
from workbench.analysis.usual import usual_heights, usual_settings
from workbench.control import Cascade, Settings
from workbench.core.errors import InputError
from workbench.dashboard import desk, session, widgets
from workbench.dashboard.chosen import session_machine
from workbench.dashboard.widgets import Field, Number, chart, guarded, held, number, plain, problem, table
from workbench.machines import Machine, kind_of, machine_text
from workbench.study.loop_design import MOST, DesignCase
from workbench.study.loop_design import numbers as numbers_in
from workbench.view import loop as report
from workbench.view import tune as tuning_report
from workbench.view.loop import HZ, RAD_S

MOTIONS: tuple[Motion, ...] = ("hoisting", "lowering", "at_rest")
STEP = 1.04  # from one step of a gain's slider to the next
REACH = {"kp": (0.1, 100.0), "ki": (0.03, 3000.0), "kv": (0.1, 30.0)}  # of a slider, times the gain by rule
BANDWIDTH, REJECTION = "bandwidth", "best rejection of load steps"
TUNED = "loop tuned"
ALSO = ("notch", "shaper", "schedule")
Wanted = tuple[Goal, Weights, tuple[str, ...]]


def show() -> None:
    """Draws the page."""
    bad: list[InputError] = []
    with st.sidebar:
        case, motion, unit, ms, goal = _side_bar(bad)
    machine = case.machine
    kind = kind_of(machine)
    st.markdown(f"#### {'Position and s' if kind.looped.position_loop else 'S'}peed loop · {plain(machine.name)}")
    if bad:  # after every control is drawn: each shows what the session keeps
        problem(bad[0])
        return
    top = st.container()
    if goal is not None:
        _tune(case, *goal)
    left, right = widgets.beside("loop")
    with left:
        _crossover(case)
    with guarded():
        members, before = loops(case, motion), loops(_by_rule(case), motion)
    with top:
        _numbers(case, members, before)
    with left:  # the colours are Nyquist's, whose legend stands for both
        figure = report.bode(members, height=600, unit=unit).update_layout(showlegend=False, margin={"t": 50})
        chart(figure, "loop bode", "Bode diagram of the open loop")
    with right:
        figure = report.nyquist(members, ms, height=600)
        below = {"orientation": "h", "x": 0.0, "y": -0.14, "yanchor": "top", "yref": "paper", "font": {"size": 12}}
        figure.update_layout(legend=below, margin={"l": 60, "r": 10, "t": 50})
        chart(figure, "loop nyquist", "Nyquist diagram with the circle of Ms")
    _tuned_before(machine)
    st.markdown(plain(" ".join(report.sentences(case, members))))
    if kind.payload and desk.current(machine).scenario.plant == "multibody":
        st.caption("Study runs on the multi-body machine; this loop is that of the lumped one, which is linearised.")
    chart(report.steps(members, height=760), "loop steps", "Step responses of the closed loop")
    chart(report.gang_of_four(members, ms, height=640, unit=unit), "loop gang", "Gang of four")
    st.markdown("##### Margins")
    table(report.table(members))


def _side_bar(bad: list[InputError]) -> tuple[DesignCase, Motion, Any, float, Wanted | None]:
    """Draws every control: the loop, its motion, the unit of frequency, the limit of Ms, what to tune for. bad: takes
    what was entered and cannot be used."""

    def typed(words: str, usual: str, key: str, what: str) -> tuple[float, ...]:
        try:
            return numbers_in(st.text_input(words, key=held(key, usual)), what)
        except InputError as error:
            bad.append(error)
            return numbers_in(usual, what)

    machine = session_machine("loop machine")
    kind = kind_of(machine)
    usual = ", ".join(f"{height:g}" for height in usual_heights(machine))
    payloads: tuple[float, ...] = (0.0,)
    if kind.payload:
        payloads = typed("Payloads (kg)", "0, 4500, 9000", "loop payloads", "payloads")
        heights = typed("Carriage heights (m)", usual, "loop heights", "heights")
    else:
        heights = typed(f"Positions ({kind.moved.unit})", usual, f"loop positions {kind.name}", "positions")
    if len(payloads) * len(heights) > MOST:
        said = f"{len(payloads)} payloads at {len(heights)} heights, expected at most {MOST} loops in all"
        bad.append(InputError(said))
    left, right = st.columns(2)
    motion: Motion = left.selectbox(
        "Motion", list(MOTIONS), key=held("loop motion", "hoisting"),
        format_func=lambda motion: kind.looped.motion_words[motion].replace("_", " "),
        help=f"At rest the {'guide' if kind.payload else 'friction'} damps: it flatters.",
    )  # fmt: skip
    unit = right.selectbox("Frequency", ["Hz", "rad/s"], key=held("loop unit", "Hz"))
    ms = st.slider("Limit of Ms", 1.1, 2.5, step=0.05, key=held("loop ms", 1.4),
                   help="The circle that L must stay out of.")  # fmt: skip
    settings = _gains(machine, bad)
    goal = st.radio("Tune for", [BANDWIDTH, REJECTION], key=held("loop goal", BANDWIDTH))
    # A position loop under its kv needs a speed loop that is wider than it: an axis begins with a wider one.
    start, own = (8.0, f" {kind.name}") if kind.looped.position_loop else (4.0, "")
    hertz = st.number_input("Bandwidth (Hz)", 0.2, 500.0, step=0.5, key=held(f"loop hertz{own}", start),
                            disabled=goal != BANDWIDTH)  # fmt: skip
    with st.expander("What the tuning weighs", icon=":material/balance:"):
        also = st.pills("Also tune", ALSO, selection_mode="multi", key=held("loop also", [])) if kind.payload else []
        weights = tuple(
            st.number_input(f"Weight of {what}", 0.0, 100.0, step=None, format="%.3g", key=held(f"loop {what}", weight))
            for what, weight in {"tracking error": 1.0, "peak": 2.0, "rms": 1.0}.items()
        )
        if not sum(weights):
            bad.append(InputError("0, 0 and 0, expected at least one above 0", place="Weights"))
    pressed = st.button("Tune", type="primary", width="stretch", icon=":material/tune:", key="loop tune")
    wanted = (Goal(hertz if goal == BANDWIDTH else None, ms), Weights(*weights), tuple(also)) if pressed else None
    case = DesignCase(machine, settings, "on this page", payloads, heights, None)
    return case, motion, RAD_S if unit == "rad/s" else HZ, ms, wanted


def _gains(machine: Machine, bad: list[InputError]) -> Settings:
    """The session's one controller, as its sliders stand."""
    now, rule = desk.controller(machine), rule_settings(machine)
    fields, values = desk.fields_of(machine, desk.current(machine).scenario), dict[str, Any]()
    for name in [*(["kv"] if isinstance(now, Cascade) else []), "kp", "ki"]:
        key, least = fields[name].key[-1], 1e-6 if name == "kp" else 0.0
        steps = gain_steps(name, getattr(rule, key))
        field = Field(fields[name].words, fields[name].key, least, 1e9, most=1e9, steps=steps)
        values[name] = number(field, getattr(now, key), f"loop {name}")
    key = held("loop weight", now.set_point_weight)
    values["weight"] = st.slider("Set-point weight", 0.0, 1.0, step=0.01, key=key)
    key = held("loop sample", 1e3 * now.sample_time_s)
    sample = 1e-3 * st.number_input("Sample time (ms)", 0.1, 50.0, step=0.5, key=key, format="%g")
    try:
        settings = desk.change(machine, {**values, "controller.sample_time_s": sample})
    except InputError as error:
        bad.append(error)
        return now
    parts = {"a notch": settings.notch is not None, "a low-pass": settings.low_pass_hz is not None,
             "feed-forward": settings.feed_forward != type(settings.feed_forward)()}  # fmt: skip
    if any(parts.values()):
        also = ", ".join(word for word, there in parts.items() if there)
        st.caption(f"Also in this loop, as set on Study: {also}.")
    return settings


def _crossover(case: DesignCase) -> None:
    """A slider above the Bode plot that moves its crossover: kp, and ki with its square, so that the damping stays."""
    settings, rule = case.settings, rule_settings(case.machine)
    now = settings.kp / rule.kp
    field = Field("Crossover, times the rule's", (), 0.01, 1e4, most=1e4, steps=gain_steps("kp", 1.0), form="%.3g")
    wanted = number(field, float(f"{now:.4g}"), "loop crossover")
    factor = wanted / now
    if abs(factor - 1.0) > 1e-3:
        desk.change(case.machine, {"kp": settings.kp * factor, "ki": settings.ki * factor**2})
        st.rerun()  # the gains stand in the side bar and are drawn already


def rule_settings(machine: Machine) -> Settings:
    """The controller that a rule of thumb gives."""
    return usual_settings(machine)[0]


def gain_steps(name: str, rule: float) -> list[float]:
    """Even in the logarithm, from the gain by rule, itself a step, down and up; kv = 0 is a speed loop alone."""
    down, up = (math.log(reach) / math.log(STEP) for reach in REACH[name])
    by_rule = [float(f"{rule * STEP**k:.4g}") for k in range(math.floor(down), math.ceil(up) + 1)]
    return [0.0, *by_rule] if name == "kv" else by_rule


def _said(case: DesignCase) -> tuple[Any, ...]:
    return machine_text(case.machine), case.settings.model_dump_json(), case.payloads_kg, case.heights_m


# A resource rather than data: the records are frozen, so that nobody need have a copy.
@st.cache_resource(max_entries=60, show_spinner=False, hash_funcs={DesignCase: _said})
def loops(case: DesignCase, motion: Motion) -> list[Member]:
    """Every payload at every height. InputError for a height off the rail."""
    return case.members(motion)


def _by_rule(case: DesignCase) -> DesignCase:
    """The same loop under the gains that a rule of thumb gives: the baseline of the numbers."""
    rule = rule_settings(case.machine)
    gains = {name: getattr(rule, name) for name in (*rule.GAINS, *(["kv_per_s"] if isinstance(rule, Cascade) else []))}
    return replace(case, settings=case.settings.model_copy(update=gains), origin="by rule")


def _numbers(case: DesignCase, members: Sequence[Member], before: Sequence[Member]) -> None:
    """The least of each margin over all loops, against that under the gains by rule."""
    now, then = weakest(members).margins, weakest(before).margins
    if not now.stable:
        st.error("Unstable with these gains: no margin means anything.", icon=":material/warning:")
        return
    same = case.settings == _by_rule(case).settings

    up, up_before = (report.gain_text(m).partition("/")[0] for m in (now, then))
    slow, slow_before = (min(m.margins.bandwidth_hz for m in each) for each in (members, before))
    known = not same and then.stable
    up_by = float(up) - float(up_before) if known and up[:1].isdigit() and up_before[:1].isdigit() else None
    widgets.numbers([
        Number("Largest Ms", now.ms, "", now.ms - then.ms if known else None, "lower"),
        Number("Phase margin", now.phase_deg, "°", now.phase_deg - then.phase_deg if known else None, "higher"),
        Number("Gain margin", float(up) if up[:1].isdigit() else None, "dB", up_by, "higher"),
        Number("Delay margin", 1e3 * now.delay_s, "ms", 1e3 * (now.delay_s - then.delay_s) if known else None,
               "higher"),
        Number("Slowest bandwidth", slow, "Hz", slow - slow_before if known else None, "higher"),
    ])  # fmt: skip
    rule = "" if same else f"; below, the difference to gains {usual_settings(case.machine)[1].replace(': ', ', ')}"
    over = "Of the one loop" if len(members) == 1 else f"The least of each over the {len(members)} loops"
    st.caption(f"{over}{rule}.")


def _tune(case: DesignCase, goal: Goal, weights: Weights, also: Sequence[str]) -> None:
    """Tunes for a goal, which sets the session's controller, and draws the page anew."""
    bar, stop = st.empty(), st.empty()
    stop.button("Cancel", icon=":material/cancel:", key="loop cancel")

    def told(progress: TuneProgress) -> None:
        # A press of any widget ends the run of the page at the next word to the bar, and the tuning with it.
        bar.progress(progress.step / STEPS, text=f"Tuning: {progress.doing}")

    try:
        tuned = case.tuned(goal, weights, also, told)
    except InputError as error:  # the loop under the present gains is still worth seeing
        bar.empty()
        stop.empty()
        problem(error)
        return
    session.put(TUNED, (case, tuned, weights))
    desk.change(case.machine, {"controller": tuned.winner.settings.model_dump()})
    st.rerun()


def _tuned_before(machine: Machine) -> None:
    """What the last tuning found."""
    if not (last := session.get(TUNED, tuple, ())):
        return
    case, tuned, weights = last
    with st.expander("What the tuning found", expanded=True, icon=":material/tune:"):
        if machine_text(case.machine) != machine_text(machine):
            st.caption("Found for another machine or drive:")
        st.markdown(plain(" ".join(tuning_report.sentences(case, tuned, weights))))
        table(tuning_report.table(tuned))
        block = tuning_report.controller_text(tuned.winner.settings)
        widgets.downloads("loop", [("Controller block for scenarios", block, "controller.yaml", "application/yaml")])
