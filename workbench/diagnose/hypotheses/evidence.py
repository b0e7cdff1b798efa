"""How well a hypothesis explains the data: its likelihood, with the sizes of the model error at their best.

    score = |whitened residual|^2 + ln det C(g, h) + (ln g / SPREAD)^2 + (ln h / SPREAD)^2
            + |base parameters in tolerances|^2

g is the campaign's own size of the model error over the default, h that of its part near standstill beside it, at their
best within bounds. The evidence of a hypothesis is the fall of its score against no effect, less its cost: each
parameter costs ln(n) (G. Schwarz, Annals of Statistics 6, 1978), n independent samples, MOST at most.

A score weighs what a hypothesis explains as if all that is left were noise and a random model error. Two discounts are
taken off what the data give, none off what the tolerances say: an effect may be of the form of the machine's own
model error (`beyond_model_error`), and beside a play it may only mend when the teeth meet (`inexact`). Whether a
further effect only mends the law of the others is asked of the answer (`verdict/free_law.py`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.fit import Fitted, others_of, parts_of
from workbench.diagnose.hypotheses.free_parameters import LOG_TIMING, Names, nuisance_std
from workbench.diagnose.hypotheses.problem import Problem, once, rms
from workbench.diagnose.hypotheses.signatures import Projection
from workbench.effects import effects_for, find, ranges_of
from workbench.machines import kind_of, with_values
from workbench.simulate.model_error import Sizes
from workbench.simulate.motion import PLAY, impact_strength

MOST = 500.0  # independent samples that a parameter pays for
FILTER = "torque_filter"


@dataclass(frozen=True)
class Score:
    """value: minus twice the logarithm of the likelihood, up to a constant, with priors. sizes: g and h. excess: the
    model error over the default one, rms."""

    value: float
    sizes: Sizes
    excess: float


def score_of(problem: Problem, fit: Fitted) -> Score:
    """A fit's score at the best sizes of the model error, to a factor of STEP. What was computed once is kept."""

    def found() -> Score:
        value, best = errors.likeliest(fit.residual)
        excess = rms(errors.sized(best).model_error) / max(rms(errors.sized((1.0, 1.0)).model_error), 1e-300)
        return Score(value + fit.prior, best, excess)

    errors = problem.errors
    return once(problem, (fit, errors), found)


def independent(problem: Problem) -> float:
    """Independent samples of the input."""
    return problem.share * problem.inputs


def cost(problem: Problem, parameters: int) -> float:
    """The cost of so many effect parameters, in the score's unit."""
    return parameters * math.log(min(max(independent(problem), 2.0), MOST))


def price(kind: str) -> float:
    """What one more cause costs beside its parameters, 2 ln N: it is as likely to be there as not, whichever of the N
    listed ones it is (J. G. Scott, J. O. Berger, Annals of Statistics 38, 2010)."""
    return 2.0 * math.log(sum(effect.listed for effect in effects_for(kind).values()))


def of_impacts(problem: Problem, effects: Collection[str], evidence: float) -> float:
    """The evidence with what the impacts in the logs say: a play has them; without one, it is worth nothing beside
    them."""
    if not problem.struck:
        return evidence
    return max(evidence, 0.0) + settings.IMPACTS if PLAY in effects else min(evidence, 0.0)


def only_mends(problem: Problem, effect: str) -> bool:
    """Whether a further effect only mends what a first one leaves, whatever it explains: a play without impacts, which
    frees inertia and friction after each reversal, takes what any other law leaves there."""
    return effect == PLAY and kind_of(problem.machine).bridged_impacts and not problem.struck


def inexact(problem: Problem, w: Weighed, base: int) -> float:
    """The gain that another effect could have by correcting the inexact law of a play with its impacts: LAW of what
    that law explains by itself, as rms. base: how many of the hypothesis' z are the base parameters'."""
    played = problem.struck and PLAY in w.names
    return settings.LAW**2 * own_energy(problem, w, (PLAY,), base) if played else 0.0


def beyond(data: float, least: float) -> float:
    """The gain from the data above `least`. A loss stays as it is."""
    return max(data - least, 0.0) if data > 0.0 else data


def lag_explains(problem: Problem, near: Fitted, fits: Mapping[Names, Fitted]) -> bool:
    """Whether a lag of a sensor alone takes what any hypothesis with a play takes, to FORETOLD of the energy. The
    kinks of a late signal look like the impacts of a play, and are none beside that lag (`heard`); what `smooths` takes
    off a play's impacts without being one.
    """

    def taken(some: Collection[Names]) -> float:
        left = min((fits[names].rms(problem.inputs) for names in some), default=math.inf)
        return near.rms(problem.inputs) ** 2 - left**2

    lags = [names for names in fits if len(names) == 1 and is_lag(problem, names[0])]
    silent = [one for one in lags if not smooths(problem, fits[one]) and not heard(problem, fits[one], settings.MINOR)]
    lag = taken(silent)
    return lag > 0.0 and lag > (1.0 - settings.FORETOLD) * taken([names for names in fits if PLAY in names])


