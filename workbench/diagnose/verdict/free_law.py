"""Whether a cause is worth its parameters beside one law of a single variable that nobody has written down.

    r = f(w) + B z + e,    f ~ GP(0, a^2 exp(-(w - w')^2 / 2 l^2)),    e as `hypotheses/model_error.py` has it
    score(f) = min over z of [r' S^-1 r + |z / tolerance|^2] + ln det (1 + a^2 K H' P H),    S = cov e + a^2 H K H'

f is a Gaussian process over one variable w of the motion (the same both ways, or another one each way), H its hats
between the knots of w, a and l at their best (C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine
Learning, 2006, 5.4.1); B z the parameters of a fit, linearised, and P takes out what they explain. The determinant is
what the freedom of f costs. Whatever the machine has beside a cause may follow such a law, so f is on both sides:

    worth = score(f alone) - score(f beside the cause) - cost of the cause's parameters

A true cause leaves less for f to take, or something that f cannot take, and is worth much. Several effects that only
imitate one law together (a bent sensor by gain, offset and friction with the load) are worth less than nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.evidence import cost
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import bounds_of
from workbench.diagnose.hypotheses.model_error import Sizes
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.profiles import RIDGE, forward, hats, variables

LENGTHS = (0.5, 0.17, 0.06)  # of the variable's range: a slope or a bow; a hump; a step between knots
SIZES = tuple(np.geomspace(0.02, 10.0, 9))  # of the residual's rms


def worth(problem: Problem, base: Fitted, cause: Fitted, sizes: Sizes) -> tuple[float, str]:
    """The least that the effects of a fit are worth beside a law of one variable, as evidence, and that variable.

    base: the fit without them, or without one of them. sizes: of the model error.
    """
    errors = problem.errors.sized(sizes)
    further = len(cause.effects) - max(len(base.effects), 1)
    paid = cost(problem, len(cause.z) - len(base.z)) + settings.calibration()["pair"] * further
    least, over = float("inf"), ""
    laws = list(_laws(problem, base))
    white = errors.whiten(np.column_stack([shape for _, shape, _ in laws]))
    rms = base.rms(problem.inputs)
    alone, beside = (projected(errors.whiten, fit) for fit in (base, cause))
    start = 0
    for name, shape, correlations in laws:
        columns = white[:, start : start + shape.shape[1]]
        start += shape.shape[1]
        gain = alone.score(columns, correlations, rms) - beside.score(columns, correlations, rms) - paid
        if gain < least:
            least, over = gain, name
    return least, over


def _laws(problem: Problem, base: Fitted) -> Iterator[tuple[str, Array, list[Array]]]:
    """Of each variable: its name, hats (rows, k), and the square roots (k, k) of their correlation at each length."""
    ahead, rest = forward(problem), np.zeros((len(base.residual) - problem.inputs, 1))
    for v in variables(problem, base.residual[: problem.inputs]):
        if v.name == "direction":
            continue
        shape, _ = hats(v)
        knots = (v.edges[[0, -1]] if v.straight else v.edges)[: shape.shape[1]]
        apart = np.abs(knots[:, None] - knots) / float(np.ptp(v.edges))
        apart = np.minimum(apart, 1.0 - apart) if v.wraps else apart
        roots = [_root(np.exp(-0.5 * (apart / length) ** 2)) for length in LENGTHS]
        both = np.hstack([np.where(ahead[:, None], shape, 0.0), np.where(ahead[:, None], 0.0, shape)])
        each_way = [np.asarray(np.kron(np.eye(2), root), dtype=float) for root in roots]
        for columns, each in ((shape, roots), (both, each_way)):
            yield v.name, np.vstack([columns, np.repeat(rest, columns.shape[1], axis=1)]), each


def _root(correlation: Array) -> Array:
    values, vectors = np.linalg.eigh(correlation)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


@dataclass(frozen=True, eq=False)
class Projected:
    """explained: orthonormal columns (rows, m) of what a fit's parameters explain; residual: (rows,) what is left
    without that. The tolerances are rows of their own, at the end."""

    explained: Array
    residual: Array

    def score(self, columns: Array, roots: list[Array], rms: float) -> float:
        """Of the fit with a law beside it at its best length and size, or without one, up to what all fits have."""
        shadow = self.explained[: len(columns)].T @ columns
        gram = columns.T @ columns - shadow.T @ shadow
        pull = columns.T @ self.residual[: len(columns)]  # the residual is clean: so is its product
        least = 0.0
        for root in roots:
            values, vectors = np.linalg.eigh(root.T @ gram @ root)
            energy = (vectors.T @ (root.T @ pull)) ** 2
            for size in SIZES:
                variance = (size * rms) ** 2
                spread = 1.0 + variance * np.maximum(values, 0.0)
                least = min(least, float(np.sum(np.log(spread) - variance * energy / spread)))
        return float(self.residual @ self.residual) + least


def projected(whiten: Callable[[Array], Array], fit: Fitted) -> Projected:
    std = bounds_of(fit.free)[2]
    hold = np.where(np.isfinite(std), 1.0 / std, 0.0)
    white = whiten(np.column_stack([fit.jacobian, fit.residual]))
    rows = np.vstack([white[:, :-1], np.diag(hold)])
    sizes = np.linalg.norm(rows, axis=0)
    u, s, _ = np.linalg.svd(rows / np.where(sizes > 0.0, sizes, 1.0), full_matrices=False)
    explained = u[:, s > RIDGE * s[0]]
    residual = np.concatenate([white[:, -1], hold * fit.z])
    return Projected(explained, residual - explained @ (explained.T @ residual))
