"""The page of a study: conclusions, table and figures in one file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workbench.figures.save import Section, save_page
from workbench.figures.study import overview, peak_torque_over_payload
from workbench.study.conclude.sentences import sentences
from workbench.study.conclude.tables import run_table
from workbench.study.execute.run import StudyResult, motor_torque_limit_nm

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def study_figures(result: StudyResult) -> list[Figure]:
    """The runs over time, the start of the first move at larger scale, the torque peak over payload."""
    machine = result.study.machine
    nominal = machine.motor.nominal_torque_nm
    limit = motor_torque_limit_nm(machine)
    name = result.study.scenario.name
    good = [(row.reference, result.runs[row.run_id]) for row in result.rows if row.ok]
    if not good:
        return []
    figures = [overview(good, nominal, limit, f"Study {name}: closed loop at each payload")]
    window, shown = start_of_move(result), ("speed", "error", "torque")
    figures.append(overview(good, nominal, limit, f"Study {name}: start of the first move", window, shown))
    payloads = np.array(sorted({row.payload_kg for row in result.rows}))
    if len(payloads) > 1:
        held = {row.payload_kg: row["hold_torque_nm"] / machine.motor.count for row in result.rows}
        peaks = {
            kind: np.array([_peak(result, payload, kind) for payload in payloads])
            for kind in result.study.scenario.kinds
        }
        static = np.array([held[payload] for payload in payloads])
        figures.append(peak_torque_over_payload(payloads, peaks, nominal, limit, static))
    return figures


def start_of_move(result: StudyResult) -> tuple[float, float]:
    """From when to when (s) the first move gathers speed, and what rings after it."""
    start, end = next(iter(result.study.plans.values())).move_windows[0]
    limits = result.study.specs[0].limits
    # The longest of the references' ramps is below 3 v/a.
    ramp = 3.0 * limits.hoisting.speed_m_s / limits.hoisting.acceleration_m_s2 if limits is not None else 5.0
    return max(start - 0.4, 0.0), start + min(end - start, ramp) + 0.6


def _peak(result: StudyResult, payload_kg: float, kind: str) -> float:
    for row in result.rows:
        if row.payload_kg == payload_kg and row.reference == kind:
            return row["peak_torque_motor_nm"]
    return float("nan")


def save_study_page(result: StudyResult, path: Path) -> None:
    """Write the page of a study; it needs no network."""
    machine = result.study.machine
    said = sentences(result.rows, motor_torque_limit_nm(machine))
    paragraphs = [result.study.scenario.description, " ".join(said)]
    section = Section(
        sentences=[paragraph for paragraph in paragraphs if paragraph],
        tables=[run_table(result.rows)],
        figures=[(figure, "") for figure in study_figures(result)],
    )
    save_page([section], path, f"Study {result.study.scenario.name} — {machine.name}")
