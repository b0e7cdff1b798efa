"""The verdict: a named cause, no gap, or a cause that no library entry explains; with probabilities.

Every hypothesis has its evidence: by how much its score is better than that of no effect, less what its parameters cost
(`hypotheses/evidence.py`). A cause is named where its law holds (`constancy.py`), whatever else is left. How evidence
becomes probabilities: `answer.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.special import chdtri, ndtri

from workbench.core.run import Array
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.evidence import (
    MOST,
    Weighed,
    advantage,
    inexact,
    is_lag,
    lag_explains,
    model_error_rms,
    only_mends,
    own_energy,
    price,
    same_but_freer,
    smooths,
    weigh,
)
from workbench.diagnose.hypotheses.fit import (
    BREAKDOWNS,
    Fitted,
    estimates,
    fit_hypothesis,
    is_timing,
    parameters_of,
    unweighed,
)
from workbench.diagnose.hypotheses.free_parameters import Names, Scalar, bounds_of, nuisance_std, within
from workbench.diagnose.hypotheses.held_out import (
    folds_by_motion,
    folds_by_run,
    foretold,
    held_out,
    significance,
    weighed_both_ways,
)
from workbench.diagnose.hypotheses.problem import Found, Problem, once
from workbench.diagnose.hypotheses.search import SearchResult
from workbench.diagnose.verdict.answer import (
    Hypothesis,
    Left,
    Reason,
    ReasonKind,
    Step,
    VerdictWord,
    none_missed,
    rank,
)
from workbench.diagnose.verdict.constancy import Constancy, constancies
from workbench.diagnose.verdict.free_law import worth
from workbench.diagnose.verdict.unknown_cause import (
    beyond_noise,
    cancellation,
    kept_percent,
    own_percent,
    signs_of,
    stays_beside,
    stretched,
)
from workbench.effects import ranges_of
from workbench.machines import kind_of
from workbench.simulate.motion import PLAY, audible

# What speaks against a fit that is none of its law.
OTHER, LATE, NOTHING, BOUND, IMPACTS = "the other effect", "a late motion", "residual", "a bound", "impacts"
AGAINST = {
    OTHER: ReasonKind.UNDO_EACH_OTHER,
    LATE: ReasonKind.ONLY_SMOOTHER,
    NOTHING: ReasonKind.TAKES_NOTHING,
    BOUND: ReasonKind.ON_A_BOUND,
    IMPACTS: ReasonKind.NO_IMPACTS,
}


@dataclass(frozen=True)
class Judged:
    """word, names: the answer. best: the best named hypothesis, also where it is not the answer.

    held: the fit that the answer was judged on. left: what it leaves. signs: of an unknown cause.
    stands: whether best is established, and the answer judged on it. counted: the evidence as it was ranked. groups: of
    hypotheses that differ in name only. mimics: those that were not established, with what speaks against each.
    barred: those that were asked and are not to be named, weighed is without them; bars: why (`bar`).
    """

    word: VerdictWord
    names: Names
    ranking: tuple[Hypothesis, ...]
    weighed: tuple[Weighed, ...]
    best: Weighed | None
    held: Fitted
    left: Left
    signs: Mapping[str, float]
    reasons: tuple[Reason, ...]
    counted: tuple[tuple[Names, float], ...]
    stands: bool
    groups: tuple[tuple[Names, ...], ...] = ()
    mimics: Mapping[Names, Constancy] = field(default_factory=dict)
    barred: tuple[Weighed, ...] = ()
    bars: Mapping[Names, str] = field(default_factory=dict)


def judge(search: SearchResult, barred: Collection[Names] = ()) -> Judged:
    """The answer, and the ranking of every hypothesis weighed; probabilities sum to 1.

    A cause is named where it is established, whatever else is left. barred: hypotheses that are not to be named,
    whatever their evidence.
    """
    problem, near = search.problem, search.within_tolerances
    if problem.struck and (idle_play(problem, near, search.fits) or lag_explains(problem, near, search.fits)):
        problem = once(problem, "without impacts", problem.without_impacts)
        search = replace(search, problem=problem)
    weighed = weigh(problem, search.base, near, search.fits, search.rivals)
    every = {w.names: w.evidence for w in weighed}
    weighed = tuple(w for w in weighed if w.names not in barred)
    best, mimics = established(problem, weighed, search.base, near, every)
    rival, said = unlisted(problem, near, weighed, best)
    numbers, its_price = settings.calibration(), price(problem.active.kind)
    least = max(settings.THRESHOLD, -math.inf if best is None else best.evidence)
    # A mimic has no evidence, unless a law of one variable does without it, and leaves base values where they are: then
    # its evidence is that law's, which as a freer one has to be better by the threshold to be as likely.
    laws = [w for w in weighed if w.names in mimics and mimics[w.names].free]
    free = {w.names for w in laws if stretched(problem, w.fit)["prior"] <= 1.0}
    counted = tuple(
        ((), w.evidence - settings.THRESHOLD)
        if w.names in free
        else (w.names, min(w.evidence, 0.0) if w.names in mimics else w.evidence)
        for w in weighed
        if not w.rival
    ) + (() if rival is None else (((), said),))
    groups = groups_of(problem, [w for w in weighed if not w.rival and w.names not in mimics])
    floor, kept = floor_of(problem), kept_percent(problem)
    held, after = near, near if best is None else best.fit
    taken = beyond_noise(problem, near.rms(problem.inputs), after.rms(problem.inputs)).percent_of_input
    # What takes less than the log itself hides imitates that.
    stands = best is not None and best.evidence > settings.THRESHOLD and taken >= kept
    signs: dict[str, float] = {}  # what an established cause leaves is a remainder, where it takes more
    if best is not None and stands:
        left = beyond_noise(problem, best.fit.rms(problem.inputs), floor)
        signs = stays_beside(problem, search.base, best.fit, left)
        # What brings a true lag's base values back may leave some off, and puts none further off than they were.
        further = best.fit.prior > search.base.prior + settings.NUISANCE**2
        lags = any(is_lag(problem, name) for name in best.names) and not further
        inexact = rebounds(problem, best.names) or lags
        if not inexact or share_of(problem, near, best.fit) < settings.MINOR:
            # A first search weighs by no model error of its own, and rebounds stretch one fit of a play: the least.
            count, posed = len(search.base.z), [(problem, best.fit)]
            if best.score.sizes != problem.errors.sizes:
                own = problem.with_model_error(best.score.sizes)
                posed.append((own, reweighed(own, best.fit, count)))
            own_laws = [prior.effect for prior in kind_of(problem.machine).nuisances if not prior.fitted]
            with_own = [tuple(sorted({*best.names, name})) for name in own_laws]  # these may bend them, too
            posed += [(problem, search.fits[names]) for names in with_own if names in search.fits]
            # So may a further cause that is as likely as none.
            beside = [w for w in weighed if not w.rival and {*w.names} > {*best.names} and w.names not in mimics]
            posed += [(problem, w.fit) for w in beside if w.evidence > best.evidence - settings.THRESHOLD]
            fits = [(p, one) for p, fit in posed for one in weighed_both_ways(p, fit, count)]
            if kind_of(problem.machine).floor == "own":  # what it leaves hangs together, and bends one of both
                fits += [(p, unweighed(p, one)) for p, one in fits]
            ways = [stretched(*one) for one in fits]
            signs |= min(ways, key=lambda sign: sign["prior"])
        rows = rank(counted, signs, numbers, its_price, groups)
        held, stands = (best.fit, True) if rows[0].verdict != "no_gap" else (near, False)
    left = beyond_noise(problem, held.rms(problem.inputs), floor)
    if not stands:  # nor is no gap what leaves much
        signs = once(problem, (near, left, "signs"), lambda: signs_of(problem, near, left))
        rows = rank(counted, signs, numbers, its_price, groups)
    if rows[0].verdict == "unknown" and kind_of(problem.machine).floor == "sensors":
        rows = rank(counted, signs, none_missed(signs, stands, numbers), its_price, groups)
    return Judged(
        word=rows[0].verdict,
        names=rows[0].effects,
        ranking=rows,
        weighed=weighed,
        best=best,
        held=held,
        left=left,
        signs=signs,
        reasons=_reasons(
            signs if not stands or rows[0].verdict == "unknown" else {},
            best.names if stands and best is not None else (),
            rival if said > least else None,
            next((w.names for w in weighed if not w.rival), ()),
            mimics,
            kept if kept > settings.HALF * own_percent(problem) else 0.0,
        ),
        counted=counted,
        stands=stands,
        groups=groups,
        mimics=mimics,
    )


def idle_play(problem: Problem, near: Fitted, fits: Mapping[Names, Fitted]) -> bool:
    """Whether a play alone takes nothing, or less than HALF of what another effect does, or leaves so much that this
    one leaves FORETOLD of it, and no pair with it explains more than that one: beyond chance, and on a machine that
    leaves more than its own model error beyond what a law may be off, LAW of what it takes, rms. Then no play makes the
    impacts. Of a small one beside others these may be nearly all that tells."""
    play = fits.get((PLAY,))
    if play is None:
        return False
    if _idle(problem, near, play):
        return True
    others = [fit for names, fit in fits.items() if len(names) == 1 and PLAY not in names]
    lead = min((fit.objective for fit in others), default=near.objective)
    pair = min((f.objective for names, f in fits.items() if len(names) == 2 and PLAY in names), default=math.inf)
    minor = near.objective - play.objective < settings.HALF * (near.objective - lead)
    minor |= lead < settings.FORETOLD * play.objective
    law = settings.LAW**2 * (near.objective - lead) if max(problem.errors.sizes) > 1.0 else 0.0
    return minor and pair > lead - max(settings.THRESHOLD, law)


def _idle(problem: Problem, near: Fitted, fit: Fitted) -> bool:
    """Whether a fit takes as little of the gap as chance does (`takes_nothing`), and of what is weighed."""
    return fit.chi2 > (1.0 - settings.FORETOLD) * near.chi2 and takes_nothing(problem, near, fit)


def unlisted(
    problem: Problem, near: Fitted, weighed: Sequence[Weighed], best: Weighed | None
) -> tuple[Weighed | None, float]:
    """The unlisted effect that says most, and its evidence: that of the best listed hypothesis, and by how much it is
    better beyond what that one's law may be off, LAW of what it explains, rms. More effects than one, which bend to
    what that one has, may be off nothing. As a freer law it has to be better by the threshold to be as likely."""
    rivals, least = [w for w in weighed if w.rival], settings.THRESHOLD
    if best is None or not rivals:
        return (rivals[0], rivals[0].evidence - least) if rivals else (None, 0.0)
    play = inexact(problem, best, len(near.z))
    law = max(settings.LAW**2 * own_energy(problem, best, best.names, len(near.z)), play)
    better = [advantage(w, best, law if len(w.names) >= len(best.names) else play) for w in rivals]
    first = int(np.argmax(better))
    return rivals[first], best.evidence + better[first] - least


def judged_to_help(search: SearchResult) -> Judged:
    """The verdict. A cause is not named if held-out runs and tolerances speak against it, nor beside others if what it
    gains there is not significant, nor what only adds to such a one an effect that is worth nothing; nor does such a
    one speak for an unknown cause, but by the tolerances that it relieves."""
    barred, deserving, not_told, bars = list[Names](), set[Names](), list[Weighed](), dict[Names, str]()
    while True:
        judged = judge(search, barred)
        standing = judged.best.names if judged.best is not None and judged.stands else next(iter(judged.mimics), ())
        # A single mimic stays: what is about as good imitates the same cause. The parts of several may be one.
        asked = {judged.names, standing if judged.stands or len(standing) > 1 else ()} - {()} - deserving
        bars |= {w.names: why for w in judged.weighed if w.names in asked and (why := bar(search, w))}
        idle = [w for w in judged.weighed if w.names in asked and w.names in bars]
        if not idle:
            most = max(not_told, key=lambda w: w.evidence, default=None)
            told = judged.reasons
            if judged.word != "named" and most is not None and most.evidence > settings.DECISIVE:
                told += (Reason(ReasonKind.BARRED, effects=most.names, value=most.evidence, over=bars[most.names]),)
            return replace(judged, barred=tuple(not_told), bars=bars, reasons=told)
        not_told += idle
        deserving |= asked.difference(w.names for w in idle)
        barred += [
            w.names
            for w in judged.weighed
            if any({*w.names} >= {*less.names} and w.evidence <= less.evidence for less in idle)
        ]


def beside_own_law(search: SearchResult, again: Callable[[Fitted], SearchResult]) -> tuple[SearchResult, Judged]:
    """A search and its verdict (`judged_to_help`), or those of another one beside a law that is taken for the machine's
    own: an unlisted effect that explains more than any listed one, beside which one may hide, in the residual or in
    base values. The other one counts where it names a cause decisively, and both together explain the runs: nothing
    relevant is left, and no base value is off nominal. again: a search for one cause beside such a law's fit."""
    judged = judged_to_help(search)
    laws = [reason.effects for reason in judged.reasons if reason.kind is ReasonKind.UNLISTED_EXPLAINS_MORE]
    if judged.word != "unknown" or not laws or len(laws[0]) > 1:
        return search, judged
    beside = again(search.fits[laws[0]])
    found = judged_to_help(beside)
    if found.word != "named" or found.best is None or found.best.evidence < settings.DECISIVE:
        return search, judged
    whole = not found.left.relevant and stretched(beside.problem, found.best.fit)["prior"] <= 1.0
    return (beside, found) if whole else (search, judged)