def heard(problem: Problem, fit: Fitted, least: float, part: float = 1.0) -> bool:
    """Whether `least` of the impacts of a play, rms, stays at the inertia of a fit and behind a `part` of the lags that
    it has for the log: with a wrong inertia, and in a late motion, each change of the acceleration looks like one."""
    kind, impacts = kind_of(problem.machine), problem.bench.impacts
    values = {key: float(np.mean(fit.setting[at])) for key, at in kind.symbols.items() if at in fit.setting}
    fitted, (lag_s, late_s) = with_values(problem.machine, values), lags_of(problem, fit)
    stays = impact_strength(fitted, problem.runs, impacts, part * late_s, part * lag_s)
    return stays > least * impact_strength(problem.machine, problem.runs, impacts)


def lags_of(problem: Problem, fit: Fitted) -> tuple[float, float]:
    """The time constant of a filter of the input in a fit, and by what its motion is late, s."""
    (lag,) = ranges_of(problem.effect(FILTER), problem.machine, problem.runs)
    lag_s, *late = (float(np.mean(fit.setting.get(one, 0.0))) for one in (lag.symbol, LOG_TIMING, problem.late))
    return lag_s, sum(late)


def smooths(problem: Problem, fit: Fitted) -> bool:
    """Whether a late motion undoes the lag of a filter of the input, but for MINOR of it: the prediction is made
    smoother, and later by what the motion is later still. No data tell that from a motion that is late by the rest
    alone; a smoother prediction takes off what the motion holds and the input does not ask for, as cogging or noise at
    high frequency."""
    if FILTER not in fit.effects:
        return False
    lag_s, late_s = lags_of(problem, fit)
    return late_s > (1.0 - settings.MINOR) * lag_s


def is_lag(problem: Problem, name: str) -> bool:
    declared = problem.effect(name)
    return declared.regime == "acceleration" and declared.subsystem(problem.active.kind).endswith("sensor")


def beyond_model_error(
    problem: Problem, before: Fitted, after: Fitted, gain: float, sizes: Sizes | None = None
) -> float:
    """The fall of the score, less what the machine's own model error could give if it had this effect's form.

    The model error is taken for random in the likelihood. It need not be: a law of friction that is not the machine's
    leaves what some effect describes. So of what the data give, the share is taken off that an effect as large as the
    model error would have, rms: the default one, or that which the machine has shown. Tolerances need no such discount.
    sizes: of the model error that stays beside the effect, None for the search's.
    """
    added = set(after.effects) - set(before.effects)
    if not added:
        return gain
    prior = before.prior - after.prior
    return prior + discounted(problem, added, gain - prior, before.residual, after.residual, sizes, not before.effects)


def discounted(
    problem: Problem,
    added: Collection[str],
    data: float,
    before: Array,
    after: Array,
    sizes: Sizes | None = None,
    first: bool = False,
) -> float:
    """The gain from the data after the discount of `beyond_model_error`. before, after: residuals (samples,) without
    and with the effects.

    An effect is compared with the model error where it acts: rows count by how much it changes them; a further one of a
    machine that leaves itself laws of its own with all of it, for it may be no more than that. What acts at speed is
    compared with that at speed: rows count less the more of their model error is that near standstill. What the machine
    has shown is no more than what is left beside the effect: the sizes follow the quick part of a residual, and may
    promise more of the slow. An axis' noise is what its log shows, to LAW: where it is larger, a lag explains
    the rest. A wrong law of the machine's own is wrong alike in every run, and is no drift over a campaign: what it has
    shown of that is what the runs differ by.
    """
    if data <= 0.0:
        return data
    effects, rows = [problem.effect(name) for name in added], slice(0, problem.inputs)
    slow = all(effect.regime == "low_speed" for effect in effects)
    errors = problem.errors if sizes is None else problem.errors.sized(sizes)
    share = np.ones(problem.inputs) if slow else errors.at_speed[rows]
    own = kind_of(problem.machine).floor == "own"
    if first or not own:
        share = share * np.abs(before[rows] - after[rows])
    default = float(np.mean(share * errors.sized((1.0, 1.0)).model_error[rows] ** 2))
    shown = float(np.mean(share * errors.model_error[rows] ** 2)) if max(errors.sizes) > 1.0 else 0.0
    shown = min(shown, float(np.mean(share * after[rows] ** 2)))
    over_all = all(e.regime == "time" and not any(parameter.per_run for parameter in e.parameters) for e in effects)
    if over_all and len({run.start_time_s for run in problem.runs}) > 1:
        form, of_run = before[rows] - after[rows], problem.run_of_row[rows]
        along, size = (np.bincount(of_run, share * form * x) for x in (after[rows], form))
        shown = min(shown, float(np.sum(along**2 / np.maximum(size, 1e-300))) / problem.inputs)
    if own:
        default += ((1.0 + settings.LAW) ** 2 - 1.0) * float(np.mean(share * problem.row_noise**2))
    taken = float(np.mean(share * (before[rows] ** 2 - after[rows] ** 2)))
    return data * max(1.0 - max(default, shown) / max(taken, 1e-300), 0.0)


