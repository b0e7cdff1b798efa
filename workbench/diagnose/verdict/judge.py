"""The verdict: a named cause, no gap, or a cause that no library entry explains; with probabilities.

Every hypothesis has a merit: by how much its score is better than that of no effect, less what its parameters cost
(`hypotheses/score.py`). A cause is named where one explains the gap; what it leaves counts against it by its share of
the gap and by its size in per cent of the torque. How merits become probabilities: `verdict/probability.py`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from workbench.diagnose.hypotheses.base import traces
from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.merit import (
    PLAY,
    SECOND,
    beyond,
    beyond_discrepancy,
    discrepancy_rms,
    inexact,
    lag_explains,
    of_impacts,
    only_mends,
)
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.records import Names
from workbench.diagnose.hypotheses.score import Score, cost, explained, score_of
from workbench.diagnose.hypotheses.search import SearchResult
from workbench.diagnose.verdict.cancellation import cancellation
from workbench.diagnose.verdict.constancy import Constancy, constancies
from workbench.diagnose.verdict.probability import calibration, is_lost, rank
from workbench.diagnose.verdict.records import Hypothesis, Left, Reason, ReasonKind, Step, VerdictWord
from workbench.diagnose.verdict.structure import lasting_share, loaded_share, repeated_share, sudden_share
from workbench.diagnose.verdict.tolerance_excess import tolerance_excess
from workbench.diagnose.verdict.twins import groups_of
from workbench.effects import find
from workbench.machines import kind_of

# Standard deviations by which tolerances are stretched by chance: more without a cause that explains anything than with
# one, for of all causes weighed one would have relieved them.
BY_CHANCE = {False: 2.0, True: 1.0}
UNDONE = 0.4  # logarithm of energies: as far two causes undo each other by chance; of 30 true pairs two did by 0.5
TRACE = 3.0  # standard deviations of an effect's trace, by chance
STRETCHED = 9.0  # of chi^2 of the tolerances, three in one place: it tells two effects apart
MUCH = 0.1  # of the gap's energy left: an answer that leaves so much leaves it open
RELEVANT_PERCENT = 0.15  # of the input's rms: less left changes no conclusion of a study
LAW = 0.15  # of what a law explains, rms: so far a real machine is off the simpler law; EMPS 0.1 off viscous friction
FREER = 5.0  # merit by which a law of more freedom has to be better than a simpler one
OWN = 0.02  # of the largest input: what an axis may leave itself at speed; the EMPS axis leaves 0.008 to 0.016
OWN_AGAIN = 0.007  # of that, what comes again with place or speed; the EMPS axis leaves 0.005
OWN_LOAD = 0.004  # of that, what comes again with the load or the acceleration; the EMPS axis leaves 0.003
OWN_BLOW = 0.002  # of that, what comes in a few moments at speed; the EMPS axis leaves none
AGAIN = 2.0  # as evidence: what comes again with twice that is as much as a discrepancy of seven times its size
SIMPLER = 0.05  # of its merit: a simpler law that lacks no more of it is alike
UNHEARD = 10.0  # as evidence: impacts that come again, and a hypothesis without play
AS_GOOD = 12.0  # merit within which another hypothesis is as good as the best
BENDS = 0.1  # of a remainder's chi^2: so much of it the base parameters take up
HALF = 0.5  # of the best one's merit: what a part of it has to have
NEARLY = 0.1  # the same, of the best one's merit
DECISIVE = 12.0  # merit by which an unlisted effect has to be better than the best listed one to count for an unknown


@dataclass(frozen=True)
class Weighed:
    """A hypothesis with its merit. gain: the fall of chi^2 and tolerances. score: at the sizes of the discrepancy that
    fit best. rival: an unlisted effect, which no answer may name."""

    names: Names
    fit: Fitted
    gain: float
    merit: float
    score: Score
    rival: bool = False


@dataclass(frozen=True)
class Judged:
    """word, names: the answer. best: the best named hypothesis, also where it is not the answer.

    held: the fit that the answer was judged on. left: what it leaves. floor: rms of noise and discrepancy, in the
    input's unit: what a machine without a gap leaves. explained: share of the gap's energy. counted:
    merits as they were ranked. twins: groups of hypotheses that differ in name only. mimics: those that were not
    established, with what speaks against each.
    """

    word: VerdictWord
    names: Names
    ranking: tuple[Hypothesis, ...]
    weighed: tuple[Weighed, ...]
    best: Weighed | None
    held: Fitted
    left: Left
    explained: float
    evidence: Mapping[str, float]
    floor: float
    unknown_probability: float
    reasons: tuple[Reason, ...]
    counted: tuple[tuple[Names, float], ...]
    twins: tuple[tuple[Names, ...], ...] = ()
    mimics: Mapping[Names, Constancy] = field(default_factory=dict)

    @property
    def of_answer(self) -> tuple[Names, ...]:
        """The answer's twins."""
        return self.ranking[0].twins


