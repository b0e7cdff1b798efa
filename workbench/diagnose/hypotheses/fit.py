"""Fits of hypotheses: base parameters within their tolerances, and the parameters of the effects.

A parameter in its own unit comes with a standard error:

    std_error² = g (Σ + d dᵀ) gᵀ + s²

Σ is the covariance of the fit, of noise, model error and tolerances; g the parameter's derivative. d is by how far
plain least squares, of the same residual without its correlation, would put the parameters elsewhere: if the error
model held, both would agree to within Σ (J. A. Hausman, Specification tests in econometrics, Econometrica 46, 1978),
and what a real machine leaves itself holds to no such model. It is one step from the fit, but for a play, which has
many minima (`play_estimated`). s is by how much the value may be off because the effect's law simplifies
(`Parameter.simplified`): where the law fits every run alike, the residual does not show it, neither as a whole nor from
run to run. By what the runs differ an answer's values have it at least (`held_out.jackknifed`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.free_parameters import (
    LOG_TIMING,
    Estimate,
    FreeParameter,
    Names,
    Scalar,
    bounds_of,
    inward,
    logarithmic_of,
    setting_of,
)
from workbench.diagnose.hypotheses.problem import Problem
from workbench.effects import ranges_of
from workbench.identify.fit import DAMPING, Evaluated, minimise
from workbench.simulate.model_error import ErrorModel
from workbench.simulate.motion import PLAY

BREAKDOWNS = (ArithmeticError, ValueError, np.linalg.LinAlgError)  # of one fit
ROUND = 4  # steps with the base parameters' signatures as they were
WORTH = 0.05  # of the objective: less is not worth another step, nor another round
WORTH_OF_ALL = 2e-5  # the same, of the whole
WORTH_ROUGHLY = 1.0  # the same, of what is refitted where it counts, and of a play that is heard
SLOPE_STEP = 1e-4  # of z, for the values' slopes

Raw = dict[bytes, tuple[Array, Array]]  # z -> residual and Jacobian, in the input's unit


@dataclass(frozen=True, eq=False)
class Fitted:
    """The fit of one hypothesis. effects: ids. z: at the minimum, base parameters first. residual, jacobian: at z.

    chi2: of the data, whitened (`ErrorModel`); prior: of the base parameters in tolerances. errors: by which it
    is weighed, None as the problem is. other: z of the same hypothesis, weighed otherwise.
    """

    effects: tuple[str, ...]
    free: tuple[FreeParameter, ...]
    z: Array
    residual: Array
    jacobian: Array
    chi2: float
    prior: float
    evaluations: int
    settled: bool
    errors: ErrorModel | None = None
    other: Array | None = None

    @property
    def objective(self) -> float:
        return self.chi2 + self.prior

    def rms(self, inputs: int) -> float:
        """Of the input's residual, the first `inputs` rows."""
        return float(np.sqrt(np.mean(self.residual[:inputs] ** 2)))

    @property
    def setting(self) -> dict[str, float | tuple[float, ...]]:
        return setting_of(self.free, self.z)


