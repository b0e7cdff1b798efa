"""The run that would decide between the open hypotheses, and by how much."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Any

import numpy as np

from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import Names, bounds_of
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import SearchResult
from workbench.diagnose.hypotheses.signatures import Projection, columns_signed, linear_gain, start_of
from workbench.diagnose.isolation.lines import Line, on_campaign, on_menu
from workbench.diagnose.isolation.planned import Planned, drawn, menu, planned_as, seen_in, varied
from workbench.machines import kind_of

LEAST = 0.35  # of the noise, rms: no model is more exact than that
APART = 3.0  # standard deviations: then a run decides
WORTH = 1.0  # more than now: less is not worth a run
DECIDED = math.log(20.0)  # of likelihoods: twenty to one
DRAWN, GENERATIONS = 8, 3  # motions that are simulated at once, and how often
BETTER = 1.03  # than the best before, to be taken
RIVALS = 3  # that the leading hypothesis is held against


@dataclass(frozen=True)
class NextRun:
    """The run that would decide between the open hypotheses.

    separation: distance of their predictions with this run, in standard deviations; now: without it; menu: with the
    best plain run that takes no longer, `plain`. decides: the probability that the likelihoods then differ by more than
    DECIDED. rivals: of the first hypothesis.
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
    """One entry of the menu: a run and what is logged beside the motors."""

    planned: Planned
    signals: tuple[str, ...]
    separation: float


def next_run(
    problem: Problem, search: SearchResult, open_effects: Sequence[Fitted | str | Names], settled: float = math.inf
) -> NextRun | None:
    """The cheapest run that separates the first open hypothesis from the others, or else the best one.

    For each planned run the predictions of the hypotheses are compared after base parameters and effects were
    refitted to all data within the tolerances. Differences below LEAST of the noise are ignored. Rivals that the
    campaign sets `settled` standard deviations apart already are left out. None if no rival is left, or if no run would
    set those that are so far apart.
    """
    fits = [fit for hypothesis in open_effects if (fit := _fit_of(problem, search, hypothesis)) is not None]
    campaign = [on_campaign(problem, fit) for fit in fits]
    near = [k for k in range(1, len(fits)) if _apart([fits[0], fits[k]], [campaign[0], campaign[k]], None) <= settled]
    kept = [0, *near[:RIVALS]]
    planned = menu(problem) if near else []
    if not planned:
        return None
    fits, campaign = [fits[k] for k in kept], [campaign[k] for k in kept]
    now = _apart(fits, campaign, None)
    ahead = Problem(problem.machine, [candidate.run for candidate in planned], problem.band_hz)
    trial = [on_menu(problem, ahead, fit) for fit in fits]
    logged = tuple(s for s in kind_of(problem.machine).to_log if all(s in run for run in problem.runs))
    offers: list[Offer] = []
    for signals in _choices(problem, logged):
        for k, candidate in enumerate(planned):
            lines = [of_run(k, signals) for of_run in trial]
            offers.append(Offer(candidate, signals, _apart(fits, campaign, lines)))
        if any(_decides(offer, now) for offer in offers):
            break
    plain = choose(offers, now)
    best = _designed(problem, fits, campaign, plain) if plain.separation > now else plain
    if settled < math.inf and best.separation <= settled:  # not all of them, perhaps the best one
        return next_run(problem, search, fits[:2], settled) if len(fits) > 2 else None
    return NextRun(
        _why(problem, fits, best, now, settled), best.planned.payload_kg, best.planned.words, best.signals,
        best.separation, now, plain.separation, chance_to_decide(best.separation), best.planned, plain.planned,
        tuple(fit.effects for fit in fits[1:]),
    )  # fmt: skip


def chance_to_decide(separation: float) -> float:
    """The probability that the log-likelihoods of two hypotheses `separation` standard deviations apart differ by more
    than DECIDED for the true one: their difference is normal with mean d²/2 and variance d²."""
    return NormalDist().cdf((0.5 * separation**2 - DECIDED) / separation) if separation > 0.0 else 0.0