def bar(search: SearchResult, w: Weighed) -> str:
    """Why a hypothesis is not to be named, "" where nothing bars it. What may be named predicts held-out runs and the
    tolerances significantly better than its effects' absence does, and the runs by themselves not significantly worse,
    nor all in all (`twice_as_much`); or a play the input, fitted by plain least squares (`weighed_both_ways`), or as it
    is, and better at all, where impacts tell of it; and with each one of several than without it, at SIGNIFICANT for
    all that they were chosen from, and better than with a free law of one variable in its place (`worth`), a play that
    a log is too coarse to hear by what impacts would say; a play that impacts tell of, which is chosen from none, not
    significantly worse than without it, for its flights are short and their ends foretold by no law. A delay beside
    others has to take something, too, of what the log's timing leaves (`takes_nothing`): a machine's own lags may be
    some sampling steps; and what every machine has, MINOR of what the others leave on held-out runs, and on parts of a
    motion that all repeat; a ripple, which no base value holds, as much as then stays. No amount may as well be none
    (`may_be_none`)."""
    problem, base, near = search.problem, search.base, search.within_tolerances
    less = []
    for name in w.names if len(w.names) > 1 else ():  # what takes no refit to folds is asked first
        less.append(without(search, w.fit, name))
        if only_late(problem, less[-1], w.fit, name, len(base.z)):
            return f"a log that is as late as it may be takes as much without {name}"
        played = name == PLAY and rebounds(problem, (PLAY,))  # its impacts are heard, or a log is too coarse for them
        more = settings.IMPACTS if played else 0.0
        if not (played and problem.struck):
            evidence, variable = worth(problem, base, w, less[-1])
            if evidence <= more:
                return f"a free law of the {variable} does without {name}"
    unfitted = {prior.effect for prior in kind_of(problem.machine).nuisances if not prior.fitted}
    for name, rest in zip(w.names, less or [near], strict=True):  # so little of what every machine has is its own
        if not nuisance_std(problem.machine, problem.runs, name):
            continue
        ways = [None, folds_by_run(problem), folds_by_motion(problem)]
        for folds in ways if name in unfitted else ways[1:]:
            both = [fit if folds is None else held_out(problem, fit, folds) for fit in (w.fit, rest)]
            least = settings.HALF if folds is None else settings.MINOR
            stays, gap = (max(one.rms(problem.inputs) ** 2 - problem.noise**2, 0.0) for one in both)
            if stays > (1.0 - least) * gap:
                return f"so little of {name} may be the machine's own"
    by_chance = -float(ndtri(settings.SIGNIFICANT))

    def told(before: Fitted, least: float) -> bool:  # what takes a fit of its own is asked last
        _, *ways = weighed_both_ways(problem, w.fit, len(base.z))
        ways += [w.fit] if ways and problem.struck else []
        both = ((held_out(problem, one, folds_by_run(problem)) for one in (before, after)) for after in ways)
        return any(foretold(problem, *two) > least for two in both)

    asked = ((False, by_chance), (True, -by_chance))
    alone = (significance(problem, near, w.fit, by_runs_alone=by_runs) > enough for by_runs, enough in asked)
    heard = problem.struck and PLAY in w.names  # its impacts tell of it
    if not (all(alone) or told(near, 0.0 if heard else by_chance)):
        return "left-out runs and tolerances are not foretold better with it, beyond chance"
    if not heard and twice_as_much(problem, near, w.fit):
        return "left-out runs keep twice the energy with it"
    least = float(-ndtri(settings.SIGNIFICANT / len({name for known in search.fits for name in known})))
    enough = all(
        significance(problem, rest, w.fit) > least
        or (problem.struck and PLAY not in rest.effects and told(rest, -by_chance))
        for rest in sorted(less, key=lambda rest: rest.objective)
    )
    if not enough:
        return "left-out runs and tolerances are foretold as well without one of its effects"
    return "its amounts may as well be zero" if may_be_none(problem, w.fit, least) else ""