def weigh(search: SearchResult) -> tuple[tuple[Weighed, ...], Score]:
    """All fitted hypotheses by falling merit, and the score without any effect.

    The merit of several effects is that of the best subset without one of them, plus what the last one adds beyond the
    gain that an inexact law of the others allows (`inexact`).
    """
    problem, none = search.problem, score_of(search.problem, search.base)
    kind = problem.active.kind

    def weighed(names: Names, score: Score, merit: float) -> Weighed:
        rival = any(name in search.rivals for name in names)
        return Weighed(names, search.fits[names], search.gain(names), merit, score, rival)

    scores = {names: score_of(problem, fit) for names, fit in search.fits.items()}
    singles: dict[Names, Weighed] = {}
    for names, fit in search.fits.items():
        if len(names) != 1:
            continue
        gain = none.value - scores[names].value
        merit = beyond_discrepancy(problem, search.base, fit, gain, scores[names].sizes) - cost(
            problem, len(fit.z) - len(search.base.z)
        )
        merit = of_impacts(problem, names, beyond_trace(problem, fit, names[0], merit))
        singles[names] = weighed(names, scores[names], merit)
    all_weighed = {names: _not_freer(search, w, singles, kind) for names, w in singles.items()}
    for size in range(2, max(map(len, search.fits), default=0) + 1):
        together: dict[Names, Weighed] = {}
        for names in (names for names in search.fits if len(names) == size):
            parts = (all_weighed.get(part) for part in combinations(names, size - 1))
            first = max((part for part in parts if part is not None), key=lambda w: w.merit, default=None)
            if first is not None:
                merit = first.merit + _added(search, first, names, scores[names])
                together[names] = weighed(names, scores[names], merit)
        all_weighed |= {names: _not_freer(search, w, together, kind) for names, w in together.items()}
    return tuple(sorted(all_weighed.values(), key=lambda w: -w.merit)), none


def _added(search: SearchResult, first: Weighed, names: Names, score: Score) -> float:
    """The merit that one more effect adds to a hypothesis."""
    problem, fit = search.problem, search.fits[names]
    gain = beyond_discrepancy(problem, first.fit, fit, first.score.value - score.value, score.sizes)
    prior = first.fit.prior - fit.prior
    (last,) = set(names) - set(first.names)
    least = inexact(problem, search.within_tolerances, first.fit, first.score)
    if problem.struck and PLAY in first.names:  # what its law does not foretell stretches tolerances too
        added = min(gain, 0.0) if only_mends(problem, last) else beyond(gain, least)
    else:
        data = beyond(gain - prior, least)
        added = prior + (min(data, 0.0) if only_mends(problem, last) else data)
    merit = added - cost(problem, len(fit.z) - len(first.fit.z))
    return beyond_trace(problem, fit, last, merit) - calibration()["pair"]


def _not_freer(search: SearchResult, mine: Weighed, beside: Mapping[Names, Weighed], kind: str) -> Weighed:
    """The hypothesis with a lower merit, if it is not better by FREER than a simpler law of the same place and regime.
    The shortfall is subtracted."""
    simpler = [
        other
        for names, other in beside.items()
        if len(set(mine.names) - set(names)) == 1
        and all(same_but_freer(a, b, kind) for a in set(mine.names) - set(names) for b in set(names) - set(mine.names))
    ]
    if not simpler:
        return mine
    ahead = [(mine.merit - other.merit, advantage(search, mine, other, LAW)) for other in simpler]
    lost = max(raw - real + min(max(FREER - real, 0.0), FREER) for raw, real in ahead)
    return replace(mine, merit=mine.merit - lost)


def advantage(search: SearchResult, mine: Weighed, other: Weighed, law: float = SECOND) -> float:
    """How much better a hypothesis is than another one whose inexact law it may only correct: the difference of the
    tolerances in full, that of the data above the other one's inexactness, `law` of what it explains, rms."""
    prior = other.fit.prior - mine.fit.prior
    least = inexact(search.problem, search.within_tolerances, other.fit, other.score, law)
    return prior + beyond(mine.merit - other.merit - prior, least)


