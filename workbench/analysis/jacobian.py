"""Numbers of exact derivatives: the matrix of traced outputs by traced inputs, at a point."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.run import Array
from workbench.trace.derive import derivative
from workbench.trace.emit import evaluate
from workbench.trace.expr import Expr, Scalar


def jacobian(of: Sequence[Scalar], by: Sequence[Expr], at: Sequence[float] | Array) -> Array:
    """(outputs, inputs): d(of)/d(by) where the symbols `by` have the values `at`."""
    memo: dict[tuple[int, int], Scalar] = {}
    flat = [derivative(f, x, memo) for f in of for x in by]
    return np.array(evaluate(flat, values(by, at))).reshape(len(of), len(by))


def values(symbols: Sequence[Expr], at: Sequence[float] | Array) -> dict[str, float]:
    """What `evaluate` takes: each symbol's name with its number."""
    return {s.args[0]: float(x) for s, x in zip(symbols, at, strict=True)}