def model_error_rms(problem: Problem) -> float:
    """The model error of the input's rows, rms, in the input's unit."""
    return float(np.sqrt(np.mean(problem.errors.model_error[: problem.inputs] ** 2)))


@dataclass(frozen=True)
class Weighed:
    """A hypothesis with its evidence. gain: the fall of chi^2 and tolerances. score: at the sizes of the model error
    that fit best. rival: an unlisted effect, which no answer may name."""

    names: Names
    fit: Fitted
    gain: float
    evidence: float
    score: Score
    rival: bool = False


def weigh(
    problem: Problem, base: Fitted, near: Fitted, fits: Mapping[Names, Fitted], rivals: Collection[str] = ()
) -> tuple[Weighed, ...]:
    """All fitted hypotheses by falling evidence.

    base: the fit without effects; near: the same within the tolerances. rivals: unlisted effects. The evidence of
    several effects is the most of all orders in which one after the other is added: of what each adds beyond the gain
    that an inexact law of those before it allows (`inexact`). So it does not hang on which of them is best alone. One
    that adds nothing as the last has none that it may have as the first, in place of another.
    """
    none, by_names, weighed = score_of(problem, base), dict[Names, Weighed](), list[Weighed]()
    for size in range(1, max(map(len, fits), default=0) + 1):
        together: dict[Names, Weighed] = {}
        for names, fit in [(names, fit) for names, fit in fits.items() if len(names) == size]:
            score = score_of(problem, fit)
            parts = [by_names[part] for part in combinations(names, size - 1) if part in by_names]
            steps = [(part.evidence, _added(problem, near, part, fit, score)) for part in parts]
            if size == 1:
                evidence = beyond_model_error(problem, base, fit, none.value - score.value, score.sizes)
                evidence -= cost(problem, len(fit.z) - len(base.z))
                evidence = of_impacts(problem, names, beyond_nuisance(problem, fit, names[0], evidence))
            elif steps:
                evidence = min(max(map(sum, steps)), *(sum(step) for step in steps if step[1] < 0.0), math.inf)
            else:
                continue
            gain, rival = base.objective - fit.objective, any(name in rivals for name in names)
            together[names] = Weighed(names, fit, gain, evidence, score, rival)
        by_names |= together
        weighed += _paid(problem, together, len(base.z)).values()
    return tuple(sorted(weighed, key=lambda w: -w.evidence))


def _added(problem: Problem, near: Fitted, first: Weighed, fit: Fitted, score: Score) -> float:
    """The evidence that one more effect adds to a hypothesis."""
    gain = beyond_model_error(problem, first.fit, fit, first.score.value - score.value, score.sizes)
    prior = first.fit.prior - fit.prior
    (last,) = set(fit.effects) - set(first.names)
    least = inexact(problem, first, len(near.z))
    data = beyond(gain - prior, least)
    added = prior + (min(data, 0.0) if only_mends(problem, last) else data)
    evidence = added - cost(problem, len(fit.z) - len(first.fit.z))
    evidence = beyond_nuisance(problem, fit, last, evidence) - price(problem.active.kind)
    return of_impacts(problem, {last}, evidence) if last == PLAY else evidence


def _paid(problem: Problem, together: Mapping[Names, Weighed], base: int) -> dict[Names, Weighed]:
    """Hypotheses of as many effects, after freer laws have paid for their freedom (`_not_freer`): simpler ones first,
    for a freer one is held against what they come to."""
    paid: dict[Names, Weighed] = {}
    for w in sorted(together.values(), key=lambda w: len(w.fit.z)):
        paid[w.names] = _not_freer(problem, w, together, paid, base)
    return paid


