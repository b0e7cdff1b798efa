"""What speaks for a cause that no hypothesis holds: a residual with structure, and tolerances stretched beyond chance.

Every real machine leaves a residual that no lumped model has: resonances, a controller's cycle, slow wear. A cause
shows as a residual that repeats in the same state of the machine, as an impact within a few moments, as friction that
changes its level at one moment of a run and keeps it, or as an offset that wanders from one half run to the next. And a
wrong hypothesis may leave no residual at all, because the base parameters absorb the rest: then only their distance
from nominal counts against it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.evidence import Score
from workbench.diagnose.hypotheses.fit import Fitted, parts_of
from workbench.diagnose.hypotheses.free_parameters import bounds_of, logarithmic_of
from workbench.diagnose.hypotheses.problem import Problem, once, rms
from workbench.diagnose.hypotheses.signatures import Projection
from workbench.diagnose.location.profiles import spacing
from workbench.diagnose.location.where import laws_left
from workbench.diagnose.verdict.answer import Left
from workbench.diagnose.verdict.constancy import by_halves
from workbench.logs.doubts import dead_band
from workbench.machines import kind_of
from workbench.simulate.motion import PLAY

AGAIN = 2.0  # as evidence: what comes again with twice its own size is as much as a model error of seven times its size
UNHEARD = 10.0  # as evidence: impacts that come again, and a hypothesis without play
MOMENTS = 0.02  # of the rows
AT_SPEED = 0.1  # of the largest of the run: slower is near standstill
SHORTEST = 0.05  # of a run's rows, before and behind a change that lasts
LASTING = 0.2  # of the energy: machines without such a change show up to 0.17
LOUD = 0.3  # of the energy, in MOMENTS of the rows: 0.13 of normal noise, some more of what is loud now and then
HEAVIEST = 12.0  # logarithm of the tolerances' weight: nothing is left of any deviation
HALVED = 40  # times


def signs_of(
    problem: Problem, base: Fitted, held: Fitted, score: Score, left: Left, share: float, relieved: bool = False
) -> dict[str, float]:
    """What speaks for a cause that no hypothesis holds, each 0 where nothing does.

    base: the fit without effects; held: that of the answer, which explains `share` of the gap's energy. relieved:
    whether a cause takes the stretch off the tolerances that is not to be named.
    left: the logarithm of the model error that it needs, over the default, in full where it leaves FORETOLD of that
    energy, less where less; or what speaks from a log that keeps its values (`kept_percent`). prior: the distance of
    the base parameters from nominal beyond chance and beyond what an inexact effect explains, in standard deviations
    above BY_CHANCE (see `tolerance_excess`). A machine that leaves nothing itself is held to its tolerances in full by
    a cause that base parameters could take up; one with a remainder the less, the more of the gap the cause takes.
    """
    if problem.struck:  # what stays beside an impact are its rebounds, which no law foretells
        return {"left": 0.0 if PLAY in held.effects else UNHEARD, "prior": 0.0}
    open_share, bent = 1.0, 0.0
    if held.effects:
        open_share, rms = min((1.0 - share) / settings.FORETOLD, 1.0), max(held.rms(problem.inputs), 1e-300)
        # A law that takes much off the gap is inexact, by LAW of what it takes: it bends the base parameters, as does
        # what the machine leaves itself.
        if kind_of(problem.machine).floor == "own":
            taken = settings.LAW**2 * share / max(1.0 - share, 1e-3)
            bent = (taken + settings.FORETOLD * max(1.0 - (problem.noise / rms) ** 2, 0.0)) * held.chi2
        else:
            bent = settings.LAW**2 * max((base.rms(problem.inputs) / rms) ** 2 - 1.0, 0.0) * held.chi2
    return {
        "left": max(
            open_share * _unexplained(problem, held, left, score.excess), AGAIN * beyond(kept_percent(problem))
        ),
        "prior": max(tolerance_excess(problem, held, bent) - settings.BY_CHANCE[relieved or bool(held.effects)], 0.0),
    }


def _unexplained(problem: Problem, held: Fitted, left: Left, excess: float) -> float:
    """The evidence in the remaining residual: the logarithm of the model error's excess, scaled by its relevance; of a
    hoist, which leaves no law itself, or that of a law of one variable that holds on other runs (`laws_left`).

    An axis has ripple and resonances, and friction near standstill, that no cause explains. There the residual at speed
    counts above OWN of the largest input, a part within a few moments above OWN_SUDDEN. And what follows a law of one
    variable on runs that the law was not fitted to (`laws_left`), or sets in and stays, or wanders, counts where it is
    more than OWN_LAW of the input's rms: a random model error does none of these.
    """
    many = max(math.log(excess), 0.0)
    laws = [law for law in laws_left(problem, held) if law.interval[0] > settings.FORETOLD]
    if kind_of(problem.machine).floor == "sensors":
        by_law = max((100.0 * rms(law.part) / max(input_rms(problem), 1e-300) for law in laws), default=0.0)
        size, law = (min((x / settings.RELEVANT_PERCENT) ** 2, 1.0) for x in (left.percent_of_input, by_law))
        return max(many * size, AGAIN * law)
    largest = max(float(np.max(np.abs(u))) for u in problem.bench.measured)
    energy, inputs = held.residual[: problem.inputs] ** 2, slice(0, problem.inputs)
    at_speed = float(problem.errors.at_speed[inputs] @ energy) / max(float(np.sum(energy)), 1e-300)
    beyond_own = min(max(left.rms * math.sqrt(at_speed) / (settings.OWN * largest) - 1.0, 0.0), 1.0)
    sudden = left.rms * math.sqrt(sudden_share(problem, held.residual)) / (settings.OWN_SUDDEN * largest)
    shares = [law.share for law in laws]
    lawful = max([lasting_share(problem, held.residual), wandering_share(problem, held.residual), *shares])
    again = max(left.percent_of_input * math.sqrt(lawful), sudden * settings.OWN_LAW)
    return max(many * beyond_own, AGAIN * beyond(again))


def beyond(percent: float) -> float:
    """0 to 1, of per cent of the input's rms: how far it is beyond OWN_LAW."""
    return min(max(percent / settings.OWN_LAW - 1.0, 0.0), 1.0)


