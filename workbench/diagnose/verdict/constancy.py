"""Whether an effect is the law that its part of the residual follows: its amount is the same wherever it is looked for.

    r ~ f(w) p + B z,    share = (held-out fall of |r|^2 by f, less CHANCE |r|^2) / |p|^2

p is what the effect takes off the residual, r what the whole fit leaves, w one of the effect's own variables: those of
its regime (speed, position, acceleration, load), the direction and the time. f is a free function of w (piecewise linear,
smoothed), fitted to the other runs; B z, the base parameters, are projected out. A true cause has one amount: f
gains nothing, whatever else is left in r. A mimic leaves a curve over its own variable, or acts in some of the runs only
(parameter constancy; G. C. Chow, Econometrica 28, 1960; A. Zeileis, K. Hornik, Statistica Neerlandica 61, 2007).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from workbench.diagnose.hypotheses.contributions import parts_of
from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.merit import PLAY
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.profiles import OnTop, hats
from workbench.diagnose.location.variables import spacing, variables
from workbench.diagnose.location.where import free_of
from workbench.effects import Effect

CHANCE = 0.05  # of what the fit leaves: so much of a remainder looks like a change of the cause's amount
EVERYWHERE = ("all", "time")  # regimes of the variables over which every amount is constant
OWN = {
    "low_speed": ("speed",),
    "all": ("load", "position"),
}  # regime of an effect -> of its variables, where it differs
SENSED = ("load",)  # of a sensor that errs everywhere: it knows no place


@dataclass(frozen=True)
class Constancy:
    """share: of the effect's own energy, what a free function of `variable` in place of its one amount takes off the
    held-out residual besides; about 0 for a true cause. over: where the other runs foretell it."""

    effect: str
    variable: str
    share: float


def constancies(problem: Problem, fit: Fitted, effects: Sequence[Effect]) -> tuple[Constancy, ...]:
    """Of each effect of a fit, for the own variable that its amount changes most with.

    Not of a play with blows: its own law is not looked at in the residual.
    """
    left, weight = fit.residual[: problem.inputs], spacing(problem)
    on_top = OnTop(problem, left, free_of(problem, fit))
    energy = float(weight @ left**2)
    found = []
    for part in parts_of(problem, fit, effects):
        rows = part.rows[: problem.inputs]
        own = float(weight @ rows**2)
        if own <= 0.0 or (part.effect.id == PLAY and problem.struck):
            continue
        regime = part.effect.regime
        sensor = part.effect.subsystem(problem.active.kind).endswith("sensor")
        regimes = (*EVERYWHERE, *(SENSED if sensor and regime == "all" else OWN.get(regime, (regime,))))
        shares = {}
        for variable in variables(problem, left):
            if variable.regime in regimes:
                shape, bend = hats(variable)
                after = on_top.after(rows[:, None] * shape, bend)
                shares[variable.name] = ((1.0 - CHANCE) * energy - float(weight @ after**2)) / own
        if shares:
            name = max(shares, key=lambda key: shares[key])
            found.append(Constancy(part.effect.id, name, shares[name]))
    return tuple(found)
