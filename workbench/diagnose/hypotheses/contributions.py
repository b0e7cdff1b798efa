"""The part of the prediction that each effect of a fit accounts for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from workbench.core.run import Array
from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.knobs import Setting
from workbench.diagnose.hypotheses.problem import Problem
from workbench.effects import Effect, ranges_of


@dataclass(frozen=True)
class Part:
    """An effect's part of the gap: rows (samples,), first the input's, then the tension's."""

    effect: Effect
    rows: Array


def parts_of(problem: Problem, fit: Fitted, effects: Sequence[Effect]) -> list[Part]:
    """The change of the prediction by each effect alone, at the fit's values."""
    settings = [_without(problem, fit, [effect]) for effect in effects]
    _, change = problem.differences(fit.setting, settings)
    return [Part(effect, rows) for effect, rows in zip(effects, change, strict=True)]


def sum_of(problem: Problem, fit: Fitted, effects: Sequence[Effect]) -> Array:
    """The change of the prediction by all effects together, (samples,)."""
    return problem.differences(fit.setting, [_without(problem, fit, effects)])[1][0]


def _without(problem: Problem, fit: Fitted, effects: Sequence[Effect]) -> Setting:
    off = {
        r.symbol: r.vanishes_at
        for effect in effects
        for r in ranges_of(effect, problem.machine, problem.runs)
        if r.vanishes_at is not None
    }
    return {**fit.setting, **off}
