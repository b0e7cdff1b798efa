"""Analyse the sampled speed loop over payloads and heights, and how the analysis is shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.analysis.family import Member, Weakest, weakest
from workbench.control import Settings
from workbench.core.shown import Shown, View
from workbench.figures import loop as loop_figures
from workbench.reports.loop import report
from workbench.reports.loop.case import LoopCaseFile


@dataclass(frozen=True, eq=False, repr=False)
class LoopAnalysis(Shown):
    """The loop at every payload and height, with its margins. ms_limit: the bound on Ms that figures show."""

    case: LoopCaseFile
    members: tuple[Member, ...]
    ms_limit: float

    @property
    def weakest(self) -> Weakest:
        """The smallest of each margin, with its loop; an unstable loop if there is any."""
        return weakest(self.members)

    @property
    def plant(self) -> Any:
        """Of the loop with the largest Ms: the sampled plant as a `control.StateSpace`; see `LinearLoop.plant_system`.
        Those of another loop: `members[0].loop.plant_system()` and `.systems()`."""
        return self.weakest.member["ms"].loop.plant_system()

    @property
    def open(self) -> Any:
        """Of the same loop: L as a `control.StateSpace`."""
        return self.weakest.member["ms"].loop.systems()[0]

    @property
    def closed(self) -> Any:
        """Of the same loop: references, load torque and noise to the outputs and the torque wanted."""
        return self.weakest.member["ms"].loop.systems()[2]


def given(controller: Settings | None) -> tuple[Settings, str] | None:
    """The caller's controller, with its origin in words."""
    return None if controller is None else (controller, "as given")


def columns(members: Sequence[Member]) -> Mapping[str, Sequence[Any]]:
    """One row per loop: operating point and margins."""
    where = [report.place_of(member) for member in members]
    places: dict[str, Sequence[Any]] = {name: [place[name] for place in where] for name in where[0]}
    words = members[0].loop.kind.looped.motion_words
    places["motion"] = [words[member.point.motion] for member in members]
    return places | {name: [getattr(m.margins, name) for m in members] for name in vars(members[0].margins)}


VIEW = View(
    {"margins": lambda a: report.table(a.members)},
    {
        "bode": lambda a: loop_figures.bode(a.members),
        "nyquist": lambda a: loop_figures.nyquist(a.members, a.ms_limit),
        "sensitivity": lambda a: loop_figures.gang_of_four(a.members, a.ms_limit),
        "steps": lambda a: loop_figures.steps(a.members),
    },
    lambda a: columns(a.members),
)
