"""Tune the speed loop; the view of the result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.analysis.tune import Candidate, Tuned, Weights
from workbench.control import Settings
from workbench.core.shown import Shown, View
from workbench.figures import loop as loop_figures
from workbench.reports.loop import tuning as report
from workbench.reports.loop.case import LoopCaseFile


@dataclass(frozen=True, eq=False, repr=False)
class Tuning(Shown):
    """What was tuned, for which goal, and the outcome with all candidates."""

    case: LoopCaseFile
    weights: Weights
    outcome: Tuned

    @property
    def controller(self) -> Settings:
        """The winner's settings, for scenarios, `simulate` and `loop`."""
        return self.outcome.winner.settings

    @property
    def winner(self) -> Candidate:
        return self.outcome.winner


def _columns(t: Tuning) -> Mapping[str, Sequence[Any]]:
    """One row a candidate of the front, the best tracking first."""
    front = t.outcome.front()
    return {
        **{gain: [getattr(c.settings, gain) for c in front] for gain in t.controller.GAINS},
        "set_point_weight": [c.settings.set_point_weight for c in front],
        "tracking_percent": [c.score.tracking_percent for c in front],
        "peak_percent": [c.score.peak_percent for c in front],
        "effort_percent": [c.score.effort_percent for c in front],
        "ms": [c.ms for c in front],
        "bandwidth_hz": [c.bandwidth_hz for c in front],
        "cost": [c.cost for c in front],
    }


VIEW = View(
    {"candidates": lambda t: report.table(t.outcome)},
    {
        "bode": lambda t: loop_figures.bode(t.outcome.members),
        "nyquist": lambda t: loop_figures.nyquist(t.outcome.members, t.outcome.goal.ms_limit),
        "sensitivity": lambda t: loop_figures.gang_of_four(t.outcome.members, t.outcome.goal.ms_limit),
        "steps": lambda t: loop_figures.steps(t.outcome.members),
    },
    _columns,
)
