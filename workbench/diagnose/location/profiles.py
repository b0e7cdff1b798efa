"""The share of the gap that a function of one variable explains on held-out runs, one function per direction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.records import Profile
from workbench.diagnose.location.variables import Variable, forward, spacing, times

SMOOTH = 1e-2  # of the data's weight: bends between bins cost so much; what lies between is bridged
BLOCKS = 8  # of a run's time, where runs cannot be held out against each other
RIDGE = 1e-9  # of the largest: directions of the parameters that nothing shows
NEVER_SEEN = 1e-12  # of the columns' energy: a bin that nothing lies in
DRAWS = 400  # of the bootstrap
LEAST_RUNS = 3  # to hold out one


@dataclass(frozen=True)
class Free:
    """The freedom of the base parameters beside a profile. columns: (inputs, m) of the prediction per z.

    low, high: (m,) how far each z may still go; hold: (m,) one over its tolerance, on the residual's scale.
    """

    columns: Array
    low: Array
    high: Array
    hold: Array


@dataclass(frozen=True)
class Explained:
    """One variable's part of the gap, (inputs,), each run predicted from the other runs."""

    variable: Variable
    part: Array
    share: float
    interval: tuple[float, float]


def explain(problem: Problem, gap: Array, variable: Variable, free: Free, seed: int) -> Explained:
    """The best function of a variable, with the base parameters free within their tolerances."""
    columns, bend = basis(problem, variable)
    folds = run_of(problem) if len(problem.runs) >= LEAST_RUNS else blocks(problem)
    part = held_out(gap, columns, bend, free, folds)
    share, interval = share_of(problem, gap, gap - part, seed)
    return Explained(variable, part, share, interval)


def run_of(problem: Problem) -> np.ndarray:
    return problem.run_of_row[: problem.inputs]


def blocks(problem: Problem) -> np.ndarray:
    """(inputs,) two folds: every other piece of each run's time."""
    return pieces(problem) % BLOCKS % 2


def share_of(problem: Problem, gap: Array, left: Array, seed: int) -> tuple[float, tuple[float, float]]:
    """The share of the gap's energy beyond noise that is not in `left`, and its 90 % interval by a bootstrap.

    Over runs; over pieces of time where there are fewer than three of them.
    """
    return _drawn(problem, gap, left, seed, run_of(problem) if len(problem.runs) >= LEAST_RUNS else pieces(problem))


def share_in_time(problem: Problem, gap: Array, left: Array, seed: int) -> tuple[float, tuple[float, float]]:
    """As `share_of`, by a bootstrap over pieces of time: for windows, which do not carry over to new runs."""
    return _drawn(problem, gap, left, seed, pieces(problem))


def _drawn(
    problem: Problem, gap: Array, left: Array, seed: int, units: np.ndarray
) -> tuple[float, tuple[float, float]]:
    weight = spacing(problem)
    gone = np.bincount(units, weight * (gap**2 - left**2))
    there = np.bincount(units, weight * (gap**2 - problem.noise**2))
    kept = np.flatnonzero(np.bincount(units))
    draw = np.random.default_rng(seed).choice(kept, (DRAWS, len(kept)))
    ratios = [_ratio(float(gone[d].sum()), float(there[d].sum())) for d in draw]
    low, high = np.quantile(ratios, [0.05, 0.95])
    return _ratio(float(gone.sum()), float(there.sum())), (float(low), float(high))


def pieces(problem: Problem) -> np.ndarray:
    """(inputs,) which of BLOCKS pieces of which run. A run of which no sample counts has none."""
    at, piece = times(problem), np.empty(problem.inputs, dtype=int)
    for j, count in enumerate(problem.run_lengths):
        if count:
            mine = run_of(problem) == j
            gone = (at[mine] - at[mine].min()) / max(float(np.ptp(at[mine])), 1e-9)
            piece[mine] = j * BLOCKS + np.minimum((gone * BLOCKS).astype(int), BLOCKS - 1)
    return piece


def _ratio(gone: float, there: float) -> float:
    return min(max(gone / there, 0.0), 1.0) if there > 0.0 else 0.0


def profile_of(problem: Problem, gap: Array, explained: Explained, regime: str) -> Profile:
    """The mean gap in the bins of a variable."""
    v, ahead, k = explained.variable, forward(problem), len(explained.variable.edges) - 1
    bins = np.clip(np.searchsorted(v.edges, v.at, side="right") - 1, 0, k - 1)
    energy = np.bincount(bins, spacing(problem) * gap**2, k)
    return Profile(
        v.name, v.label, v.unit, regime, v.edges,
        _means(bins[ahead], gap[ahead], k), _means(bins[~ahead], gap[~ahead], k),
        energy / max(float(energy.sum()), 1e-300), explained.share, explained.interval,
    )  # fmt: skip


