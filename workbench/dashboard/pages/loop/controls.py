"""What the page Loop asks for: machine and drive, payloads, heights, motion, and the gains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import streamlit as st

from workbench.analysis.linearise import Motion
from workbench.analysis.tune import Goal
from workbench.control import FeedForward, PiSettings
from workbench.dashboard import controller, session
from workbench.dashboard.machines import session_machine
from workbench.errors import InputError
from workbench.machine import Hoist
from workbench.reports.loop.case import MOST, numbers, usual_controller, usual_heights

MOTIONS: dict[str, Motion] = {"hoisting": "hoisting", "lowering": "lowering", "at rest": "at_rest"}
KP, KI, WEIGHT, SAMPLE = "loop kp", "loop ki", "loop weight", "loop sample"
STEP = 1.04  # from one step of a gain's slider to the next
_PENDING = "loop gains found"  # set by a tuning, taken over before the sliders are drawn


@dataclass(frozen=True)
class Question:
    machine: Hoist
    payloads_kg: tuple[float, ...]
    heights_m: tuple[float, ...]
    motion: Motion
    ms_limit: float
    rad_s: bool


def question() -> Question:
    """The part of the side bar above the gains. InputError for what does not fit."""
    machine = session_machine("loop machine")
    payloads = numbers(st.text_input("Payloads (kg)", "0, 4500, 9000", key="loop payloads"), "payloads")
    usual = ", ".join(f"{height:g}" for height in usual_heights(machine))
    heights = numbers(st.text_input("Carriage heights (m)", usual, key="loop heights"), "heights")
    if len(payloads) * len(heights) > MOST:
        raise InputError(f"{len(payloads)} payloads at {len(heights)} heights, expected at most {MOST} loops in all")
    left, right = st.columns(2)
    motion = left.selectbox("Motion", list(MOTIONS), key="loop motion", help="At rest the guide damps: it flatters.")
    unit = right.selectbox("Frequency", ["Hz", "rad/s"], key="loop unit")
    ms = st.slider("Limit of Ms", 1.1, 2.5, 1.4, 0.05, key="loop ms", help="The circle that L must stay out of.")
    return Question(machine, payloads, heights, MOTIONS[motion], Goal(ms_limit=ms).ms_limit, unit == "rad/s")


def put_gains(settings: PiSettings) -> None:
    """Fills the sliders on the next run of the page."""
    session.put(_PENDING, (settings.kp_nm_s_per_rad, settings.ki_nm_per_rad, settings.set_point_weight))


def gains(asked: Question) -> PiSettings:
    """The session's controller. The sliders' steps are even in the logarithm; gains that a tuning found, that another
    page has set or that are typed are a step of their own."""
    rule = controller.present() or usual_controller(asked.machine)
    elsewhere = controller.taken_over("loop")
    proposed = session.get(_PENDING, tuple, ())
    session.put(_PENDING, ())
    starts = (rule.kp_nm_s_per_rad, rule.ki_nm_per_rad, rule.set_point_weight)
    for key, start in zip((KP, KI, WEIGHT), proposed or starts, strict=True):
        if proposed or elsewhere is not None or key not in st.session_state:
            st.session_state[key] = start
    if elsewhere is not None or SAMPLE not in st.session_state:
        st.session_state[SAMPLE] = 1e3 * rule.sample_time_s
    kp = _slider("kp (N m s/rad)", KP, kp_steps(asked.machine), 1e-6)
    ki = _slider("ki (N m/rad)", KI, ki_steps(asked.machine), 0.0)
    weight = st.slider("Set-point weight", 0.0, 1.0, step=0.01, key=WEIGHT)
    sample = st.number_input("Sample time (ms)", 0.1, 50.0, step=0.5, key=SAMPLE, format="%g")
    values = {"kp_nm_s_per_rad": kp, "ki_nm_per_rad": ki, "set_point_weight": weight, "sample_time_s": 1e-3 * sample}
    settings = PiSettings.model_validate(rule.model_dump() | values)
    controller.said("loop", settings)
    if also := _also(settings):
        st.caption(f"Also in this loop, as set on Study: {also}.")
    return settings


def _also(settings: PiSettings) -> str:
    """What of the controller no slider of this page shows."""
    said = []
    if settings.notch is not None:
        said.append(f"a notch at {settings.notch.frequency_hz:g} Hz")
    if settings.low_pass_hz is not None:
        said.append(f"a low-pass at {settings.low_pass_hz:g} Hz")
    if settings.feed_forward != FeedForward():
        said.append("feed-forward")
    return ", ".join(said)


def kp_steps(machine: Hoist) -> list[float]:
    """From a tenth to a hundred times the gain by rule."""
    return _log_steps(usual_controller(machine).kp_nm_s_per_rad, 0.1, 100.0)


def ki_steps(machine: Hoist) -> list[float]:
    return _log_steps(usual_controller(machine).ki_nm_per_rad, 0.03, 3000.0)


def _log_steps(rule: float, low: float, high: float) -> list[float]:
    """Up and down from the gain by rule, which is itself a step."""
    down, up = math.floor(math.log(low) / math.log(STEP)), math.ceil(math.log(high) / math.log(STEP))
    return [float(f"{rule * STEP**k:.4g}") for k in range(down, up + 1)]


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
            f"{label}, typed", least, 1e6, key=typed, step=None, format="%.4g", on_change=take,
            label_visibility="collapsed",
        )  # fmt: skip
    with left:
        return float(st.select_slider(label, options, key=key, format_func=lambda value: f"{value:.4g}"))
