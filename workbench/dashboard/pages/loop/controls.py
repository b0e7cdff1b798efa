"""What the page Loop asks for: machine and drive, payloads, heights, motion, and the gains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import streamlit as st

from workbench.analysis.linearise import Motion
from workbench.analysis.tune import Goal
from workbench.control import PiSettings
from workbench.dashboard import session
from workbench.dashboard.machines import chosen_machine
from workbench.errors import InputError
from workbench.machine import Hoist, with_values
from workbench.reports.loop.case import MOST, numbers, usual_controller, usual_heights

MOTIONS: dict[str, Motion] = {"hoisting": "hoisting", "lowering": "lowering", "at rest": "at_rest"}
KP, KI, WEIGHT = "loop kp", "loop ki", "loop weight"
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
    machine = _with_drive(chosen_machine("loop machine"))
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


def _with_drive(machine: Hoist) -> Hoist:
    """The machine behind the drive's times that are set here; its own to begin with."""
    drive = machine.drive
    with st.expander("Drive", expanded=False):
        said = [
            ("Torque lag (ms)", "torque_lag_s", drive.torque_lag_s),
            ("Speed filter (ms)", "speed_filter_s", drive.speed_filter_s),
            ("Speed delay (ms)", "speed_delay_s", drive.speed_delay_s),
        ]
        values = {
            f"drive.{name}": 1e-3
            * st.number_input(label, 0.0, 200.0, 1e3 * value, 0.5, key=f"loop {name} {1e3 * value:g}", format="%g")
            for label, name, value in said
        }
    return with_values(machine, values)


def put_gains(settings: PiSettings) -> None:
    """Fills the sliders on the next run of the page."""
    session.put(_PENDING, (settings.kp_nm_s_per_rad, settings.ki_nm_per_rad, settings.set_point_weight))


def gains(asked: Question) -> PiSettings:
    """The sliders. Their steps are even in the logarithm; gains that a tuning found are a step of their own."""
    rule = usual_controller(asked.machine)
    found = session.get(_PENDING, tuple, ())
    session.put(_PENDING, ())
    starts = (rule.kp_nm_s_per_rad, rule.ki_nm_per_rad, rule.set_point_weight)
    for key, start in zip((KP, KI, WEIGHT), found or starts, strict=True):
        if found or key not in st.session_state:
            st.session_state[key] = start
    kp = _slider("kp (N m s/rad)", KP, kp_steps(asked.machine))
    ki = _slider("ki (N m/rad)", KI, ki_steps(asked.machine))
    weight = st.slider("Set-point weight", 0.0, 1.0, step=0.01, key=WEIGHT)
    sample = st.number_input("Sample time (ms)", 0.1, 50.0, 1.0, 0.5, key="loop sample", format="%g")
    return PiSettings(kp_nm_s_per_rad=kp, ki_nm_per_rad=ki, set_point_weight=weight, sample_time_s=1e-3 * sample)


def kp_steps(machine: Hoist) -> list[float]:
    """From a tenth to a hundred times the gain by rule."""
    return _log_steps(usual_controller(machine).kp_nm_s_per_rad, 0.1, 100.0)


def ki_steps(machine: Hoist) -> list[float]:
    return _log_steps(usual_controller(machine).ki_nm_per_rad, 0.03, 3000.0)


def _log_steps(rule: float, low: float, high: float) -> list[float]:
    """Up and down from the gain by rule, which is itself a step."""
    down, up = math.floor(math.log(low) / math.log(STEP)), math.ceil(math.log(high) / math.log(STEP))
    return [float(f"{rule * STEP**k:.4g}") for k in range(down, up + 1)]


def _slider(label: str, key: str, steps: Sequence[float]) -> float:
    now = st.session_state[key] = float(st.session_state[key])
    options = sorted({*steps, now})
    return float(st.select_slider(label, options, key=key, format_func=lambda value: f"{value:.4g}"))