def twice_as_much(problem: Problem, near: Fitted, fit: Fitted) -> bool:
    """Whether held-out runs keep twice the energy of the input's residual with an effect: row by row it may be no worse
    (`significance`), and where friction turns over by far."""
    before, after = (held_out(problem, one, folds_by_run(problem)).rms(problem.inputs) for one in (near, fit))
    return settings.HALF * after**2 > before**2


def only_late(problem: Problem, less: Fitted, fit: Fitted, name: str, base: int) -> bool:
    """Whether an effect of several is a delay that takes nothing (`takes_nothing`) of what the fit without it leaves,
    the log's timing within NUISANCE deviations. base: how many of its z are the base parameters'."""
    if problem.late not in {r.symbol for r in ranges_of(problem.effect(name), problem.machine, problem.runs)}:
        return False
    free = [within(k, settings.NUISANCE * k.std) if isinstance(k, Scalar) and is_timing(k) else k for k in less.free]
    return takes_nothing(problem, fit_hypothesis(problem, less.effects, free, less.z, base=base), fit)


def without(search: SearchResult, fit: Fitted, name: str) -> Fitted:
    """A fit with one effect less: that of the search, or refitted from the values beside the effect."""
    rest = tuple(other for other in fit.effects if other != name)
    known = search.fits.get(tuple(sorted(rest)))
    if known is not None:
        return known
    count = len(search.base.z)
    stays, z = parameters_of(fit, rest, count)
    free = [*fit.free[: len(search.base.free)], *stays]
    return fit_hypothesis(search.problem, rest, free, np.concatenate([fit.z[:count], z]), base=count)


