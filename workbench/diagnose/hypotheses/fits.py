"""Fits of hypotheses: base parameters within their tolerances, and the parameters of the effects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.error_model import ErrorModel
from workbench.diagnose.hypotheses.knobs import LOG_TIMING, Knob, bounds_of, effect_knobs, setting_of
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.scan import Atom
from workbench.effects import ranges_of
from workbench.identify.least_squares import minimise


@dataclass(frozen=True)
class Fitted:
    """The fit of one hypothesis. effects: ids. z: at the minimum, base parameters first. residual, jacobian: at z.

    chi2: of the data, whitened (`ErrorModel`); prior: of the base parameters in tolerances.
    """

    effects: tuple[str, ...]
    knobs: tuple[Knob, ...]
    z: Array
    residual: Array
    jacobian: Array
    chi2: float
    prior: float
    evaluations: int
    settled: bool

    @property
    def objective(self) -> float:
        return self.chi2 + self.prior

    def rms(self, inputs: int) -> float:
        """Of the input's residual, the first `inputs` rows."""
        return float(np.sqrt(np.mean(self.residual[:inputs] ** 2)))

    @property
    def setting(self) -> dict[str, float | tuple[float, ...]]:
        return setting_of(self.knobs, self.z)


def fit_knobs(
    problem: Problem,
    effects: Sequence[str],
    knobs: Sequence[Knob],
    z: Array,
    most: int = 25,
    base: int = 0,
    known: Array | None = None,
) -> Fitted:
    """The minimum of chi^2 and prior, started at z, in at most about `most` evaluations.

    base: how many of the first z are the base parameters'. Their signatures hardly change on
    the way, so they are differenced anew only every few steps; all but those of friction near standstill
    and of the log's timing, which an effect's own delay has to stay parallel to. known: (samples, base or more) their
    Jacobian at a point near z, None where they are to be differenced at z.
    """
    lowest, highest, std = bounds_of(knobs)
    z = np.clip(z, lowest, highest)
    whiten = problem.errors.whiten
    careful = np.array([_careful(k) for k in knobs for _ in k.lowest], dtype=bool)
    reach = np.where(careful, 0.5, np.inf)
    late = np.array([_late(k) for k in knobs for _ in k.lowest], dtype=bool)
    changing = careful | late | (np.arange(len(z)) >= base)
    anew, lasting = np.flatnonzero(changing), np.flatnonzero(~changing)
    prior = np.diag(1.0 / std)
    residual, jacobian = problem.evaluate(knobs, z, None if known is None else anew)
    if known is not None:
        own, jacobian = jacobian, np.empty((len(residual), len(z)))
        jacobian[:, anew], jacobian[:, lasting] = own, known[:, lasting]
    white, slopes = whiten(residual), whiten(jacobian)
    evaluations, settled, elsewhere = 1, False, known is not None

    def renewed() -> tuple[Array, Array]:
        """The Jacobian with the lasting columns differenced at z, and whitened."""
        full, full_white = jacobian.copy(), slopes.copy()
        full[:, lasting] = problem.evaluate(knobs, z, lasting)[1]
        full_white[:, lasting] = whiten(full[:, lasting])
        return full, full_white

    before = _objective(white, z, std)
    while evaluations < most:
        raw = {z.tobytes(): (residual, jacobian)}  # the minimum is sought in whitened rows

        def evaluate(at: Array, kept: Array = jacobian, known: Array = slopes, raw: Raw = raw) -> tuple[Array, Array]:
            r, own = problem.evaluate(knobs, at, only=anew)
            full, full_white = kept.copy(), known.copy()
            both = whiten(np.column_stack([r, own]))
            full[:, anew], full_white[:, anew] = own, both[:, 1:]
            raw[at.tobytes()] = r, full
            return both[:, 0], full_white

        allowed = min(ROUND, most - evaluations) if base else most - evaluations
        minimum = minimise(evaluate, (z, white, slopes), lowest, reach, 1.0, prior, highest, allowed)
        evaluations += minimum.evaluations
        z, white, slopes = minimum.z, minimum.residual, minimum.jacobian
        residual, jacobian = raw[z.tobytes()]
        after = _objective(white, z, std)
        if not base or (minimum.settled and minimum.evaluations == 0) or before - after < WORTH:
            settled = minimum.settled or before - after < WORTH
            break
        before = after
        jacobian, slopes = renewed()
        elsewhere = False
        evaluations += 1
    if elsewhere:
        jacobian, _ = renewed()
    return Fitted(
        tuple(effects), tuple(knobs), z, residual, jacobian, float(white @ white), float(np.sum((z / std) ** 2)),
        evaluations, settled,
    )  # fmt: skip


ROUND = 4  # steps with the base parameters' signatures as they were
WORTH = 0.05  # of the objective: less is not worth another round


Raw = dict[bytes, tuple[Array, Array]]  # z -> residual and Jacobian, in the input's unit


def _objective(white: Array, z: Array, std: Array) -> float:
    return float(white @ white) + float(np.sum((z / std) ** 2))


def _careful(knob: Knob) -> bool:
    return bool(getattr(knob, "logarithmic", False))


def _late(knob: Knob) -> bool:
    return getattr(knob, "symbol", "") == LOG_TIMING