def kept_percent(problem: Problem) -> float:
    """Of the input's rms: what a log hides that keeps a value until it has left a dead band, evenly spread over it."""
    bands = [dead_band(run[name]) for run in problem.runs for name in kind_of(problem.machine).inputs if name in run]
    return 100.0 * max(bands, default=0.0) / math.sqrt(3.0) / max(input_rms(problem), 1e-300)


def input_rms(problem: Problem) -> float:
    """The rms of the measured input while the machine moves, in its unit."""
    parts = [u[rows] for u, rows in zip(problem.bench.measured, problem.rows, strict=True)]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def beyond_noise(problem: Problem, residual_rms: float, noise: float) -> Left:
    """What a residual leaves beyond the noise, or the floor that is allowed for."""
    rms = math.sqrt(max(residual_rms**2 - noise**2, 0.0))
    percent = 100.0 * rms / max(input_rms(problem), 1e-300)
    return Left(rms, percent, percent > settings.RELEVANT_PERCENT)


def sudden_share(problem: Problem, residual: Array) -> float:
    """Of the energy of the input's residual (samples,), 0 to 1: what the loudest MOMENTS of its rows hold beyond LOUD,
    of those at speed. Near standstill a machine is loud for a moment at each reversal, by its friction."""
    at_speed = [
        np.abs(motion.speed[at]) > AT_SPEED * np.max(np.abs(motion.speed[at]), initial=0.0)
        for motion, at in zip(problem.bench.motions, problem.rows, strict=True)
    ]
    rows = residual[: problem.inputs]
    energy = np.sort(rows[np.concatenate(at_speed)] ** 2)
    loudest = energy[-max(int(MOMENTS * len(energy)), 1) :]
    share = float(np.sum(loudest)) / max(float(np.sum(energy)), 1e-300)
    of_all = float(np.sum(energy)) / max(float(rows @ rows), 1e-300)
    return max((share - LOUD) / (1.0 - LOUD), 0.0) * of_all


def lasting_share(problem: Problem, residual: Array) -> float:
    """Of the energy of the input's residual (samples,), 0 to 1: what friction takes off it whose level changes once in
    each run, at its best moment, beyond LASTING, as much as a slow model error looks like that by chance."""
    start, taken = 0, 0.0
    for motion, at in zip(problem.bench.motions, problem.rows, strict=True):
        along = residual[start : start + len(at)] * np.sign(motion.speed[at])
        start += len(at)
        least = max(int(SHORTEST * len(at)), 1)
        if len(at) <= 2 * least:
            continue
        before, total, count = np.cumsum(along)[least - 1 : -least], float(np.sum(along)), len(at)
        rows = np.arange(least, count - least + 1)
        changed = before**2 / rows + (total - before) ** 2 / (count - rows) - total**2 / count
        taken += float(np.max(changed))
    energy = float(residual[: problem.inputs] @ residual[: problem.inputs])
    share = taken / energy if energy > 0.0 else 0.0
    return max((share - LASTING) / (1.0 - LASTING), 0.0)


