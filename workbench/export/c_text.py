"""Printing traced programs as C99: straight-line functions on plain arrays.

What depends on parameters alone is computed once, by `constants`, into an array that the other functions read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from workbench.trace.emit import Printer
from workbench.trace.expr import Scalar

# Every printed line is one operation on names and numbers, `name = ...`.
_TRUTH = re.compile(r"^\S+ (<|<=|>|>=|&|\|) \S+$")
_CALLS = {
    "abs": "fabs", "atan_": "atan", "sin_": "sin", "cos_": "cos", "exp_": "exp", "sqrt_": "sqrt", "floor_": "floor",
}  # fmt: skip

HEADER = """\
#include <math.h>

static inline double fma_(double a, double b, double c) { return a * b + c; }
"""


class CText:
    """Functions over one array of constants; `parameters`: their order in the array p."""

    def __init__(self, parameters: Sequence[str]) -> None:
        self.parameters = tuple(parameters)
        self.printer = Printer()
        self.rows: dict[str, int] = {}
        self.functions: list[str] = []

    def function(
        self, name: str, arguments: str, reads: Mapping[str, str], outputs: Sequence[Scalar], to: Sequence[str]
    ) -> None:
        """A C function `void name(arguments)`; reads: symbol -> where its value stands; to: where each output goes."""
        body, results, carried = self.printer.block(outputs)
        used = set(re.findall(r"[A-Za-z_]\w*", "\n".join([*body, *results])))
        lines = [f"const double {symbol} = {place};" for symbol, place in reads.items() if symbol in used]
        for constant in carried:
            row = self.rows.setdefault(constant, len(self.rows))
            lines.append(f"const {self._type_of(constant)} {constant} = c[{row}];")
        lines += [_statement(line) for line in body]
        lines += [f"{place} = {result};" for place, result in zip(to, results, strict=True)]
        silent = " ".join(f"(void){word};" for word in re.findall(r"(\w+)(?:,|$)", arguments))
        self.functions.append(
            "\n".join([f"void {name}({arguments}) {{", f"    {silent}", *(f"    {x}" for x in lines), "}"])
        )

    def constants(self, name: str = "model_constants") -> str:
        """The function that computes the constants; print it after all others, for they say what they read."""
        lines = [f"const double p_{symbol} = p[{i}];" for i, symbol in enumerate(self.parameters)]
        lines += [_statement(line) for line in self.printer.setup]
        lines += [f"c[{row}] = {constant};" for constant, row in self.rows.items()]
        text = "\n".join(f"    {line}" for line in lines)
        # A parameter that no equation reads is none of the compiler's business.
        silent = " ".join(f"(void)p_{symbol};" for symbol in self.parameters)
        unread = " ".join(f"(void)c_{i};" for i in range(len(self.printer.setup)))
        return (
            f"void {name}(const double *p, double *c) {{\n    (void)p; (void)c;\n{text}\n    {silent}\n    {unread}\n}}"
        )

    def text(self) -> str:
        return "\n\n".join([HEADER, *self.functions, self.constants()]) + "\n"

    def _type_of(self, constant: str) -> str:
        if constant.startswith("p_"):
            return "double"
        line = self.printer.setup[int(constant.removeprefix("c_"))]
        return "int" if _TRUTH.match(line.partition(" = ")[2]) else "double"


def _statement(line: str) -> str:
    """One printed operation as a C statement; a truth is an int."""
    name, _, operation = line.partition(" = ")
    kind = "int" if _TRUTH.match(operation) else "double"
    return f"const {kind} {name} = {c_operation(operation)};"


def c_operation(operation: str) -> str:
    """The right side of a printed line, in C."""
    call = re.fullmatch(r"(\w+)\((.*)\)", operation)
    if call is None:
        return operation
    function, arguments = call[1], call[2]
    if function == "select":
        condition, a, b = arguments.split(", ")
        return f"{condition} ? {a} : {b}"
    return f"{_CALLS.get(function, function)}({arguments})"