def established(
    problem: Problem, weighed: Sequence[Weighed], base: Fitted, near: Fitted, every: Mapping[Names, float]
) -> tuple[Weighed | None, Mapping[Names, Constancy]]:
    """The best hypothesis all of whose effects hold as laws (`constancies`) and that a free law of one variable cannot
    do without (`free_law`), None if there is none; and the hypotheses above the threshold that are not established,
    each with what speaks against it.

    base, near: the fits without effects, the latter within the tolerances. A hypothesis that leaves more than `near`,
    by more than chance, whose effects undo each other, or that sits on a bound is not established either: the next with
    HALF of the evidence is looked at. Behind a mimic only what it is made of is, for whatever else is about as good
    imitates the same cause; but for what adds to it, where a free law does without it. every: evidence of all.
    """
    mimics: dict[Names, Constancy] = {}

    def asked(find: Callable[..., Found], w: Weighed, *given: Any) -> Found:
        """Once of each fit, whatever else is barred."""
        return once(problem, (find, w.names, *given), lambda: find(problem, *given))

    listed = [w for w in weighed if not w.rival]
    able = [w for w in listed if w.evidence > settings.THRESHOLD]
    objections = {w.names: asked(_against, w, w, near) for w in able}
    no_laws = {names: why for names, why in objections.items() if why is not None}
    laws = [w for w in able if w.names not in no_laws]
    imitated, passed, lead = False, list[Names](), laws[0].evidence if laws else 0.0
    for w in laws:
        part = any(set(w.names) < set(names) for names in mimics) and w.evidence > settings.HALF * lead
        as_good = not imitated and w.evidence > min(lead - settings.DECISIVE, settings.HALF * lead)
        if not (part or as_good or _adds_to_free_laws(w, mimics, every)):
            passed.append(w.names)
            continue
        held = asked(constancies, w, base, near, w.fit)
        why = next((one for one in held if one.broken), None)
        if why is None:
            evidence, variable = asked(_worth_both_ways, w, base, w)
            # A play that is heard has its impacts beside that; of several effects, one that is not is asked of beside
            # the others (`bar`).
            unheard = rebounds(problem, w.names) and not problem.struck and len(w.names) == 1
            if evidence > (settings.IMPACTS if unheard else 0.0) or _explains_all(problem, base, w):
                return w, {names: next(iter(mimics.values())) for names in passed} | mimics | no_laws
            why = Constancy(w.names[-1], variable, 0.0, free=True)
        # Beside what leaves base values far off, the next about as good may bring them back: it imitates nothing.
        imitated = imitated or stretched(problem, w.fit)["prior"] <= 1.0
        mimics[w.names] = why
    mimics = {**mimics, **no_laws}
    if able:  # none holds: what was not looked at is no better
        return None, {w.names: mimics.get(w.names, next(iter(mimics.values()))) for w in able}
    return next(iter(listed), None), mimics


