"""The record of a whole diagnosis."""

from __future__ import annotations

from dataclasses import dataclass, field

from workbench.consequences import Consequences
from workbench.core.shown import Shown
from workbench.diagnose.hypotheses.search import SearchResult
from workbench.diagnose.isolation.records import Isolability, NextRun
from workbench.diagnose.location.records import Delivered, Gap, Where
from workbench.diagnose.readiness.records import Condition
from workbench.diagnose.shrink import Shrink
from workbench.diagnose.unexplained.records import Unknown
from workbench.diagnose.verdict.answer import Candidate, Verdict
from workbench.diagnose.verdict.judge import Judged
from workbench.logs import Campaign
from workbench.machines import Axis, Hoist


@dataclass(frozen=True, repr=False)
class Diagnosis(Shown):
    """The results of a diagnosis, in the order of its steps. corrected: the machine for replay and study."""

    campaign: Campaign
    seed: int
    condition: Condition
    gap: Gap
    delivered: Delivered
    where: Where | None
    candidates: tuple[Candidate, ...]
    isolability: Isolability
    verdict: Verdict
    next_run: NextRun | None
    shrink: Shrink
    corrected: Hoist | Axis
    refitted: Hoist | Axis
    unknown: Unknown | None
    consequences: Consequences | None
    why_no_consequences: str
    search: SearchResult = field(repr=False, compare=False)
    judged: Judged = field(repr=False, compare=False)
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """The answer in a few lines; `table()` and `plot()` show the rest."""
        likeliest = sorted(self.verdict.ranking, key=lambda row: -row.probability)[:3]
        shrink = self.shrink
        lines = [
            f"Diagnosis of {self.campaign.name}",
            f"  {self.verdict.sentence}",
            *(f"  {row.probability:.2f} {' + '.join(row.effects) or row.verdict}" for row in likeliest),
            f"  held-out residual: {shrink.before:.3g} to {shrink.after:.3g} {shrink.unit}, noise {shrink.noise:.3g}",
        ]
        if self.where is not None:
            lines.append(f"  where: {self.where.subsystem}, {self.where.regime}")
        return "\n".join(lines)