def fit_hypothesis(
    problem: Problem,
    effects: Sequence[str],
    free: Sequence[FreeParameter],
    z: Array,
    most: int = 25,
    base: int = 0,
    known: Array | None = None,
    roughly: bool = False,
) -> Fitted:
    """The minimum of chi^2 and prior, started at z, in at most about `most` evaluations.

    base: how many of the first z are the base parameters'. Their signatures hardly change on
    the way, so they are differenced anew only every few steps; all but those of friction near standstill
    and of the log's timing, which an effect's own delay has to stay parallel to. known: (samples, base or more) their
    Jacobian at a point near z, None where they are to be differenced at z. roughly: of what is refitted
    where it counts; a step has to gain WORTH_ROUGHLY, times chi^2 over what noise and model error would leave: of a
    poor fit's values a little of its residual tells as much less.
    """
    lowest, highest, std = bounds_of(free)
    z = np.clip(z, lowest, highest)
    whiten = problem.errors.whiten
    careful = logarithmic_of(free)
    reach = np.where(careful, 0.5, np.inf)
    late = np.array([is_timing(k) for k in free for _ in k.lowest], dtype=bool)
    changing = careful | late | (np.arange(len(z)) >= base)
    anew, lasting = np.flatnonzero(changing), np.flatnonzero(~changing)
    prior = np.diag(1.0 / std)
    residual, jacobian = problem.evaluate(free, z, None if known is None else anew)
    if known is not None:
        own, jacobian = jacobian, np.empty((len(residual), len(z)))
        jacobian[:, anew], jacobian[:, lasting] = own, known[:, lasting]
    white, slopes = whiten(residual), whiten(jacobian)
    evaluations, settled, damping, elsewhere = 1, False, DAMPING, known is not None and len(lasting) > 0
    stiff = any(problem.effect(name).memory for name in effects)  # steps are many, and slopes beside them cost little

    def renewed(
        which: np.ndarray, at: Array, r: Array, full: Array, full_white: Array, beside: Array | None = None
    ) -> tuple[Array, Array]:
        """The Jacobian and the whitened one with these columns differenced at a point with the residual r, or as they
        are known; one beside which the simulation breaks down stays what it was."""
        found = problem.evaluate(free, at, which, r)[1] if beside is None else beside
        full, full_white, sound = full.copy(), full_white.copy(), np.all(np.isfinite(found), axis=0)
        full[:, which[sound]] = found[:, sound]
        full_white[:, which] = whiten(full[:, which])
        return full, full_white

    before = _objective(white, z, std)
    worth = WORTH_ROUGHLY if PLAY in effects and problem.struck and problem.thin else WORTH
    enough = max(worth, WORTH_OF_ALL * before)
    while evaluations < most:
        if roughly:
            worth = enough = WORTH_ROUGHLY * max(1.0, before / max(problem.share * problem.samples, 1.0))
        raw = {z.tobytes(): (residual, jacobian)}  # the minimum is sought in whitened rows

        def evaluate(at: Array, kept: Array = jacobian, known: Array = slopes, raw: Raw = raw) -> Evaluated:
            r, beside = problem.evaluate(free, at, anew if stiff else [])

            def anew_at() -> Array:
                full, full_white = renewed(anew, at, r, kept, known, beside if stiff else None)
                raw[at.tobytes()] = r, full
                return full_white

            return whiten(r), anew_at

        allowed = min(ROUND, most - evaluations) if len(lasting) else most - evaluations
        minimum = minimise(evaluate, (z, white, slopes), lowest, reach, 1.0, prior, highest, allowed, damping, worth)
        evaluations, damping = evaluations + minimum.evaluations, minimum.damping
        z, white, slopes = minimum.z, minimum.residual, minimum.jacobian
        residual, jacobian = raw[z.tobytes()]
        after = _objective(white, z, std)
        if not len(lasting) or (minimum.settled and minimum.evaluations == 0) or before - after < enough:
            settled = minimum.settled or before - after < enough
            break
        before = after
        jacobian, slopes = renewed(lasting, z, residual, jacobian, slopes)
        elsewhere = False
        evaluations += 1
    if elsewhere:
        jacobian, _ = renewed(lasting, z, residual, jacobian, slopes)
    if stiff:  # what the machine leaves alone: beside its slopes it took other steps, and teeth met at other times
        residual = problem.residuals([setting_of(free, z)])[0]
        white = whiten(residual)
    return Fitted(
        tuple(effects), tuple(free), z, residual, jacobian, float(white @ white), float(np.sum((z / std) ** 2)),
        evaluations, settled,
    )  # fmt: skip


def _objective(white: Array, z: Array, std: Array) -> float:
    return float(white @ white) + float(np.sum((z / std) ** 2))


def is_timing(parameter: FreeParameter) -> bool:
    return isinstance(parameter, Scalar) and parameter.symbol == LOG_TIMING


def parameters_of(fit: Fitted, effects: Collection[str], base: int) -> tuple[list[FreeParameter], Array]:
    """The parameters of these effects in a fit, and their z. base: how many of its first z are the base parameters'."""
    mine, z, at = list[FreeParameter](), list[float](), 0
    for parameter in fit.free:
        own = {symbol.split("__")[0] for symbol in parameter.values([0.0] * parameter.size)}
        if at >= base and own & {*effects}:
            mine.append(parameter)
            z += fit.z[at : at + parameter.size].tolist()
        at += parameter.size
    return mine, np.array(z)


def others_of(fit: Fitted, effects: Collection[str], base: int) -> Fitted:
    """A fit with all its parameters but those of these effects. base: as in `parameters_of`."""
    own = parameters_of(fit, effects, base)[0]
    stays = np.repeat([one not in own for one in fit.free], [one.size for one in fit.free])
    free = tuple(one for one in fit.free if one not in own)
    return replace(fit, free=free, z=fit.z[stays], jacobian=fit.jacobian[:, stays])


