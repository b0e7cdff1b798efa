"""The folder of an identification: machine, JSON, and a page with the paper's Figures 6 to 8 for the campaign."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workbench.core.whole_folder import check_free, whole_folder, write_json
from workbench.figures.identify import correlation_matrix, level_history
from workbench.figures.replay import friction_law
from workbench.identify.identify import Identification
from workbench.machines import kind_of, save_machine
from workbench.reports.identify import report
from workbench.reports.identify.friction import combined_weight, force_balance, law
from workbench.reports.replay import report as replay_report
from workbench.reports.replay.page import INPUTS_NOTE, RESIDUAL_NOTE, inputs, notes_line, residuals, speeds
from workbench.view.page import Section, save_page
from workbench.view.words import direction_names

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def write_identification(run: Callable[[], Identification], folder: Path) -> Identification:
    """Identify, and write machine.yaml, replay.json for that machine, identify.json and identify.html."""
    check_free(folder)
    with whole_folder(folder) as hidden:
        identification = run()
        save_machine(identification.machine, hidden / "machine.yaml")
        write_json(
            hidden / "replay.json", replay_report.to_json(report.as_campaign(identification), identification.after)
        )
        write_json(hidden / "identify.json", report.to_json(identification))
        save_identify_page(identification, hidden / "identify.html")
    return identification


def save_identify_page(identification: Identification, path: Path) -> None:
    """Write the page of an identification; it needs no network."""
    machine = identification.machine
    weight = combined_weight(machine, identification.after)
    per = "" if weight is None else f" Weight: {weight / 1000.0:.0f} kN, carriage and mean payload of the runs."
    section = Section(
        sentences=[*report.sentences(identification), *notes_line(identification.campaign)],
        tables=[report.table(identification.fit), report.measures_table(identification)],
        figures=[
            (inputs(machine, identification.after), INPUTS_NOTE),
            (
                friction(identification),
                f"The paper's Figure 7. Points: the log's balance of forces under the identified machine.{per}",
            ),
            (
                speeds(machine, identification.after),
                "The identified machine under the measured input (the paper's Figure 8).",
            ),
            (residuals(machine, identification.after, identification.before), RESIDUAL_NOTE),
            (
                history(identification),
                "The paper's own identification: all other values stay nominal; round 0 is the start.",
            ),
            (
                correlation_matrix([free.key for free in identification.fit.free], identification.fit.correlation),
                "Near ±1 the runs show two values together only: one may be off as long as the other makes up for it.",
            ),
        ],
    )
    save_page([section], path, f"Identification of {machine.name} from campaign {identification.campaign.name}")


def friction(identification: Identification) -> Figure:
    """Fig. 7: the law before and after, and the log's own points."""
    nominal, machine = identification.campaign.machine, identification.machine
    points = force_balance(machine, identification.after)
    fastest = 1.1 * float(np.max(np.abs(points[0]), initial=1e-3))
    # Many points near standstill, where the law turns over.
    half = fastest * np.linspace(0.0, 1.0, 200) ** 3
    speed = np.concatenate([-half[:0:-1], half])
    kind = kind_of(machine)
    return friction_law(
        speed,
        [("identified", law(machine, speed)), ("nominal", law(nominal, speed))],
        combined_weight(machine, identification.after),
        points,
        kind.moved.speed_unit,
        kind.friction.unit,
    )


def history(identification: Identification) -> Figure:
    machine = identification.machine
    forward, backward = direction_names(machine)
    levels = {forward: identification.levels.forward, backward: identification.levels.backward}
    return level_history(levels, kind_of(machine).friction.unit)
