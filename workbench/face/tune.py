"""Tune the speed loop; the view of the result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.analysis.family import operating_points
from workbench.analysis.tune import Candidate, Goal, Tuned, TuneProgress, Weights
from workbench.analysis.tune import tune as search_gains
from workbench.control import Settings
from workbench.core.shown import Shown
from workbench.face.logs import PathLike
from workbench.face.loop import given
from workbench.face.view import View
from workbench.figures import loop as loop_figures
from workbench.machines import Axis, Hoist
from workbench.reports.loop import tuning as report
from workbench.reports.loop.case import LoopCaseFile, loop_case

USUAL_WEIGHTS = Weights()


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


def tune(
    machine: Hoist | Axis | None = None,
    controller: Settings | None = None,
    *,
    bandwidth_hz: float | None = None,
    ms_limit: float = 1.4,
    payloads_kg: Sequence[float] | None = None,
    heights_m: Sequence[float] | None = None,
    weights: Weights = USUAL_WEIGHTS,
    scenario: PathLike | None = None,
    tell: Callable[[TuneProgress], object] = lambda progress: None,
) -> Tuning:
    """Find kp, ki and the set-point weight: loop shaping first, then runs of the nonlinear closed loop.

    bandwidth_hz: of the slowest payload; without it the best rejection of load steps is sought. ms_limit: of the worst
    payload. controller: settings that stay as they are (filters, feed-forward). tell: receives the progress, and may
    raise to stop. InputError, with the reason, for a goal out of reach.
    """
    goal = Goal(bandwidth_hz, ms_limit)
    case = loop_case(machine, given(controller), payloads_kg, heights_m, scenario)
    points = operating_points(case.machine, case.payloads_kg, case.heights_m)
    tuned = search_gains(case.machine, case.settings, points, case.trial(), goal, weights, tell=tell)
    return Tuning(case, weights, tuned)


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
