"""The page of an identification: the paper's Figures 6 to 8 for the campaign, and what the fit is sure of."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workbench.figures.identify import correlation_matrix, level_history
from workbench.figures.replay import friction_law
from workbench.figures.save import save
from workbench.identify.identify import Identification
from workbench.kinds import kind_of
from workbench.reports.identify import report
from workbench.reports.identify.friction import combined_weight, force_balance, law
from workbench.reports.replay import report as replay_report
from workbench.reports.replay.page import RESIDUAL_NOTE, inputs, notes_line, residuals, speeds
from workbench.reports.words import direction_names

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def save_identify_page(found: Identification, path: Path) -> None:
    """Write the page of an identification; it needs no network."""
    machine = found.machine
    weight = combined_weight(machine, found.after)
    per = "" if weight is None else f" Weight: {weight / 1000.0:.0f} kN, carriage and mean payload of the runs."
    save(
        [
            inputs(machine, found.after),
            friction(found),
            speeds(machine, found.after),
            residuals(machine, found.after, found.before),
            history(found),
            correlation_matrix([free.key for free in found.fit.free], found.fit.correlation),
        ],
        path,
        title=f"Identification of {machine.name} from campaign {found.campaign.name}",
        sentences=[*report.sentences(found), *notes_line(found.campaign)],
        table=(report.HEAD, report.table(found.fit)),
        caption=report.CAPTION,
        more_tables=[
            (
                report.measures_head(machine),
                report.measures_table(found),
                replay_report.caption(machine, found.after),
            )
        ],
        figure_notes=[
            "What the machine was given (the paper's Figure 6).",
            f"The paper's Figure 7. Points: the log's balance of forces under the identified machine.{per}",
            "The identified machine under the measured input (the paper's Figure 8).",
            RESIDUAL_NOTE,
            "The paper's own identification: all other values stay nominal; round 0 is the start.",
            "Near ±1 the runs show two values together only: one may be off as long as the other makes up for it.",
        ],
    )


def friction(found: Identification) -> Figure:
    """Fig. 7: the law before and after, and the log's own points."""
    nominal, machine = found.campaign.machine, found.machine
    points = force_balance(machine, found.after)
    fastest = 1.1 * float(np.max(np.abs(points[0]), initial=1e-3))
    # Many points near standstill, where the law turns over.
    half = fastest * np.linspace(0.0, 1.0, 200) ** 3
    speed = np.concatenate([-half[:0:-1], half])
    kind = kind_of(machine)
    return friction_law(
        speed,
        [("identified", law(machine, speed)), ("nominal", law(nominal, speed))],
        combined_weight(machine, found.after),
        points,
        kind.moved.speed_unit,
        kind.friction.unit,
    )


def history(found: Identification) -> Figure:
    machine = found.machine
    forward, backward = direction_names(machine)
    levels = {forward: found.levels.forward, backward: found.levels.backward}
    return level_history(levels, kind_of(machine).friction.unit)
