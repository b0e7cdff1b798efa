"""The controller's program as C99, as IEC 61131-3 structured text and as PLCopen XML, with self-tests on its record."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from workbench.export.controller_program import (
    AGREES,
    CHECKS,
    FOLLOWS,
    HOLD,
    PROFILE,
    RESULT,
    RIPPLE,
    RIPPLES,
    Program,
    Record,
)

COMPARED = 20  # samples between two torques that the self-test in structured text compares
INPUTS = ("speed_reference_rad_s", "speed_motor_rad_s", "motor_failed")
_OPERATORS = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Lt: "<", ast.Gt: ">", ast.LtE: "<=", ast.GtE: ">=",
}  # fmt: skip
_C_CALLS = {"abs": "fabs", "min": "fmin", "max": "fmax"}


@dataclass(frozen=True)
class Language:
    """How a language writes calls, names, numbers, and joins truths."""

    call: Callable[[str, list[str]], str]
    name: Callable[[str], str]
    number: Callable[[float], str]
    both: str
    either: str


def expression(text: str, language: Language) -> str:
    """An expression of the program in a language. TypeError for what the program does not take."""

    def show(x: ast.expr) -> str:
        match x:
            case ast.BinOp(left, op, right):
                a, b = show(left), show(right)
                # Left to right in all three languages; brackets wherever that is not plain.
                if isinstance(op, ast.Mult | ast.Div):
                    a = f"({a})" if isinstance(left, ast.BinOp) and isinstance(left.op, ast.Add | ast.Sub) else a
                    b = f"({b})" if isinstance(right, ast.BinOp | ast.UnaryOp) else b
                else:
                    b = f"({b})" if isinstance(right, ast.BinOp) and isinstance(right.op, ast.Add | ast.Sub) else b
                return f"{a} {_OPERATORS[type(op)]} {b}"
            case ast.BoolOp(op, values):
                joint = language.both if isinstance(op, ast.And) else language.either
                return f" {joint} ".join(f"({show(value)})" for value in values)
            case ast.UnaryOp(ast.USub(), operand):
                return f"-{show(operand)}"
            case ast.Compare(left, [op], [right]):
                return f"{show(left)} {_OPERATORS[type(op)]} {show(right)}"
            case ast.Call(ast.Name(function), arguments):
                return language.call(function, [show(a) for a in arguments])
            case ast.Name(word):
                return language.name(word)
            case ast.Constant(int() | float() as value):
                return language.number(float(value))
        raise TypeError(f"the program does not take {ast.unparse(x)}")

    return show(ast.parse(text, mode="eval").body)


def assignment(line: str, language: Language, sign: str) -> str:
    name, _, right = line.partition(" = ")
    return f"{language.name(name)} {sign} {expression(right, language)};"


def c_of(program: Program) -> Language:
    """C99; what is kept stands in the structure `m`."""
    kept = {*program.memory, "fresh", "speed_before"}

    def call(function: str, arguments: list[str]) -> str:
        if function == "where":
            condition, a, b = arguments
            return f"({condition} ? {a} : {b})"
        return f"{_C_CALLS[function]}({', '.join(arguments)})"

    return Language(call, lambda word: f"m->{word}" if word in kept else word, repr, "&&", "||")


def _st_call(function: str, arguments: list[str]) -> str:
    if function == "where":  # SEL gives the third where the first is TRUE
        condition, a, b = arguments
        return f"SEL({condition}, {b}, {a})"
    return f"{function.upper()}({', '.join(arguments)})"


def st_number(value: float) -> str:
    """A literal of structured text: digits on both sides of the point, E for the exponent."""
    mantissa, _, exponent = repr(float(value)).partition("e")
    mantissa = mantissa if "." in mantissa else f"{mantissa}.0"
    return f"{mantissa}E{int(exponent):+d}" if exponent else mantissa


ST = Language(
    _st_call, lambda word: {"reference": INPUTS[0], "speed": INPUTS[1]}.get(word, word), st_number, "AND", "OR"
)


@dataclass(frozen=True)
class Declared:
    """A variable of the function block."""

    name: str
    kind: str
    meaning: str = ""
    start: str = ""


def _sections(program: Program) -> dict[str, list[Declared]]:
    """The variables of the block by section."""
    reasons = "; ".join(f"{check.reason} {check.meaning}" for check in CHECKS)
    takes_over = "takes over a load that torque_hold_nm holds, without a bump, ends a fault; TRUE in the first call"
    return {
        "VAR_INPUT": [
            Declared("reset", "BOOL", takes_over), Declared("torque_hold_nm", "LREAL"), Declared(INPUTS[0], "LREAL"),
            Declared(INPUTS[1], "LREAL"), Declared(INPUTS[2], "BOOL", "one motor gives no torque"),
        ],
        "VAR_OUTPUT": [
            Declared("torque_motor_nm", "LREAL"), Declared("limited", "BOOL", "the command is at a limit"),
            Declared("fault", "BOOL", "a check failed: the last torque is held until a reset; wire it to the brake"),
            Declared("fault_reason", "INT", f"0 none; {reasons}"),
        ],
        "VAR CONSTANT": [Declared(n.name, "LREAL", n.meaning, st_number(n.value)) for n in program.numbers],
        "VAR": [
            *(Declared(name, "LREAL") for name in (*program.memory, "speed_before", *program.locals, "most_nm")),
            Declared("fresh", "BOOL"),
        ],
    }  # fmt: skip


def controller_texts(form: str, title: str, program: Program, record: Record, version: str) -> dict[str, str]:
    """File name -> text, of the form `c` or `st`. title: it goes into comments and ends none."""
    c = c_of(program)
    environment = Environment(
        loader=PackageLoader("workbench", "export/controller_templates"), undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters |= {
        "c": lambda text: expression(text, c), "c_line": lambda line: assignment(line, c, "="),
        "st": lambda text: expression(text, ST), "st_line": lambda line: assignment(line, ST, ":="),
        "lreal": st_number,
    }  # fmt: skip
    values: dict[str, Any] = {
        "title": title, "version": version, "program": program, "record": record, "rows": _rows(record),
        "checks": CHECKS, "hold": HOLD, "result": RESULT, "sections": _sections(program), "profile": PROFILE,
        "follows": FOLLOWS, "ripple": RIPPLE, "turn": 2.0 * math.pi * RIPPLES, "compared": COMPARED,
        "expected": record.torque_nm[COMPARED - 1 :: COMPARED].tolist(), "tolerance_nm": AGREES * record.largest_nm,
    }  # fmt: skip
    values["body"] = environment.get_template("body.st").render(values)
    names = {
        "c": ("speed_controller.h", "speed_controller.c", "speed_controller_test.c"),
        "st": ("speed_controller.st", "speed_controller.xml", "speed_controller_test.st"),
    }
    return {name: environment.get_template(name).render(values) for name in names[form]}


def record_csv(record: Record) -> str:
    """The test record as a table; its first line after the header is the first step after the reset."""
    lines = [f"# reset with torque_hold_nm {record.hold_nm!r}", ",".join((*INPUTS, "torque_motor_nm"))]
    lines += [f"{r!r},{w!r},{int(f)},{u!r}" for r, w, f, u in _rows(record)]
    return "\n".join(lines) + "\n"


def _rows(record: Record) -> list[tuple[float, float, float, float]]:
    """Reference, speed, whether a motor has failed, torque, by sample."""
    columns = (record.reference_rad_s, record.speed_rad_s, record.motor_failed, record.torque_nm)
    return list(zip(*(map(float, column) for column in columns), strict=True))