def beyond_trace(problem: Problem, fit: Fitted, name: str, merit: float) -> float:
    """The merit less the part that an ordinary trace of the effect explains: TRACE of its standard deviations."""
    known = traces(problem.machine, problem.runs, name)
    sizes = [float(np.mean(fit.setting[symbol])) / std for symbol, std in known.items()]
    if merit <= 0.0 or not sizes:
        return merit
    return merit * max(1.0 - (TRACE / max(*sizes, TRACE)) ** 2, 0.0)


def judge(search: SearchResult, barred: Collection[Names] = ()) -> Judged:
    """The answer, and the ranking of every hypothesis weighed; probabilities sum to 1.

    A cause is named where it is established, whatever else is left. barred: hypotheses that are not to be named,
    whatever their merit.
    """
    if search.problem.struck and lag_explains(search.problem, search.within_tolerances, search.fits):
        search = replace(search, problem=search.problem.without_impacts())
    weighed, score = weigh(search)
    weighed = tuple(w for w in weighed if w.names not in barred)
    best, mimics = established(search.problem, weighed, search.within_tolerances)
    held, stands = search.within_tolerances, best is not None and best.merit > calibration()["threshold"]
    if best is not None and stands:
        held, score = best.fit, best.score
    floor = math.hypot(search.problem.noise, discrepancy_rms(search.problem.with_discrepancy((1.0, 1.0))))
    left, share = left_of(search, held, floor)
    evidence = evidence_of(search, held, score, left, share)
    if stands:
        evidence["left"] = 0.0  # what an established cause leaves is a remainder
    vetoes = [w for w in weighed if w.rival and (best is None or advantage(search, w, best, LAW) > DECISIVE)]
    counted = tuple(ranked_merits(weighed, vetoes, mimics))
    twins = groups_of(search.problem, [w for w in weighed if not w.rival and w.names not in mimics])
    rows = rank(counted, evidence, calibration(), twins, left.percent_of_input)
    unknown = next(row.probability for row in rows if row.verdict == "unknown")
    reasons = _reasons(left, evidence, best, vetoes)
    answer = rows[0]
    return Judged(
        answer.verdict,
        answer.effects,
        rows,
        weighed,
        best,
        held,
        left,
        share,
        evidence,
        floor,
        unknown,
        reasons,
        counted,
        twins,
        mimics,
    )


def established(
    problem: Problem, weighed: Sequence[Weighed], near: Fitted
) -> tuple[Weighed | None, Mapping[Names, Constancy]]:
    """The best hypothesis all of whose effects hold as laws (`constancies`), None if there is none; and the hypotheses
    above the threshold that are not established, each with what speaks against it.

    near: the fit without effects, within the tolerances. A hypothesis that leaves more than that fit, whose two effects
    undo each other, or that sits on a bound is not established either: the next about as good is looked at. Behind a
    mimic only what it is made of is, for whatever else is about as good imitates the same cause.
    """
    mimics: dict[Names, Constancy] = {}
    listed = [w for w in weighed if not w.rival]
    able = [w for w in listed if w.merit > calibration()["threshold"]]
    imitated = False
    for w in able:
        part = any(set(w.names) < set(names) for names in mimics) and w.merit > HALF * able[0].merit
        as_good = not imitated and w.merit > able[0].merit - max(AS_GOOD, NEARLY * able[0].merit)
        if not (part or as_good):
            continue
        why = _against(problem, w, near)
        if why is None:
            effects = [find(name, problem.active.kind) for name in w.names]
            why = next((one for one in constancies(problem, near, w.fit, effects) if one.broken), None)
            imitated |= why is not None
        if why is None:
            return w, mimics
        mimics[w.names] = why
    if able:  # none holds: what was not looked at is no better
        return None, {w.names: mimics.get(w.names, next(iter(mimics.values()))) for w in able}
    return next(iter(listed), None), mimics


def _against(problem: Problem, w: Weighed, near: Fitted) -> Constancy | None:
    """What speaks against a fit, whatever its law."""
    last, more = w.names[-1], w.fit.rms(problem.inputs) / max(near.rms(problem.inputs), 1e-300) - 1.0
    if more > 0.0 and not (problem.struck and PLAY in w.names):  # what a play leaves are the rebounds
        return Constancy(last, "residual", more)
    if (undone := cancellation(problem, w.fit, len(near.z))) > UNDONE:
        return Constancy(last, "the other effect", undone)
    return Constancy(last, "a bound", 1.0) if _on_bound(w.fit, len(near.z)) else None


