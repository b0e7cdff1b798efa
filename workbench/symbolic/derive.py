"""Exact derivatives of traced programs, by forward accumulation.

At a kink (`where`, `abs`) the derivative is that of the branch taken.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.core.run import Array
from workbench.symbolic.emit import evaluate
from workbench.symbolic.expr import Expr, Scalar, constant, cos, exp, sin, where


def derivative(of: Scalar, by: Expr, _memo: dict[tuple[int, int], Scalar] | None = None) -> Scalar:
    """d(of)/d(by), again a traced scalar; `by` is a symbol."""
    memo: dict[tuple[int, int], Scalar] = {} if _memo is None else _memo
    if not isinstance(of, Expr):
        return constant(0.0)
    key = (of.id, by.id)
    if key not in memo:
        memo[key] = _rule(of, by, memo)
    return memo[key]


def jacobian(of: Sequence[Scalar], by: Sequence[Expr], at: Sequence[float] | Array) -> Array:
    """(outputs, inputs): d(of)/d(by) where the symbols `by` have the values `at`."""
    memo: dict[tuple[int, int], Scalar] = {}
    flat = [derivative(f, x, memo) for f in of for x in by]
    return np.array(evaluate(flat, values(by, at))).reshape(len(of), len(by))


def values(symbols: Sequence[Expr], at: Sequence[float] | Array) -> dict[str, float]:
    """The argument of `evaluate`: each symbol's name with its number."""
    return {s.args[0]: float(x) for s, x in zip(symbols, at, strict=True)}


def _rule(e: Expr, by: Expr, memo: dict[tuple[int, int], Scalar]) -> Scalar:
    if e is by:
        return constant(1.0)
    if e.op in ("symbol", "const", "floor"):
        return constant(0.0)
    d = [derivative(a, by, memo) for a in e.args if isinstance(a, Expr)]
    a = e.args[0]
    match e.op:
        case "+":
            return d[0] + d[1]
        case "-":
            return d[0] - d[1]
        case "neg":
            return -d[0]
        case "*":
            return d[0] * e.args[1] + a * d[1]
        case "fma":
            return d[0] * e.args[1] + a * d[1] + d[2]
        case "/":
            return (d[0] - e * d[1]) / e.args[1]
        case "where":
            return where(a, d[1], d[2])
        case "abs":
            return where(a < 0.0, -1.0, 1.0) * d[0]
        case "atan":
            return d[0] / (1.0 + a * a)
        case "sin":
            return cos(a) * d[0]
        case "cos":
            return -(sin(a) * d[0])
        case "exp":
            return exp(a) * d[0]
        case "sqrt":
            return d[0] / (2.0 * e)
    return constant(0.0)  # comparisons: flat almost everywhere
