"""What the page Loop asks for: machine and drive, payloads, heights, motion, and the gains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import streamlit as st

from workbench.analysis.linearise import Motion
from workbench.analysis.tune import Goal
from workbench.analysis.usual import usual_settings
from workbench.control import Cascade, Settings
from workbench.dashboard import controller, session
from workbench.dashboard.machines import session_machine
from workbench.errors import InputError
from workbench.kinds import kind_of
from workbench.machine import Axis, Hoist
from workbench.reports.loop.case import MOST, numbers, usual_heights

MOTIONS: dict[str, Motion] = {"hoisting": "hoisting", "lowering": "lowering", "at rest": "at_rest"}
KP, KI, WEIGHT, SAMPLE, KV = "loop kp", "loop ki", "loop weight", "loop sample", "loop kv"
STEP = 1.04  # from one step of a gain's slider to the next
_OF = "loop gains of"
_PENDING = "loop gains found"  # set by a tuning, taken over before the sliders are drawn


@dataclass(frozen=True)
class Question:
    machine: Hoist | Axis
    payloads_kg: tuple[float, ...]
    heights_m: tuple[float, ...]
    motion: Motion
    ms_limit: float
    rad_s: bool


def question() -> Question:
    """The part of the side bar above the gains. InputError for what does not fit."""
    machine = session_machine("loop machine")
    kind = kind_of(machine)
    usual = ", ".join(f"{height:g}" for height in usual_heights(machine))
    if kind.payload:
        payloads = numbers(st.text_input("Payloads (kg)", "0, 4500, 9000", key="loop payloads"), "payloads")
        heights = numbers(st.text_input("Carriage heights (m)", usual, key="loop heights"), "heights")
    else:
        payloads = (0.0,)
        said = st.text_input(f"Positions ({kind.moved.unit})", usual, key=f"loop positions {kind.name}")
        heights = numbers(said, "positions")
    if len(payloads) * len(heights) > MOST:
        raise InputError(f"{len(payloads)} payloads at {len(heights)} heights, expected at most {MOST} loops in all")
    left, right = st.columns(2)
    called = {way: kind.looped.motion_words[motion].replace("_", " ") for way, motion in MOTIONS.items()}
    motion = left.selectbox(
        "Motion", list(MOTIONS), key="loop motion", format_func=lambda way: called[way],
        help=f"At rest the {'guide' if kind.payload else 'friction'} damps: it flatters.",
    )  # fmt: skip
    unit = right.selectbox("Frequency", ["Hz", "rad/s"], key="loop unit")
    ms = st.slider("Limit of Ms", 1.1, 2.5, 1.4, 0.05, key="loop ms", help="The circle that L must stay out of.")
    return Question(machine, payloads, heights, MOTIONS[motion], Goal(ms_limit=ms).ms_limit, unit == "rad/s")


def put_gains(settings: Settings) -> None:
    """Fills the sliders on the next run of the page."""
    session.put(_PENDING, (settings.kp, settings.ki, settings.set_point_weight))


def gains(asked: Question) -> Settings:
    """The session's controller. The sliders' steps are even in the logarithm; gains that a tuning found, that another
    page has set or that are typed are a step of their own."""
    whose = controller.owner(asked.machine)
    rule = controller.present(whose) or rule_settings(asked.machine)
    elsewhere = controller.taken_over("loop", whose) is not None or session.get(_OF, str, whose) != whose
    session.put(_OF, whose)
    proposed = session.get(_PENDING, tuple, ())
    session.put(_PENDING, ())
    starts = (rule.kp, rule.ki, rule.set_point_weight)
    for key, start in zip((KP, KI, WEIGHT), proposed or starts, strict=True):
        if proposed or elsewhere or key not in st.session_state:
            st.session_state[key] = start
    if elsewhere or SAMPLE not in st.session_state:
        st.session_state[SAMPLE] = 1e3 * rule.sample_time_s
    values: dict[str, Any] = {}
    if isinstance(rule, Cascade):
        if elsewhere or KV not in st.session_state:
            st.session_state[KV] = rule.kv_per_s
        values["kv_per_s"] = _slider("kv (1/s)", KV, kv_steps(asked.machine), 0.0)
    kp = _slider(f"kp ({rule.UNITS[0]})", KP, kp_steps(asked.machine), 1e-6)
    ki = _slider(f"ki ({rule.UNITS[1]})", KI, ki_steps(asked.machine), 0.0)
    weight = st.slider("Set-point weight", 0.0, 1.0, step=0.01, key=WEIGHT)
    sample = st.number_input("Sample time (ms)", 0.1, 50.0, step=0.5, key=SAMPLE, format="%g")
    values |= {rule.GAINS[0]: kp, rule.GAINS[1]: ki, "set_point_weight": weight, "sample_time_s": 1e-3 * sample}
    if values.get("kv_per_s") == 0.0 and rule.feed_forward.speed == 0.0:
        raise InputError("kv and the feed-forward of speed are both 0: nothing asks the axis to move", place="kv")
    settings = type(rule).model_validate(rule.model_dump() | values)
    controller.said("loop", settings, whose)
    if also := _also(settings):
        st.caption(f"Also in this loop, as set on Study: {also}.")
    return settings


def rule_settings(machine: Hoist | Axis) -> Settings:
    """The controller that a rule of thumb gives."""
    return usual_settings(machine)[0]


def _also(settings: Settings) -> str:
    """What of the controller no slider of this page shows."""
    said = []
    if settings.notch is not None:
        said.append(f"a notch at {settings.notch.frequency_hz:g} Hz")
    if settings.low_pass_hz is not None:
        said.append(f"a low-pass at {settings.low_pass_hz:g} Hz")
    if settings.feed_forward != type(settings.feed_forward)():
        said.append("feed-forward")
    return ", ".join(said)


def kp_steps(machine: Hoist | Axis) -> list[float]:
    """From a tenth to a hundred times the gain by rule."""
    return _log_steps(rule_settings(machine).kp, 0.1, 100.0)


def ki_steps(machine: Hoist | Axis) -> list[float]:
    return _log_steps(rule_settings(machine).ki, 0.03, 3000.0)


def kv_steps(machine: Hoist | Axis) -> list[float]:
    """Of the position loop; 0 is a speed loop alone."""
    return [0.0, *_log_steps(rule_settings(machine).kv_per_s, 0.1, 30.0)]


def _log_steps(rule: float, low: float, high: float) -> list[float]:
    """Up and down from the gain by rule, which is itself a step."""
    down, up = math.floor(math.log(low) / math.log(STEP)), math.ceil(math.log(high) / math.log(STEP))
    return [float(f"{rule * STEP**k:.4g}") for k in range(down, up + 1)]


def _shown(value: float) -> str:
    """As the field beside it shows it: 121300, not 1.213e+05."""
    return f"{float(f'{value:.4g}'):.10g}"


def _slider(label: str, key: str, steps: Sequence[float], least: float) -> float:
    """A slider with a field beside it, in which any value may be typed."""
    now = st.session_state[key] = float(st.session_state[key])
    typed = f"{key} typed"
    st.session_state[typed] = now

    def take() -> None:
        st.session_state[key] = float(st.session_state[typed])

    options = sorted({*steps, now})
    left, right = st.columns([1.5, 1.0], vertical_alignment="bottom")
    with right:
        st.number_input(
            f"{label}, typed", least, 1e9, key=typed, step=None, format="%.4g", on_change=take,
            label_visibility="collapsed",
        )  # fmt: skip
    with left:
        return float(st.select_slider(label, options, key=key, format_func=_shown))
