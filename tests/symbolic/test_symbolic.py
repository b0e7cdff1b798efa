"""Traced scalars: exact derivatives, folding, one object for equal expressions, and what the printer writes."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from workbench.engine.preamble import PREAMBLE
from workbench.symbolic import expr as ops
from workbench.symbolic.derive import derivative, jacobian
from workbench.symbolic.emit import Printer, evaluate
from workbench.symbolic.expr import Expr, Scalar, const_value, constant, symbol, where

X, Y, P = symbol("x"), symbol("y"), symbol("p_a")  # p_: a parameter, computed apart by the printer

# Each operation on smooth ground: a program of x, and a place where it is smooth.
OPERATIONS = {
    "+": (lambda x: x + 3.0 * x, 0.7),
    "-": (lambda x: 2.0 - x, 0.7),
    "neg": (lambda x: -x, 0.7),
    "*": (lambda x: x * x * 0.5, 0.7),
    "/": (lambda x: (1.0 + x) / (2.0 + x * x), 0.7),
    "power": (lambda x: x**3, 0.7),
    "where, first branch": (lambda x: where(x < 1.0, x * x, x), 0.7),
    "where, second branch": (lambda x: where(x < 0.5, x * x, 5.0 * x), 0.7),
    "where, two conditions": (lambda x: where((x > 0.5) & (x <= 1.0), x * x, x), 0.7),
    "where, either condition": (lambda x: where((x > 1.0) | (x >= 0.5), x * x, x), 0.7),
    "abs, above": (ops.absolute, 0.7),
    "abs, below": (ops.absolute, -0.7),
    "atan": (lambda x: ops.atan(3.0 * x), 0.7),
    "sin": (lambda x: ops.sin(3.0 * x), 0.7),
    "cos": (lambda x: ops.cos(3.0 * x), 0.7),
    "exp": (lambda x: ops.exp(-3.0 * x), 0.7),
    "sqrt": (lambda x: ops.sqrt(3.0 * x), 0.7),
    "floor": (lambda x: ops.floor(3.0 * x) * x, 0.7),
    "minimum": (lambda x: ops.minimum(x * x, 0.6), 0.7),
    "maximum": (lambda x: ops.maximum(x * x, 0.6), 0.7),
    "clip, inside": (lambda x: ops.clip(x * x, -1.0, 1.0), 0.7),
    "clip, outside": (lambda x: ops.clip(x * x, -1.0, 0.3), 0.7),
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_a_derivative_is_that_of_central_differences(name):
    function, at = OPERATIONS[name]
    (exact,) = evaluate([derivative(function(X), X)], {"x": at})
    h = 1e-6
    above, below = (evaluate([function(X)], {"x": at + d})[0] for d in (h, -h))
    assert exact == pytest.approx((above - below) / (2.0 * h), rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("name", OPERATIONS)
def test_slopes_of_numbers_are_those_of_the_program_of_derivatives(name):
    function, at = OPERATIONS[name]
    both = function(X) * Y + function(X), function(Y), constant(2.0)
    programs = [[evaluate([derivative(f, by)], {"x": at, "y": 1.3 * at})[0] for by in (X, Y)] for f in both]
    assert jacobian(both, [X, Y], [at, 1.3 * at]) == pytest.approx(np.array(programs), rel=1e-14)


def test_a_branch_that_is_not_taken_has_no_part_in_slopes():
    kink = where(X > 0.0, 2.0 * X, ops.sqrt(X * X) * Y)  # whose own slope is none at 0
    assert np.array_equal(
        jacobian([kink, where(X > -1.0, Y, ops.sqrt(X))], [X, Y], [0.5, 3.0]), [[2.0, 0.0], [0.0, 1.0]]
    )


def test_every_operation_that_exists_is_tested():
    used: set[str] = set()

    def visit(e: Scalar) -> None:
        if isinstance(e, Expr):
            used.add(e.op)
            for a in e.args:
                visit(a)

    for function, _ in OPERATIONS.values():
        visit(function(X))
    known = {"+", "-", "neg", "*", "/", "<", "<=", ">", ">=", "&", "|", "where", "abs", "symbol", "const"}
    assert used == known | {"atan", "sin", "cos", "exp", "sqrt", "floor"}


def trees() -> st.SearchStrategy[Any]:
    """Random programs of x, y and p_a as functions of three scalars, smooth but at the kinks of abs and where."""
    leaves = st.sampled_from([lambda x, y, a: x, lambda x, y, a: y, lambda x, y, a: a]) | st.floats(-2.0, 2.0).map(
        lambda c: lambda x, y, a: c
    )

    def grow(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
        def two(make: Any) -> st.SearchStrategy[Any]:
            return st.tuples(inner, inner).map(lambda t: lambda x, y, a: make(t[0](x, y, a), t[1](x, y, a)))

        def one(make: Any) -> st.SearchStrategy[Any]:
            return inner.map(lambda t: lambda x, y, a: make(t(x, y, a)))

        return st.one_of(
            two(lambda u, v: u + v),
            two(lambda u, v: u - v),
            two(lambda u, v: u * v),
            two(lambda u, v: u / (2.0 + v * v)),
            two(lambda u, v: where(u < v, u * v, u - v)),
            one(ops.atan),
            one(ops.sin),
            one(ops.cos),
            one(lambda u: ops.exp(-(u * u))),
            one(lambda u: ops.sqrt(1.0 + u * u)),
            one(ops.absolute),
            one(lambda u: -u),
        )

    return st.recursive(leaves, grow, max_leaves=12)


@given(trees(), st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_the_derivative_of_any_program_is_that_of_central_differences(tree, x, y, a):
    program = tree(X, Y, P)

    def value(at: float) -> float:
        return evaluate([program], {"x": at, "y": y, "p_a": a})[0]

    h = 1e-5
    right, left = (value(x + h) - value(x)) / h, (value(x) - value(x - h)) / h
    scale = 1.0 + abs(right) + abs(left) + abs(value(x))
    assume(abs(right - left) < 1e-3 * scale and scale < 1e3)  # no kink within h
    (exact,) = evaluate([derivative(program, X)], {"x": x, "y": y, "p_a": a})
    assert exact == pytest.approx((right + left) / 2.0, abs=1e-5 * scale + abs(right - left))


PLAIN = {
    "select": lambda c, a, b: a if c else b,
    "fma_": lambda a, b, c: a * b + c,
    **{f"{name}_": getattr(math, name) for name in ("atan", "sin", "cos", "exp", "sqrt", "floor")},
}


def run_printed(outputs: list[Scalar], **values: float) -> list[float]:
    """What the printed text computes, as plain Python."""
    printer = Printer()
    body, results, carried = printer.block(outputs)
    space: dict[str, Any] = {**PLAIN, **values}
    exec("\n".join(printer.setup), space)
    allowed = {*PLAIN, *carried, *(name for name in values if not name.startswith("p_")), "__builtins__"}
    space = {name: value for name, value in space.items() if name in allowed}  # a body reads only what is carried
    exec("\n".join(body), space)
    return [float(eval(name, space)) for name in results]


@given(trees(), st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_a_printed_program_computes_what_the_functions_do(tree, x, y, a):
    direct = float(tree(x, y, a))
    (printed,) = run_printed([tree(X, Y, P)], x=x, y=y, p_a=a)
    assert printed == pytest.approx(direct, rel=1e-9, abs=1e-9)


def test_what_hangs_on_parameters_alone_is_computed_in_the_setup():
    printer = Printer()
    body, _, carried = printer.block([X / (P * P) + ops.sqrt(P)])
    assert len(printer.setup) == 3  # p*p, sqrt(p), and the inverse for the division
    assert not any("p_a" in line or "/" in line for line in body)
    assert all(name.startswith("c_") for name in carried)


@pytest.mark.parametrize(
    "folded",
    [X + 0.0, 0.0 + X, X - 0.0, X * 1.0, 1.0 * X, X / 1.0, where(X < 0.0, X, X), X**1, where(True, X, Y)],
    ids=repr,
)
def test_what_changes_nothing_leaves_no_trace(folded):
    assert folded is X


def test_a_negative_zero_is_not_a_zero():
    assert constant(0.0) is not constant(-0.0)
    assert str(const_value(constant(-0.0))) == "-0.0"


@pytest.mark.parametrize("branch", [lambda: bool(X), lambda: 1 if X > 0.0 else 2, lambda: X and Y, lambda: max(X, 0.0)])
def test_physics_that_branches_on_a_traced_value_is_refused(branch):
    with pytest.raises(TypeError, match="use where"):
        branch()


def test_a_number_of_numpy_may_stand_left_of_a_traced_scalar():
    three: Any = np.float64(3.0)
    assert three * X is 3.0 * X
    assert (three < X) is (X > 3.0)
    assert three / X is 3.0 / X


def test_threads_that_trace_at_once_get_one_object_for_equal_expressions():
    def build(_: int) -> list[Scalar]:
        e: Scalar = X
        made = []
        for k in range(400):
            e = e * (1.5 + k) + Y
            made.append(e)
        return made

    with ThreadPoolExecutor(8) as pool:
        chains = list(pool.map(build, range(8)))
    assert all(a is b for chain in chains[1:] for a, b in zip(chain, chains[0], strict=True))
    assert len({e.id for e in chains[0]}) == 400


@pytest.fixture(scope="module")
def preamble() -> dict[str, Any]:
    """The preamble's functions as plain Python, `select` and `fma_` by hand."""
    space: dict[str, Any] = {"select": lambda c, a, b: a if c else b, "fma_": lambda a, b, c: a * b + c}
    exec(PREAMBLE, space)
    return space


def test_the_arctangent_is_exact_to_rounding_over_the_line(preamble):
    x = np.concatenate(
        [np.linspace(-5.0, 5.0, 40000), np.geomspace(1e-12, 1e12, 20001), -np.geomspace(1e-12, 1e12, 99)]
    )
    ours = np.array([preamble["atan_"](float(v)) for v in x])
    exact = np.arctan(x)
    assert np.max(np.abs(ours - exact)) <= 4.5e-16
    assert np.max(np.abs(ours - exact) / np.abs(exact)) <= 4.5e-16
