"""The page of a study: conclusions, table and figures in one file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workbench.figures.study import overview, peak_torque_over_payload
from workbench.figures.study_axis import axis_overview
from workbench.machines import kind_of
from workbench.study.answer import answer, read_answer
from workbench.study.decide import decision_table
from workbench.study.labels import set_in
from workbench.study.rows import Row, with_payload
from workbench.study.run import StudyResult, peak_limit
from workbench.study.tables import run_table
from workbench.view.page import Section, save_page

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def study_figures(result: StudyResult) -> list[Figure]:
    """The runs over time, the start of the first move at larger scale, the torque peak over payload."""
    machine, name = result.study.machine, result.study.scenario.name
    good = [(_name(row), result.runs[row.run_id]) for row in result.rows if row.ok]
    if not good:
        return []
    kind = kind_of(machine)
    if kind.looped.position_loop:
        of = kind, peak_limit(machine), machine.drive.nominal
        whole = axis_overview(good, *of, f"Study {name}: closed loop")
        return [whole, axis_overview(good, *of, f"Study {name}: start of the first move", start_of_move(result))]
    nominal, limit = machine.motor.nominal_torque_nm, peak_limit(machine)
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
    if kind_of(result.study.machine).looped.position_loop and limits is not None:  # what an axis does is soon over
        ramp = 2.0 * limits.hoisting.speed_m_s / limits.hoisting.acceleration_m_s2
        return max(start - 0.1 * ramp, 0.0), start + min(end - start, ramp)
    # The longest of the references' ramps is below 3 v/a.
    ramp = 3.0 * limits.hoisting.speed_m_s / limits.hoisting.acceleration_m_s2 if limits is not None else 5.0
    return max(start - 0.4, 0.0), start + min(end - start, ramp) + 0.6


def _name(row: Row) -> str:
    """What tells the runs of an axis apart: what was swept, too. A hoist's are told apart by their panels."""
    swept = "" if with_payload(row) else set_in(row)
    return f"{row.reference}, {swept}" if swept else row.reference


def _peak(result: StudyResult, payload_kg: float, kind: str) -> float:
    for row in result.rows:
        if row.payload_kg == payload_kg and row.reference == kind:
            return row["peak_torque_motor_nm"]
    return float("nan")


def save_study_page(result: StudyResult, path: Path) -> None:
    """Write the page of a study, with the answer that stands beside it; it needs no network."""
    machine, description = result.study.machine, result.study.scenario.description
    decision, kept = decision_table(result.rows), read_answer(path.parent)
    section = Section(
        sentences=[description] if description else [],
        points=answer(result.study, result.rows) if kept is None else kept.sentences,
        tables=[*([decision] if decision is not None else []), run_table(result.rows)],
        figures=[(figure, "") for figure in study_figures(result)],
    )
    save_page([section], path, f"Study {result.study.scenario.name} — {machine.name}")
