"""The answer of the page Study for an axis."""

from __future__ import annotations

from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from workbench.dashboard.pages.study.answer import decision, numbers_of, take_away, window
from workbench.dashboard.widgets import chart
from workbench.figures.study_axis import axis_overview
from workbench.kinds import kind_of
from workbench.machine import SHIPPED, Axis, shipped
from workbench.machine.files import machine_text
from workbench.study.run import StudyResult, peak_limit
from workbench.study.scenario import Scenario
from workbench.yaml_strict import dumps


def axis_names(machine: Axis) -> dict[str, str]:
    """What a scenario calls a value, and the control that sets it."""
    kind = kind_of(machine)
    unit = kind.moved.unit
    return {
        "name": "Name of the study",
        "start_position_m": f"Start position ({unit})",
        "start_position_rad": f"Start position ({unit})",
        "moves": f"There and back by ({unit})",
        "speed_m_s": "Limit speed (m/s)",
        "speed_rad_s": "Limit speed (rad/s)",
        "acceleration_m_s2": "Limit acceleration (m/s²)",
        "acceleration_rad_s2": "Limit acceleration (rad/s²)",
        "jerk_m_s3": "Limit jerk (m/s³)",
        "jerk_rad_s3": "Limit jerk (rad/s³)",
        "kv_per_s": "kv (1/s)",
    }


def axis_files(scenario: Scenario, machine: Axis) -> dict[str, tuple[str, str]]:
    """Button -> (file name, text): the scenario, and the machine that it names where that does not ship."""
    own, file = shipped_as(machine), f"{scenario.name}_machine.yaml"
    files = {"Save scenario": (f"{scenario.name}.yaml", axis_text(scenario, own or file))}
    return files if own else files | {"Save machine": (file, machine_text(machine))}


def shipped_as(machine: Axis) -> str | None:
    """What a scenario calls the machine; None for one that does not ship."""
    return next((name for name in SHIPPED if shipped(name) == machine), None)


def axis_text(scenario: Scenario, machine: str) -> str:
    """The scenario as YAML, on the machine of this name; empty blocks and missing values are left out."""
    data: dict[str, Any] = scenario.model_dump(mode="json", exclude={"extends"}, exclude_none=True)
    data["machine"] = machine
    data["limits"] = {key: value for key, value in data["limits"].items() if value != {}}
    return dumps({key: value for key, value in data.items() if value not in ({}, "")})


def axis_answer(scenario: Scenario, machine: Axis, result: StudyResult) -> DeltaGenerator:
    """Verdict, lights, table, numbers, the runs over time, files; the place of the verdict."""
    sentence = st.empty()
    decision(result, sentence)
    with st.expander("One reference against the trapezoid", icon=":material/compare:"):
        numbers_of(result)
    ran, kind = result.study.machine, kind_of(machine)
    runs = [(row.reference, result.runs[row.run_id]) for row in result.rows if row.ok and row.run_id in result.runs]
    if runs:
        stretch = window(result, max(float(run.time_s[-1]) for _, run in runs))
        figure = axis_overview(runs, kind, peak_limit(ran), ran.drive.nominal, "", stretch, height=740)
        alt = f"Position, tracking error, speed and {kind.drive.quantity} over time"
        chart(figure, "study over time", alt)
    take_away(result)
    return sentence
