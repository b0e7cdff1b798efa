"""Printing a traced program as straight-line Python for the compiler.

Every operation is one line on one name. What depends on parameters alone is
printed apart, as `setup`, to run once a scenario instead of once a step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from workbench.symbolic import expr as ops
from workbench.symbolic.expr import Expr, Scalar, Scalars, const_value

INFIX = {"+", "-", "*", "/", "<", "<=", ">", ">=", "&", "|"}


class Printer:
    """Prints programs that share one setup: several blocks of one kernel."""

    def __init__(self) -> None:
        self.setup: list[str] = []
        self._fixed: dict[int, str] = {}
        self._inverse: dict[str, str] = {}

    def block(self, outputs: Scalars) -> tuple[list[str], list[str], list[str]]:
        """(body lines, result names, setup names that the body reads)."""
        body: list[str] = []
        names: dict[int, str] = {}
        carried: dict[str, None] = {}

        def use(e: Expr) -> str:
            name = self._fixed.get(e.id) or names[e.id]
            if e.id in self._fixed and e.op != "const":
                carried[name] = None
            return name

        def visit(root: Expr) -> None:
            stack = [root]
            while stack:
                e = stack[-1]
                if e.id in names or e.id in self._fixed:
                    stack.pop()
                    continue
                todo = [a for a in e.args if isinstance(a, Expr) and a.id not in names and a.id not in self._fixed]
                if todo:
                    stack.extend(reversed(todo))
                    continue
                stack.pop()
                self._print(e, body, names, carried, use)

        results = []
        for out in outputs:
            if isinstance(out, Expr):
                visit(out)
                results.append(use(out))
            else:
                results.append(repr(float(out)))
        return body, results, list(carried)

    def _print(
        self, e: Expr, body: list[str], names: dict[int, str], carried: dict[str, None], use: Callable[[Expr], str]
    ) -> None:
        if e.op == "const":
            self._fixed[e.id] = repr(const_value(e))
            return
        if e.op == "symbol":  # of a scenario's parameters it begins with p_
            (self._fixed if e.args[0].startswith("p_") else names)[e.id] = e.args[0]
            return
        if all(a.id in self._fixed for a in e.args if isinstance(a, Expr)):
            name = self._fixed[e.id] = f"c_{len(self.setup)}"
            self.setup.append(f"{name} = {_operation(e, [self._fixed[a.id] for a in e.args])}")
            return
        names[e.id] = name = f"v{len(body)}"
        if e.op == "/" and e.args[1].id in self._fixed:  # one division at setup instead of one a step
            divisor = self._fixed[e.args[1].id]
            if divisor not in self._inverse:
                self._inverse[divisor] = f"c_{len(self.setup)}"
                self.setup.append(f"{self._inverse[divisor]} = 1.0 / {divisor}")
            carried[self._inverse[divisor]] = None
            body.append(f"{name} = {use(e.args[0])} * {self._inverse[divisor]}")
            return
        body.append(f"{name} = {_operation(e, [use(a) for a in e.args])}")


def _operation(e: Expr, args: Sequence[str]) -> str:
    if e.op in INFIX:
        return f"{args[0]} {e.op} {args[1]}"
    if e.op == "neg":
        return f"-{args[0]}"
    if e.op == "where":
        return f"select({args[0]}, {args[1]}, {args[2]})"
    if e.op == "abs":
        return f"abs({args[0]})"
    return f"{e.op}_({', '.join(args)})"


def evaluate(outputs: Scalars, values: Mapping[str, float]) -> list[float]:
    """Run a traced program with numbers for its symbols; slow, for tests and single values."""
    known: dict[int, Scalar] = {}

    def run(e: Scalar) -> Scalar:
        if not isinstance(e, Expr):
            return e
        if e.id in known:
            return known[e.id]
        if e.op == "symbol":
            result: Scalar = values[e.args[0]]
        elif e.op == "const":
            result = const_value(e)
        else:
            result = computed(e.op, [run(x) for x in e.args])
        known[e.id] = result
        return result

    return [float(run(out)) for out in outputs]


def computed(op: str, args: Scalars) -> Scalar:
    """The value of an operation on numbers."""
    return _NUMERIC[op](*args) if op in _NUMERIC else getattr(ops, op)(*args)


_NUMERIC: dict[str, Callable[..., Scalar]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "neg": lambda a: -a,
    "abs": abs,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
    "&": lambda a, b: a and b,
    "|": lambda a, b: a or b,
    "where": lambda c, a, b: a if c else b,
}