@dataclass(frozen=True)
class Projection:
    """Residual and signatures with the part that the base parameters can explain projected out."""

    errors: ErrorModel
    rows: Array  # orthonormal columns of the whitened, augmented base Jacobian
    residual: Array
    priors: int

    @staticmethod
    def of(problem: Problem, base: Fitted) -> Projection:
        _, _, std = bounds_of(base.knobs)
        white = problem.errors.whiten(np.column_stack([base.jacobian, base.residual]))
        q, _ = np.linalg.qr(np.vstack([white[:, :-1], np.diag(1.0 / std)]))
        residual = np.concatenate([white[:, -1], base.z / std])
        return Projection(problem.errors, q, residual - q @ (q.T @ residual), len(std))

    def clean(self, columns: Array) -> Array:
        """(samples, k) signatures -> (samples + priors, k), whitened, the base taken out."""
        a = np.vstack([self.errors.whiten(columns), np.zeros((self.priors, columns.shape[1]))])
        return a - self.rows @ (self.rows.T @ a)

    def gain(self, atom: Atom) -> tuple[float, float, Array]:
        """`linear_gain` of an effect at one shape."""
        return linear_gain(self.clean(atom.columns), self.residual, columns_signed(atom), self.priors)


def linear_gain(columns: Array, residual: Array, signs: Sequence[bool], priors: int) -> tuple[float, float, Array]:
    """The largest fall of |residual|^2 by the columns: in the data, in the last `priors` rows; and their amounts.

    signs: which amounts may be negative.
    """
    if columns.shape[1] == 0:
        return 0.0, 0.0, np.zeros(0)
    gram, pull = columns.T @ columns, columns.T @ residual
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    amounts = _normal(gram, pull, scale)
    held = np.zeros(len(pull), dtype=bool)
    # What comes out negative and must not be is left out, one after the other: few columns have signs.
    while np.any(wrong := ~np.array(signs) & ~held & (amounts < 0.0)):
        held[int(np.argmin(np.where(wrong, amounts * scale, 0.0)))] = True
        free = np.flatnonzero(~held)
        amounts = np.zeros(len(pull))
        if len(free):
            amounts[free] = _normal(gram[np.ix_(free, free)], pull[free], scale[free])
    left = residual - columns @ amounts
    gained = residual**2 - left**2
    return float(np.sum(gained[:-priors])), float(np.sum(gained[-priors:])), np.asarray(amounts, dtype=float)


def _normal(gram: Array, pull: Array, scale: Array) -> Array:
    """Least squares by the normal equations, each column on its own scale; nearly equal columns share the amount."""
    unit = gram / np.outer(scale, scale)
    unit[np.diag_indices_from(unit)] += 1e-9
    return np.asarray(np.linalg.solve(unit, pull / scale) / scale)


def start_of(problem: Problem, atom: Atom, amounts: Array) -> tuple[list[Knob], list[float]]:
    """Knobs and z of an effect, from the amounts that a linear fit gave its signature."""
    effect = atom.effect
    ranges = ranges_of(effect, problem.machine, problem.runs)
    at: dict[str, float | tuple[float, ...]] = dict(atom.at)
    if atom.wave is not None:
        r, scale = atom.amounts[0], atom.scale[0]
        if atom.wave.per_run:
            pairs = amounts.reshape(-1, 2)
            size = float(np.sqrt(np.mean(np.sum(pairs**2, axis=1)))) * scale
            at[r.symbol] = min(max(size, 0.05 * r.scale), r.highest)
            at[atom.wave.symbol] = tuple(float(math.atan2(b, a)) for a, b in pairs)
        else:
            at[r.symbol] = min(float(np.hypot(*amounts)) * scale, r.highest)
            at[atom.wave.symbol] = math.atan2(amounts[1], amounts[0])
    else:
        for r, scale, amount in zip(atom.amounts, atom.scale, amounts, strict=True):
            assert r.vanishes_at is not None
            value = r.vanishes_at + scale * float(amount)
            at[r.symbol] = min(max(value, r.lowest), r.highest)
    return effect_knobs(effect, ranges, at)


def stepped_aside(problem: Problem, at: Fitted, taken: Array, delay: bool = False) -> Array:
    """z of a fit's own parameters, refitted linearly after an effect has taken `taken` (samples,) off the residual.

    Two nonlinear parameters stay fixed: the turn-over of friction, and the log's timing, since friction jumps between
    samples. delay: the effect is a delay itself, so the timing is refitted too.
    """
    lowest, highest, std = bounds_of(at.knobs)
    held = [_careful(knob) or (_late(knob) and not delay) for knob in at.knobs]
    moved = np.array([not h for h, knob in zip(held, at.knobs, strict=True) for _ in knob.lowest], dtype=bool)
    white = problem.errors.whiten(np.column_stack([at.jacobian[:, moved], at.residual - taken]))
    rows = np.vstack([white[:, :-1], np.diag(1.0 / std[moved])])
    target = np.concatenate([white[:, -1], at.z[moved] / std[moved]])
    scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    z = at.z.copy()
    z[moved] -= np.linalg.lstsq(rows / scale, target, rcond=1e-12)[0] / scale
    return np.clip(z, lowest, highest)


def columns_signed(atom: Atom) -> list[bool]:
    if atom.wave is not None:
        return [True] * atom.columns.shape[1]
    return [r.lowest < (r.vanishes_at or 0.0) for r in atom.amounts]