def wandering_share(problem: Problem, residual: Array) -> float:
    """Of the energy of the input's residual (samples,), 0 to 1: what an offset takes off it that is another one in each
    half of each run, beyond chance and LASTING."""
    rows = residual[: problem.inputs]
    share = by_halves(problem, np.ones(problem.inputs), rows) / max(float(spacing(problem) @ rows**2), 1e-300)
    return max((share - LASTING) / (1.0 - LASTING), 0.0)


def tolerance_excess(problem: Problem, fit: Fitted, allowed: float = 0.0) -> float:
    """The base parameters' distance from nominal, all together, in standard deviations beyond chance.

    allowed: by how much chi^2 of the data may rise for parameters nearer to nominal: an effect is no exact image of
    what the machine has, and what it misses bends the base parameters.

    A parameter that the data do not determine stays at its nominal value, whatever the true one. So true values drawn
    from the tolerances come back, in tolerances, with the covariance I - P, P the one that the data leave. The sum of
    their squares is then like chi^2 of fewer degrees than there are parameters: of as many as the data determine. How
    steeply friction turns over at standstill has no tolerance and does not count.
    """
    _, _, std = bounds_of(fit.free)
    hold = np.where(np.isfinite(std), 1.0 / std, 0.0)
    which = np.flatnonzero(np.isfinite(std) & ~logarithmic_of(fit.free))
    if not len(which):
        return 0.0
    white = problem.errors.whiten(np.column_stack([fit.jacobian, fit.residual]))
    data = white[:, :-1].T @ white[:, :-1]
    information = data + np.diag(hold**2)
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    left = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)
    determined = np.eye(len(which)) - (left * np.outer(hold, hold))[np.ix_(which, which)]
    shares = np.clip(np.linalg.eigvalsh(determined), 1e-9, 1.0)
    # A sum of squares of unequal variances, as chi^2 of the same mean and variance (F. E. Satterthwaite, Biometrics
    # Bulletin 2, 1946), in standard deviations (R. A. Fisher's sqrt(2 chi^2) - sqrt(2 k - 1)).
    unit = float(np.sum(shares**2) / np.sum(shares))
    pull = white[:, :-1].T @ white[:, -1]
    off = ((fit.z + _nearer(data, pull, fit.z, hold, scale, allowed)) * hold)[which]
    return math.sqrt(2.0 * float(off @ off) / unit) - math.sqrt(max(2.0 * float(np.sum(shares)) / unit - 1.0, 0.0))


def _nearer(data: Array, pull: Array, z: Array, hold: Array, scale: Array, allowed: float) -> Array:
    """The step from z to the parameters nearest to nominal at which chi^2 of the data, 2 pull step + step' data step
    above that at z, has risen by `allowed`."""

    def step(log_weight: float) -> Array:
        weight = math.exp(log_weight) * hold**2
        matrix = (data + np.diag(weight)) / np.outer(scale, scale)
        return np.asarray(np.linalg.lstsq(matrix, -(pull + weight * z) / scale, rcond=1e-12)[0] / scale)

    low, high = 0.0, HEAVIEST
    if allowed <= 0.0:
        return np.zeros(len(z))
    for _ in range(HALVED):
        middle = 0.5 * (low + high)
        there = step(middle)
        if 2.0 * float(pull @ there) + float(there @ data @ there) > allowed:
            high = middle
        else:
            low = middle
    return step(low)


def cancellation(problem: Problem, fit: Fitted, base: int) -> float:
    """The cancellation between the effects of a fit: the logarithm of the energy of their shares over that of the sum;
    0 where they add, and for one effect.

    Real causes are independent: their shares of the residual are mostly orthogonal, and add as often as they cancel.
    Two effects that together imitate a third explain the same part of it and cancel in the rest. base: how many of the
    fit's first z are the base parameters'. What these could explain of a share is taken out.
    """
    if len(fit.effects) < 2:
        return 0.0

    def found() -> float:
        parts = parts_of(problem, fit, [(name,) for name in fit.effects])
        first = int(np.searchsorted(np.cumsum([parameter.size for parameter in fit.free]), base)) + 1
        plain = replace(fit, free=fit.free[:first], z=fit.z[:base], jacobian=fit.jacobian[:, :base])
        return cancelled(Projection.of(problem, plain).clean(parts.T))

    return once(problem, (fit, "cancellation", problem.errors.sizes), found)


def cancelled(shares: Array) -> float:
    """The cancellation of shares, (rows, effects)."""
    apart, together = float(np.sum(shares**2)), float(np.sum(np.sum(shares, axis=1) ** 2))
    return max(math.log(max(apart, 1e-300) / max(together, 1e-12 * apart, 1e-300)), 0.0)
