"""Which effects a campaign can discriminate, and the smallest amount of each that it can show."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from workbench.core.names import listed
from workbench.core.run import Array
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.evidence import cost, independent
from workbench.diagnose.hypotheses.free_parameters import Names
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import SearchResult
from workbench.diagnose.hypotheses.signatures import Projection, Signature


@dataclass(frozen=True)
class Isolability:
    """Angles between signatures, degrees, after the base parameters are projected out. names: (k,), angle: (k, k).

    visible: the smallest amount of each effect that this campaign can show, in its first parameter's unit.
    """

    names: Names
    angle: Array
    visible: Mapping[str, tuple[str, float]]
    sentences: tuple[str, ...]


ALIKE_DEG = 10.0
APART = 3.0  # standard deviations, between the fits of two effects
SPECIAL = 1e-3  # of a projected: less than this outside another is none
NOTHING = 1e-9  # of a column's size: what the base parameters take away whole


@dataclass(frozen=True)
class Projected:
    """An effect at its best shape: its signature, and its columns without the part of the base parameters,
    (samples + priors, k)."""

    signature: Signature
    columns: Array
    gain: float
    merit: float


def isolability(problem: Problem, search: SearchResult) -> Isolability:
    """Angles between the effects' signatures, the base parameters projected out with tolerances as priors.

    The angle is the smallest one between the two signatures' spaces (A. Bjorck, G. H. Golub, Mathematics of
    Computation 27, 1973): at 0 an amount of one effect has exactly the projected of an amount of the other.
    """
    n = independent(problem)
    projection = Projection.of(problem, search.within_tolerances)
    best = best_signatures(projection, search.signatures, n)
    names = tuple(best)
    spaces = [_space(best[name].columns) for name in names]
    angle = np.zeros((len(names), len(names)))
    for i, a in enumerate(spaces):
        for j, b in enumerate(spaces[:i]):
            angle[i, j] = angle[j, i] = angle_between(a, b)
    visible = {name: _visible(projected, projection.priors, n) for name, projected in best.items()}
    return Isolability(names, angle, visible, tuple(_sentences(best, angle, search, projection.priors, n)))


def best_signatures(projection: Projection, signatures: Iterable[Signature], n: float) -> dict[str, Projected]:
    """Effect -> its signature at the shape that fits the data best."""
    best: dict[str, Projected] = {}
    shown = [one for one in signatures if np.any(np.abs(one.columns) > 0.0)]  # not a place that no run has passed
    for signature, (data, prior, _) in zip(shown, projection.gains(shown), strict=True):
        worth = data + prior - (signature.columns.shape[1] + len(signature.at)) * math.log(max(n, 2.0))
        name = signature.effect.id
        if name not in best or worth > best[name].merit:
            best[name] = Projected(signature, projection.clean(signature.columns), data + prior, worth)
    return best


def _space(columns: Array) -> Array:
    """Orthonormal columns of the same span; directions with negligible singular values are dropped."""
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(u[:, s > NOTHING * max(float(s[0]), 1e-300)], dtype=float)


def angle_between(a: Array, b: Array) -> float:
    """The smallest angle, degrees, between two spaces given by orthonormal columns; 90 for an empty one."""
    if not a.shape[1] or not b.shape[1]:
        return 90.0
    small, large = (a, b) if a.shape[1] <= b.shape[1] else (b, a)
    overlap = large.T @ small
    _, s, v = np.linalg.svd(overlap, full_matrices=False)
    if s[0] < math.sqrt(0.5):
        return math.degrees(math.acos(min(float(s[0]), 1.0)))
    # Near 0 the cosine says nothing; what of the nearest direction lies outside the other space does.
    away = small @ v[0] - large @ (overlap @ v[0])
    return math.degrees(math.asin(min(float(np.linalg.norm(away)), 1.0)))


def _visible(projected: Projected, priors: int, n: float) -> tuple[str, float]:
    """The first parameter's smallest distance from its vanishing value at which the effect would be named."""
    wave = projected.signature.wave is not None
    if wave:  # the quadratures of all runs, a mean over phases
        squares = np.sum(projected.columns**2, axis=1) / 2.0
    else:  # all amounts alike, each on its own scale
        squares = np.sum(projected.columns, axis=1) ** 2
    data, prior = float(np.sum(squares[:-priors])), float(np.sum(squares[-priors:]))
    parameters = projected.columns.shape[1] + len(projected.signature.at)
    amount = smallest_amount(data, prior, parameters, n)
    return projected.signature.amounts[0].name, amount * abs(projected.signature.scale[0])


