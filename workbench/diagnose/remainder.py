"""The remainder: what no cause takes, stated beside any verdict; and the one definition of what a cause explains.

    explained = 1 - (after² - noise²) / (before² - noise²),    remainder = (after² - noise²) / (before² - noise²)

before and after are the rms of the held-out runs' residual without and with the answer, noise that of the sensors in
the same band. Every real machine leaves something; it vetoes no name.
"""

from __future__ import annotations

from workbench.diagnose.gap import Shrink
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.places import placed
from workbench.diagnose.location.profiles import best_of
from workbench.diagnose.location.where import holding, laws_left, regime_of
from workbench.diagnose.verdict.answer import Remainder
from workbench.diagnose.verdict.unknown_cause import beyond_noise
from workbench.machines import kind_of


def remainder_of(problem: Problem, fit: Fitted, base: int, shrink: Shrink, seed: int) -> Remainder:
    """fit: of the answer, with the table of an unknown cause; base: how many of its first z are the base parameters'.
    Where it changes no conclusion, its place is unsaid."""
    rest, gap = (max(x**2 - shrink.noise**2, 0.0) for x in (shrink.after, shrink.before))
    stays = beyond_noise(problem, shrink.after, shrink.noise)
    kind = kind_of(problem.machine)
    left = fit.residual[: problem.inputs]
    regime, subsystem = "all", kind.whole or "unsaid"
    if stays.relevant:
        best = best_of(laws_left(problem, fit, seed))
        if best.share > settings.FORETOLD:
            regime = regime_of(problem, left, best)
        if not kind.whole:
            subsystem = placed(problem, fit, base, holding(problem, fit, best, seed)).places[0].subsystem
    share = min(rest / gap, 1.0) if gap > 0.0 else float(rest > 0.0)
    return Remainder(stays.rms, stays.percent_of_input, stays.relevant, share, subsystem, regime)