def ranked_merits(
    weighed: Sequence[Weighed], vetoes: Sequence[Weighed], mimics: Collection[Names] = ()
) -> list[tuple[Names, float]]:
    """The merits to be ranked. An unlisted effect that is about as good as the best listed one is left out; a
    hypothesis that is not established has none."""
    return [
        (() if w.rival else w.names, min(w.merit, 0.0) if w.names in mimics else w.merit)
        for w in weighed
        if not w.rival or w in vetoes
    ]


def input_rms(problem: Problem) -> float:
    """The rms of the measured input while the machine moves, in its unit."""
    parts = [u[rows] for u, rows in zip(problem.bench.measured, problem.rows, strict=True)]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def left_of(search: SearchResult, held: Fitted, floor: float) -> tuple[Left, float]:
    """The residual of a fit beyond the floor, and the share of the gap's energy that the fit explains."""
    problem = search.problem
    rms = math.sqrt(max(held.rms(problem.inputs) ** 2 - floor**2, 0.0))
    percent = 100.0 * rms / max(input_rms(problem), 1e-300)
    gap = search.within_tolerances.rms(problem.inputs) ** 2 - floor**2
    share = 1.0 - rms**2 / gap if gap > 0.0 and held.effects else 0.0
    return Left(rms, percent, percent > RELEVANT_PERCENT), min(max(share, 0.0), 1.0)


def evidence_of(search: SearchResult, held: Fitted, score: Score, left: Left, share: float) -> dict[str, float]:
    """What speaks for a cause that no hypothesis holds, each 0 where nothing does.

    left: the logarithm of the discrepancy that the best hypothesis needs, over the default, in full where it leaves
    MUCH of the gap's energy and more than RELEVANT_PERCENT of the input, less where it leaves less.
    prior: the distance of the base parameters from nominal beyond chance and beyond what an inexact effect explains, in
    standard deviations above BY_CHANCE (see `tolerance_excess`). bound: an effect's value at its limit. against: how
    far two effects cancel each other (see `cancellation`), above UNDONE.
    """
    own = len(search.base.z)
    if search.problem.struck:  # what stays beside an impact are its rebounds, which no law foretells
        return {"left": 0.0 if PLAY in held.effects else UNHEARD, "prior": 0.0, "bound": 0.0, "against": 0.0}
    open_share = min((1.0 - share) / MUCH, 1.0) if held.effects else 1.0
    bent = 0.0
    if held.effects:  # an inexact law bends the base parameters, and so does a remainder
        noise = search.problem.noise / max(held.rms(search.problem.inputs), 1e-300)
        bent = SECOND**2 * explained(search.problem, search.base, held, score)
        bent += BENDS * max(1.0 - noise**2, 0.0) * held.chi2
    return {
        "left": open_share * unexplained(search.problem, held, left, score.excess),
        "prior": max(tolerance_excess(search.problem, held, bent) - BY_CHANCE[bool(held.effects)], 0.0),
        "bound": float(_on_bound(held, own)),
        "against": max(cancellation(search.problem, held, own) - UNDONE, 0.0),
    }


def unexplained(problem: Problem, held: Fitted, left: Left, excess: float) -> float:
    """The evidence in the remaining residual: the logarithm of the discrepancy's excess, scaled by its relevance.

    An axis has ripple and resonances, and friction near standstill, that no cause explains. On an axis the residual at
    speed counts above OWN of the largest input. A part that repeats with place or speed, or sets in and stays, counts
    above OWN_AGAIN; one that repeats with input or acceleration above OWN_LOAD; a part within a few moments above
    OWN_BLOW: a random discrepancy has none of them.
    """
    many = max(math.log(excess), 0.0)
    if kind_of(problem.machine).floor == "sensors":
        return many * min((left.percent_of_input / RELEVANT_PERCENT) ** 2, 1.0)
    largest = max(float(np.max(np.abs(u))) for u in problem.bench.measured)
    energy, inputs = held.residual[: problem.inputs] ** 2, slice(0, problem.inputs)
    at_speed = float(problem.errors.at_speed[inputs] @ energy) / max(float(np.sum(energy)), 1e-300)
    beyond_own = min(max(left.rms * math.sqrt(at_speed) / (OWN * largest) - 1.0, 0.0), 1.0)
    structured = (
        (repeated_share(problem, held.residual), OWN_AGAIN),
        (loaded_share(problem, held.residual), OWN_LOAD),
        (lasting_share(problem, held.residual), OWN_AGAIN),
        (sudden_share(problem, held.residual), OWN_BLOW),
    )
    again = max(left.rms * math.sqrt(share) / (own * largest) for share, own in structured)
    return max(many * beyond_own, AGAIN * min(max(again - 1.0, 0.0), 1.0))


