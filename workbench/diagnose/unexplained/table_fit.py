"""Tables of force fitted to the residual beside the base parameters, linearly, and judged on runs left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import bounds_of
from workbench.diagnose.hypotheses.held_out import folds_by_run
from workbench.diagnose.hypotheses.problem import Problem

TURN = 2.0 * np.pi
BENDS = (0.03, 0.1, 0.3, 1.0)  # of the table's size: how far a level may lie off the line between its neighbours
LOOSE = 2.0  # of the table's size: how far a level may lie off zero
NEARLY = 1.05  # of the least that is left: the smoothest table within it is taken
CAREFUL = 0.5  # of a logarithmic base parameter: how far one step may lead


@dataclass(frozen=True)
class TableFit:
    """levels: (2 points,) forward, then backward; z: (base,) the fit's numbers that go with them.

    std: of levels, by leaving out one run after the other. before, after: (groups,) sums of squares of the
    input's residual on what was left out, without and with the table; noise: the noise's. bend: the
    smoothness taken. others: (groups, base + 2 points) z and levels fitted without each group.
    """

    levels: Array
    z: Array
    std: Array
    before: Array
    after: Array
    noise: Array
    bend: float
    others: Array

    @property
    def explains(self) -> float:
        """Share of the residual's energy above the noise that the table takes away where it was not fitted."""
        gap = float(np.sum(self.before - self.noise))
        return float(np.sum(self.before - self.after)) / gap if gap > 0.0 else 0.0


class TableFitter:
    """Tables beside the base parameters, from the nominal machine on, against the base parameters' own fit.

    From the nominal machine, since that fit may be far away from where the base parameters belong: it has bent
    them as far as the data wanted, friction's turn at standstill by orders of magnitude.
    """

    def __init__(self, problem: Problem, fitted: Fitted) -> None:
        self.problem, self.fitted = problem, fitted
        _, _, self.std = bounds_of(fitted.free)
        self.groups = folds_by_run(problem)
        self.count = int(self.groups.max()) + 1
        self.careful = np.concatenate(
            [np.full(len(parameter.lowest), bool(parameter.logarithmic)) for parameter in fitted.free]
        )
        self.move_to(np.zeros(len(fitted.z)))
        self.before = self._alone()

    def move_to(self, z: Array) -> None:
        """Linearise at other base values."""
        self.z = z
        self.residual, self.jacobian = self.problem.evaluate(self.fitted.free, z)

    def left(self, columns: Array, fit: TableFit) -> Array:
        """(samples,) the residual with a table, linearised."""
        return self.residual + self.jacobian @ (fit.z - self.z) - columns @ fit.levels

    def _alone(self) -> Array:
        """(groups,) sums of squares of the input's residual, with the base parameters fitted without that group."""
        r, x = self.fitted.residual, -self.fitted.jacobian
        hold = np.diag(1.0 / self.std**2)
        normal, right = self._normal(x, r)
        costs = []
        for g in range(self.count):
            step = np.linalg.solve(normal.sum(0) - normal[g] + hold, right.sum(0) - right[g] - hold @ self.fitted.z)
            rows = np.flatnonzero(self.groups[: self.problem.inputs] == g)
            costs.append(float(np.sum((r[rows] - x[rows] @ step) ** 2)))
        return np.array(costs)

    def fit(
        self,
        at: Array,
        columns: Array,
        turn: bool,
        lever: float,
        levels: Array | None = None,
        z: Array | None = None,
        residual: Array | None = None,
        bend: float | None = None,
    ) -> TableFit:
        """at: (points,). columns: (samples, 2 points). lever: input over force, so that sizes are right.

        levels, z, residual: the state of a driven simulation with a table; without a table by default.
        bend: the smoothness; by default chosen on the groups held out.
        """
        z = self.z if z is None else z
        residual = self.residual if residual is None else residual
        levels = np.zeros(columns.shape[1]) if levels is None else levels
        x = np.hstack([-self.jacobian, columns])
        normal, right = self._normal(x, residual)
        size = self.fitted.rms(self.problem.inputs) / lever
        fits = []
        for bend_allowed in BENDS if bend is None else (bend,):
            holds = _smooth(at, turn, bend_allowed * size, LOOSE * size)
            fits.append(self._solved(normal, right, holds, x, residual, z, levels, bend_allowed))
        least = min(float(fit.after.sum()) for fit in fits)
        return next(fit for fit in fits if fit.after.sum() <= NEARLY * least)

    def _normal(self, x: Array, residual: Array) -> tuple[Array, Array]:
        """(groups, k, k) and (groups, k), of whitened rows."""
        white = self.problem.errors.whiten(np.column_stack([x, residual]))
        parts = [white[self.groups == g] for g in range(self.count)]
        return np.array([p[:, :-1].T @ p[:, :-1] for p in parts]), np.array([p[:, :-1].T @ p[:, -1] for p in parts])

    def _solved(
        self,
        normal: Array,
        right: Array,
        holds: Array,
        x: Array,
        residual: Array,
        z: Array,
        levels: Array,
        bend: float,
    ) -> TableFit:
        base = len(z)
        hold = np.zeros((base + len(levels),) * 2)
        hold[:base, :base] = np.diag(1.0 / self.std**2)
        hold[base:, base:] = holds
        pull = hold @ np.concatenate([z, levels])
        step = self._step(normal.sum(0) + hold, right.sum(0) - pull)
        after, others = [], []
        for g in range(self.count):
            without = self._step(normal.sum(0) - normal[g] + hold, right.sum(0) - right[g] - pull)
            rows = np.flatnonzero(self.groups[: self.problem.inputs] == g)
            after.append(float(np.sum((residual[rows] - x[rows] @ without) ** 2)))
            others.append(np.concatenate([z, levels]) + without)
        spread = np.array(others)[:, base:] - np.mean(others, axis=0)[base:]
        std = np.sqrt((self.count - 1) / self.count * np.sum(spread**2, axis=0))
        sizes = np.bincount(self.groups[: self.problem.inputs], minlength=self.count)
        noise = np.asarray(sizes * self.problem.noise**2, dtype=float)
        return TableFit(
            levels + step[base:], z + step[:base], std, self.before, np.array(after), noise, bend, np.array(others)
        )

    def _step(self, normal: Array, right: Array) -> Array:
        """The least-squares step. Logarithmic parameters move by CAREFUL at most; the others are refitted to that."""
        step = np.linalg.solve(normal, right)
        far = np.flatnonzero(self.careful & (np.abs(step[: len(self.careful)]) > CAREFUL))
        if len(far):
            free = np.setdiff1d(np.arange(len(step)), far)
            step[far] = np.sign(step[far]) * CAREFUL
            step[free] = np.linalg.solve(
                normal[np.ix_(free, free)], right[free] - normal[np.ix_(free, far)] @ step[far]
            )
        return np.asarray(step, dtype=float)


