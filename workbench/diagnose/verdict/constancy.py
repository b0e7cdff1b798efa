"""Whether an effect is the law that its part of the residual follows: its amount is the same wherever it is looked for.

    r ~ f(w) p + B z,    share = (held-out fall of |r|^2 by f, less FORETOLD |r|^2) / |p|^2
    r ~ g(w) + B z,      rest = (held-out fall of |r|^2 by g, less FORETOLD |r|^2) / (|r_0|^2 - |r|^2)

p is what the effect takes off the residual, r what the whole fit leaves, r_0 what the fit without effects leaves. w is
one of the effect's own variables: those of its regime (speed, position, acceleration, load, time); for f also the
direction and the time, over which an amount is constant but a remainder may go, and all where its regime is all or
time; there r is what g leaves of a variable that is not its own. f and g are free functions of w (piecewise linear,
smoothed; g one each way), fitted to the other runs; B z, the base parameters, are projected out. A true cause has one
amount and takes all that is in its own variables: f and g gain nothing that matters, whatever else is left in r. Where
the tolerances tell more of it than the residual, for base parameters could take it up, what it takes is |p|^2. What
acts everywhere has its amount in each half of each run, too: what wanders has another one, which no other run
foretells, so there f is fitted to the half itself. A mimic leaves a curve over its own variable, or acts in some of the
runs only (parameter constancy; G. C. Chow, Econometrica 28, 1960; A. Zeileis, K. Hornik, Statistica Neerlandica 61,
2007).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from workbench.core.run import Array
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.fit import Fitted, parts_of
from workbench.diagnose.hypotheses.held_out import STRETCHES, stretches
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.profiles import OnTop, basis, hats, spacing, variables
from workbench.diagnose.location.where import free_of
from workbench.simulate.motion import PLAY

EVERYWHERE = ("all", "time")  # regimes of the variables over which every amount is constant
OWN = {
    "low_speed": ("speed",),
    "all": ("load", "position"),
}  # regime of an effect -> of its variables, where it differs
PAYLOAD = "payload"  # a variable over which every amount is constant, too, that is not declared to go with the load
SENSED = ("load",)  # of a sensor that errs everywhere: it knows no place, speed or time


@dataclass(frozen=True)
class Constancy:
    """What speaks against an effect as a cause. over: the variable, or another reason. share, rest: see the module;
    about 0 for a true cause. free: whether a free law of the variable does without it (`free_law`)."""

    effect: str
    over: str
    share: float
    rest: float = 0.0
    free: bool = False

    @property
    def broken(self) -> bool:
        return self.share > settings.FORETOLD or self.rest > settings.HALF**2


def constancies(problem: Problem, base: Fitted, near: Fitted, fit: Fitted) -> tuple[Constancy, ...]:
    """Of each effect of a fit, for the own variable that it is least constant over. base, near: the fits without
    effects, as far as they go and within the tolerances.

    Not of a play with impacts: its own law is not looked at in the residual.
    """
    left, weight = fit.residual[: problem.inputs], spacing(problem)
    on_top = OnTop(problem, left, free_of(problem, fit))
    energy, before = (float(weight @ rows[: problem.inputs] ** 2) for rows in (left, near.residual))

    def left_by(columns: Array, penalty: Array) -> float:
        return float(weight @ on_top.after(columns, penalty) ** 2)

    chance, noise = settings.FORETOLD * energy, problem.noise**2 * float(np.sum(weight))
    taken = max(before - energy, chance)
    by_tolerances = base.prior - fit.prior > base.chi2 - fit.chi2
    found = []
    for name, part in zip(fit.effects, parts_of(problem, fit, [(name,) for name in fit.effects]), strict=True):
        rows, effect = part[: problem.inputs], problem.effect(name)
        own = float(weight @ rows**2)
        if own <= 0.0 or (name == PLAY and problem.struck):
            continue
        regime = effect.regime
        sensor = effect.subsystem(problem.active.kind).endswith("sensor")
        own_regimes = SENSED if sensor and regime == "all" else OWN.get(regime, (regime,))
        tested, scale = [], max(taken, own) if by_tolerances else taken
        for variable in variables(problem, left):
            within, always = variable.regime in own_regimes, variable.regime in EVERYWHERE
            of_load = variable.name == PAYLOAD and not within
            if not (within or always or of_load or (regime in EVERYWHERE and not sensor)):
                continue
            (shape, bend), law = hats(variable), basis(problem, variable)
            shape, beside = rows[:, None] * shape, energy
            if not (within or always or of_load):  # a remainder that goes with the speed is no drift that does
                beside, shape = min(left_by(*law), energy), np.hstack([law[0], shape])
                bend = block_diag(law[1], bend)
            changing = beside - left_by(shape, bend)
            rest = (energy - left_by(*law) - chance) / scale if within else 0.0
            if of_load:
                rest = (changing - chance) / max(energy - noise, chance)
            tested.append(Constancy(name, variable.name, (changing - chance) / own, rest))
        if regime == "all":  # it acts in each half of each run
            changing = by_halves(problem, rows, left) - chance
            tested.append(Constancy(name, "halves_of_each_run", changing / own))
        if tested:
            found.append(max(tested, key=lambda one: max(one.share / settings.FORETOLD, one.rest / settings.HALF**2)))
    return tuple(found)


def by_halves(problem: Problem, part: Array, left: Array) -> float:
    """The energy that another amount of a part in each half of each run takes off what is left, (inputs,) both, beyond
    chance: what hangs together for no longer than a stretch differs as much from stretch to stretch of a half."""
    which, weight = stretches(problem)[: problem.inputs], spacing(problem)
    taken, count = [], []
    for pieces in (which // (STRETCHES // 2), which):
        along, size = (np.bincount(pieces, weight * part * rows) for rows in (left, part))
        taken.append(float(np.sum(along**2 / np.maximum(size, 1e-300))))
        count.append(int(np.count_nonzero(size)))
    return max(taken[0] - (taken[1] - taken[0]) * count[0] / max(count[1] - count[0], 1), 0.0)
