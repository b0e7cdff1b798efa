"""Runs a function block of IEC 61131-3 structured text as a real parser reads it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from blark import transform as st
from blark.parse import parse_source_code

CALLS: Mapping[str, Any] = {
    "MIN": min,
    "MAX": max,
    "ABS": abs,
    "SEL": lambda which, no, yes: yes if which else no,
}
OPERATIONS: Mapping[str, Any] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "<": lambda a, b: a < b,
    ">": lambda a, b: a > b,
    "=": lambda a, b: a == b,
    "<>": lambda a, b: a != b,
    "AND": lambda a, b: a and b,
}


def parsed(text: str) -> Any:
    """The one declaration of a file. A fault of the text fails here."""
    result = parse_source_code(text)
    if result.exception is not None:
        raise result.exception
    (item,) = result.transform().items
    return item


class Block:
    """An instance of a function block: its variables, and a call with inputs."""

    def __init__(self, text: str) -> None:
        self.block = parsed(text)
        self.values: dict[str, Any] = {}
        for group in self.block.declarations:
            for item in group.items:
                kind = str(item.init.spec.type)
                start = 0.0 if kind == "LREAL" else False
                if item.init.value is not None:
                    start = self.of(item.init.value)
                for declared in item.variables:
                    self.values[str(declared.variable.name)] = start

    def __call__(self, **inputs: Any) -> None:
        unknown = inputs.keys() - self.values.keys()
        assert not unknown, unknown
        self.values |= inputs
        self.run(self.block.body)

    def run(self, body: st.StatementList) -> None:
        for statement in body.statements:
            match statement:
                case st.AssignmentStatement():
                    (target,) = statement.variables
                    assert str(target.name) in self.values, f"{target.name} is not declared"
                    self.values[str(target.name)] = self.of(statement.expression)
                case st.IfStatement():
                    branches = [(statement.if_expression, statement.statements)]
                    branches += [(branch.if_expression, branch.statements) for branch in statement.else_ifs]
                    for condition, inside in branches:
                        if self.of(condition):
                            self.run(inside)
                            break
                    else:
                        if statement.else_clause is not None:
                            self.run(statement.else_clause.statements)
                case _:
                    raise TypeError(f"{type(statement).__name__}: {statement}")

    def of(self, e: Any) -> Any:
        match e:
            case st.SimpleVariable():
                return self.values[str(e.name)]
            case st.Real():
                return float(str(e.value))
            case st.Integer():
                return float(int(str(e.value)))
            case st.Boolean():
                return str(e.value).upper() == "TRUE"
            case st.ParenthesizedExpression():
                return self.of(e.expr)
            case st.UnaryOperation():
                value = self.of(e.expr)
                return (not value) if str(e.op).upper() == "NOT" else -value
            case st.BinaryOperation():
                return OPERATIONS[str(e.op).upper()](self.of(e.left), self.of(e.right))
            case st.FunctionCall():
                return CALLS[str(e.name.name).upper()](*(self.of(p.value) for p in e.parameters))
        raise TypeError(f"{type(e).__name__}: {e}")