def _smooth(at: Array, turn: bool, bend: float, size: float) -> Array:
    """The penalty on the levels of both directions: the distance from the line of their neighbours over `bend`, and the
    distance from zero over `size`."""
    m = len(at)
    rows = []
    for k in range(m) if turn else range(1, m - 1):
        before, after = (at[k] - at[k - 1]) % TURN, (at[(k + 1) % m] - at[k]) % TURN
        if not turn:
            before, after = at[k] - at[k - 1], at[k + 1] - at[k]
        # The kink over the shorter step: the second difference where the steps are alike.
        step = min(before, after)
        row = np.zeros(m)
        row[k - 1] += step / before
        row[(k + 1) % m] += step / after
        row[k] -= step / before + step / after
        rows.append(row)
    second = np.array(rows).reshape(-1, m)
    both = np.kron(np.eye(2), second.T @ second / bend**2 + np.eye(m) / size**2)
    return np.asarray(both, dtype=float)


def telling_points(at: Array, levels: Array, most: int) -> Array:
    """Up to `most` of the points `at`, (n,), such that lines between them follow `levels`, (2 n,), most closely."""
    curves = levels.reshape(2, -1)
    kept = [0, len(at) - 1]
    while len(kept) < most:
        order = np.sort(kept)
        off = np.max([np.abs(curve - np.interp(at, at[order], curve[order])) for curve in curves], axis=0)
        off[kept] = -1.0
        kept.append(int(np.argmax(off)))
    return at[np.sort(kept)]
