"""Joint least squares over all runs, with tolerances as priors, standard errors and correlations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.errors import InputError
from workbench.core.names import listed
from workbench.core.run import Array
from workbench.core.shown import Brief
from workbench.identify.model import Free, OutputModel

ENOUGH = 0.01  # of chi^2: less than this left to gain is a tenth of a standard error
ROUND_OFF = 1e-11  # of chi^2, relative: less than this is noise of the arithmetic
MOST = 40  # evaluations
DAMPING = 1e-4  # to begin with, of the diagonal of J'J

Evaluated = tuple[Array, Callable[[], Array]]  # a residual (n,), and what gives its Jacobian (n, m)


@dataclass(frozen=True)
class Minimum:
    """z: (m,); residual: (n,), jacobian: (n, m) at z. settled: the last step would have gained next to nothing.
    damping: of the next step."""

    z: Array
    residual: Array
    jacobian: Array
    evaluations: int
    settled: bool
    damping: float


def minimise(
    evaluate: Callable[[Array], Evaluated],
    begin: tuple[Array, Array, Array],
    lowest: Array,
    reach: Array,
    weight: float,
    prior: Array,
    highest: Array | None = None,
    most: int = MOST,
    damping: float = DAMPING,
    enough: float = ENOUGH,
) -> Minimum:
    """Minimise |weight residual(z)|^2 + |prior z|^2 for lowest <= z <= highest, in steps of at most `reach`.

    evaluate: its Jacobian is asked for where a step serves. begin: z with its residual and Jacobian. damping: to begin
    with. enough: of chi^2, less is not worth a step. K. Madsen, H. B. Nielsen, O. Tingleff, "Methods for Non-Linear
    Least Squares Problems", 2004, section 3.2; each step is the best one within bounds and reach.
    """
    z, residual, jacobian = begin
    growth, evaluations = 2.0, 0
    top = np.full(len(z), np.inf) if highest is None else highest
    chi2 = _chi2(z, residual, weight, prior)
    while evaluations < most:
        gradient = weight**2 * (jacobian.T @ residual) + prior.T @ (prior @ z)
        hessian = weight**2 * (jacobian.T @ jacobian) + prior.T @ prior
        box = np.maximum(lowest - z, -reach), np.minimum(top - z, reach)
        step = _step(hessian, gradient, box, damping)
        trial = np.clip(z + step, lowest, top)
        step = trial - z
        promised = float(-(2.0 * gradient @ step + step @ hessian @ step))
        if promised <= max(enough, ROUND_OFF * chi2):
            return Minimum(z, residual, jacobian, evaluations, True, damping)
        r, slopes = evaluate(trial)
        evaluations += 1
        trial_chi2 = _chi2(trial, r, weight, prior)
        if trial_chi2 < chi2:
            gain = min((chi2 - trial_chi2) / promised, 1.0)
            z, residual, jacobian, chi2 = trial, r, slopes(), trial_chi2
            damping = max(damping * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3) * 0.3, 1e-12)
            growth = 2.0
        else:
            damping, growth = max(damping, 1e-9) * growth * 4.0, growth * 2.0
            if damping > 1e12:
                break
    return Minimum(z, residual, jacobian, evaluations, False, damping)


def _chi2(z: Array, residual: Array, weight: float, prior: Array) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        value = float(weight**2 * (residual @ residual) + np.sum((prior @ z) ** 2))
    return value if np.isfinite(value) else np.inf


def _step(hessian: Array, gradient: Array, box: tuple[Array, Array], damping: float) -> Array:
    """The damped Newton step, the best one within the box."""
    scale = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    unit = hessian / np.outer(scale, scale)  # variables on their own scale, else the damping is of the largest
    unit[np.diag_indices_from(unit)] *= 1.0 + damping
    pull = gradient / scale
    if not (np.all(np.isfinite(unit)) and np.all(np.isfinite(pull))):  # LAPACK would complain on the terminal
        raise np.linalg.LinAlgError("the slopes of the residual are not finite")
    step = -np.linalg.lstsq(unit, pull, rcond=1e-14)[0] / scale
    if np.all((step >= box[0]) & (step <= box[1])):
        return step
    return bounded(unit, -pull, np.minimum(box[0], 0.0) * scale, np.maximum(box[1], 0.0) * scale) / scale


def bounded(gram: Array, pull: Array, low: Array, high: Array) -> Array:
    """The least of x'Gx/2 - b'x for low <= x <= high, with 0 in between; 1e-12 of the diagonal hold a flat direction.

    P. B. Stark, R. L. Parker, Bounded-variable least-squares, Computational Statistics 10 (1995): what a step takes
    over its bound is held there, and let go where it would come back.
    """
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    unit, aim, least, most = gram / np.outer(scale, scale), pull / scale, low * scale, high * scale
    unit[np.diag_indices_from(unit)] += 1e-12
    x, free = np.zeros(len(aim)), np.ones(len(aim), dtype=bool)
    for _ in range(10 * len(aim)):
        step, left = np.zeros(len(aim)), aim - unit @ x
        step[free] = np.linalg.solve(unit[np.ix_(free, free)], left[free])
        end = np.where(step < 0.0, least, most)
        part = np.divide(end - x, step, out=np.full(len(aim), np.inf), where=step != 0.0)  # of the step, to its bound
        if np.min(part) >= 1.0:
            x += step
            back = np.where(x <= least, 1.0, -1.0) * (aim - unit @ x)
            back[free | (least == most)] = 0.0
            if np.max(back) <= 1e-12 * np.max(np.abs(aim)):
                break
            free[np.argmax(back)] = True
        else:
            x += np.min(part) * step
            held = part <= np.min(part)
            x[held], free[held] = end[held], False
    return np.clip(x / scale, low, high)


# Joint least squares over all runs, with tolerances as priors, standard errors and correlations.


STEP = 1e-3  # of a parameter's own scale, for derivatives
POOR = 0.95  # correlation beyond which two values are told apart poorly
ROUNDS = 10  # of fitting and measuring the residual anew


@dataclass(frozen=True, repr=False)
class Fit(Brief):
    """A fit's outcome. value, std_error: in each parameter's own unit; correlation: (m, m).

    std_prior: what the tolerance alone would allow, None where nothing held the value.
    residual_rms: of the model's output at the fit; noise_rms: the sensor's share of it. unlikely: minus twice the
    logarithm of the residual's likelihood.
    """

    free: tuple[Free, ...]
    value: tuple[float, ...]
    std_error: tuple[float, ...]
    correlation: Array
    residual_rms_before: float
    residual_rms: float
    noise_rms: float
    samples: int
    evaluations: int
    statements: tuple[str, ...]
    unlikely: float

    def values(self) -> dict[str, float]:
        """Key of machine.yaml -> fitted value."""
        return {f.key: v for f, v in zip(self.free, self.value, strict=True)}

    def tolerances_off(self) -> list[float]:
        """Each value's distance from its nominal one in tolerances; 0 if it has none."""
        return [
            0.0 if f.prior_std is None or f.logarithmic else abs(value - f.nominal) / (f.scale * f.prior_std)
            for f, value in zip(self.free, self.value, strict=True)
        ]