def _explains_all(problem: Problem, base: Fitted, w: Weighed) -> bool:
    """Whether a single cause, no play, leaves less than FORETOLD of what base values as far as they go do, rms, and
    these where they were: no law that it merely imitates does, and one of few ramps' time may be all of any cause."""
    whole = PLAY not in w.names and len(w.names) == 1 and w.fit.chi2 < settings.FORETOLD**2 * base.chi2
    return whole and stretched(problem, w.fit)["prior"] <= 1.0


def _worth_both_ways(problem: Problem, base: Fitted, w: Weighed) -> tuple[float, str]:
    """`worth`, of a play that is heard by plain least squares too where it is worth nothing whitened: samples beside
    its impacts, which no law of one variable foretells, weigh next to nothing there (`weighed_both_ways`)."""
    found = worth(problem, base, w)
    if found[0] > 0.0 or not problem.struck:
        return found
    for one in weighed_both_ways(problem, w.fit, len(base.z)):
        if one.errors is not None:
            plain = replace(w, fit=one, score=replace(w.score, sizes=one.errors.sizes))
            found = max(found, worth(problem.weighed_by(one.errors), base, plain), key=lambda way: way[0])
    return found


def _adds_to_free_laws(w: Weighed, mimics: Mapping[Names, Constancy], every: Mapping[Names, float]) -> bool:
    """Whether a hypothesis explains something else than what free laws do without: to each of those it adds more than
    HALF of its evidence. every: evidence of all hypotheses."""
    together = [every.get(tuple(sorted({*w.names, *names})), -math.inf) - every.get(names, 0.0) for names in mimics]
    return all(why.free for why in mimics.values()) and min(together, default=-math.inf) > settings.HALF * w.evidence


