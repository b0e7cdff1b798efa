"""The run that would decide between the open hypotheses, and by how much."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby, product
from statistics import NormalDist
from typing import Any

import numpy as np

from workbench.core.numbers import figures
from workbench.core.run import Array
from workbench.diagnose.hypotheses.evidence import nested, same_but_freer
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import Names, base_parameters, bounds_of
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import SearchResult
from workbench.diagnose.hypotheses.signatures import Projection, columns_signed, linear_gain, start_of
from workbench.diagnose.isolation.lines import Ahead, Line, OnMenu, least_of, on_campaign, on_menu
from workbench.diagnose.isolation.planned import Planned, drawn, menu, planned_as, seen_in, varied
from workbench.machines import kind_of

APART = 3.0  # standard deviations: then a run decides
CLOSER = 0.1  # of a tolerance: a value that was measured for the question
WORTH = 1.0  # more than now: less is not worth a run
DECIDED = math.log(20.0)  # of likelihoods: twenty to one
DRAWN, GENERATIONS = 8, 3  # motions that are simulated at once, and how often
BETTER = 1.03  # than the best before, to be taken
RIVALS = 3  # that the leading hypothesis is held against


@dataclass(frozen=True)
class NextRun:
    """The run that would decide between the open hypotheses.

    separation: distance of their predictions with this run, in standard deviations; now: without it; menu: with the
    best plain run that takes no longer, `plain`. decides: the probability that it makes the likelihoods differ by more
    than DECIDED. rivals: of the first hypothesis.
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
    """One entry of the menu: a run and what is logged beside the motors. shown: what it shows of each pair."""

    planned: Planned
    signals: tuple[str, ...]
    separation: float
    shown: Sequence[Compared] = ()


@dataclass(frozen=True)
class Compared:
    """What the data of a run, or of the campaign, show of a true hypothesis and a rival.

    triangles: of each channel R of the QR decomposition of [the rival's Jacobian, its own values, the true prediction
    less the rival's], all that least squares ask of their rows. least: of each one the chi^2 that is ignored.
    own_hold: the rival's.
    """

    triangles: tuple[Array, ...]
    least: tuple[float, ...]
    own_hold: Array


def next_run(
    problem: Problem, search: SearchResult, open_effects: Sequence[Fitted | str | Names], settled: float = math.inf
) -> NextRun | None:
    """The cheapest run that separates the first open hypothesis from the others, or else the best one.

    For each planned run the predictions of the hypotheses are compared after base parameters and effects were
    refitted to all data within the tolerances. Differences below `least_of` the noise are ignored. Rivals that the
    campaign sets `settled` standard deviations apart already are left out. None if no rival is left, or if no run would
    set those that are so far apart.
    """
    fits = [fit for hypothesis in open_effects if (fit := _fit_of(problem, search, hypothesis)) is not None]
    campaign = [on_campaign(problem, fit) for fit in fits]
    rivals = range(1, len(fits))
    near = [k for k in rivals if _apart(problem, [fits[0], fits[k]], compared([campaign[0], campaign[k]])) <= settled]
    planned = sorted(menu(problem), key=lambda one: one.duration_s) if near else []
    if not planned:
        return None
    kept = [0, *near[:RIVALS]]
    fits, campaign = [fits[k] for k in kept], [campaign[k] for k in kept]
    logged = tuple(s for s in kind_of(problem.machine).to_log if all(s in run for run in problem.runs))
    by_length = [list(alike) for _, alike in groupby(planned, key=lambda one: one.duration_s)]
    trials: list[list[OnMenu]] = []  # of the runs of each length the hypotheses
    while True:
        known = compared(campaign[: len(fits)])
        now = _apart(problem, fits, known)
        offers: list[Offer] = []
        for signals, length in product(_choices(problem, logged), range(len(by_length))):
            if any(_decides(offer, now) for offer in offers):
                break
            if length == len(trials):
                trials.append(_ahead(problem, by_length[length], fits))
            for k, candidate in enumerate(by_length[length]):
                shown = compared([of_run(k, signals) for of_run in trials[length][: len(fits)]])
                offers.append(Offer(candidate, signals, _apart(problem, fits, known, shown)))
        plain = choose(offers, now)
        best = _designed(problem, fits, known, plain) if plain.separation > now else plain
        best, plain = (_stated(problem, fits, known, offer) for offer in (best, plain))
        if settled == math.inf or best.separation > settled:
            break
        if len(fits) == 2:
            return None
        fits = fits[:2]  # not all of them, perhaps the best one
    return NextRun(
        _why(problem, fits, known, best, now, settled), best.planned.payload_kg, best.planned.words, best.signals,
        best.separation, now, plain.separation, chance_to_decide(best.separation, now), best.planned, plain.planned,
        tuple(fit.effects for fit in fits[1:]),
    )  # fmt: skip


