"""Exact derivatives of traced programs, by forward accumulation.

At a kink (`where`, `abs`) the derivative is that of the branch taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from workbench.core.run import Array
from workbench.symbolic.emit import computed
from workbench.symbolic.expr import Expr, Scalar, Scalars, const_value, constant, cos, exp, sin, where


def derivative(of: Scalar, by: Expr, _memo: dict[tuple[int, int], Scalar] | None = None) -> Scalar:
    """d(of)/d(by), again a traced scalar; `by` is a symbol."""
    memo: dict[tuple[int, int], Scalar] = {} if _memo is None else _memo
    if not isinstance(of, Expr):
        return constant(0.0)
    key = (of.id, by.id)
    if key not in memo:
        if of is by or of.op in ("symbol", "const"):
            memo[key] = constant(float(of is by))
        else:
            memo[key] = _rule(of.op, of, of.args, [derivative(a, by, memo) for a in of.args])
    return memo[key]


def jacobian(of: Scalars, by: Sequence[Expr], at: Sequence[float] | Array) -> Array:
    """(outputs, inputs): d(of)/d(by) where the symbols `by` have the values `at`.

    By the same rules on numbers, each operation once for all inputs: at a few points that is quicker than a program of
    the derivatives.
    """
    known: dict[int, tuple[Any, Any]] = {
        s.id: (float(x), row) for s, x, row in zip(by, at, np.eye(len(by)), strict=True)
    }

    def run(e: Scalar) -> tuple[Any, Any]:
        """The value, and the slopes (inputs,); 0.0 where no input is behind it."""
        if not isinstance(e, Expr):
            return e, 0.0
        if e.id not in known:
            if e.op == "const":
                known[e.id] = const_value(e), 0.0
            else:
                args, slopes = zip(*map(run, e.args), strict=True)
                value = computed(e.op, args)
                fixed = all(isinstance(slope, float) for slope in slopes)
                known[e.id] = value, 0.0 if fixed else _rule(e.op, value, args, slopes)
        return known[e.id]

    with np.errstate(all="ignore"):  # of the branch that is not taken
        return np.array([run(f)[1] + np.zeros(len(by)) for f in of]).reshape(len(of), len(by))


def values(symbols: Sequence[Expr], at: Sequence[float] | Array) -> dict[str, float]:
    """The argument of `evaluate`: each symbol's name with its number."""
    return {s.args[0]: float(x) for s, x in zip(symbols, at, strict=True)}


def _rule(op: str, value: Scalar, args: Scalars, d: Scalars) -> Scalar:
    """The derivative of an operation of this value, from those of its arguments."""
    a = args[0]
    match op:
        case "+":
            return d[0] + d[1]
        case "-":
            return d[0] - d[1]
        case "neg":
            return -d[0]
        case "*":
            return d[0] * args[1] + a * d[1]
        case "fma":
            return d[0] * args[1] + a * d[1] + d[2]
        case "/":
            return (d[0] - value * d[1]) / args[1]
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
            return d[0] / (2.0 * value)
    return 0.0  # whole numbers and comparisons: flat almost everywhere