def _reasons(
    left: Left, evidence: Mapping[str, float], best: Weighed | None, vetoes: Sequence[Weighed]
) -> tuple[Reason, ...]:
    reasons = []
    if vetoes and (best is None or vetoes[0].merit > best.merit):
        reasons.append(Reason(ReasonKind.UNLISTED_EXPLAINS_MORE, effects=vetoes[0].names))
    if evidence["left"] > 0.5:
        reasons.append(Reason(ReasonKind.LEAVES_MUCH, value=left.rms, percent=left.percent_of_input))
    if best is not None and is_lost([(best.names, best.merit)], calibration()["threshold"], left.percent_of_input):
        reasons.append(Reason(ReasonKind.FITS_ARE_LOST, percent=left.percent_of_input))
    if evidence["prior"] > 1.5:
        reasons.append(Reason(ReasonKind.STRETCHES_TOLERANCES, value=evidence["prior"]))
    if evidence["bound"]:
        reasons.append(Reason(ReasonKind.ON_A_BOUND))
    if evidence["against"] > 0.0:
        reasons.append(Reason(ReasonKind.UNDO_EACH_OTHER, effects=best.names if best else ()))
    return tuple(reasons)


def _on_bound(fit: Fitted, base: int) -> bool:
    """Whether an effect's value is at its upper bound, or at a lower bound where the effect does not vanish."""
    at = 0
    for knob in fit.knobs:
        for low, high in zip(knob.lowest, knob.highest, strict=True):
            z = float(fit.z[at])
            at += 1
            if at > base and (z >= high - 1e-9 or (z <= low + 1e-9 and z != 0.0)):
                return True
    return False


def alternatives(judged: Judged, kind: str, within: float = 12.0) -> tuple[Names, ...]:
    """Hypotheses that explain the gap about as well as the answer does, the best first: with another effect in place of
    one of its own, of another place or regime, and about its merit. In place of a single one, also the simpler law of
    its own place and regime where that leaves little more."""
    best = next((w for w in judged.weighed if w.names == judged.names), None)
    if judged.word != "named" or best is None:
        return ()
    others: list[Names] = []
    for w in judged.weighed:
        if len(w.names) != len(best.names) or len(set(w.names) - set(best.names)) != 1 or w.merit <= 0.0:
            continue
        (mine,), (other,) = set(best.names) - set(w.names), set(w.names) - set(best.names)
        freer, simpler = same_but_freer(other, mine, kind), same_but_freer(mine, other, kind)
        single = len(best.names) == 1
        as_good = best.merit - w.merit < within and not freer and (single or not simpler)
        little_more = single and simpler and w.merit > (1.0 - SIMPLER) * best.merit
        if w.fit.prior - best.fit.prior < STRETCHED and (as_good or little_more):
            others.append(w.names)
    return tuple(others)


def alike(judged: Judged, kind: str) -> Names:
    """Effects of `alternatives` that are not of the answer."""
    hypotheses = alternatives(judged, kind)
    return tuple(dict.fromkeys(name for names in hypotheses for name in names if name not in judged.names))


def steps(judged: Judged, inputs: int) -> tuple[Step, ...]:
    """The steps to a named answer, one effect more in each. inputs: rows of the residual that are the input's."""
    known = {w.names: w for w in judged.weighed}
    ladder: list[Step] = []
    names = judged.names
    while names in known:
        ladder.insert(0, Step(names, known[names].merit, known[names].fit.rms(inputs)))
        parts = [part for part in combinations(names, len(names) - 1) if part in known]
        names = max(parts, key=lambda part: known[part].merit, default=())
    return tuple(ladder)


def same_but_freer(freer: str, simpler: str, kind: str) -> bool:
    """Whether an effect has the place and regime of another one and more parameters: the same cause by a freer law."""
    a, b = find(freer, kind), find(simpler, kind)
    return len(a.parameters) > len(b.parameters) and (a.subsystem(kind), a.regime) == (b.subsystem(kind), b.regime)
