"""The search: the fit without effects, every effect alone, then one further effect after the other.

Every shape of an effect is tried linearly, on its signatures. The most promising effects are fitted nonlinearly, each
with all that are there before it, until no further one is worth its parameters.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, field, replace
from itertools import combinations, product

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.evidence import (
    Weighed,
    beyond_model_error,
    cost,
    heard,
    inexact,
    price,
    same_but_freer,
    score_of,
    smooths,
    weigh,
)
from workbench.diagnose.hypotheses.fit import (
    BREAKDOWNS,
    Fitted,
    fit_hypothesis,
    parameters_of,
    uncorrelated,
)
from workbench.diagnose.hypotheses.fits import FIRST_ROUND, LAST_ROUND, SHAPES_KEPT, Fits, Promise
from workbench.diagnose.hypotheses.free_parameters import (
    LOG_TIMING,
    Names,
    Scalar,
    bounds_of,
    effect_parameters,
    setting_of,
    within,
)
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.signatures import (
    Projection,
    Signature,
    columns_signed,
    gain_of,
    stepped,
)
from workbench.diagnose.progress import Progress, Stage, Task, Tell
from workbench.effects import Effect
from workbench.simulate.model_error import STEP, Sizes
from workbench.simulate.motion import PLAY

REFITTED = 8  # single effects that are refitted nonlinearly, the linearly best
FEW = 3  # of them to begin with
ALWAYS = 2  # effects refitted whatever they promise
HOPELESS = -10.0  # evidence, linearly
SLACK = 30.0  # evidence that a linear estimate may be short of: a delay beside a payload error was by 20
EXTENDED_REFITTED = 6
LEADS = 0.4  # of the best hypothesis' evidence
TOLERANCES = 3.0  # within which signatures are taken
TURNED = 1.5  # the same, of the logarithm of what nobody knows: how friction turns over
PAIR_IN_REACH = 0.9
STUCK = 0.5  # of the logarithm of how friction turns over: further apart lie different minima
IN_REACH = 0.3  # of the best gain: what is followed to its end
OUT_OF_REACH = 0.25  # of the gain of the best single effect: what promises less is not refitted, what gains less left
IN_PART = 10.0  # so many times the strain of its nuisance may an effect gain that takes its place
PARTNERS = 3  # of each leading hypothesis, that are refitted with it
LEADERS = 3
LARGE = 0.5  # of what a leader leaves: a further effect that promises so much tells what the model error is
MOST_SIZES = 3  # of the model error that are tried after the default ones
LEADERS_AGAIN = 2  # hypotheses that tell the next sizes
TOO_LATE = 5.0  # sampling steps of the log's motion behind its input
TIMINGS = (0.0, 0.5, 1.0)  # of the delay that the base fit asks for, at which a play's impacts are heard
TOO_SMALL = 1.5  # sizes of the model error: what needs more is searched again with them
ROUNDS_OF_PLAY = 3  # steps of its values, then a fit of all


@dataclass(frozen=True)
class SearchResult:
    """The fits of one campaign. base: without an effect; within_tolerances: the same with every base parameter at most
    TOLERANCES standard deviations off nominal. fits: names -> the best fit.

    linear: names -> what a linear fit promises, also for what was not refitted. failures: names -> why a fit broke
    down. signatures: the signatures at `within_tolerances`. rivals: effects weighed alone that no answer may name.
    """

    problem: Problem
    base: Fitted
    within_tolerances: Fitted
    fits: Mapping[Names, Fitted]
    linear: Mapping[Names, float]
    signatures: Sequence[Signature]
    failures: Mapping[Names, str] = field(default_factory=dict)
    rivals: frozenset[str] = frozenset()

    def gain(self, names: Names) -> float:
        """What the objective falls by, against no effect."""
        return self.base.objective - self.fits[names].objective


def searched(
    problem: Problem,
    effects: Sequence[Effect],
    most_effects: int = settings.MOST_EFFECTS,
    tell: Tell | None = None,
    rivals: Sequence[Effect] = (),
    base: Mapping[str, Scalar] | None = None,
    quick: bool = False,
    own: Fitted | None = None,
) -> SearchResult:
    """The search, with the size of model error that the best hypothesis needs.

    Where the base parameters alone put the log's motion more than TOO_LATE sampling steps behind its input, the samples
    are left out whose motion had ended by then. The search begins with the default sizes. If the best hypothesis leaves
    a larger residual, the base parameters have absorbed part of the gap: the sizes that the best hypothesis needs are
    found with refits of the leading ones, and all are searched once more with them. Beside a play that is heard, whose
    stiff contact makes a fit take seconds, what counts is refitted with them instead. quick: single effects only, and
    no second search. own: the fit of effects that are taken for the machine's own.
    """
    problem = problem.quick() if quick else problem
    search = Search(problem, effects, tell, rivals, base, own)
    late_s = search.late_s()
    if late_s > 0.0:
        search = Search(problem.moving_after(late_s), effects, tell, rivals, base, own)
    search.hear_impacts()
    result = search.causes(1 if quick else most_effects, FEW, LARGE)  # enough to tell the sizes, in most campaigns
    if quick:
        return search.exact(result, 1)
    fits: Sequence[Fitted] = [result.base, *result.fits.values()]
    left, whole = MOST_SIZES, False
    while True:
        resized, before = False, search
        while left and (sizes := search.sizes_needed(fits)) is not None:
            search, left, resized = search.with_sizes(sizes), left - 1, True
            fits = search.leaders_again(fits)
        if whole and resized and search.problem.struck:
            result = before._refitted(result, search.problem)
            search, resized = before._at(result), False
        if whole and not resized:
            return search.exact(result, most_effects)
        result, whole = search.causes(most_effects, REFITTED, 0.0), True
        if not search.found:  # the default sizes have served
            return search.exact(result, most_effects)
        fits = [result.base, *result.fits.values()]


@dataclass(frozen=True)
class _Way:
    """A leading hypothesis and the effect to add to it, by linear estimates. worth: the evidence of both; gain: the
    fall of the objective."""

    worth: float
    gain: float
    leader: Fitted
    promise: Promise


class Search(Fits):
    """One campaign's search."""

    def hear_impacts(self) -> None:
        """Take impacts for a play's only where HALF of them stays at the inertia that the base fit asks for, at any
        timing of the log up to what it asks for (`heard`). That fit is by plain least squares: whitened, it is bent to
        what rings after each impact."""
        if self.problem.struck:
            fit = self.base_fit()
            plain = self.problem.weighed_by(uncorrelated(self.problem, fit))
            with suppress(*BREAKDOWNS):
                fit = fit_hypothesis(plain, (), fit.free, np.zeros(self.count), LAST_ROUND, self.count)
            if not all(heard(self.problem, fit, settings.HALF, part) for part in TIMINGS):
                self.problem = self.problem.without_impacts()

    def late_s(self) -> float:
        """The delay of the log's motion in the base fit, s; 0 up to TOO_LATE sampling steps."""
        if LOG_TIMING not in self.base:
            return 0.0
        fit = self.base_fit()
        late = float(fit.z[self._place_of(self.base[LOG_TIMING])][0])
        return late * self.base[LOG_TIMING].scale if late > TOO_LATE else 0.0

    def causes(self, most: int, refitted: int, least: float) -> SearchResult:
        """The fits of single effects, `refitted` of them; then one further effect after the other beside the leading
        hypotheses, as long as one more is worth it. least: of what a leader leaves, what a further effect has to
        promise."""
        result = self.singles(refitted)
        for size in range(1, most):
            self._extend(result, size, least)
            if size == 1:
                self._joint(result, least)
            self._finish(result.base, [names for names in self.fits if len(names) == size + 1], PAIR_IN_REACH)
            if size == 1:
                if least == 0.0:
                    self._step_play(2)
                self._drop(result.base)
            self._offer_standstill(result.base)
            self._fit_simpler_laws(result, size + 1)
            result = self._found(result.base, result.within_tolerances, result.signatures)
            leading = self.leading(result)
            if leading is None or len(leading.names) <= size or self._mends_play(result, leading):
                break
        return result

    def _mends_play(self, result: SearchResult, leading: Weighed) -> bool:
        """Whether the last effect beside a play that is heard, and another one, adds so little that a further one could
        but mend the play's law."""
        if not self.problem.struck or PLAY not in leading.names or len(leading.names) < 3:
            return False
        fewer = [w.evidence for w in self._nameable(result) if len(w.names) < len(leading.names)]
        return leading.evidence - max(fewer, default=0.0) < settings.FORETOLD * leading.evidence

    def exact(self, result: SearchResult, most: int) -> SearchResult:
        """The result with what counts refitted at every sample of the logs, and what may be beside the leading
        hypothesis. most: effects at once."""
        if self.problem.thin:
            result = self._refitted(result, self.problem.exact())
        return self._leaving_out(self._beside_the_leading(result, most))

    def _leaving_out(self, result: SearchResult) -> SearchResult:
        """The result with the leading hypothesis refitted without each of several effects, and by simpler laws, from
        where it is, and those of as many effects that it is decisively better than, but by less than HALF, from its
        base values, if a linear step from there makes up for that, as long as another one leads then: these may be at a
        poorer minimum, or not fitted at all."""
        search, before = self._at(result), None
        while (w := search.leading(result)) is not None and w.names != before:
            before = w.names
            for kept in combinations(w.fit.effects, len(before) - 1) if len(before) > 1 else ():
                names = tuple(sorted(kept))
                search._try(names, lambda fit=w.fit, kept=kept: search._without(fit, kept))  # type: ignore[misc]
                search._finish(result.base, [names])
            search._fit_simpler_laws(result, len(before))
            for other in [other for other in search._nameable(result) if len(other.names) == len(before)]:
                begun = np.concatenate([w.fit.z[: self.count], other.fit.z[self.count :]])
                near = settings.HALF * w.evidence < other.evidence < w.evidence - settings.DECISIVE
                if near and search._stepped(other.fit, begun) < other.fit.objective - (w.evidence - other.evidence):
                    search._try(other.names, lambda f=other.fit, z=begun: search._fit(f.effects, f.free, z))  # type: ignore[misc]
            result = search._found(result.base, result.within_tolerances, result.signatures)
        return result

    def _at(self, result: SearchResult) -> Search:
        """This search, to go on from a result."""
        search = copy(self)
        search.problem, search.fits = result.problem, dict(result.fits)
        return search

    def _refitted(self, result: SearchResult, problem: Problem) -> SearchResult:
        """The result of the same campaign posed otherwise: what counts is refitted, the rest weighed."""
        evidence = {w.names: w.evidence for w in self.weighed(result)}
        counts = {names for names, worth in evidence.items() if worth > max(evidence.values()) - SLACK}
        # The evidence of several builds on that of their best part.
        for size in range(max(map(len, counts), default=0), 1, -1):
            for names in [names for names in counts if len(names) == size]:
                counts |= {max(combinations(names, size - 1), key=lambda part: evidence.get(part, -math.inf))}

        def again(fit: Fitted) -> Fitted:
            return fit_hypothesis(problem, fit.effects, fit.free, fit.z, LAST_ROUND, self.count, fit.jacobian)

        def weighed(fit: Fitted) -> Fitted:
            white = problem.errors.whiten(fit.residual)
            return replace(fit, chi2=float(white @ white))

        near = result.within_tolerances
        base = again(result.base)
        return replace(
            result,
            problem=problem,
            base=base,
            within_tolerances=base if near is result.base else again(near),
            fits={names: again(fit) if names in counts else weighed(fit) for names, fit in result.fits.items()},
        )

    def _beside_the_leading(self, result: SearchResult, most: int) -> SearchResult:
        """The result with a further effect sought beside the leading hypothesis, where the search may have missed it;
        if one leads, what counts is refitted with the sizes of the model error that it leaves, none below its default.

        Any, where the leading hypothesis leaves less of a model error than the search has taken it for: a ripple may
        have passed for what is near standstill. And the waves of a motor's turn, where not every sample was simulated:
        between samples such a turn may pass, and its wave looks like a slower one, or like none."""
        search, told = self._at(result), result
        leading = search.leading(result)
        if leading is None or len(leading.names) >= most:
            return result
        size, standstill = _left_by(leading)
        sizes = size, standstill * STEP if standstill > 1.0 else standstill  # as in `sizes_needed`
        sought = [e for e in self.effects.values() if self._new_to(leading.names, e.id)]
        if any(left < taken for left, taken in zip(sizes, self.problem.errors.sizes, strict=True)):
            search.problem = result.problem.with_model_error(sizes)
        else:
            sought = [e for e in sought if self.problem.thin and any(r.scan == "order" for r in self._ranges(e))]
        if not sought:
            return result
        fit, search.scanned = search._again(leading.fit), ()
        promises = search._promised(fit, search._signatures(sought, fit))
        law = inexact(search.problem, leading, self.count)  # of a play that is heard: no estimate is short of more
        least = price(self.problem.active.kind) - (0.0 if law > 0.0 else SLACK)
        further = {
            tuple(sorted((*leading.names, name))): promise
            for name, promise in promises.items()
            if search._worth(fit, promise, law) > least
        }
        if not further:
            return result
        if search.problem is not result.problem:
            told = search._refitted(result, search.problem)
            search = search._at(told)
        for names, promise in further.items():
            search.fits.pop(names, None)
            search._try(names, lambda promise=promise: search._fit_with(fit, promise))  # type: ignore[misc]
            search._finish(told.base, [names])
        search._offer_standstill(told.base)
        told = search._found(told.base, told.within_tolerances, told.signatures)
        leading = search.leading(told)
        if leading is None or leading.names not in further:
            return result
        for _ in range(MOST_SIZES):
            if leading is None or (sizes := _left_by(leading)) == told.problem.errors.sizes:
                break
            told = search._refitted(told, told.problem.with_model_error(sizes))
            search = search._at(told)
            leading = search.leading(told)
        return told

    def leaders_again(self, found: Sequence[Fitted]) -> list[Fitted]:
        """The likeliest of the fits of a search with other sizes, refitted with these."""
        scores = {score_of(self.problem, fit).value: fit for fit in found}
        first = [scores[value] for value in sorted(scores)[:LEADERS_AGAIN] if value < min(scores) + SLACK]
        fits = [self._again(fit) for fit in first]
        self.found = {**self.found, **{tuple(sorted(fit.effects)): fit for fit in fits}}
        return fits

    def sizes_needed(self, fits: Sequence[Fitted]) -> Sizes | None:
        """The sizes of the model error at which the best hypothesis is likeliest; None where they are about those of
        this search."""
        size, standstill = min((score_of(self.problem, fit) for fit in fits), key=lambda score: score.value).sizes
        if standstill > 1.0 and max(size, standstill) > TOO_SMALL:
            standstill *= STEP  # a fit has bent itself to what is near standstill, and asks for less than there is
        sizes = (max(size, 1.0), standstill)
        apart = (abs(math.log(a / b)) for a, b in zip(sizes, self.problem.errors.sizes, strict=True))
        return None if max(apart) < math.log(TOO_SMALL) else sizes

    def with_sizes(self, sizes: Sizes) -> Search:
        """The same search with other sizes of the model error, begun at what this one has found."""
        again = copy(self)
        again.problem = self.problem.with_model_error(sizes)
        again.found = {**self.found, **self.fits}
        again.begin = self._base.z if self._base is not None else self.begin
        again.fits, again.linear, again.failures, again._base, again._begun = {}, {}, {}, None, None
        return again

    def singles(self, refitted: int = REFITTED) -> SearchResult:
        """The fit without effects, and the fits of every effect alone."""
        base = self.base_fit()
        if self._begun is None:
            within = self._within_tolerances(base)
            self._tell(Progress(Stage.SEARCH, Task.SIGNATURES))
            found = self._signatures([*self.effects.values(), *self.rivals.values()], replace(within, free=base.free))
            self.scanned = self.scanned or found
            self._begun = within, found
        within, signatures = self._begun
        near = replace(within, free=base.free)  # hypotheses start there, and may go further
        self._singles(base, near, signatures, refitted)
        self._offer_standstill(base)
        return self._found(base, within, signatures)

    def _found(self, base: Fitted, near: Fitted, signatures: Sequence[Signature]) -> SearchResult:
        return SearchResult(
            self.problem, base, near, self.fits, self.linear, signatures, self.failures, frozenset(self.rivals)
        )

    def _within_tolerances(self, base: Fitted) -> Fitted:
        """The base fit with all parameters within TOLERANCES. Signatures are taken there: a fit that a large effect has
        pulled far from nominal is a poor point to linearise at."""
        # What happens at standstill must not stand in for the gap either.
        far = [TURNED if k.logarithmic else TOLERANCES * k.prior_std[0] for k in self.held]
        reach = np.repeat(far, [k.size for k in self.held])
        if np.all(np.abs(base.z) <= TOLERANCES * np.minimum(bounds_of(self.held)[2], 1.0)):
            return base
        held = [within(k, limit) for k, limit in zip(self.held, far, strict=True)]
        return self._fit((), held, np.clip(base.z, -reach, reach))

    def _singles(self, base: Fitted, near: Fitted, signatures: Sequence[Signature], refitted: int) -> None:
        promised = self._promised(near, signatures)
        self.linear |= {(name,): promise.gain for name, promise in promised.items()}
        order = sorted(promised, key=lambda name: -promised[name].evidence)
        strained = set(self._strained(base)) | ({PLAY} if self.problem.struck else set())
        order = [
            name
            for k, name in enumerate(order)
            if k < ALWAYS or name in strained or (k < refitted and promised[name].evidence > HOPELESS)
            or self._worth(near, promised[name]) > 0.0
        ]  # fmt: skip
        order = [name for name in order if (name,) not in self.fits]
        for k, name in enumerate(order):
            if k >= ALWAYS and self._hopeless(promised[name].gain, name):
                continue
            self._tell(Progress(Stage.SEARCH, Task.SINGLE, k + 1, len(order), (name,)))
            self._try((name,), lambda promise=promised[name]: self._fit_with(near, promise))  # type: ignore[misc]
            if (found := self.found.get((name,))) is not None:
                white, fit = self.problem.errors.whiten(found.residual), self.fits.get((name,))
                before = replace(found, chi2=float(white @ white))
                if fit is None or before.objective < fit.objective or self._better(before, fit):
                    self._try((name,), lambda found=found: self._again(found))  # type: ignore[misc]
        if np.any(near.z != base.z):
            self._from_base(base, [n for n in order[:FEW] if not self._hopeless(promised[n].gain, n)])
        self._in_place(base)
        self._step_play()
        self._finish(base, [(name,) for name in order])

    def _step_play(self, size: int = 1) -> None:
        """The fits of a play and so many effects in all, the LEADERS best, continued from the best point that steps of
        the play's values lead to: of the best fit from all that are tried of them, of the others also from there, for
        beside another cause they may lie elsewhere."""
        tried = {names: fit.objective for names, fit in self.fits.items() if len(names) == size}
        played = sorted((names for names in tried if PLAY in names), key=lambda names: tried[names])
        # One that nobody hears, and that is not the best: its steps are not worth their time.
        if not played or (not self.problem.struck and tried[played[0]] > min(tried.values())):
            return
        for names in played[:LEADERS]:
            for _ in range(ROUNDS_OF_PLAY if size == 1 else 1):
                fit, still, best = self.fits[names], self._still.get(names), self.fits[played[0]]
                if fit is still:
                    break
                first, self._still[names] = names == played[0] and still is None, fit
                also = [] if fit is best else [best.setting]
                z = stepped(self.problem, fit, PLAY, self.count, also, everywhere=first)
                if np.any(z != fit.z):
                    self._try(names, lambda fit=fit, z=z: self._again(replace(fit, z=z)))  # type: ignore[misc]

    def _hopeless(self, promise: float, name: str) -> bool:
        """Whether the best single effect so far explains so much, beyond what may be model error, that one with this
        linear promise cannot compete.

        One that the base fit has in part, as its nuisance, may gain much more than what it promises beside that. A play
        whose impacts are heard is never: without one nothing is worth anything beside them.
        """
        if name == PLAY and self.problem.struck:
            return False
        base, alone = self.base_fit(), [fit for names, fit in self.fits.items() if len(names) == 1]
        gains = [beyond_model_error(self.problem, base, fit, base.objective - fit.objective) for fit in alone]
        most = promise + IN_PART * self._strained(base).get(name, 0.0) + SLACK
        return most < OUT_OF_REACH * max(gains, default=0.0)

    def _from_base(self, base: Fitted, names: Sequence[str]) -> None:
        """Fits started from the unrestricted base fit too, where that promises more than the fit so far: the first one
        may have stopped in a local minimum."""
        known = {**self.effects, **self.rivals}
        signatures = self._signatures([known[name] for name in names], base)
        for name, promise in self._promised(base, signatures).items():
            fit = self.fits.get((name,))
            if fit is None or base.objective - fit.objective < 0.8 * promise.gain:
                self._try((name,), lambda e=promise: self._fit_with(base, e))  # type: ignore[misc]

    def _in_place(self, at: Fitted) -> None:
        """An effect in place of its nuisance, where a fit has taken that far beyond its tolerance; a delay in place of
        the log's timing. That fit has the effect's values already, and nothing is left for a linear estimate."""
        strained = set(self._strained(at)) & set(self.effects) - set(at.effects)
        strained = {name for name in strained if at.effects or not self._hopeless(0.0, name)}
        late = self.base.get(LOG_TIMING)
        if late is not None and float(at.z[self._place_of(late)][0]) > TOLERANCES * late.std:
            strained |= {e.id for e in self.effects.values() for r in self._ranges(e) if r.symbol == self.problem.late}
        for name in (name for name in strained if self._new_to(at.effects, name)):
            ranges, values = self._ranges(self.effects[name]), dict(at.setting)
            own = [one for key, one in self.nuisances.items() if key.partition(".")[0] == name]
            if not own:
                own = [self.base[LOG_TIMING]]
                values[self.problem.late] = values[LOG_TIMING]
            if any(r.symbol not in values for r in ranges):
                continue
            more, amount = effect_parameters(self.effects[name], ranges, {r.symbol: values[r.symbol] for r in ranges})
            z = np.concatenate([at.z, amount])
            for parameter in own:
                z[self._place_of(parameter)] = 0.0
            names, free = tuple(sorted((*at.effects, name))), [*at.free, *more]
            most = FIRST_ROUND if at.effects and names in self.fits else LAST_ROUND
            self._try(names, lambda n=(*at.effects, name), free=free, z=z, m=most: self._fit(n, free, z, m))  # type: ignore[misc]

    def _finish(self, base: Fitted, tried: Sequence[Names], reach: float = IN_REACH) -> None:
        """Continue to convergence the fits close to the best, and those whose linear estimate exceeds it."""
        done = {names: self.fits[names] for names in tried if names in self.fits}
        best = max((base.objective - fit.objective for fit in done.values()), default=0.0)
        for names, fit in done.items():
            gain = base.objective - fit.objective
            parts = [self.fits[part] for part in combinations(names, len(names) - 1) if part in self.fits]
            if any(part.objective < fit.objective for part in parts):
                continue  # it does not lead to where one effect less already is
            if not fit.settled and gain >= (OUT_OF_REACH if self.linear.get(names, 0.0) > best else reach) * best:
                self._try(names, lambda f=fit: self._again(f))  # type: ignore[misc]

    def _offer_standstill(self, base: Fitted) -> None:
        """Restart the fits close to the best from its values of friction near standstill, where their slopes promise
        that another minimum may lie there that competes.

        That friction has several local minima. Without this a fit could win by its starting point alone.
        """
        if not self.fits:
            return
        donor = min(self.fits.values(), key=lambda fit: fit.objective)
        turns = np.array([k.logarithmic for k in self.held for _ in k.lowest], dtype=bool)
        best = base.objective - donor.objective
        for names, fit in list(self.fits.items()):
            apart = np.abs(fit.z[: self.count] - donor.z[: self.count])[turns]
            if base.objective - fit.objective < PAIR_IN_REACH * best or not np.any(apart > STUCK):
                continue
            begun = donor.z[: self.count][turns]
            tried = self._offered.setdefault((self.problem, names), [])
            if any(np.all(np.abs(begun - other) <= STUCK) for other in tried):
                continue
            tried.append(begun)
            z = fit.z.copy()
            z[: self.count][turns] = begun
            beside, objective = self._promised_at(fit, z)
            more = cost(self.problem, len(donor.z) - len(fit.z))  # what the donor's further parameters have to earn
            if objective < min(fit.objective, donor.objective + more) + SLACK:
                self._try(names, lambda f=fit, z=beside: self._again(replace(f, z=z)))  # type: ignore[misc]

    def _promised_at(self, fit: Fitted, z: Array) -> tuple[Array, float]:
        """z with the fit's other parameters refitted to how friction turns over there, as far as its slopes tell, and
        the objective that they promise."""
        moved = self.problem.residuals([setting_of(fit.free, z)])[0]
        if not np.all(np.isfinite(moved)):
            return z, math.inf
        beside = self._aside(replace(fit, z=z, residual=moved), np.zeros(len(moved)))
        white = self.problem.errors.whiten(moved + fit.jacobian @ (beside - z))
        return beside, float(white @ white + np.sum((beside / bounds_of(fit.free)[2]) ** 2))

    def _extend(self, result: SearchResult, size: int, least: float) -> None:
        """The leading hypotheses of `size` effects, extended by the further effects that promise evidence, and `least`
        of what a leader leaves."""
        weighed = self._nameable(result)
        leaders = [w for w in weighed if len(w.names) == size and w.evidence >= LEADS * weighed[0].evidence > 0.0]
        ways: dict[Names, list[_Way]] = {}
        for k, w in enumerate(leaders[:LEADERS]):
            leader = w.fit
            self._tell(Progress(Stage.SEARCH, Task.PAIRS, k + 1, len(leaders[:LEADERS]), w.names))
            inexactly = inexact(self.problem, w, self.count)
            added = [
                (self._worth(leader, promise, inexactly), promise)
                for promise in self._further(leader)
                if promise.evidence > 0.0 and promise.gain > least * leader.chi2
            ]
            for worth, promise in sorted(added, key=lambda one: -one[0])[:PARTNERS]:
                if worth > price(self.problem.active.kind) - SLACK:
                    way = _Way(w.evidence + worth, result.gain(w.names) + promise.gain, leader, promise)
                    ways.setdefault(tuple(sorted((*w.names, promise.signature.effect.id))), []).append(way)
        for names in sorted(ways, key=lambda names: -max(way.worth for way in ways[names]))[:EXTENDED_REFITTED]:
            self.linear[names] = max(way.gain for way in ways[names])
            # A promise is linear, and may not be kept: the way from the better hypothesis is tried first.
            for way in sorted(ways[names], key=lambda way: way.leader.objective):
                fit = self.fits.get(names)
                if fit is None or fit.objective > way.leader.objective:
                    self._try(names, lambda w=way: self._fit_with(w.leader, w.promise))  # type: ignore[misc]
        for w in leaders[:LEADERS]:
            self._in_place(w.fit)

    def _further(self, leader: Fitted) -> Iterable[Promise]:
        """What each further effect promises beside a leading hypothesis, kept for the next pass."""
        if (self.problem, leader) not in self._promises:
            new = [effect for effect in self.effects.values() if self._new_to(leader.effects, effect.id)]
            self._promises[self.problem, leader] = self._promised(leader, self._signatures(new, leader)).values()
        return self._promises[self.problem, leader]

    def weighed(self, result: SearchResult) -> tuple[Weighed, ...]:
        """All fits so far, as the verdict weighs them."""
        return weigh(self.problem, result.base, result.within_tolerances, self.fits, self.rivals)

    def leading(self, result: SearchResult) -> Weighed | None:
        """The listed hypothesis with most evidence so far."""
        return next(iter(self._nameable(result)), None)

    def _nameable(self, result: SearchResult) -> list[Weighed]:
        """The listed hypotheses so far; none that only smooths the prediction, which nobody names."""
        return [w for w in self.weighed(result) if not w.rival and not smooths(self.problem, w.fit)]

    def _fit_simpler_laws(self, result: SearchResult, size: int) -> None:
        """Refit the leading hypotheses of `size` effects with the simpler law in the place of each freer one."""
        own, count = len(self.held), self.count
        for w in [w for w in self._nameable(result)[:LEADERS] if len(w.names) == size]:
            for freer, simpler in product(w.names, self.effects):
                names = tuple(sorted({*w.names, simpler} - {freer}))
                alone, known = self.fits.get((simpler,)), self.fits.get(names)
                if alone is None or not same_but_freer(freer, simpler, self.problem.active.kind):
                    continue
                # One that is decisively worse than the freer law may be at a poorer minimum.
                if known is not None and score_of(self.problem, known).value < w.score.value + settings.DECISIVE:
                    continue
                order = (*(name for name in w.fit.effects if name != freer), simpler)
                stays, kept = parameters_of(w.fit, order, count)
                free = [*w.fit.free[:own], *stays, *alone.free[own:]]
                # Where the freer law is, and where the simpler one is alone.
                for begin in (w.fit.z, alone.z) if known is None else (w.fit.z,):
                    if known is None and names in self.fits and self.fits[names].objective < alone.objective:
                        break  # it leads to where one effect less is, or further
                    z = np.concatenate([begin[:count], kept, alone.z[count:]])
                    self._try(names, lambda order=order, free=free, z=z: self._fit(order, free, z))  # type: ignore[misc]

    def _drop(self, base: Fitted) -> None:
        """Refit each effect of the leading pair alone, started from the pair: a pair needs both effects to earn their
        cost, and a single one that was never fitted is no rival (an offset was named as a carriage's mass, at 0.99)."""
        pair: Names = min((n for n in self.fits if len(n) == 2), key=lambda n: self.fits[n].objective, default=())
        if any(fit.objective < self.fits[pair].objective for names, fit in self.fits.items() if len(names) < len(pair)):
            return  # fewer effects explain more
        for left in pair:
            self._try((left,), lambda n=left: self._without(self.fits[pair], (n,)))  # type: ignore[misc]
        self._finish(base, [(left,) for left in pair])

    def _joint(self, result: SearchResult, least: float) -> None:
        """Pairs of effects that promise more together than the best single effect, and `least` of what it leaves,
        though neither leads alone."""
        near = replace(result.within_tolerances, free=result.base.free)
        alone = [fit.objective for names, fit in self.fits.items() if len(names) == 1 and names[0] in self.effects]
        best = near.objective - min(alone, default=near.objective)  # taken off by the best alone, from the same point
        enough = best + least * (near.objective - best)
        projection = Projection.of(self.problem, near)
        kept: dict[str, list[tuple[float, Signature]]] = {}
        mine = [one for one in result.signatures if one.effect.id in self.effects]
        for one, (data, prior, _) in zip(mine, projection.gains(mine), strict=True):
            kept.setdefault(one.effect.id, []).append((data + prior, one))
        shapes = [q for name in sorted(kept) for _, q in sorted(kept[name], key=lambda q: -q[0])[:SHAPES_KEPT]]
        pairs: dict[Names, tuple[Promise, Promise]] = {}
        if not shapes:
            return
        columns = projection.clean(np.hstack([one.columns for one in shapes]))
        gram, pull = columns.T @ columns, columns.T @ projection.residual
        places = np.split(np.arange(len(pull)), np.cumsum([one.columns.shape[1] for one in shapes[:-1]]))
        for (a, left), (b, right) in combinations(zip(shapes, places, strict=True), 2):
            names = (a.effect.id, b.effect.id)
            if not self._new_to(names[:1], names[1]) or names in self.fits:
                continue
            both = np.concatenate([left, right])
            gain, amounts = gain_of(gram[np.ix_(both, both)], pull[both], [*columns_signed(a), *columns_signed(b)])
            self.linear[names] = max(gain, self.linear.get(names, 0.0))
            worth = gain - cost(self.problem, len(both))
            if gain > enough and (names not in pairs or worth > pairs[names][0].evidence):
                first, second = np.split(amounts, [len(left)])
                pairs[names] = (Promise(gain, gain, worth, a, first), Promise(gain, gain, worth, b, second))
        for pair, promises in sorted(pairs.items(), key=lambda q: -q[1][0].evidence)[:PARTNERS]:
            self._try(pair, lambda promises=promises: self._fit_with(near, *promises))  # type: ignore[misc]


def _left_by(w: Weighed) -> Sizes:
    """The sizes of the model error that a hypothesis leaves, as a whole no less than the default."""
    size, standstill = w.score.sizes
    return max(size, 1.0), max(min(size, 1.0) * standstill, 1.0)