def _means(bins: np.ndarray, values: Array, k: int) -> Array:
    count = np.bincount(bins, minlength=k)
    total = np.bincount(bins, values, k)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def held_out(gap: Array, columns: Array, bend: Array, free: Free, folds: np.ndarray) -> Array:
    """(inputs,) the prediction of each fold by `columns` and the base, fitted to the other folds.

    bend: (k, k) the penalty on rough amounts.
    """
    a = np.hstack([columns, free.columns])
    k, m = columns.shape[1], free.columns.shape[1]
    cost = np.zeros((k + m, k + m))
    scale = float(np.mean(np.sum(columns**2, axis=0))) if k else 0.0
    cost[:k, :k] = scale * (SMOOTH * bend + 1e-6 * np.eye(k))
    cost[k:, k:] = np.diag(free.hold**2)
    low = np.concatenate([np.full(k, -np.inf), free.low])
    high = np.concatenate([np.full(k, np.inf), free.high])
    parts = {f: (a[folds == f].T @ a[folds == f], a[folds == f].T @ gap[folds == f]) for f in np.unique(folds)}
    gram, pull = sum(g for g, _ in parts.values()), sum(b for _, b in parts.values())
    out = np.zeros_like(gap)
    for f, (g, b) in parts.items():
        if len(parts) == 1:
            g, b = np.zeros_like(g), np.zeros_like(b)
        out[folds == f] = a[folds == f] @ _bounded(gram - g + cost, pull - b, low, high)
    return out


class OnTop:
    """Functions on top of a fit, fitted to the other runs; what the fit's own parameters explain is projected out, so
    that they stay where all runs have put them."""

    def __init__(self, problem: Problem, left: Array, free: Free) -> None:
        """left: (inputs,) the fit's residual; free: its parameters."""
        self.left, self._inputs = left, len(left)
        rows = np.vstack([free.columns, np.diag(free.hold)])
        sizes = np.linalg.norm(rows, axis=0)
        u, s, _ = np.linalg.svd(rows / np.where(sizes > 0.0, sizes, 1.0), full_matrices=False)
        self._base = u[:, s > RIDGE * max(s[0], 1e-300)] if len(s) else u
        self._folds = run_of(problem) if len(problem.runs) >= LEAST_RUNS else blocks(problem)
        self._nothing = Free(np.zeros((len(left), 0)), np.zeros(0), np.zeros(0), np.zeros(0))

    def after(self, columns: Array, bend: Array) -> Array:
        """(inputs,) what the columns leave of it on runs they were not fitted to."""
        sizes = np.sum(columns**2, axis=0)
        seen = sizes > NEVER_SEEN * np.sum(sizes)
        shown = columns[:, seen]
        base = self._base[: self._inputs]
        shown = shown - base @ (base.T @ shown)
        return self.left - held_out(self.left, shown, bend[np.ix_(seen, seen)], self._nothing, self._folds)


def _bounded(gram: Array, pull: Array, low: Array, high: Array) -> Array:
    """The least of x'Gx/2 - b'x within bounds, to within what one pass of an active set gives."""
    x = np.zeros(len(pull))
    held = np.zeros(len(pull), dtype=bool)
    for _ in range(len(pull)):
        go = ~held
        x[go] = np.linalg.lstsq(gram[np.ix_(go, go)], pull[go] - gram[np.ix_(go, held)] @ x[held], rcond=1e-12)[0]
        beyond = go & ((x < low) | (x > high))
        if not np.any(beyond):
            break
        x[beyond] = np.clip(x[beyond], low[beyond], high[beyond])
        held |= beyond
    return x


def basis(problem: Problem, v: Variable) -> tuple[Array, Array]:
    """(inputs, k) columns of a function of the variable for each direction, and the penalty on its bends."""
    ahead = forward(problem)
    if v.name == "direction":
        return np.stack([ahead, ~ahead], axis=1).astype(float), np.zeros((2, 2))
    shape, bend = hats(v)
    both = np.hstack([np.where(ahead[:, None], shape, 0.0), np.where(ahead[:, None], 0.0, shape)])
    zero = np.zeros_like(bend)
    return both, np.block([[bend, zero], [zero, bend]])


def hats(v: Variable) -> tuple[Array, Array]:
    """Piecewise linear between the bins' edges; a line only where few values are known."""
    knots = v.edges[[0, -1]] if v.straight else v.edges
    which = np.clip(np.searchsorted(knots, v.at, side="right") - 1, 0, len(knots) - 2)
    part = (v.at - knots[which]) / (knots[which + 1] - knots[which])
    hats = np.zeros((len(v.at), len(knots)))
    rows = np.arange(len(v.at))
    hats[rows, which] = 1.0 - part
    hats[rows, which + 1] += part
    if v.wraps:
        hats[:, 0] += hats[:, -1]
        hats = hats[:, :-1]
    return hats, _bends(hats.shape[1], v.wraps)


def _bends(k: int, wraps: bool) -> Array:
    eye = np.eye(k)
    second = np.roll(eye, 1, 0) - 2.0 * eye + np.roll(eye, -1, 0) if wraps else np.diff(eye, 2, axis=0)
    return np.asarray(second.T @ second, dtype=float)


def best_of(explained: Sequence[Explained], margin: float = 0.03) -> Explained:
    """The variable that explains most; among nearly equal ones the first, which is the simplest."""
    most = max(variable.share for variable in explained)
    return next(variable for variable in explained if variable.share >= most - margin)