def _ahead(problem: Problem, planned: Sequence[Planned], fits: Sequence[Fitted]) -> list[OnMenu]:
    """Each hypothesis on planned runs; they share what base parameters change."""
    ahead = Ahead(problem.machine, [one.run for one in planned], problem.band_hz)
    return [on_menu(problem, ahead, fit) for fit in fits]


def _stated(problem: Problem, fits: Sequence[Fitted], known: Sequence[Compared], offer: Offer) -> Offer:
    """An offer with the separation that each hypothesis gives with base signatures of its own."""
    own = [_ahead(problem, [offer.planned], [fit])[0] for fit in fits]
    shown = compared([of_run(0, offer.signals) for of_run in own])
    return replace(offer, separation=_apart(problem, fits, known, shown), shown=shown)


def chance_to_decide(separation: float, now: float = 0.0) -> float:
    """The probability that a run makes the log-likelihoods of two hypotheses differ by more than DECIDED for the true
    one, which sets them `separation` standard deviations apart where the campaign has them `now` apart: what it adds is
    normal with mean d²/2 and variance d²."""
    d = math.sqrt(max(separation**2 - now**2, 0.0))
    return NormalDist().cdf((0.5 * d**2 - DECIDED) / d) if d > 0.0 else 0.0


def _designed(problem: Problem, fits: Sequence[Fitted], known: Sequence[Compared], plain: Offer) -> Offer:
    """A motion no longer than the plain one that sets the hypotheses further apart, found by a seeded random search and
    by varying the best; the plain one where that finds none."""
    rng, seen, best, design = np.random.default_rng(0), seen_in(problem), plain, None
    for _ in range(GENERATIONS):
        tried = drawn(problem, 4 * DRAWN, rng) if design is None else varied(problem, design, 4 * DRAWN, rng)
        able = [(one, run) for one in tried if (run := planned_as(problem, seen, one, plain.planned.duration_s))][
            :DRAWN
        ]
        if not able:
            break
        trial = _ahead(problem, [run for _, run in able], fits)
        for k, (one, run) in enumerate(able):
            apart = _apart(problem, fits, known, compared([of_run(k, plain.signals) for of_run in trial]))
            if apart > BETTER * best.separation:
                best, design = Offer(run, plain.signals, apart), one
    return best


def choose(offers: Sequence[Offer], now: float) -> Offer:
    """The cheapest offer that decides: fewest signals, then the shortest run; else the largest separation."""
    enough = [offer for offer in offers if _decides(offer, now)]
    if enough:
        return min(enough, key=lambda o: (len(o.signals), o.planned.duration_s, -o.separation))
    most = max(offer.separation for offer in offers)
    return min(
        (o for o in offers if o.separation >= 0.95 * most), key=lambda o: (len(o.signals), o.planned.duration_s)
    )  # fmt: skip


def _decides(offer: Offer, now: float) -> bool:
    return offer.separation > APART and offer.separation > now + WORTH


def _choices(problem: Problem, logged: tuple[str, ...]) -> list[tuple[str, ...]]:
    """The sets of signals to log beside the motors, cheapest first; signals that are logged already are kept."""
    every = [logged, *(tuple(sorted({*logged, more})) for more in kind_of(problem.machine).to_log)]
    return list(dict.fromkeys(every))


def _fit_of(problem: Problem, search: SearchResult, hypothesis: Fitted | str | Names) -> Fitted | None:
    """The fit of a hypothesis; if it was not refitted, its linear fit at the best shape."""
    if isinstance(hypothesis, Fitted):
        return hypothesis
    names = (hypothesis,) if isinstance(hypothesis, str) else tuple(hypothesis)
    if names in search.fits:
        return search.fits[names]
    if not names:
        return search.base
    if len(names) > 1:
        return None
    near = search.within_tolerances
    projection = Projection.of(problem, near)
    options = []
    for signature in search.signatures:
        if signature.effect.id == names[0]:
            columns = projection.clean(signature.columns)
            gain = linear_gain(columns, projection.residual, columns_signed(signature), projection.priors)
            options.append((gain[0] + gain[1], signature, gain[2]))
    if not options:
        return None
    _, signature, amounts = max(options, key=lambda q: q[0])
    more, start = start_of(problem, signature, amounts)
    free, z = (*near.free, *more), np.concatenate([near.z, start])
    residual, jacobian = problem.evaluate(free, z)
    chi2 = problem.share / problem.noise**2 * float(residual @ residual)
    return Fitted(names, free, z, residual, jacobian, chi2, near.prior, 1, False)


def _pairs(hypotheses: int) -> list[tuple[int, int]]:
    """(true, rival): the first one with each other, whichever of the two is true."""
    return [pair for k in range(1, hypotheses) for pair in ((0, k), (k, 0))]


