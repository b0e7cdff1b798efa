"""Discounts on the merit of a hypothesis, for the gain that an imperfect model would give as well.

A score weighs what a hypothesis explains as if all that is left were noise and a random discrepancy. Two discounts are
taken off what the data give, none off what the tolerances say: an effect may be of the form of the machine's own
discrepancy (`beyond_discrepancy`), and a second effect may only mend the first one's inexact law (`inexact`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.error_model import Sizes
from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.score import Score, explained
from workbench.effects import find
from workbench.machines import kind_of

PLAY = "backlash"  # the effect whose impacts are found in the logs (`simulate/motion.py`)
BLOWS = 150.0  # merit of a play where impacts come again: no other effect has them, and no fit looks at them
BESIDE_PLAY = 0.3  # as SECOND, where the first is a play: when its teeth meet is foretold to some milliseconds only
LAGS = 0.3  # of the residual, rms: what a lag leaves that made the impacts itself; a play has left 0.5 to its lag
NOISE_KNOWN = 0.15  # of an axis' noise, rms: what is told of it by its log, which is all that is known of it
SECOND = 0.06  # of what the first effect explains, rms: the smallest second one


def of_impacts(problem: Problem, effects: Collection[str], merit: float) -> float:
    """The merit with what the impacts in the logs say: a play has them; without play nothing is worth."""
    if not problem.struck:
        return merit
    return max(merit, 0.0) + BLOWS if PLAY in effects else min(merit, 0.0)


def only_mends(problem: Problem, effect: str) -> bool:
    """Whether a further effect only mends what a first one leaves, whatever it explains. A lag of a sensor beside a
    play takes what its rebounds leave. A play without impacts, which frees inertia and friction after each reversal,
    takes what any other law leaves there.
    """
    if effect == PLAY:
        return kind_of(problem.machine).bridged_impacts and not problem.struck
    return problem.struck and _is_lag(problem, effect)


def inexact(problem: Problem, near: Fitted, fit: Fitted, score: Score, second: float = SECOND) -> float:
    """The gain that a further effect could have by correcting the inexact law of this fit: `second` of what the fit
    explains, as rms; BESIDE_PLAY where that is a play with its impacts."""
    second = BESIDE_PLAY if problem.struck and PLAY in fit.effects else second
    return second**2 * explained(problem, near, fit, score)


def beyond(data: float, least: float) -> float:
    """The gain from the data above `least`. A loss stays as it is."""
    return max(data - least, 0.0) if data > 0.0 else data


def lag_explains(problem: Problem, near: Fitted, fits: Mapping[tuple[str, ...], Fitted]) -> bool:
    """Whether a lag of a sensor alone takes the gap. The kinks of a late signal look like the impacts of a play."""
    lags = [names[0] for names in fits if len(names) == 1 and _is_lag(problem, names[0])]
    return any(fits[name,].rms(problem.inputs) < LAGS * near.rms(problem.inputs) for name in lags)


def _is_lag(problem: Problem, name: str) -> bool:
    declared = find(name, problem.active.kind)
    return declared.regime == "acceleration" and declared.subsystem(problem.active.kind).endswith("sensor")


def beyond_discrepancy(
    problem: Problem, before: Fitted, after: Fitted, gain: float, sizes: Sizes | None = None
) -> float:
    """The fall of the score, less what the machine's own discrepancy could give if it had this effect's form.

    The discrepancy is taken for random in the likelihood. It need not be: a law of friction that is not the machine's
    leaves what some effect describes. So of what the data give, the share is taken off that an effect as large as the
    discrepancy would have, rms: the default one, or that which the machine has shown. Tolerances need no such discount.
    sizes: of the discrepancy that stays beside the effect, None for the search's.
    """
    added = set(after.effects) - set(before.effects)
    if not added:
        return gain
    prior = before.prior - after.prior
    return prior + discounted(problem, added, gain - prior, before.residual, after.residual, sizes)


def discounted(
    problem: Problem, added: Collection[str], data: float, before: Array, after: Array, sizes: Sizes | None = None
) -> float:
    """The gain from the data after the discount of `beyond_discrepancy`. before, after: residuals (samples,) without
    and with the effects.

    What acts at speed is compared with the discrepancy at speed: rows count less the more of their discrepancy is that
    near standstill. An axis' noise is what its log shows, to NOISE_KNOWN: where it is larger, a lag explains the rest.
    """
    if data <= 0.0:
        return data
    slow = all(find(name, problem.active.kind).regime == "low_speed" for name in added)
    rows = slice(0, problem.inputs)
    errors = problem.errors if sizes is None else problem.errors.sized(sizes)
    share = np.ones(problem.inputs) if slow else errors.at_speed[rows]
    default = float(np.mean(share * errors.sized((1.0, 1.0)).discrepancy[rows] ** 2))
    shown = float(np.mean(share * errors.discrepancy[rows] ** 2)) if max(errors.sizes) > 1.0 else 0.0
    if kind_of(problem.machine).floor == "own":
        default += ((1.0 + NOISE_KNOWN) ** 2 - 1.0) * float(np.mean(share * problem.row_noise**2))
    taken = float(np.mean(share * (before[rows] ** 2 - after[rows] ** 2)))
    return data * max(1.0 - max(default, shown) / max(taken, 1e-300), 0.0)


def discrepancy_rms(problem: Problem) -> float:
    """The discrepancy of the input's rows, rms, in the input's unit."""
    return float(np.sqrt(np.mean(problem.errors.discrepancy[: problem.inputs] ** 2)))
