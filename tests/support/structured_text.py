"""Runs a function block of IEC 61131-3 structured text as a real parser reads it: its tree becomes Python."""

from __future__ import annotations

from typing import Any

import numpy as np
from blark import transform as st
from blark.parse import parse_source_code

_OPERATORS = {"=": "==", "<>": "!=", "AND": "and", "OR": "or"}


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
                start = {"LREAL": 0.0, "INT": 0}.get(str(item.init.spec.type), False)
                if item.init.value is not None:
                    start = eval(_python(item.init.value))
                for declared in item.variables:
                    self.values[str(declared.variable.name)] = start
        self.names = set(self.values)
        self._calls = {"MIN": min, "MAX": max, "ABS": abs, "SEL": lambda which, no, yes: yes if which else no}
        self._code = compile("\n".join(self._lines(self.block.body, "")), "<structured text>", "exec")

    def __call__(self, **inputs: Any) -> None:
        unknown = inputs.keys() - self.names
        assert not unknown, unknown
        self.values |= inputs
        exec(self._code, self._calls, self.values)

    def run(self, output: str, **inputs: Any) -> list[float]:
        """Many calls, as one loop over arrays or single values; what `output` is after each."""
        count = max(np.size(value) for value in inputs.values())
        columns = {name: np.broadcast_to(value, count).tolist() for name, value in inputs.items()}
        lines = ["def run(v, columns):", *(f"    {name} = v[{name!r}]" for name in sorted(self.names)), "    out = []"]
        lines += [f"    for {', '.join(columns)} in zip(*columns.values(), strict=True):"]
        lines += [*self._lines(self.block.body, 8 * " "), f"        out.append({output})"]
        lines += [*(f"    v[{name!r}] = {name}" for name in sorted(self.names)), "    return out"]
        scope: dict[str, Any] = dict(self._calls)
        exec("\n".join(lines), scope)
        result: list[float] = scope["run"](self.values, columns)
        return result

    def _lines(self, body: st.StatementList, indent: str) -> list[str]:
        lines: list[str] = []
        for statement in body.statements:
            match statement:
                case st.AssignmentStatement():
                    (target,) = statement.variables
                    assert str(target.name) in self.names, f"{target.name} is not declared"
                    lines.append(f"{indent}{target.name} = {_python(statement.expression)}")
                case st.IfStatement():
                    branches = [("if", statement.if_expression, statement.statements)]
                    branches += [("elif", branch.if_expression, branch.statements) for branch in statement.else_ifs]
                    for word, condition, inside in branches:
                        lines += [f"{indent}{word} {_python(condition)}:", *self._lines(inside, indent + "    ")]
                    if statement.else_clause is not None:
                        lines += [f"{indent}else:", *self._lines(statement.else_clause.statements, indent + "    ")]
                case _:
                    raise TypeError(f"{type(statement).__name__}: {statement}")
        return lines


def _python(e: Any) -> str:
    match e:
        case st.SimpleVariable():
            return str(e.name)
        case st.Real() | st.Integer():
            return str(e.value)
        case st.Boolean():
            return str(e.value).capitalize()
        case st.ParenthesizedExpression():
            return f"({_python(e.expr)})"
        case st.UnaryOperation():
            return f"{'not ' if str(e.op).upper() == 'NOT' else str(e.op)}{_python(e.expr)}"
        case st.BinaryOperation():
            operator = str(e.op).upper()
            return f"({_python(e.left)} {_OPERATORS.get(operator, operator)} {_python(e.right)})"
        case st.FunctionCall():
            return f"{str(e.name.name).upper()}({', '.join(_python(p.value) for p in e.parameters)})"
    raise TypeError(f"{type(e).__name__}: {e}")