def reweighed(problem: Problem, fit: Fitted, base: int) -> Fitted:
    """A fit as the problem weighs its samples, refitted; or as it is, where that breaks down."""
    try:
        return fit_hypothesis(problem, fit.effects, fit.free, fit.z, base=base)
    except BREAKDOWNS:
        return fit


def rebounds(problem: Problem, names: Names) -> bool:
    """Whether a hypothesis has a play of an axis whose impacts are heard, or are none that such logs show."""
    bridged = kind_of(problem.machine).bridged_impacts
    return PLAY in names and bridged and (problem.struck or not audible(problem.logged))


def _against(problem: Problem, w: Weighed, near: Fitted) -> Constancy | None:
    """What speaks against a fit, whatever its law."""
    last, more = w.names[-1], w.fit.chi2 / max(near.chi2, 1e-300) - 1.0  # as weighed: near standstill no law is exact
    # Worse: by more than one standard deviation of one value.
    if (w.fit.chi2 - near.chi2 > 1.0 or _idle(problem, near, w.fit)) and not (problem.struck and PLAY in w.names):
        return Constancy(last, NOTHING, more)  # what a play leaves are the rebounds
    undone = cancellation(problem, w.fit, len(near.z))
    # True causes may happen to cancel, as a drift where later runs carry more; what imitates leaves a remainder.
    if undone > -math.log(settings.HALF) and w.score.excess > 1.0:
        return Constancy(last, OTHER, undone)
    if smooths(problem, w.fit):
        return Constancy(last, LATE, 1.0)
    if PLAY in w.names and only_mends(problem, PLAY) and not rebounds(problem, w.names) and more > -settings.HALF:
        return Constancy(PLAY, IMPACTS, more)
    return Constancy(last, BOUND, 1.0) if _on_bound(problem, w, len(near.z)) else None


def may_be_none(problem: Problem, fit: Fitted, least: float) -> bool:
    """Whether all amounts of an effect are within `least` standard errors of where they vanish: what a trade of an
    amount for a time constant leaves open is no cause, whatever both take together. A machine's own slow change of
    friction is one. As narrow as the log can show, a stretch is held at its width. Of a play that is heard impacts
    tell: no standard error of its values is below a third of them."""
    shape = np.repeat([not one.amount for one in fit.free], [one.size for one in fit.free])
    held = shape & (fit.z <= bounds_of(fit.free)[0] + 1e-9)
    for name, values in estimates(problem, replace(fit, jacobian=np.where(held, 0.0, fit.jacobian))).items():
        off = {r.name: r.vanishes_at for r in ranges_of(problem.effect(name), problem.machine, problem.runs)}
        amounts = [(one, at) for one in values if (at := off[one.name]) is not None]
        small = [np.all(np.abs(np.array(one.value) - at) < least * np.array(one.std_error)) for one, at in amounts]
        if amounts and all(small) and not (name == PLAY and problem.struck):
            return True
    return False


def leaves_off(problem: Problem, fit: Fitted, base: int) -> bool:
    """Whether a play leaves base values further off nominal than chance does, whichever way it is fitted: its rebounds
    may bend them, and so does a cause beside it. base: how many of the first z are the base parameters'."""
    if PLAY not in fit.effects or stretched(problem, fit)["prior"] <= 1.0:  # without a fit of its own
        return False
    return min(stretched(problem, one)["prior"] for one in weighed_both_ways(problem, fit, base)) > 1.0


def takes_nothing(problem: Problem, near: Fitted, fit: Fitted) -> bool:
    """Whether a fit takes no more of the gap's energy than chance does, nor brings the machine's known values nearer to
    nominal. The log's timing is no such value: what goes with the speed bends it as it bends a delay."""
    known = np.repeat([not is_timing(one) for one in near.free], [one.size for one in near.free])
    held = known / bounds_of(near.free)[2]
    relieved = float(np.sum((near.z * held) ** 2) - np.sum((fit.z[: len(near.z)] * held) ** 2))
    return relieved < settings.NUISANCE**2 and share_of(problem, near, fit) < settings.FORETOLD