def parts_of(problem: Problem, fit: Fitted, groups: Sequence[Names]) -> Array:
    """(groups, samples): the change of the prediction by the effects of each group, at the fit's values; rows of the
    input first, then of the tension."""
    settings = []
    for names in groups:
        ranges = [r for name in names for r in ranges_of(problem.effect(name), problem.machine, problem.runs)]
        off = {r.symbol: r.vanishes_at for r in ranges if r.vanishes_at is not None}
        settings.append({**fit.setting, **off})
    return problem.differences(fit.setting, settings)[1]


def uncorrelated(problem: Problem, fit: Fitted) -> ErrorModel:
    """The errors of plain least squares: all of a fit's residual is independent, that beside impacts, too, and
    tolerances weigh beside it as they did."""
    white = problem.row_noise / math.sqrt(problem.share) if problem.struck else problem.errors.white
    if np.any(fit.residual):
        white = white * float(np.linalg.norm(fit.residual / white)) / math.sqrt(fit.chi2)
    return replace(problem.errors, white=white, sizes=(0.0, 0.0))


def unweighed(problem: Problem, fit: Fitted) -> Fitted:
    """The same hypothesis where plain least squares put its values: one step from the fit, but for a play."""
    if fit.other is not None:
        return replace(fit, z=fit.other)
    lowest, highest, std = bounds_of(fit.free)
    rows = uncorrelated(problem, fit).whiten(np.column_stack([fit.jacobian, fit.residual]))
    step = -_inverse(rows[:, :-1], std) @ (rows[:, :-1].T @ rows[:, -1] + fit.z / std**2)
    return replace(fit, z=np.clip(fit.z + step, lowest, highest))


def covariance(problem: Problem, fit: Fitted) -> Array:
    """The covariance of z, (m, m). What the data leave open grows in proportion to a residual above the noise, and with
    how far plain least squares are off; what tolerances say does not."""
    excess, off = max(1.0, fit.chi2 / max(problem.share * problem.samples, 1.0)), unweighed(problem, fit).z - fit.z
    rows = problem.errors.whiten(fit.jacobian) / math.sqrt(excess)
    return _inverse(rows, bounds_of(fit.free)[2]) + np.outer(off, off)


def _inverse(rows: Array, std: Array) -> Array:
    """Of the information of whitened rows (n, m) and of priors (m,)."""
    information = rows.T @ rows + np.diag(1.0 / std**2)
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    return np.asarray(np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-12) / np.outer(scale, scale))


def estimates(problem: Problem, fit: Fitted, exact: bool = False) -> dict[str, tuple[Estimate, ...]]:
    """Effect -> its parameters: value and standard error, of each run where they are each run's own.

    exact: of laws taken as exact, as where two fits of one law are compared; otherwise what the law simplifies is in
    the standard error (`Parameter.simplified`).
    """
    spread, slopes, rows = covariance(problem, fit), _slopes(fit), dict[str, tuple[Estimate, ...]]()
    for name in fit.effects:
        effect = problem.effect(name)
        declared = list(zip(effect.parameters, ranges_of(effect, problem.machine, problem.runs), strict=True))
        e = SimpleNamespace(**{p.symbol: fit.setting.get(r.symbol, r.start) for p, r in declared})
        rows[name] = ()
        for p, r in [(p, r) for p, r in declared if r.symbol in fit.setting]:
            value, s = fit.setting[r.symbol], 0.0 if exact or p.simplified is None else float(p.simplified(e))
            errors = tuple(float(np.sqrt(max(row @ spread @ row, 0.0) + s**2)) for row in slopes[r.symbol])
            rows[name] += (Estimate(r.name, value, errors if isinstance(value, tuple) else errors[0]),)
    return rows


def _slopes(fit: Fitted) -> dict[str, Array]:
    """symbol -> (values, m): the derivative of each value by z; angles by their shorter way round."""
    base = {name: np.atleast_1d(np.array(value)) for name, value in fit.setting.items()}
    slopes = {name: np.zeros((len(value), len(fit.z))) for name, value in base.items()}
    steps = inward(fit.free, fit.z, np.full(len(fit.z), SLOPE_STEP))
    for k, row in enumerate(np.diag(steps)):
        moved = setting_of(fit.free, fit.z + row)
        for name, value in moved.items():
            change = np.atleast_1d(np.array(value)) - base[name]
            if name.endswith("phase_rad"):
                change = (change + math.pi) % (2.0 * math.pi) - math.pi
            slopes[name][:, k] = change / steps[k]
    return slopes
