"""Hanging still with effects: where the states are, and which input holds them.

A plant's own `equilibrium` knows the plain machine. Effects may move it: a drum out of round,
a stiffer wire, more weight. Newton's method on the traced accelerations finds it, for many
scenarios at once; a step that leaves more acceleration than there was is halved. Where the
plain equilibrium is one, it is kept to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.core.run import Array
from workbench.engine.source import parameter_symbols
from workbench.machines import NO_EFFECTS, Effects, Plant
from workbench.symbolic.derive import derivative
from workbench.symbolic.emit import Printer
from workbench.symbolic.expr import symbol

ROUNDS = 20  # a step that has to be halved takes a few more
AT_REST = 1e-6  # m/s^2 (rad/s^2); rounding of lengths leaves a thousandth of it


def of_each(function: Callable[..., Any], names: Sequence[str], table: Array, *at: Any, traced: bool = True) -> Array:
    """(numbers, scenarios) what function(*at, p) gives for each scenario: at once, or one after the other where it has
    branches. table: (names, scenarios), the parameters. traced: whether it may have none."""

    def flat(found: Any) -> list[Any]:
        parts = found if isinstance(found, tuple) else (found,)
        return [number for part in parts for number in (part if isinstance(part, list) else [part])]

    if traced:
        rows = SimpleNamespace(**dict(zip(names, table, strict=True)))
        with suppress(TypeError, ValueError):  # a branch of a user's effect
            found = flat(function(*(np.asarray(row, dtype=float) for row in at), rows))
            return np.array([np.broadcast_to(numbers, table.shape[1]) for numbers in found], dtype=float)
    ways = [
        (*here, SimpleNamespace(**dict(zip(names, p, strict=True))))
        for *here, p in zip(*at, table.T.tolist(), strict=True)
    ]
    return np.array([flat(function(*way)) for way in ways], dtype=float).T


def hang_still(
    plant: Plant, effects: Effects, table: Array, heights: Sequence[float], times: Sequence[float]
) -> tuple[Array, Array]:
    """positions (positions, scenarios) and holding inputs (scenarios,) at rest.

    table: (names, scenarios) the plant's and the effects' parameters; heights: of the
    coordinate that the plant is placed by; times: what the clock shows.
    """
    names = (*plant.parameters, *effects.parameters)
    plain = of_each(plant.equilibrium, names, table, heights, traced=plant.guess is None)
    q, u = plain[:-1], plain[-1]
    if effects is NO_EFFECTS:
        return q, u
    balance = _balance(plant, effects)
    kept = [of_each(m.start, names, table)[0] for m in effects.memory]
    free = [i for i in range(len(q)) if i != plant.placed]
    t = np.asarray(times, dtype=float)

    def at(trial_q: Array, trial_u: Array) -> tuple[Array, Array, Array]:
        """Accelerations (scenarios, m), their slopes (scenarios, m, m), and the largest acceleration."""
        a, slopes = balance(t, trial_q, trial_u, table, kept)
        return a.T, slopes.transpose(2, 0, 1), np.max(np.abs(a), axis=0)

    found_q, found_u, least = _newton(at, q, u, free, halved=False)
    if np.any(least > AT_REST):
        other_q, other_u, other = _newton(at, q, u, free, halved=True)
        nearer = (other < least) & (least > AT_REST)
        found_q, found_u = np.where(nearer, other_q, found_q), np.where(nearer, other_u, found_u)
    return found_q, found_u


def _newton(
    at: Callable[[Array, Array], tuple[Array, Array, Array]], q: Array, u: Array, free: Sequence[int], halved: bool
) -> tuple[Array, Array, Array]:
    """Newton's way to rest from q, u: the best point on it and the acceleration there.

    halved: a step that leaves more acceleration than there was is halved, for a step too far ends in a slack wire,
    where no slope tells the way back. Without, it goes on from there: the way across a play leads over more
    acceleration.
    """
    best_q, best_u, least = q, u, np.full(len(u), np.inf)
    trial_q, trial_u, step = q.copy(), u.copy(), np.zeros((len(free) + 1, len(u)))
    for _ in range(ROUNDS):
        a, matrix, size = at(trial_q, trial_u)
        solvable = np.isfinite(size) & (np.linalg.det(matrix) != 0.0)
        better = (size < least) & solvable
        best_q, best_u = np.where(better, trial_q, best_q), np.where(better, trial_u, best_u)
        least = np.where(better, size, least)
        off = least > AT_REST
        if not off.any():
            break
        newton = off & (better if halved else solvable)
        step[:, newton] = np.linalg.solve(matrix[newton], a[newton][..., None])[..., 0].T
        step[:, off & ~newton] *= 0.5
        from_q, from_u = (best_q, best_u) if halved else (trial_q, trial_u)
        moved_q, moved_u = trial_q.copy(), trial_u.copy()
        moved_u[off] = from_u[off] - step[-1, off]
        for row, i in enumerate(free):
            moved_q[i, off] = from_q[i, off] - step[row, off]
        trial_q, trial_u = moved_q, moved_u
    return best_q, best_u, least


@cache
def _balance(plant: Plant, effects: Effects) -> Callable[..., tuple[Array, Array]]:
    """Accelerations (m, scenarios) at rest, and their derivatives by the free positions and the input."""
    names = (*plant.parameters, *effects.parameters)
    q = [symbol(f"q{i}") for i in range(len(plant.positions))]
    kept = [symbol(f"z{i}") for i in range(len(effects.memory))]
    t, u = symbol("t"), symbol("u")
    at_rest = [*[0.0] * len(plant.speeds), *kept]
    a = plant.rates(t, q, at_rest, u, parameter_symbols(names), effects)[: len(plant.speeds)]
    unknown = [*(x for i, x in enumerate(q) if i != plant.placed), u]
    memo: dict[tuple[int, int], Any] = {}
    printer = Printer()
    body, results, _ = printer.block([*a, *(derivative(f, x, memo) for f in a for x in unknown)])
    arguments = ["t", "u", *(x.args[0] for x in (*q, *kept)), *(f"p_{name}" for name in names)]
    lines = [f"def balance({', '.join(arguments)}):", *(f"    {line}" for line in (*printer.setup, *body))]
    scope: dict[str, Any] = {
        "select": np.where, "abs": np.abs, "sin_": np.sin, "cos_": np.cos, "exp_": np.exp, "atan_": np.arctan,
        "sqrt_": np.sqrt, "floor_": np.floor, "fma_": lambda a, b, c: a * b + c,
    }  # fmt: skip
    exec("\n".join([*lines, f"    return {', '.join(results)},"]), scope)
    m = len(plant.speeds)

    def balance(time: Array, at: Array, hold: Array, table: Array, memory: Sequence[Array]) -> Any:
        out = scope["balance"](time, hold, *at, *memory, *table)
        rows = np.empty((len(out), len(hold)))
        for row, its in zip(rows, out, strict=True):
            row[:] = its
        return rows[:m], rows[m:].reshape(m, m, len(hold))

    return balance