def groups_of(problem: Problem, weighed: Sequence[Weighed]) -> tuple[tuple[Names, ...], ...]:
    """Groups of two and more hypotheses that differ in name only: they predict the same input, at base parameters that
    are as likely, with as many parameters. Each with its best first; weighed: the best first.

    Such hypotheses are of as many effects, all but one of them the same. Their evidence may differ: of an effect
    that every machine has a little of, that little is taken off it alone.
    """

    def same(one: Weighed, other: Weighed) -> bool:
        if len(one.names) != len(other.names) or len(set(one.names) - set(other.names)) != 1:
            return False
        apart = problem.errors.whiten(one.fit.residual - other.fit.residual)
        as_likely = abs(one.fit.objective - other.fit.objective) < settings.SAME and len(one.fit.z) == len(other.fit.z)
        return as_likely and float(np.sum(apart**2)) < settings.SAME

    groups: list[list[Weighed]] = []
    for hypothesis in weighed:
        if hypothesis.evidence > 0.0:
            group = next((group for group in groups if same(group[0], hypothesis)), None)
            groups.append([hypothesis]) if group is None else group.append(hypothesis)
    return tuple(tuple(one.names for one in group) for group in groups if len(group) > 1)


def floor_of(problem: Problem) -> float:
    """The rms of noise and model error, in the input's unit: what a machine without a gap leaves."""
    return math.hypot(problem.noise, model_error_rms(problem.with_model_error((1.0, 1.0))))


def share_of(problem: Problem, near: Fitted, held: Fitted) -> float:
    """The share of the gap's energy beyond the floor that a fit explains: of the input, or of the dead line's tension
    where that tells more."""
    floor, of_input = problem.errors.sized((1.0, 1.0)).model_error ** 2, np.arange(problem.samples) < problem.inputs
    parts = [(fit.residual**2 - floor - problem.noise**2) for fit in (near, held)]
    both = [[max(float(np.sum(part[rows])), 0.0) for part in parts] for rows in (of_input, ~of_input)]
    return max(1.0 - left / gap if gap > 0.0 else 0.0 for gap, left in both)


def _reasons(
    signs: Mapping[str, float],
    part: Names,
    rival: Weighed | None,
    first: Names,
    mimics: Mapping[Names, Constancy],
    kept: float,
) -> tuple[Reason, ...]:
    """What speaks against a named cause; a sign does from HALF of its odds on. part: an established cause, which leaves
    as much as a part of another one. rival: an unlisted effect that explains more. first: the listed hypothesis with
    most evidence. kept: percent that a log hides, 0 where that is no reason."""
    loud = {name: value for name, value in signs.items() if value**2 > settings.HALF}
    reasons = [Reason(ReasonKind.LOG_KEEPS, percent=kept)] if kept else []
    if rival is not None:
        reasons.append(Reason(ReasonKind.UNLISTED_EXPLAINS_MORE, effects=rival.names))
    if "left" in loud:
        reasons.append(Reason(ReasonKind.LEAVES_MUCH, effects=part))  # by how much is said of held-out runs, in the end
    if "prior" in loud:
        reasons.append(Reason(ReasonKind.STRETCHES_TOLERANCES, effects=part, value=settings.NUISANCE * loud["prior"]))
    if why := mimics.get(first):
        kind = ReasonKind.FREE_LAW if why.free else AGAINST.get(why.over, ReasonKind.VARIES)
        reasons.append(Reason(kind, effects=first, over=why.over.replace("_", " ")))
    return tuple(reasons)


def _on_bound(problem: Problem, w: Weighed, base: int) -> bool:
    """Whether a shape is at its upper bound, where one law turns into another; or an amount there, or a value at a
    lower bound where the effect does not vanish, and the data would carry it further: let go, the others refitted,
    chi^2 falls by g C g, by more than the threshold and what its law may be off (LAW of what it explains, rms), g its
    slope there and C its variance. As narrow as the log can show, a true stretch is on its bound, and the load behind a
    play may be nearly all that moves."""
    (lowest, highest, std), z = bounds_of(w.fit.free), w.fit.z
    rows = problem.errors.sized(w.score.sizes).whiten(np.column_stack([w.fit.jacobian, w.fit.residual]))
    slope, information = rows[:, :-1].T @ rows[:, -1] + z / std**2, rows[:, :-1].T @ rows[:, :-1] + np.diag(std**-2.0)
    gain = slope**2 * np.diag(np.linalg.pinv(information, rcond=1e-12, hermitian=True))
    low, high = (z <= lowest + 1e-9) & (z != 0.0) & (slope > 0.0), z >= highest - 1e-9
    shape = np.repeat([not one.amount for one in w.fit.free], [one.size for one in w.fit.free])
    further = (low | (high & (slope < 0.0))) & (gain > settings.THRESHOLD)
    for name in w.names if np.any(further[base:]) else ():
        mine = parameters_of(w.fit, (name,), base)[0]
        least = settings.THRESHOLD + settings.LAW**2 * own_energy(problem, w, (name,), base)
        further &= (gain > least) | np.repeat([one not in mine for one in w.fit.free], [one.size for one in w.fit.free])
    return bool(np.any(((high & shape) | further)[base:]))


