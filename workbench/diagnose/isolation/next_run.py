"""The run that would decide between the open hypotheses, and by how much."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby, permutations
from statistics import NormalDist
from typing import Any

import numpy as np

from workbench.core.names import listed
from workbench.core.numbers import figures
from workbench.core.run import Array
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.evidence import cost, freedom, nested, same_but_freer
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import Names, base_parameters, bounds_of
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import SearchResult
from workbench.diagnose.isolation.lines import Line, OnMenu, ahead_of, least_of, on_campaign, on_menu, rough_of
from workbench.diagnose.isolation.planned import Design, Planned, drawn, menu, planned_as, repeated, seen_in, varied
from workbench.diagnose.readiness.checks import variety
from workbench.diagnose.verdict.judge import reach
from workbench.machines import kind_of

CLOSER = 0.1  # of a tolerance: a value that was measured for the question
LIKELY = 0.1  # probability from which on a hypothesis is open
SURE = 0.9  # probability from which on a run is said to decide
APART = NormalDist().inv_cdf(SURE) + math.sqrt(NormalDist().inv_cdf(SURE) ** 2 + settings.DECISIVE)  # deviations: so
TIMES = (2, 3, 4)  # a run of the menu over, in one run
DRAWN, GENERATIONS = 20, 4  # motions that are simulated at once, and how often
BETTER = 1.03  # than the best before, to be taken
RARE = 0.01  # probability of a hypothesis that is counted as undecided
DRAWS = 40  # machines of the likeliest hypothesis, and of another one as it is likely, for the chance
STATED = 6  # times as many, for the one that is stated
REFITS = 12  # at the most, each with what left its bounds held there, and what would go back released
RIVALS = 5  # that the leading hypothesis is held against


@dataclass(frozen=True)
class NextRun:
    """The run that would decide between the open hypotheses.

    separation: distance of their predictions with this run, in standard deviations; now: without it; menu: with the
    best plain run that takes no longer, `plain`. decides: the probability that only one is open then. rivals: of the
    first hypothesis.
    """

    why: str
    payload_kg: float
    profile: str
    signals: tuple[str, ...]
    separation: float
    now: float
    menu: float = math.nan
    decides: float = math.nan
    planned: Planned | None = field(default=None, compare=False)
    plain: Planned | None = field(default=None, compare=False)
    rivals: tuple[Names, ...] = ()

    @property
    def record(self) -> dict[str, Any]:
        """Plain data: the run, its motion, and what it decides."""
        fields = {key: value for key, value in vars(self).items() if key not in ("planned", "plain")}
        return fields | (self.planned.motion if self.planned else {})


@dataclass(frozen=True)
class Offer:
    """One entry of the menu: a run and what is logged beside the motors. separation: in standard deviations, beyond
    what is ignored; whole: with that. shown: what it shows of each pair. lines: of each hypothesis on it. poor: whether
    the runs do not vary all that tells causes apart with it either. short: by how much it falls short of deciding, to
    be compared. design: of a run that is none of the menu. most: the chance of a run that shows whatever differs."""

    planned: Planned
    signals: tuple[str, ...]
    separation: float
    whole: float
    shown: Sequence[Compared] = ()
    lines: Sequence[Line] = ()
    poor: bool = False
    chance: float = 0.0
    short: float = 0.0
    design: Design | None = None
    most: float = 1.0

    @property
    def decides(self) -> bool:
        return self.chance >= SURE * self.most


@dataclass(frozen=True)
class Compared:
    """What the data of a run, or of the campaign, show of a true hypothesis and a rival, by their numbers.

    triangles: of each channel R of the QR decomposition of [the rival's Jacobian, its own values, the true prediction
    less the rival's], all that least squares ask of their rows. least: of each one the chi^2 that is ignored.
    own_hold: the rival's.
    """

    true: int
    rival: int
    triangles: tuple[Array, ...]
    least: tuple[float, ...]
    own_hold: Array


@dataclass(frozen=True, eq=False)
class Odds:
    """What the campaign says of some hypotheses, and what a run would add: by machines drawn from what each one leaves
    open, on each of which all are refitted, to second order.

    evidence: as the verdict has it, before freer laws pay for their freedom. lost: by how much it is less than the
    gain, for what the model may be off: a run adds to that as its samples do. paid: for parameters. inputs: samples of
    the campaign. curved, steep: of each fit a root of the second derivative of its objective over two, and the slope
    over two, tolerances among them. counts: how many are open; a fit without an effect, which the others gain upon, is
    one of them or the last. kind: of machine. ignored: chi^2 of the campaign that no model is exact to. unnamed:
    whether no answer may name one, whichever it is.
    """

    fits: Sequence[Fitted]
    evidence: Array
    lost: Array
    paid: Array
    inputs: int
    curved: Sequence[Array]
    steep: Sequence[Array]
    counts: int
    kind: str
    ignored: float
    unnamed: Sequence[bool]

    @classmethod
    def of(cls, search: SearchResult, fits: Sequence[Fitted], evidence: Mapping[Names, float]) -> Odds:
        problem, none = search.problem, search.base
        every = [*fits, *([] if any(not fit.effects for fit in fits) else [none])]
        gained = np.array([search.base.objective - fit.objective for fit in every])
        paid = np.array([cost(problem, max(len(fit.z) - len(none.z), 0)) for fit in every])
        names = [tuple(sorted(fit.effects)) for fit in every]
        worth = np.array([evidence.get(one, float(g - p)) for one, g, p in zip(names, gained, paid, strict=True)])
        curved, steep = [], []
        for fit in every:
            hold = 1.0 / bounds_of(fit.free)[2]
            white = problem.errors.whiten(np.column_stack([fit.jacobian, fit.residual]))
            curved.append(np.asarray(np.linalg.qr(np.vstack([white[:, :-1], np.diag(hold)]), mode="r")))
            steep.append(white[:, :-1].T @ white[:, -1] + hold**2 * fit.z)
        kind, ignored = problem.active.kind, least_of(problem) ** 2 * problem.share * problem.inputs
        known, least = worth.copy(), settings.THRESHOLD
        for k, j in freer_of(every, kind):  # as `_freely` takes it off
            worth[k] = max(worth[k], known[k] + min(max(0.5 * (least - known[k] + known[j]), 0.0), least))
        lost = np.maximum(gained - worth - paid, 0.0)
        unnamed = [bool(search.rivals & {*one}) for one in names]
        return cls(every, worth, lost, paid, problem.inputs, curved, steep, len(fits), kind, ignored, unnamed)

    @cached_property
    def likely(self) -> Array:
        """Of each open hypothesis, the probability that the campaign leaves it among these."""
        evidence = self._freely(self.evidence)[: self.counts]
        likely = np.exp(0.5 * (evidence - np.max(evidence)))
        return np.asarray(likely / np.sum(likely))

    @property
    def most(self) -> float:
        """The chance of a run that shows whatever differs: a freer law explains more by chance."""
        simpler = [j for _, j in freer_of(self.fits, self.kind)]
        by_chance = [(1.0 - 2.0 * settings.SIGNIFICANT) ** simpler.count(j) for j in range(self.counts)]
        return float(self.likely @ by_chance)

    def _freely(self, evidence: Array) -> Array:
        """(hypotheses, …) the evidence after freer laws have paid for their freedom, as the verdict has it."""
        paid = evidence.copy()
        for k, j in freer_of(self.fits, self.kind):
            real = evidence[k] - evidence[j]
            paid[k] = np.minimum(paid[k], paid[j] + real - freedom(real))
        return paid

    def chance(
        self, lines: Sequence[Line], poor: bool = False, times: int = 1, draws: int = DRAWS
    ) -> tuple[float, float]:
        """The probability that a run, driven so many times over, leaves the true hypothesis alone, as the verdict has
        it; and how far it falls short of doing so by DECISIVE more, 0 to 1, where what lacks that much of being enough
        lacks all. What the model may be off decides nothing: a rival loses no more by that than the true one. lines: of
        each fit on the run. poor: whether the runs do not vary all that tells causes apart with it either: then a rival
        with HALF of the evidence must not predict what the true one does, but for what is ignored."""
        sizes = [line.own.shape[1] for line in lines]
        widths = [len(fit.z) + size + 1 for fit, size in zip(self.fits, sizes, strict=True)]
        rows = np.asarray(np.linalg.qr(math.sqrt(times) * np.hstack([line.white for line in lines]), mode="r"))
        blocks = np.split(rows, np.cumsum(widths)[:-1], axis=1)
        more = times * np.count_nonzero(lines[0].channel == 0) / self.inputs * self.lost
        ignored = self.ignored + times * lines[0].least ** 2 * lines[0].share * np.count_nonzero(lines[0].channel == 0)
        unlikely = 2.0 * math.log(1.0 / LIKELY - 1.0)
        alone, short, likeliest = 0.0, 0.0, float(np.max(self.likely))
        for true, weight in enumerate(self.likely):
            if weight < RARE:
                short += weight
                continue
            fit, curved, rng = self.fits[true], self.curved[true], np.random.default_rng(true)
            size, many = np.maximum(np.linalg.norm(curved, axis=0), 1e-12), math.ceil(draws * weight / likeliest)
            low, high, _ = bounds_of(fit.free)
            spread = rng.normal(size=(many, len(size))) @ np.linalg.pinv(curved / size, rcond=1e-9).T / size
            changed = (np.clip(fit.z + spread, low, high) - fit.z) @ blocks[true][:, : len(size)].T
            drawn = rng.normal(size=changed.shape) - changed - blocks[true][:, -1]
            refitted = [self._left(k, blocks[k], lines[k].own_hold, drawn) for k in range(len(self.fits))]
            left, held = (np.array(values) for values in zip(*refitted, strict=True))
            none = next(k for k, one in enumerate(self.fits) if not one.effects)
            gained = (self.evidence + self.paid - np.minimum(more, more[true]))[:, None] + left[none] - left
            after = self._freely(np.maximum(gained, 0.0) - self.paid[:, None])
            after[none] = self.evidence[none]
            lead = np.full(many, math.inf)
            for k, one in enumerate(self.fits):  # without an effect it is no gap, whether that was open or not
                if k != true and not (self.unnamed[true] and self.unnamed[k]):
                    as_good = reach(fit, one, fit.effects, one.effects, self.kind, after[true])
                    as_likely = held[k] - held[true] < settings.NUISANCE**2
                    least = np.maximum(np.where(as_likely, as_good, 0.0), unlikely)
                    first = after[true] - after[k]
                    lead = np.minimum(lead, first - least)
                    if poor:
                        rival = (as_good >= settings.DECISIVE) & (after[k] > settings.HALF * after[true])
                        apart = first + self.paid[true] - self.paid[k] - ignored - APART**2
                        lead = np.where(rival, np.minimum(lead, apart), lead)
            alone += weight * np.mean(lead >= 0.0)
            short += weight * np.mean(np.clip(0.5 - 0.5 * lead / settings.DECISIVE, 0.0, 1.0))
        return float(alone), float(short)

    def _left(self, k: int, block: Array, own_hold: Array, drawn: Array) -> tuple[Array, Array]:
        """(draws,) by how much the objective of a hypothesis grows with drawn data, its values refitted in their
        bounds; and what the tolerances hold of it then."""
        fit, values = self.fits[k], len(self.fits[k].z)
        free, endless = values + len(own_hold), np.full(len(own_hold), np.inf)
        lowest, highest, std = bounds_of(fit.free)
        low, high = np.append(lowest - fit.z, -endless), np.append(highest - fit.z, endless)
        rows, wanted = block[:, :-1], -(drawn + block[:, -1])
        hold = np.zeros((len(self.curved[k]) + len(own_hold), free))
        hold[: len(self.curved[k]), :values] = self.curved[k]
        hold[len(self.curved[k]) :, values:] = np.diag(own_hold)
        size = np.maximum(np.sqrt(np.sum(rows**2, axis=0) + np.sum(hold**2, axis=0)), 1e-12)
        normal = (rows.T @ rows + hold.T @ hold) / np.outer(size, size) + 1e-10 * np.eye(free)
        pull = (wanted @ rows - np.append(self.steep[k], np.zeros(len(own_hold)))) / size
        low, high = low * size, high * size
        x, side, turning = np.zeros(pull.shape), np.zeros(pull.shape), np.arange(len(pull))
        for _ in range(REFITS):  # block principal pivoting: J. J. Judice, F. M. Pires, Computers Op. Res. 21, 1994
            here, held = side[turning], side[turning] != 0.0
            at = np.where(here < 0.0, low, np.where(here > 0.0, high, 0.0))
            system = np.where(held[:, :, None] | held[:, None, :], held[:, :, None] * np.eye(free), normal)
            at = np.linalg.solve(system, np.where(held, at, pull[turning] - at @ normal)[..., None])[..., 0]
            pushed = here * (at @ normal - pull[turning]) < 0.0  # against the bound where it is held
            now = np.where(held, here * pushed, 1.0 * (at > high + 1e-9) - (at < low - 1e-9))
            x[turning] = at
            side[turning] = now
            turning = turning[np.any(now != here, axis=1)]
            if not len(turning):
                break
        x = np.clip(x, low, high)
        grown = np.sum(wanted**2, axis=1) - 2.0 * np.sum(x * pull, axis=1) + np.sum((x @ normal) * x, axis=1)
        return grown, np.sum(((fit.z + x[:, :values] / size[:values]) / std) ** 2, axis=1)


@dataclass(frozen=True)
class Question:
    """Which hypothesis holds, the first one or another.

    known: what the campaign shows. odds: None where it favours the first one; asked is then whether a rival could
    predict what that one does. now: how far it sets them apart, in standard deviations, beyond what is ignored and
    whole.
    """

    problem: Problem
    fits: Sequence[Fitted]
    known: Sequence[Compared]
    odds: Odds | None
    now: tuple[float, float]

    @property
    def favoured(self) -> bool:
        return self.odds is None

    @property
    def hypotheses(self) -> Sequence[Fitted]:
        """Whose lines an offer has: those of the question, and that of no effect."""
        return self.fits if self.odds is None else self.odds.fits

    def offer(self, trial: Sequence[OnMenu], run: int, planned: Planned, signals: tuple[str, ...]) -> Offer:
        """One planned run. trial: the hypotheses on several."""
        lines = [of_run(run, signals) for of_run in trial]
        shown = compared(lines[: len(self.fits)], self.favoured)
        apart = _apart(self.problem, self.fits, self.known, shown)
        offer = self.weighed(Offer(planned, signals, *apart, shown, lines))
        return self.weighed(replace(offer, poor=True)) if offer.decides and self.poor_with(planned) else offer

    def poor_with(self, planned: Planned) -> bool:
        """Whether the runs with that one do not vary all that tells causes apart either."""
        problem = self.problem
        return bool(variety(Problem(problem.machine, [*problem.runs, planned.run], problem.band_hz).bench))

    def weighed(self, offer: Offer, times: int = 1, draws: int = DRAWS) -> Offer:
        """The offer with its chance to decide, as driven so many times over, each as good as the first."""
        if self.odds is not None:
            chance, short = self.odds.chance(offer.lines, offer.poor, times, draws)
            return replace(offer, chance=chance, short=short, most=self.odds.most)
        one = zip(self.now, (offer.separation, offer.whole), strict=True)
        apart, whole = (math.sqrt(a**2 + times * max(b**2 - a**2, 0.0)) for a, b in one)
        chance = NormalDist(apart**2, 2.0 * max(whole, 1e-9)).cdf(APART**2)
        return replace(offer, chance=1.0 - chance, short=1.0 / max(apart, 1e-9))


def next_run(
    problem: Problem,
    search: SearchResult,
    open_effects: Sequence[Names],
    evidence: Mapping[Names, float] | None = None,
    settled: float = math.inf,
) -> NextRun | None:
    """The cheapest run that separates the first open hypothesis from the others, or else the best one.

    For each planned run the predictions of the hypotheses are compared after base parameters and effects were
    refitted to all data within the tolerances. Differences below `least_of` the noise are ignored. With `settled` the
    campaign favours the first one: asked is whether a rival could predict what that one does, and rivals that the
    campaign sets so many standard deviations off it already are left out. None if no rival is left, or if no run would
    set those that are so far off.
    """
    fits = [search.fits[names] if names else search.base for names in open_effects]
    campaign, favoured = [on_campaign(problem, fit) for fit in fits], settled < math.inf

    def asked(*which: int) -> Question:
        kept = (0, *which)
        chosen, known = [fits[k] for k in kept], compared([campaign[k] for k in kept], favoured)
        odds = None if favoured else Odds.of(search, chosen, evidence or {})
        return Question(problem, chosen, known, odds, _apart(problem, chosen, known))

    near = [k for k in range(1, len(fits)) if asked(k).now[0] <= settled][:RIVALS]
    planned = sorted(menu(problem), key=_effort) if near else []
    if not planned:
        return None
    by_length = [list(alike) for _, alike in groupby(planned, key=_effort)]
    to_log = kind_of(problem.machine).to_log
    logged = tuple(s for s in to_log if any(s in run for run in problem.runs))  # stays logged, and more costs more
    choices = dict.fromkeys([logged, *(tuple(sorted({*logged, more})) for more in to_log)])
    trials: list[list[OnMenu]] = []  # of the runs of each length the hypotheses
    while True:
        question, tried = asked(*near), list[tuple[Offer, Offer]]()
        for signals in choices:
            offers = list[Offer]()
            for length, alike in enumerate(by_length):
                if length == len(trials):
                    trials.append(_ahead(problem, alike, question.hypotheses))
                trial = trials[length][: len(question.hypotheses)]
                offers += [question.offer(trial, k, one, signals) for k, one in enumerate(alike)]
                if any(offer.decides for offer in offers):
                    break
            plain = _stated(question, choose(offers))
            hopeful = question.weighed(plain, TIMES[-1]).chance >= settings.HALF
            tried.append(_longer(question, _designed(question, plain, offers)) if hopeful else (plain, plain))
            if tried[-1][0].decides:
                break
        best = choose([one for one, _ in tried])
        usual = next(plain for one, plain in tried if one is best)
        if best is usual and not best.decides:
            best, usual = _longer(question, _designed(question, usual, ()))
        if best.separation > settled or not favoured:
            break
        if len(near) == 1:
            return None
        near = near[:1]  # not all of them, perhaps the best one
    why, helps = _why(question, best)
    advice = NextRun(
        why, best.planned.payload_kg, best.planned.words, best.signals, best.separation, question.now[0],
        usual.separation, best.chance, best.planned, usual.planned, tuple(fit.effects for fit in question.fits[1:]),
    )  # fmt: skip
    return advice if helps else replace(advice, profile="none", planned=None, plain=None)


def _ahead(problem: Problem, planned: Sequence[Planned], fits: Sequence[Fitted], shared: bool = True) -> list[OnMenu]:
    """Each hypothesis on planned runs. shared: what base parameters change."""
    ahead = ahead_of(problem, [one.run for one in planned], fits[0])
    lines, rough = list[OnMenu](), rough_of(problem, fits[0])
    for fit in fits:
        if not shared:
            ahead.kept.clear()
        lines.append(on_menu(problem, ahead, fit, rough))
    return lines


def _stated(question: Question, offer: Offer) -> Offer:
    """An offer with the separation that each hypothesis gives with base signatures of its own."""
    own = _ahead(question.problem, [offer.planned], question.hypotheses, shared=False)
    stated = question.offer(own, 0, offer.planned, offer.signals)
    stated = replace(stated, design=offer.design, poor=question.poor_with(offer.planned))
    return question.weighed(stated, draws=STATED * DRAWS)


def _designed(question: Question, plain: Offer, others: Sequence[Offer]) -> tuple[Offer, Offer]:
    """A motion no longer than the plain one that falls less short of deciding, or shorter and no further, found by a
    seeded random search and by varying the best, or the plain one where that finds none; and the best plain one that
    takes no longer, of others: the shortest where all do."""
    problem, rng = question.problem, np.random.default_rng(0)
    seen, best = seen_in(problem), plain
    top, longest = max(seen.speed, plain.planned.limits.speed_m_s), plain.planned.duration_s
    for _ in range(GENERATIONS):
        design, many = best.design, 4 * DRAWN
        fresh = drawn(problem, many, rng) if design is None else varied(problem, design, many, rng)
        able = [(one, run) for one in fresh if (run := planned_as(problem, seen, one, longest, top))][:DRAWN]
        if not able:
            break
        trial = _ahead(problem, [run for _, run in able], question.hypotheses)
        for k, (one, run) in enumerate(able):
            offer = replace(question.offer(trial, k, run, plain.signals), design=one)
            shorter = BETTER * offer.planned.duration_s < best.planned.duration_s
            if BETTER * offer.short < best.short or (shorter and offer.short <= best.short):
                best = offer
    own = plain if best is plain else _stated(question, best)
    if own is plain or (not own.decides and (plain.decides or own.short > plain.short)):
        return plain, plain
    longest = max(own.planned.duration_s, min((o.planned.duration_s for o in others), default=0.0))
    usual = [o for o in others if o.planned.duration_s <= longest]
    return own, _stated(question, min(usual, key=lambda o: (-o.chance, o.short))) if usual else plain


def _longer(question: Question, pair: tuple[Offer, Offer]) -> tuple[Offer, Offer]:
    """A run that does not decide, and the plain one, as often over as it takes to; once if TIMES do not do."""
    once, plain = pair

    def again(offer: Offer, times: int) -> Offer:
        problem, run = question.problem, None
        if offer.design is None:
            run = repeated(problem, offer.planned, times)
        else:
            often, top = replace(offer.design, legs=offer.design.legs * times), offer.planned.limits.speed_m_s
            run = planned_as(problem, seen_in(problem), often, math.inf, top)
        return _stated(question, replace(offer, planned=run)) if run else offer

    for times in TIMES:
        if once.decides:
            break
        if question.weighed(once, times).decides:
            longer = again(once, times)
            if longer.decides:
                return longer, longer if once is plain else again(plain, times)
    return pair


def _effort(planned: Planned) -> tuple[bool, float]:
    """A run faster than any before is driven where no other one decides."""
    return planned.faster, planned.duration_s


def choose(offers: Sequence[Offer]) -> Offer:
    """The cheapest offer that decides: fewest signals, then no faster than before, then the shortest run; else the one
    that falls least short."""
    if enough := [offer for offer in offers if offer.decides]:
        return min(enough, key=lambda o: (len(o.signals), *_effort(o.planned), -o.separation))
    least = min(offer.short for offer in offers)
    return min((o for o in offers if 0.95 * o.short <= least), key=lambda o: (len(o.signals), *_effort(o.planned)))


def freer_of(fits: Sequence[Fitted], kind: str) -> list[tuple[int, int]]:
    """Pairs of a hypothesis and another one with a simpler law in place of one of its own; the simpler ones first."""
    pairs = []
    for (k, one), (j, other) in permutations(enumerate(fits), 2):
        own, its = {*one.effects} - {*other.effects}, {*other.effects} - {*one.effects}
        if len(own) == len(its) == 1 and same_but_freer(own.pop(), its.pop(), kind):
            pairs.append((k, j))
    return sorted(pairs, key=lambda pair: len(fits[pair[0]].z))


def compared(lines: Sequence[Line], favoured: bool = False) -> list[Compared]:
    """The first hypothesis with each other one on the same data, whichever of the two is true; or with the first one
    true, which the data in hand favour."""
    found = []
    for true, rival in ((t, r) for k in range(1, len(lines)) for t, r in ((0, k), (k, 0))[: 1 if favoured else 2]):
        mine, its = lines[true], lines[rival]
        rows = math.sqrt(its.share) * np.column_stack([its.jacobian, its.own, mine.residual - its.residual])
        channels = [rows[its.channel == channel] for channel in np.unique(its.channel)]
        triangles = tuple(np.asarray(np.linalg.qr(some, mode="r")) for some in channels)
        least = tuple(its.least**2 * its.share * len(r) for r in channels)
        found.append(Compared(true, rival, triangles, least, its.own_hold))
    return found


def _apart(
    problem: Problem, fits: Sequence[Fitted], *data: Sequence[Compared], closer: str = ""
) -> tuple[float, float]:
    """`distances` between the first hypothesis and its nearest rival, as `compared`; but a rival
    with an effect more, or with a freer law that contains the other's, predicts whatever the other does: there the
    question is whether its amount is none, or the same both ways."""
    kind = problem.active.kind

    def contains(rival: Fitted, true: Fitted) -> bool:
        more, less = set(rival.effects) - set(true.effects), set(true.effects) - set(rival.effects)
        if len(more) == len(less) == 1:
            (freer,), (simpler,) = more, less
            return same_but_freer(freer, simpler, kind) and nested(freer, simpler, kind)
        return bool(more) and not less

    asked = [(fits[shown[0].true], fits[shown[0].rival], shown) for shown in zip(*data, strict=True)]
    return min((distances(*of, closer) for of in asked if not contains(of[1], of[0])), default=(math.inf, math.inf))


def distances(true: Fitted, rival: Fitted, data: Sequence[Compared], closer: str = "") -> tuple[float, float]:
    """Standard deviations between the data of the true hypothesis and the rival that is refitted to them, beyond what
    is ignored and whole. closer: the symbol of a base parameter that is known to CLOSER of its tolerance, at its true
    value."""
    _, _, std = bounds_of(rival.free)
    values, at = len(std), len(std)
    size, off, prior = values + sum(len(shown.own_hold) for shown in data), rival.z.copy(), true.prior
    if (k := _place_of(rival, closer)) is not None:
        j = _place_of(true, closer)
        its = 0.0 if j is None else float(true.z[j])
        std, off[k], prior = (
            np.where(np.arange(values) == k, CLOSER * std, std),
            off[k] - its,
            prior - (its / std[k]) ** 2,
        )
    tolerances = np.zeros((values, size + 1))  # the last column is what is wanted
    tolerances[:, :values], tolerances[:, -1] = np.diag(1.0 / std), -off / std
    rows, least, holds = [tolerances], list[float](), list[Array]()
    for shown in data:
        own = range(at, at + len(shown.own_hold))
        at += len(own)
        for triangle in shown.triangles:
            rows.append(np.zeros((len(triangle), size + 1)))
            rows[-1][:, [*range(values), *own, size]] = triangle
        least += shown.least
        holds.append(np.zeros((len(own), size + 1)))
        holds[-1][range(len(own)), own] = shown.own_hold
    every = np.concatenate([*rows, *holds])
    size_of = np.maximum(np.linalg.norm(every[:, :-1], axis=0), 1e-300)
    step = np.linalg.lstsq(every[:, :-1] / size_of, every[:, -1], rcond=1e-10)[0] / size_of
    left = [float(np.sum((of_one @ np.append(step, -1.0)) ** 2)) for of_one in rows]
    beyond = sum(max(a - b, 0.0) for a, b in zip(left[1:], least, strict=True))
    return math.sqrt(max(left[0] - prior + beyond, 0.0)), math.sqrt(max(sum(left) - prior, 0.0))


def _place_of(fit: Fitted, symbol: str) -> int | None:
    """The index in z of a base parameter, None where the fit has none."""
    first = np.cumsum([0, *(parameter.size for parameter in fit.free)])
    return next(
        (int(k) for k, one in zip(first, fit.free, strict=False) if getattr(one, "symbol", None) == symbol), None
    )


def _closer(
    problem: Problem, fits: Sequence[Fitted], *data: Sequence[Compared], run: str = "that run", without: float = 0.0
) -> str:
    """What would set hypotheses apart that no run does: one base parameter whose value were known more closely; "" if
    none would, or no further than without, in standard deviations."""
    keys = {key: one.symbol for key, one in base_parameters(problem.machine, problem.logged).items() if one.std == 1.0}
    apart = {key: _apart(problem, fits, *data, closer=symbol)[0] for key, symbol in keys.items()}
    key = max(apart, key=lambda key: apart[key], default="")
    if not key or apart[key] < max(APART, BETTER * without):
        return ""
    return (
        f"A closer tolerance is needed: with {key} known to {CLOSER:g} of it {run} would set them apart by "
        f"{apart[key]:.1f} standard deviations."
    )


def _why(question: Question, best: Offer) -> tuple[str, bool]:
    """What a run would decide, in words, and whether it may help at all, be it with a value known more closely."""
    problem, fits, now = question.problem, question.fits, question.now[0]
    names = [" + ".join(fit.effects) or "a machine without an effect" for fit in fits]
    *others, last = names[1:]
    rivals = f"{', '.join(others)} and {'over' if question.favoured else 'from'} {last}" if others else last
    load = f"a run with {best.planned.payload_kg:g} kg" if kind_of(problem.machine).payload else "a run"
    signals = f" and with {listed(best.signals)} logged" if best.signals else ""
    least = least_of(problem)
    begin = f"The campaign sets {names[0]} apart from {rivals} by {now:.1f} standard deviations"
    if now < 0.05:
        begin = f"The campaign does not set {names[0]} apart from {rivals}"
    if question.favoured:  # the likelihoods are apart: they are as good as the model is exact
        begin = (
            f"The runs favour {names[0]} over {rivals}, but set them apart by only {now:.1f} standard deviations where "
            f"differences below {figures(least * problem.noise, 2)} {kind_of(problem.machine).drive.unit} rms, "
            f"{figures(least, 2)} of the noise, count for nothing"
        )
    run, nothing = f"{load}, {best.planned.words}{signals},", best.separation < 0.05
    chance = best.chance
    decides = f"decide with a probability of {f'{100.0 * chance:.0f}' if chance < 0.995 else 'over 99'} %"
    # A freer law can be the simpler one: what decides between them is its price.
    by = "" if nothing else f"set them apart by {best.separation:.1f} standard deviations, and "
    if best.decides:
        return f"{begin}; {run} would {by}{decides}.", True
    if now >= APART:
        inexact = "of the noise: what the model may be off leaves them open, and a run is likely to do so, too"
        return f"{begin} {inexact}. The best, {run} would {by}{decides}.", True
    hopeless = nothing and chance < 0.005
    which = run if hopeless else "that run"
    closer = _closer(problem, fits, question.known, best.shown, run=which, without=best.separation)
    no_value = "No single value of the machine, known more closely, would either."
    if hopeless:
        return f"{begin}, and no run on the menu would. {closer or no_value}", bool(closer)
    return f"{begin}; no run on the menu decides. The best, {run} would {by}{decides}. {closer or no_value}", True