def fit(
    model: OutputModel,
    free: Sequence[Free],
    ties: Sequence[tuple[str, str]] = (),
    own: Callable[[Array], Array] | None = None,
    spread: Callable[[Array], Array] | None = None,
) -> Fit:
    """Least squares of the model's residuals over their spread, and of z over its tolerances.

    own: residuals (samples,) at z of the fitted model's own log, sampled as the machine's: what sampling alone leaves.
    The shift of a value by it is added to its uncertainty.

    spread: of a residual, the standard deviation (samples,) of each row; None for the same of all, the larger of the
    sensor's noise and of what the fit leaves. It is found in rounds: an honest model error widens the error bars.
    `ties` are pairs of keys that the data cannot tell apart from a third: they are kept equal, and a statement says so.
    """
    if sum(model.run_lengths) <= len(free):
        raise InputError("the machine hardly moves in these runs: nothing to fit; choose runs with motion")
    m = len(free)
    prior = _prior(free, ties)
    lowest = np.array([f.lowest_z for f in free])
    reach = np.array([1.0 if f.logarithmic else np.inf for f in free])  # a factor of e at a time
    evaluations = 1

    z = np.maximum(np.zeros(m), lowest)
    out = model.residuals(free, [z, *(z + STEP * row for row in np.eye(m))])
    residual, jacobian = out[0], (out[1:] - out[0]).T / STEP
    before, sigma = _rms(residual), np.full(len(residual), model.noise)

    def both(at: Array) -> Evaluated:
        out = model.residuals(free, [at, *(at + STEP * row for row in np.eye(m))]) / sigma
        return out[0], lambda: (out[1:] - out[0]).T / STEP

    for _ in range(ROUNDS):
        begin = z, residual / sigma, jacobian / sigma[:, None]
        outcome = minimise(both, begin, lowest, reach, 1.0, prior)
        z, residual, jacobian = outcome.z, outcome.residual * sigma, outcome.jacobian * sigma[:, None]
        evaluations += outcome.evaluations
        last, left = sigma, _rms(residual)
        sigma = np.full(len(residual), max(model.noise, left)) if spread is None else spread(residual)
        if np.all(np.abs(sigma - last) < 0.01 * last):
            break
    white = jacobian / sigma[:, None]
    covariance = _covariance(white, residual / sigma, prior, model)
    if own is not None:
        shift = _information(white, prior) @ (white.T @ (own(z) / sigma))
        covariance = covariance + np.outer(shift, shift)
    std_z = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(std_z > 0.0, std_z, 1.0)
    return Fit(
        tuple(free),
        tuple(f.value(float(x)) for f, x in zip(free, z, strict=True)),
        tuple(f.std_error(float(x), float(s)) for f, x, s in zip(free, z, std_z, strict=True)),
        covariance / np.outer(safe, safe),
        before,
        left,
        model.noise,
        len(residual),
        evaluations,
        tuple(_statements(free, z, std_z, covariance / np.outer(safe, safe), jacobian, ties)),
        float(np.sum((residual / sigma) ** 2 + 2.0 * np.log(sigma))),
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _prior(free: Sequence[Free], ties: Sequence[tuple[str, str]]) -> Array:
    """Rows of the prior: prior @ z are standard normal. A tie keeps two values equal within 0.01 %."""
    rows = [row / f.prior_std for row, f in zip(np.eye(len(free)), free, strict=True) if f.prior_std is not None]
    keys = [f.key for f in free]
    for a, b in ties:
        i, j = keys.index(a), keys.index(b)
        row = np.zeros(len(free))
        size = 1e-4 * max(abs(free[i].nominal), free[i].scale)
        row[i], row[j] = free[i].scale / size, -free[j].scale / size
        rows.append(row)
    return np.array(rows).reshape(len(rows), len(free))


def _covariance(jacobian: Array, residual: Array, prior: Array, model: OutputModel) -> Array:
    """Of z, by the sandwich: residuals are taken as correlated over `lags` samples.

    W. K. Newey, K. D. West, Econometrica 55 (1987): Bartlett weights, never negative; runs
    are independent.
    """
    scores = jacobian * residual[:, None]
    middle = prior.T @ prior
    begin = 0
    for length in filter(None, model.run_lengths):  # a run that stands still holds none
        # Bartlett's weights are those of sums over a window: their outer products, once for every place of it.
        lags = min(model.lags, length - 1)
        total = np.cumsum(scores[begin : begin + length], axis=0)
        begin += length
        total = np.concatenate([np.zeros((lags + 1, total.shape[1])), total, np.repeat(total[-1:], lags, axis=0)])
        windows = total[lags + 1 :] - total[: -lags - 1]
        middle = middle + windows.T @ windows / (lags + 1.0)
    bread = _information(jacobian, prior)
    return bread @ middle @ bread


def _information(jacobian: Array, prior: Array) -> Array:
    """The inverse of the whitened normal equations, (m, m)."""
    return np.asarray(np.linalg.pinv(jacobian.T @ jacobian + prior.T @ prior, rcond=1e-14))


def _statements(
    free: Sequence[Free], z: Array, std_z: Array, correlation: Array, jacobian: Array, ties: Sequence[tuple[str, str]]
) -> list[str]:
    """Plain sentences about what these data cannot determine."""
    statements = [
        f"{a} and {b} cannot be told apart from the constant load by these data: they were held alike" for a, b in ties
    ]
    for i, f in enumerate(free):
        if f.prior_std is not None and std_z[i] > 0.8 * f.prior_std:
            what = "a factor of ten" if f.logarithmic else "its tolerance"
            statements.append(f"{f.key}: the data say hardly more than {what} does")
        if f.prior_std is not None and not f.logarithmic and abs(z[i]) > 3.0 * f.prior_std:
            statements.append(
                f"{f.key}: {abs(z[i]):.1f} tolerances from its nominal value; something else may hide behind it"
            )
        if z[i] <= f.lowest_z + 1e-6:
            statements.append(f"{f.key}: the fit ends at the lowest value allowed")
    return statements + [
        _alike([f.key for f in free], group, correlation) for group in _groups(correlation, free, ties)
    ]


def _groups(correlation: Array, free: Sequence[Free], ties: Sequence[tuple[str, str]]) -> list[list[int]]:
    """Groups of correlated parameters: each correlates with another of its group by more than POOR."""
    near = np.abs(correlation) > POOR
    keys = [f.key for f in free]
    for a, b in ties:
        near[keys.index(a), keys.index(b)] = near[keys.index(b), keys.index(a)] = False
    left, groups = set(range(len(free))), []
    while left:
        group = {min(left)}
        while more := {int(j) for i in group for j in np.flatnonzero(near[i])} - group:
            group |= more
        left -= group
        groups.append(sorted(group))
    return [group for group in groups if len(group) > 1]


def _alike(keys: Sequence[str], group: Sequence[int], correlation: Array) -> str:
    names = [keys[i] for i in group]
    part = np.abs(correlation[np.ix_(group, group)]) - np.eye(len(group))
    return f"{listed(names)}: told apart poorly by these runs (correlation up to {part.max():.3f}); trust them together"
