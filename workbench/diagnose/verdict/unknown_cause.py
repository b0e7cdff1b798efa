"""What speaks for a cause that no hypothesis holds: a residual that is foretold, tolerances stretched beyond chance.

Every real machine leaves a residual that no lumped model has: resonances, a controller's cycle, slow wear. A cause
shows as a residual that a law of one variable foretells on runs that it was not fitted to, and on a machine that leaves
little itself by its size alone. And the base parameters may absorb it: then their distance from nominal tells of it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.fit import Fitted, parts_of
from workbench.diagnose.hypotheses.free_parameters import bounds_of, logarithmic_of
from workbench.diagnose.hypotheses.problem import Problem, once, rms
from workbench.diagnose.hypotheses.signatures import Projection
from workbench.diagnose.location.places import event_gain, event_threshold
from workbench.diagnose.location.profiles import spacing
from workbench.diagnose.location.where import laws_left
from workbench.diagnose.verdict.answer import Left, logistic_argument
from workbench.diagnose.verdict.constancy import by_halves
from workbench.logs.doubts import dead_band
from workbench.machines import kind_of


def signs_of(problem: Problem, near: Fitted, left: Left) -> dict[str, float]:
    """What speaks for a cause that no hypothesis holds where none is established, each over its limit, at which such a
    cause is as likely as not: `left`, see `left_percent`, and `stretched`.

    near: the fit without effects, left: what it leaves. MINOR of the input is over the limit, whatever tells of it: the
    equation is not this machine's (recorded ones leave 0.3 to 11 %). So are brief events, which no law of the motion
    foretells, that are more than DECISIVE in the logarithm likelier than none: what a machine leaves has longer tails
    than a normal distribution; on a machine whose whole residual counts it takes twice as much
    (`event_threshold`). Impacts that come again are a play's: beside them are their rebounds, which no law foretells.
    """
    if problem.struck:
        return {"left": settings.IMPACTS, "prior": 0.0}
    of_input, limit = left.percent_of_input / (100.0 * settings.MINOR), event_threshold(problem)
    known = max(left_percent(problem, near, left) / own_percent(problem), of_input)
    all_said = logistic_argument({"left": known}, {"unknown_bias": 1.0}) <= -1.0
    events = 0.0 if all_said else event_gain(problem, near, limit * known**2)  # those that say less change nothing
    return {"left": max(known, math.sqrt(max(events, 0.0) / limit)), **stretched(problem, near)}


def stretched(problem: Problem, fit: Fitted) -> dict[str, float]:
    """What speaks for an unknown cause, beside an established one too: `prior`, how far a fit has the base parameters
    from nominal beyond chance (`tolerance_excess`), over NUISANCE. A true cause brings them back, on any machine."""
    return {"prior": max(tolerance_excess(problem, fit), 0.0) / settings.NUISANCE}


def stays_beside(problem: Problem, base: Fitted, fit: Fitted, left: Left) -> dict[str, float]:
    """What speaks for an unknown cause beside an established one: `left`, the lesser of what stays over its limit and
    of its share of what the cause takes over HALF, both rms. Of a machine that leaves itself nothing a true cause
    takes nearly all, and a part of another one does not. Any other may leave anything: that is a remainder.

    base: the fit without effects as far as it goes: what base parameters can take is no cause's. left: what stays.
    """
    if kind_of(problem.machine).floor == "own":
        return {}
    taken = base.rms(problem.inputs) ** 2 - fit.rms(problem.inputs) ** 2
    share = left.rms / (settings.HALF * math.sqrt(max(taken, 1e-300)))
    return {"left": min(left.percent_of_input / own_percent(problem), share)}


def left_percent(problem: Problem, fit: Fitted, left: Left) -> float:
    """Of the input's rms: the most that a law of one variable foretells of the residual, on runs that it was not fitted
    to (`laws_left`), that an offset of each half of each run takes, beyond chance, for a sensor that wanders, or that a
    log hides (`kept_percent`); of a machine that its sensors limit, all that is left.

    Any other machine has ripple and resonances, and friction near standstill, that no cause explains.
    """
    rows, weight = fit.residual[: problem.inputs], spacing(problem)
    wanders = by_halves(problem, np.ones(problem.inputs), rows) - settings.FORETOLD * float(weight @ rows**2)
    laws = [law for law in laws_left(problem, fit) if law.interval[0] > settings.FORETOLD]
    sizes = [math.sqrt(max(wanders, 0.0) / float(np.sum(weight))), *(rms(law.part) for law in laws)]
    told = max(100.0 * max(sizes) / max(input_rms(problem), 1e-300), kept_percent(problem))
    return told if kind_of(problem.machine).floor == "own" else max(told, left.percent_of_input)


def own_percent(problem: Problem) -> float:
    """Of the input's rms: what a machine may leave of a law, and with sensors that limit it at all, without a cause."""
    return settings.RELEVANT_PERCENT if kind_of(problem.machine).floor == "sensors" else settings.OWN_PERCENT


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


def tolerance_excess(problem: Problem, fit: Fitted) -> float:
    """The base parameters' distance from nominal, all together, in standard deviations beyond chance.

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
    white = problem.errors.whiten(fit.jacobian)
    information = white.T @ white + np.diag(hold**2)
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    left = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)
    determined = np.eye(len(which)) - (left * np.outer(hold, hold))[np.ix_(which, which)]
    shares = np.clip(np.linalg.eigvalsh(determined), 1e-9, 1.0)
    # A sum of squares of unequal variances, as chi^2 of the same mean and variance (F. E. Satterthwaite, Biometrics
    # Bulletin 2, 1946), in standard deviations (R. A. Fisher's sqrt(2 chi^2) - sqrt(2 k - 1)).
    unit = float(np.sum(shares**2) / np.sum(shares))
    off = (fit.z * hold)[which]
    return math.sqrt(2.0 * float(off @ off) / unit) - math.sqrt(max(2.0 * float(np.sum(shares)) / unit - 1.0, 0.0))


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