def _not_freer(
    problem: Problem, mine: Weighed, beside: Mapping[Names, Weighed], paid: Mapping[Names, Weighed], base: int
) -> Weighed:
    """The hypothesis with less evidence, if it is not better by the threshold than the best simpler law of the place
    and regime of each of its effects: the shortfall is subtracted, with what that one has paid itself (`paid`). No more
    is it where its prediction is off that of the simpler law by less than LAW of what that law explains, rms: so far a
    real machine is off any law; but by what it relieves the tolerances. Nor is a law with more parameters, whose
    prediction is as near to that of another one, better by what only one of both is taken to share with the model
    error: a drift that is as good as constant is a constant. base: how many of a fit's z are the base parameters'."""
    most = mine.evidence
    best: dict[str, Weighed] = {}
    for names, other in beside.items():
        own, its = set(mine.names) - set(names), set(names) - set(mine.names)
        if len(own) != 1:
            continue
        if all(same_but_freer(a, b, problem.active.kind) for a in own for b in its):
            (freer,) = own
            best[freer] = max(other, best.get(freer, other), key=lambda w: w.evidence)
        elif not other.rival and len(mine.fit.z) > len(other.fit.z):
            real = other.score.value - mine.score.value - cost(problem, len(mine.fit.z) - len(other.fit.z))
            alike = paid[other.names].evidence + real - float(freedom(real))
            off = settings.LAW**2 * own_energy(problem, other, tuple(its), base) if alike < most else 0.0
            if off > 0.0 and _bent(problem, mine, other) < off:
                most = alike
    for other in best.values():
        off = settings.LAW**2 * own_energy(problem, other, tuple({*other.names} - {*mine.names}), base)
        real = advantage(mine, other, off)
        if _bent(problem, mine, other) < off:
            real = min(real, max(other.fit.prior - mine.fit.prior, 0.0))
        most = min(most, paid[other.names].evidence + real - float(freedom(real)))
    return replace(mine, evidence=most)


def _bent(problem: Problem, one: Weighed, other: Weighed) -> float:
    """By how much two predictions differ, whitened as the other is: its energy."""
    bent = problem.errors.sized(other.score.sizes).whiten(one.fit.residual - other.fit.residual)
    return float(bent @ bent)


def freedom(better: float | Array) -> Array:
    """What a freer law pays beside a simpler one: by how much it is `better` by less than the threshold."""
    least = settings.THRESHOLD
    return np.clip(least - better, 0.0, least)


def own_energy(problem: Problem, w: Weighed, names: Names, base: int) -> float:
    """The energy of what effects of a hypothesis explain, whitened as it is, without what the others of its parameters
    could take up within their tolerances: the same law explains as much alone as beside others. base: how many of its z
    are the base parameters'."""

    def found() -> float:
        sized = problem.with_model_error(w.score.sizes)
        return float(
            np.sum(Projection.of(sized, others_of(w.fit, names, base)).clean(parts_of(problem, w.fit, [names]).T) ** 2)
        )

    return once(problem, (w.fit, names, "own energy", w.score.sizes), found)


def advantage(mine: Weighed, other: Weighed, off: float) -> float:
    """How much better a hypothesis is than another one whose inexact law it may only correct: the difference of the
    tolerances in full, that of the data above what the other one's law may be off."""
    prior = other.fit.prior - mine.fit.prior
    return prior + beyond(mine.evidence - other.evidence - prior, off)


def beyond_nuisance(problem: Problem, fit: Fitted, name: str, evidence: float) -> float:
    """The evidence less the part that an ordinary nuisance amount of the effect explains: NUISANCE deviations."""
    known = nuisance_std(problem.machine, problem.runs, name)
    sizes = [float(np.mean(fit.setting[symbol])) / std for symbol, std in known.items()]
    if evidence <= 0.0 or not sizes:
        return evidence
    return evidence * max(1.0 - (settings.NUISANCE / max(*sizes, settings.NUISANCE)) ** 2, 0.0)


def same_but_freer(freer: str, simpler: str, kind: str) -> bool:
    """Whether an effect has the place and regime of another one and more parameters: the same cause by a freer law."""
    a, b = find(freer, kind), find(simpler, kind)
    return len(a.parameters) > len(b.parameters) and (a.subsystem(kind), a.regime) == (b.subsystem(kind), b.regime)


def nested(one: str, other: str, kind: str) -> bool:
    """Whether one of two effects contains the other: the same cause by a freer law with amounts of the same unit, as a
    friction of each direction and one of both. Together they are one law twice, with amounts that cancel."""

    def units(name: str) -> set[str]:
        return {parameter.size for parameter in find(name, kind).parameters}

    freer = same_but_freer(one, other, kind) or same_but_freer(other, one, kind)
    return freer and units(one) == units(other)
