"""Whether a cause is worth its parameters beside one law of a single variable that nobody has written down.

    r = f(w) + B z + e,    f ~ GP(0, a^2 exp(-(w - w')^2 / 2 l^2)),    e as `simulate/model_error.py` has it
    q(f, a, l) = min over z of [r' S^-1 r + |z / tolerance|^2] + ln det (1 + a^2 K H' P H),    S = cov e + a^2 H K H'
    score(f) = -2 ln of the mean of exp(-q / 2) over a and l

f is a Gaussian process over one variable w of the motion (the same both ways, or another one each way), H its hats
between the knots of w, each of some a and l as likely as the others (C. E. Rasmussen, C. K. I. Williams, Gaussian
Processes for Machine Learning, 2006, 5.2); B z the parameters of a fit, linearised, and P takes out what they explain.
The determinant and the mean are what the freedom of f costs. Whatever the machine has beside a cause may follow such a
law, so f is on both sides:

    worth = score(f alone) - score(f beside the cause) - cost of the cause's parameters

and less what one gains by chance, the threshold, of a machine that leaves itself laws of its own; not beside a law of
the cause's own variable, which can be all of it, nor of an inertia beside one of another variable.

Beside the cause, B is that of the fit with it, or that of the fit without, whichever scores better: friction near
standstill turns over elsewhere in each, and a law that does without a cause may not live on that. A cause that is a
function of w itself, as a level of friction is of the speed, would else be given up to a law that can be all of it.
A level each way is no law of w at all, but what friction or an offset is declared as, and a slope over the
acceleration, or the load, is an inertia: of a machine that leaves itself laws of its own, f is without what such a
cause takes. A slope over another variable is none: to and fro a spring's force goes with the acceleration.

Beside other causes f is one more that was chosen of many, and pays for that as a listed one does. So whatever the form
of what an inexact law of theirs leaves, the next cause is credited with what it gains beside that alone.

A cause that comes again or goes with the time has a phase or a wave that bends to a slope or a bow over another
variable: then such an f alone is better than the cause alone, and does without most of what the cause takes, though the
rest may be worth a parameter; a true cause takes beside f about what it takes alone. A cause that bends is worth less
than nothing, by as much as f alone is better. A freer f is not asked: over the place it can be a true ripple, and what
else the machine has there. A cause that goes with the time has to be DECISIVE better than levels of friction of each
run, too: three or four runs of any machine differ, and lie near some exponential. Of twice as many runs as it has
values, a level among them, it may be so with levels beside it, which then differ less.

A true cause leaves less for f to take, or something that f cannot take, and is worth much. Several effects that only
imitate one law together (a bent sensor by gain, offset and friction with the load) are worth less than nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import logsumexp

from workbench.core.run import Array
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.evidence import Weighed, cost, price
from workbench.diagnose.hypotheses.fit import Fitted, parts_of
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.signatures import Projection
from workbench.diagnose.location.profiles import basis, forward, hats, variables
from workbench.machines import kind_of

LENGTHS = (0.5, 0.17, 0.06)  # of the variable's range: a slope or a bow; a hump; a step between knots
BENDING, FORCES = {"time", "periodic"}, {"acceleration", "load"}  # regimes
SIZES = tuple(np.geomspace(0.02, 10.0, 9))  # of the residual's rms


def worth(problem: Problem, base: Fitted, cause: Weighed, less: Fitted | None = None) -> tuple[float, str]:
    """The least that a hypothesis is worth beside a law of one variable, as evidence, and that variable in words.

    base: the fit without effects. less: a fit with some of the effects, if only the others are weighed.
    """
    less, rms = less or base, base.rms(problem.inputs)
    sized, more = problem.with_model_error(cause.score.sizes), len(cause.names) - max(len(less.effects), 1)
    paid = cost(problem, len(cause.fit.z) - len(less.z)) + price(problem.active.kind) * more
    its = price(problem.active.kind) if less.effects else 0.0
    alone, beside = (Projection.of(sized, fit) for fit in (less, cause.fit))
    added = [(name,) for name in cause.names if name not in less.effects]
    own, _ = np.linalg.qr(alone.clean(parts_of(problem, cause.fit, added).T))
    leaves_laws, single = kind_of(problem.machine).floor == "own", len(cause.names) == 1
    level, declared = (leaves_laws and _is_declared(problem, alone, own, slopes) for slopes in (False, single))
    chance = settings.THRESHOLD if leaves_laws and not less.effects else 0.0
    least = (np.inf, "")
    nothing, only = (float(one.residual @ one.residual) for one in (alone, beside))
    regimes = {problem.effect(name).regime for (name,) in added}
    bends = regimes <= BENDING
    for label, regime, shape, roots in _laws(problem, base):
        rows = np.column_stack([alone.clean(shape), alone.residual])
        taken = level or (declared and regime in FORCES)
        if taken:
            rows[:, :-1] -= own @ (own.T @ rows[:, :-1])
        there, here = np.column_stack([beside.clean(shape), beside.residual]), rows - own @ (own.T @ rows)
        one, both = _alone_and_beside((rows, there, here), roots, rms, its)
        by_chance = 0.0 if regime in regimes or (declared and not taken) else chance
        least = min(least, (one - both - paid - by_chance, label))
        if bends and regime not in regimes:
            one, both = _alone_and_beside((rows, there, here), roots[:1], rms, its)
            if one < only and one - both < settings.HALF * (nothing - only):
                least = min(least, (one - only, label))
    if regimes == {"time"}:
        runs = np.eye(len(problem.runs))
        levels = np.where(forward(problem), 1.0, -1.0)[:, None] * runs[problem.run_of_row[: problem.inputs]]
        shape = np.pad(levels, ((0, problem.samples - problem.inputs), (0, 0)))
        each = [np.column_stack([fit.clean(shape), fit.residual]) for fit in (alone, beside)]
        one, both = _alone_and_beside(each, [runs], rms, its)
        many = settings.HALF * len(np.unique(problem.run_of_row)) > len(cause.fit.z) - len(less.z)
        beside_levels = one - (both if many else only) - paid - settings.DECISIVE
        least = min(least, (min(one - only, beside_levels), "friction of each run"))
    return least


def _alone_and_beside(each: Sequence[Array], roots: list[Array], rms: float, price: float) -> tuple[float, float]:
    """The score of a law alone, and the better one of those beside the cause. each: so ordered, the residual last."""
    alone, *beside = (score(rows[:, :-1], rows[:, -1], roots, rms, price) for rows in each)
    return alone, min(beside)


def _is_declared(problem: Problem, alone: Projection, own: Array, single: bool) -> bool:
    """Whether what each of the causes explains, (rows, k) orthonormal, is mostly a level each way, and for a single one
    a slope over the acceleration: what a machine's friction, offset and inertia are declared as. Beside others a slope
    may be what an inexact law of theirs leaves, as a load that swings leaves beside a lag."""
    ahead, slopes = forward(problem), [v.at for v in variables(problem) if v.regime == "acceleration"]
    shape = np.stack([ahead, ~ahead, *(slopes if single else ())], axis=1).astype(float)
    base, _ = np.linalg.qr(alone.clean(np.pad(shape, ((0, problem.samples - problem.inputs), (0, 0)))))
    return float(np.min(np.linalg.eigvalsh(own.T @ base @ base.T @ own))) > settings.HALF


def _laws(problem: Problem, base: Fitted) -> Iterator[tuple[str, str, Array, list[Array]]]:
    """Of each variable: its label, its regime, hats (rows, k), and the square roots (k, k) of their correlation at
    each length; for a law that is the same both ways, then for one each way."""
    others = len(base.residual) - problem.inputs
    for v in variables(problem, base.residual[: problem.inputs]):
        if v.name == "direction":
            continue
        shape, _ = hats(v)
        knots = (v.edges[[0, -1]] if v.straight else v.edges)[: shape.shape[1]]
        apart = np.abs(knots[:, None] - knots) / float(np.ptp(v.edges))
        apart = np.minimum(apart, 1.0 - apart) if v.wraps else apart
        roots = [_root(np.exp(-0.5 * (apart / length) ** 2)) for length in LENGTHS]
        each_way = [np.asarray(np.kron(np.eye(2), root), dtype=float) for root in roots]
        for columns, its in ((shape, roots), (basis(problem, v)[0], each_way)):
            yield v.label, v.regime, np.pad(columns, ((0, others), (0, 0))), its


def _root(correlation: Array) -> Array:
    values, vectors = np.linalg.eigh(correlation)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def score(columns: Array, residual: Array, roots: list[Array], rms: float, price: float = 0.0) -> float:
    """Of a law with these columns (rows, k), whitened and clean as the residual (rows,) is, up to what all fits have:
    on average over its lengths and sizes, which nobody knows, and at its `price`; or without it."""
    gram, pull, fallen = columns.T @ columns, columns.T @ residual, []
    for root in roots:
        values, vectors = np.linalg.eigh(root.T @ gram @ root)
        energy = (vectors.T @ (root.T @ pull)) ** 2
        for size in SIZES:
            variance = (size * rms) ** 2
            spread = 1.0 + variance * np.maximum(values, 0.0)
            fallen.append(float(np.sum(variance * energy / spread - np.log(spread))))
    mean = float(logsumexp(0.5 * np.array(fallen))) - np.log(len(fallen))
    return float(residual @ residual) - max(2.0 * mean - price, 0.0)
