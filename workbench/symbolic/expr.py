"""Scalars that remember how they were computed.

Physics is written once, as plain Python on scalars. Called with numbers it
returns numbers; called with `Expr` it returns the straight-line program that
computes them, which `derive` differentiates and `emit` prints for the compiler.

Equal expressions are one object (hash-consing), so common subexpressions cost
nothing, and what is exactly zero or one is folded away: an effect that is not
there leaves no trace in the program.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

Scalar = Any  # float, numpy array or Expr
Scalars = Sequence[Scalar]
Signals = Mapping[str, Scalar]
_numbers = itertools.count()


class Expr:
    """One operation on earlier operations; made by `_make`, never changed."""

    __slots__ = ("op", "args", "id")
    _made: ClassVar[dict[tuple[Any, ...], Expr]] = {}
    # numpy's numbers leave the operation to Expr; else they would try to make an array of it.
    __array_ufunc__ = None

    op: str
    args: tuple[Any, ...]
    id: int

    def __add__(self, other: Scalar) -> Scalar:
        return add(self, other)

    __radd__ = __add__

    def __sub__(self, other: Scalar) -> Scalar:
        return subtract(self, other)

    def __rsub__(self, other: Scalar) -> Scalar:
        return subtract(other, self)

    def __mul__(self, other: Scalar) -> Scalar:
        return multiply(self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Scalar) -> Scalar:
        return divide(self, other)

    def __rtruediv__(self, other: Scalar) -> Scalar:
        return divide(other, self)

    def __neg__(self) -> Scalar:
        return subtract(0.0, self)

    def __pow__(self, exponent: int) -> Scalar:
        if not isinstance(exponent, int) or exponent < 1:
            raise TypeError(f"a traced power takes a positive whole exponent, not {exponent!r}")
        result: Scalar = self
        for _ in range(exponent - 1):
            result = result * self
        return result

    def __lt__(self, other: Scalar) -> Expr:
        return _make("<", self, _wrap(other))

    def __le__(self, other: Scalar) -> Expr:
        return _make("<=", self, _wrap(other))

    def __gt__(self, other: Scalar) -> Expr:
        return _make(">", self, _wrap(other))

    def __ge__(self, other: Scalar) -> Expr:
        return _make(">=", self, _wrap(other))

    def __eq__(self, other: object) -> bool:
        raise TypeError("a traced value cannot be compared for equality; use a range")

    __hash__ = object.__hash__

    def __and__(self, other: Scalar) -> Expr:
        return _make("&", self, _wrap(other))

    def __or__(self, other: Scalar) -> Expr:
        return _make("|", self, _wrap(other))

    def __bool__(self) -> bool:
        raise TypeError("physics cannot branch on a traced value; use where(condition, a, b)")

    def __repr__(self) -> str:
        if self.op in ("symbol", "const"):
            return str(self.args[0])
        return f"{self.op}({', '.join(map(repr, self.args))})"


def _make(op: str, *args: Any) -> Expr:
    key = (op, *[a.id if isinstance(a, Expr) else ("raw", a) for a in args])
    known = Expr._made.get(key)
    if known is None:
        made = Expr.__new__(Expr)
        made.op, made.args, made.id = op, args, next(_numbers)
        known = Expr._made.setdefault(key, made)  # two threads may trace at once: the first one's stays
    return known


def symbol(name: str) -> Expr:
    """A named input of the program."""
    return _make("symbol", name)


def constant(value: float) -> Expr:
    """A literal; told apart by its bits, so 0.0 and -0.0 are two."""
    return _make("const", float(value).hex())


def const_value(e: Scalar) -> float | None:
    """The number behind a literal, None for anything else."""
    if isinstance(e, Expr):
        return float.fromhex(e.args[0]) if e.op == "const" else None
    return float(e)


def _wrap(value: Scalar) -> Expr:
    return value if isinstance(value, Expr) else constant(value)


def _traced(*values: Scalar) -> bool:
    return any(isinstance(v, Expr) for v in values)


def add(a: Scalar, b: Scalar) -> Scalar:
    ca, cb = const_value(a), const_value(b)
    if ca is not None and cb is not None:
        return constant(ca + cb)
    if ca == 0.0:
        return b
    if cb == 0.0:
        return a
    return _make("+", _wrap(a), _wrap(b))


def subtract(a: Scalar, b: Scalar) -> Scalar:
    ca, cb = const_value(a), const_value(b)
    if ca is not None and cb is not None:
        return constant(ca - cb)
    if cb == 0.0:
        return a
    if ca == 0.0:
        return _make("neg", _wrap(b))
    return _make("-", _wrap(a), _wrap(b))


def multiply(a: Scalar, b: Scalar) -> Scalar:
    ca, cb = const_value(a), const_value(b)
    if ca is not None and cb is not None:
        return constant(ca * cb)
    if ca == 0.0 or cb == 0.0:
        return constant(0.0)
    if ca == 1.0:
        return b
    if cb == 1.0:
        return a
    return _make("*", _wrap(a), _wrap(b))


def divide(a: Scalar, b: Scalar) -> Scalar:
    ca, cb = const_value(a), const_value(b)
    if ca is not None and cb is not None:
        return constant(ca / cb)
    if ca == 0.0:
        return constant(0.0)
    if cb == 1.0:
        return a
    return _make("/", _wrap(a), _wrap(b))


def where(condition: Scalar, a: Scalar, b: Scalar) -> Scalar:
    """`a` where the condition holds, `b` elsewhere; both are computed."""
    if not _traced(condition, a, b):
        return np.where(condition, a, b) if isinstance(condition, np.ndarray) else (a if condition else b)
    if not isinstance(condition, Expr):
        return a if condition else b
    if _wrap(a) is _wrap(b):
        return a
    return _make("where", condition, _wrap(a), _wrap(b))


def minimum(a: Scalar, b: Scalar) -> Scalar:
    return where(a < b, a, b) if _traced(a, b) else np.minimum(a, b)


def maximum(a: Scalar, b: Scalar) -> Scalar:
    return where(a > b, a, b) if _traced(a, b) else np.maximum(a, b)


def clip(x: Scalar, low: Scalar, high: Scalar) -> Scalar:
    return minimum(maximum(x, low), high)


def fma(a: Scalar, b: Scalar, c: Scalar) -> Scalar:
    """a b + c; rounded once where it is compiled, so use it where no effect may add anything."""
    if not _traced(a, b, c):
        return a * b + c
    if const_value(a) == 0.0 or const_value(b) == 0.0:
        return c
    if const_value(c) == 0.0:
        return a * b
    return _make("fma", _wrap(a), _wrap(b), _wrap(c))


def absolute(x: Scalar) -> Scalar:
    return _make("abs", x) if isinstance(x, Expr) else np.abs(x)


def _unary(name: str, number: Callable[[float], float], array: Callable[[Any], Any]) -> Callable[[Scalar], Scalar]:
    def function(x: Scalar) -> Scalar:
        if isinstance(x, Expr):
            value = const_value(x)
            return constant(number(value)) if value is not None else _make(name, x)
        return array(x)

    function.__name__ = name
    function.__doc__ = f"{name}(x) of a number, an array or a traced scalar."
    return function


atan = _unary("atan", math.atan, np.arctan)
sin = _unary("sin", math.sin, np.sin)
cos = _unary("cos", math.cos, np.cos)
exp = _unary("exp", math.exp, np.exp)
sqrt = _unary("sqrt", math.sqrt, np.sqrt)
floor = _unary("floor", math.floor, np.floor)