def compared(lines: Sequence[Line]) -> list[Compared]:
    """Hypotheses on the same data, of each pair of `_pairs`."""
    found = []
    for mine, its in ((lines[true], lines[rival]) for true, rival in _pairs(len(lines))):
        rows = math.sqrt(its.share) * np.column_stack([its.jacobian, its.own, mine.residual - its.residual])
        channels = [rows[its.channel == channel] for channel in np.unique(its.channel)]
        triangles = tuple(np.asarray(np.linalg.qr(some, mode="r")) for some in channels)
        found.append(Compared(triangles, tuple(its.least**2 * its.share * len(r) for r in channels), its.own_hold))
    return found


def _apart(problem: Problem, fits: Sequence[Fitted], *data: Sequence[Compared], closer: str = "") -> float:
    """Standard deviations between the first hypothesis and its nearest rival, whichever of the two is true; but a rival
    with an effect more, or with a freer law that contains the other's, predicts whatever the other does: there the
    question is whether its amount is none, or the same both ways."""
    kind = problem.active.kind

    def contains(rival: Fitted, true: Fitted) -> bool:
        more, less = set(rival.effects) - set(true.effects), set(true.effects) - set(rival.effects)
        if len(more) == len(less) == 1:
            (freer,), (simpler,) = more, less
            return same_but_freer(freer, simpler, kind) and nested(freer, simpler, kind)
        return bool(more) and not less

    pairs = zip(_pairs(len(fits)), zip(*data, strict=True), strict=True)
    asked = ((fits[true], fits[rival], shown) for (true, rival), shown in pairs)
    return min((separation(*of, closer) for of in asked if not contains(of[1], of[0])), default=math.inf)


def separation(true: Fitted, rival: Fitted, data: Sequence[Compared], closer: str = "") -> float:
    """Standard deviations between the data of the true hypothesis and the rival that is refitted to them. closer: the
    symbol of a base parameter that is known to CLOSER of its tolerance, at its true value."""
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
    total = left[0] - prior + sum(max(a - b, 0.0) for a, b in zip(left[1:], least, strict=True))
    return math.sqrt(max(total, 0.0))


def _place_of(fit: Fitted, symbol: str) -> int | None:
    """The index in z of a base parameter, None where the fit has none."""
    first = np.cumsum([0, *(parameter.size for parameter in fit.free)])
    return next(
        (int(k) for k, one in zip(first, fit.free, strict=False) if getattr(one, "symbol", None) == symbol), None
    )


def _closer(problem: Problem, fits: Sequence[Fitted], *data: Sequence[Compared], run: str = "that run") -> str:
    """What would set hypotheses apart that no run does: one base parameter whose value were known more closely."""
    keys = {key: one.symbol for key, one in base_parameters(problem.machine, problem.runs).items() if one.std == 1.0}
    apart = {key: _apart(problem, fits, *data, closer=symbol) for key, symbol in keys.items()}
    key = max(apart, key=lambda key: apart[key], default="")
    if not key or apart[key] < APART:
        return "No single value of the machine, known more closely, would either."
    return (
        f"A closer tolerance is needed: with {key} known to {CLOSER:g} of it {run} would set them apart by "
        f"{apart[key]:.1f} standard deviations."
    )


def _why(
    problem: Problem, fits: Sequence[Fitted], known: Sequence[Compared], best: Offer, now: float, settled: float
) -> str:
    names = [" and ".join(fit.effects) or "a machine without an effect" for fit in fits]
    rivals = names[1] if len(names) == 2 else f"{', '.join(names[1:-1])} and from {names[-1]}"
    load = f"a run with {best.planned.payload_kg:g} kg" if kind_of(problem.machine).payload else "a run"
    signals = f" and with {' and '.join(best.signals)} logged" if best.signals else ""
    least = least_of(problem)
    begin = f"The campaign sets {names[0]} apart from {rivals} by {now:.1f} standard deviations"
    if now < 0.05:
        begin = f"The campaign does not set {names[0]} apart from {rivals}"
    if settled < math.inf:  # the likelihoods are apart: they are as good as the model is exact
        begin = (
            f"The runs favour {names[0]} over {rivals}, but set them apart by only {now:.1f} standard deviations where "
            f"differences below {figures(least * problem.noise, 2)} {kind_of(problem.machine).drive.unit} rms, "
            f"{figures(least, 2)} of the noise, count for nothing"
        )
    if _decides(best, now):
        apart = f"{best.separation:.1f} standard deviations"
        sure = f"{100.0 * chance_to_decide(best.separation, now):.0f} %"
        return (
            f"{begin}; {load}, {best.planned.words}{signals}, would do so by {apart}, and decide twenty to one with a "
            f"probability of {sure}."
        )
    run, nothing = f"{load}, {best.planned.words}{signals},", best.separation < 0.05
    closer = _closer(problem, fits, known, best.shown, run=run if nothing else "that run")
    if nothing:
        return f"{begin}, and no run on the menu would. {closer}"
    return (
        f"{begin}; no run on the menu decides. The best, {run} would set them apart by {best.separation:.1f} standard "
        f"deviations. {closer}"
    )