def smallest_amount(data: float, prior: float, parameters: int, n: float) -> float:
    """The amount a at which a² (data + prior) equals the cost of its parameters; inf if the effect never shows."""
    worth = parameters * math.log(max(n, 2.0))
    return math.sqrt(worth / (data + prior)) if data + prior > 0.0 else math.inf


def _sentences(best: Mapping[str, Projected], angle: Array, search: SearchResult, priors: int, n: float) -> list[str]:
    names, out = list(best), []
    for group in groups(separations(best, priors, n), APART):
        members = [names[k] for k in group]
        widest = max(float(angle[i, j]) for i in group for j in group)
        out.append(
            f"This campaign cannot tell small amounts of {listed(members)} apart: twice what would just be visible "
            f"of one passes for the other{'s' if len(group) > 2 else ''} within noise and tolerances"
            + (f" (signatures within {max(widest, 0.1):.2g} degrees)." if widest < ALIKE_DEG else ".")
        )
    return [*out, *_near_the_best(search, n)]


def separations(best: Mapping[str, Projected], priors: int, n: float) -> Array:
    """(k, k) distances between effects in standard deviations: one at twice its smallest visible amount, the other
    fitted to it as closely as possible.

    inf if one effect is a special case of the other: no campaign tells these apart; the simpler one is preferred.
    """
    signatures = list(best.values())
    spaces, raw = [_space(one.columns) for one in signatures], [_space(one.signature.columns) for one in signatures]
    apart = np.full((len(signatures), len(signatures)), np.inf)
    for i, one in enumerate(signatures):
        vector = _twice_visible(one, priors, n)
        for j in range(len(signatures)):
            small, large = sorted((raw[i], raw[j]), key=lambda space: space.shape[1])  # base values not projected out
            part = small.shape[1] < large.shape[1] and np.linalg.norm(small - large @ (large.T @ small)) < SPECIAL
            if i != j and not part:
                apart[i, j] = _distance(vector - spaces[j] @ (spaces[j].T @ vector), priors, n)
    return np.asarray(np.maximum(apart, apart.T), dtype=float)


def _distance(away: Array, priors: int, n: float) -> float:
    """The size of a difference in standard deviations of data and tolerances."""
    data, prior = float(np.sum(away[:-priors] ** 2)), float(np.sum(away[-priors:] ** 2))
    return math.sqrt(max(data, 0.0) + prior)


def _twice_visible(projected: Projected, priors: int, n: float) -> Array:
    """(samples + priors,) the projected at twice its smallest visible amount; of a wave at phase 0 in every run."""
    columns = projected.columns[:, ::2] if projected.signature.wave is not None else projected.columns
    vector = np.sum(columns, axis=1)
    data, prior = float(np.sum(vector[:-priors] ** 2)), float(np.sum(vector[-priors:] ** 2))
    amount = smallest_amount(data, prior, projected.columns.shape[1] + len(projected.signature.at), n)
    return np.asarray(vector * (2.0 * amount), dtype=float) if math.isfinite(amount) else np.zeros(len(vector))


def _near_the_best(search: SearchResult, n: float) -> list[str]:
    """The single effects that fit nearly as well as the best one, with their distance in standard deviations."""
    singles = sorted((n for n in search.fits if len(n) == 1), key=lambda n: search.fits[n].objective)
    if not singles:
        return []
    best = search.fits[singles[0]]
    worth = search.base.objective - best.objective - cost(search.problem, len(best.z) - len(search.base.z))
    if worth <= settings.THRESHOLD:
        return []
    near = []
    for names in singles[1:]:
        other = search.fits[names]
        data = other.chi2 - best.chi2
        worse = math.sqrt(max(data + other.prior - best.prior, 0.0))
        if worse < APART:
            near.append(f"{names[0]} ({worse:.1f})")
    if not near:
        return []
    return [
        f"With the amount found, noise and tolerances leave open beside {singles[0][0]}: {', '.join(near)}; in "
        "parentheses how many standard deviations worse each fits."
    ]


def groups(apart: Array, limit: float) -> list[list[int]]:
    """Indices that all lie within `limit` of each other, nearest pairs first; each in one group only."""
    pairs = sorted((float(apart[i, j]), i, j) for i in range(len(apart)) for j in range(i))
    taken: dict[int, list[int]] = {}
    for size, i, j in pairs:
        if size >= limit:
            break
        a, b = taken.get(i, [i]), taken.get(j, [j])
        if a is not b and all(apart[x, y] < limit for x in a for y in b):
            joined = sorted([*a, *b])
            taken |= dict.fromkeys(joined, joined)
    unique = {id(group): group for group in taken.values()}
    return sorted(unique.values())