def _designed(problem: Problem, fits: Sequence[Fitted], campaign: Sequence[Line], plain: Offer) -> Offer:
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
        ahead = Problem(problem.machine, [run.run for _, run in able], problem.band_hz)
        trial = [on_menu(problem, ahead, fit) for fit in fits]
        for k, (one, run) in enumerate(able):
            apart = _apart(fits, campaign, [of_run(k, plain.signals) for of_run in trial])
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


def _apart(fits: Sequence[Fitted], campaign: Sequence[Line], more: Sequence[Line] | None) -> float:
    """Standard deviations between the first hypothesis and its nearest rival, whichever of the two is true."""
    least = math.inf
    for k in range(1, len(fits)):
        for true, rival in ((0, k), (k, 0)):
            lines = [(campaign[true], campaign[rival])]
            if more is not None:
                lines.append((more[true], more[rival]))
            least = min(least, separation(fits[true], fits[rival], lines))
    return least


def separation(true: Fitted, rival: Fitted, lines: Sequence[tuple[Line, Line]]) -> float:
    """Standard deviations between the data of the true hypothesis and the rival that is refitted to them."""
    _, _, std = bounds_of(rival.free)
    own = sum(line.own.shape[1] for _, line in lines)
    size, at = len(rival.z) + own, len(rival.z)
    matrix, target = [np.hstack([np.diag(1.0 / std), np.zeros((len(std), own))])], [-rival.z / std]
    blocks = []
    for mine, its in lines:
        weight = math.sqrt(its.share)
        a = np.zeros((len(its.residual), size))
        a[:, : len(rival.z)] = weight * its.jacobian
        k = its.own.shape[1]
        a[:, at : at + k] = weight * its.own
        hold = np.zeros((k, size))
        hold[:, at : at + k] = np.diag(its.own_hold)
        at += k
        blocks.append((a, -weight * (its.residual - mine.residual), its))
        matrix += [a, hold]
        target += [blocks[-1][1], np.zeros(k)]
    a, b = np.concatenate(matrix), np.concatenate(target)
    size_of = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    step = np.linalg.lstsq(a / size_of, b, rcond=1e-10)[0] / size_of
    total = float(np.sum(((rival.z + step[: len(rival.z)]) / std) ** 2)) - true.prior
    for part, wanted, line in blocks:
        left = (part @ step - wanted) ** 2
        for channel in np.unique(line.channel):
            rows = line.channel == channel
            total += max(float(left[rows].sum()) - LEAST**2 * line.share * int(rows.sum()), 0.0)
    return math.sqrt(max(total, 0.0))


def _why(problem: Problem, fits: Sequence[Fitted], best: Offer, now: float, settled: float) -> str:
    names = [" with ".join(fit.effects) or "a machine without an effect" for fit in fits]
    rivals = names[1] if len(names) == 2 else f"{', '.join(names[1:-1])} and {names[-1]}"
    load = f"a run with {best.planned.payload_kg:g} kg" if kind_of(problem.machine).payload else "a run"
    signals = f" and with {' and '.join(best.signals)} logged" if best.signals else ""
    begin = f"The campaign sets {names[0]} apart from {rivals} by {now:.1f} standard deviations"
    if now < 0.05:
        begin = f"The campaign does not set {names[0]} apart from {rivals}"
    if settled < math.inf:  # the likelihoods are apart: they are as good as the model is exact
        begin = (
            f"The runs favour {names[0]} over {rivals}, but set them apart by only {now:.1f} standard deviations once "
            f"a model error of {LEAST:g} of the noise is allowed for"
        )
    if best.separation > APART:
        apart = f"{best.separation:.1f} standard deviations"
        sure = f"{100.0 * chance_to_decide(best.separation):.0f} %"
        return (
            f"{begin}; {load}, {best.planned.words}{signals}, would do so by {apart}, and decide twenty to one with a "
            f"probability of {sure}."
        )
    closer = "a closer tolerance is needed, such as a weighed load or a checked sensor."
    if best.separation < 0.05:
        return f"{begin}, and no run on the menu would: {closer}"
    return (
        f"{begin}; no run on the menu decides. The best, {load}, {best.planned.words}{signals}, would set them apart "
        f"by {best.separation:.1f} standard deviations: {closer}"
    )