def alternatives(search: SearchResult, judged: Judged, answer: Names | None = None) -> tuple[Names, ...]:
    """Hypotheses that explain the gap about as well as the answer does (`reach`) or differ from it in name only, the
    best first, at base values about as likely. Where the answer needs more model error than the default, its laws are
    inexact, and what an effect takes up of that tells of none: it has to be better by what the law of those that both
    share may be off, too. answer: one that was not given, None for the named one."""
    names = answer or judged.names
    best = next((w for w in judged.weighed if w.names == names), None)
    if best is None or not (answer or judged.word == "named"):
        return ()
    others, problem, count = list[Names](), search.problem, len(search.base.z)
    for w in judged.weighed:
        if w.names == names or w.evidence <= 0.0:
            continue
        both = tuple(name for name in names if name in w.names)
        off = settings.LAW**2 * own_energy(problem, best, both, count) if both and best.score.excess > 1.0 else 0.0
        least = reach(best.fit, w.fit, names, w.names, problem.active.kind, np.array(best.evidence))
        as_good = advantage(best, w, off) < least
        in_name_only = any({names, w.names} <= {*group} for group in judged.groups)
        if (as_good or in_name_only) and w.fit.prior - best.fit.prior < settings.NUISANCE**2:
            others.append(w.names)
    return tuple(others)


def reach(mine: Fitted, its: Fitted, answer: Names, other: Names, kind: str, evidence: Array) -> Array:
    """By how much less evidence than an answer another hypothesis is about as good, -inf where it never is: with an
    effect of another place or regime instead of one of its own; with a freer law of the same, where that explains more
    than by chance (SIGNIFICANT each way), if not by what its parameters cost and the threshold; instead of a single one
    with the simpler law, also where that leaves little more. evidence: of the answer."""
    own, instead = set(answer) - set(other), set(other) - set(answer)
    never = np.full_like(evidence, -math.inf)
    if len(own) != 1 or len(instead) != 1:
        return never
    (one,), (another,) = own, instead
    if same_but_freer(another, one, kind):
        more = max(len(its.z) - len(mine.z), 1)  # parameters, each of which costs as much
        short = settings.THRESHOLD + more * math.log(MOST) - float(chdtri(more, 2.0 * settings.SIGNIFICANT))
        return np.full_like(evidence, short)
    if not same_but_freer(one, another, kind):
        return np.full_like(evidence, settings.DECISIVE)
    return np.maximum(settings.DECISIVE, settings.FORETOLD * evidence) if len(answer) == 1 else never


def runners_up(judged: Judged, kind: str) -> tuple[Names, ...]:
    """The other hypotheses of as many effects, listed or not, that are no freer law of the same, the best first; only
    those that have HALF of the answer's evidence: what has less, the runs themselves rule out."""
    least = settings.HALF * max((w.evidence for w in judged.weighed if w.names == judged.names), default=0.0)
    found = []
    for w in judged.weighed:
        mine, its = set(judged.names) - set(w.names), set(w.names) - set(judged.names)
        freer = any(same_but_freer(a, b, kind) for a in its for b in mine)
        if len(w.names) == len(judged.names) and len(its) == 1 and w.evidence > least and not freer:
            found.append(w.names)
    return tuple(found)


def unlisted_likely(judged: Judged) -> tuple[Names, ...]:
    """The single unlisted effects that have HALF of the best one's evidence, the best first."""
    rivals = [w for w in judged.weighed if w.rival and len(w.names) == 1 and w.evidence > 0.0]
    return tuple(w.names for w in rivals if w.evidence > settings.HALF * rivals[0].evidence)


def alike(search: SearchResult, judged: Judged) -> Names:
    """Effects of `alternatives` that are not of the answer."""
    hypotheses = alternatives(search, judged)
    return tuple(dict.fromkeys(name for names in hypotheses for name in names if name not in judged.names))


def steps(judged: Judged, inputs: int) -> tuple[Step, ...]:
    """The steps to a named answer, one effect more in each. inputs: rows of the residual that are the input's."""
    known = {w.names: w for w in judged.weighed}
    ladder: list[Step] = []
    names = judged.names
    while names in known:
        ladder.insert(0, Step(names, known[names].evidence, known[names].fit.rms(inputs)))
        parts = [part for part in combinations(names, len(names) - 1) if part in known]
        names = max(parts, key=lambda part: known[part].evidence, default=())
    return tuple(ladder)
