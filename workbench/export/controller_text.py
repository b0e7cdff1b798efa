"""The controller's files: its program as C99, as IEC 61131-3 structured text and as PLCopen XML, with self-tests on its
record; or a drive's parameters."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

from jinja2 import Environment, PackageLoader, StrictUndefined

from workbench import __version__
from workbench.control import PiSettings, feed_forward
from workbench.core.yaml_strict import dumps, load, validate
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
    check_exported,
    checked,
)
from workbench.machines import HOIST, Hoist
from workbench.references import Limits
from workbench.study.scenario import LimitsBlock

DRIVES = ("siemens-s120", "abb-acs880", "generic")
_JINJA = Environment(undefined=StrictUndefined)


def ramp_of(path: Path) -> Limits | None:
    """The limits of a scenario's motion, both ways alike; None for a file without them."""
    block = load(path).block("limits")
    if block is None:
        return None
    given = validate(LimitsBlock, block).given()
    return Limits(**given) if {"speed_m_s", "acceleration_m_s2"} <= given.keys() else None


@cache
def _table() -> dict[str, Any]:
    data = load(Path(__file__).with_name("drives.yaml")).data
    assert isinstance(data, dict) and tuple(data["drives"]) == DRIVES
    return data


def drive_settings(
    drive: str, settings: PiSettings, machine: Hoist, payload_kg: float = 0.0, ramp: Limits | None = None
) -> dict[str, Any]:
    """The parameters of one drive, each motor on its own: gains and inertia are divided by the number of motors; and
    what that drive's controller does not do as the exported one. KeyError for a drive that is not among DRIVES."""
    check_exported(settings)
    motor, p = machine.motor, vars(HOIST.plant.values(machine, payload_kg))
    fed = {**p, "ff_J": 1.0, "ff_w": 0.0, "ff_F": 0.0, "T_hold": 0.0}
    ki, top = settings.ki_nm_per_rad, motor.nominal_speed_rad_s
    names = {
        "drive": drive, "s": settings, "ramp": ramp, "motors": motor.count, "rpm": 60.0 / (2.0 * math.pi), "top": top,
        "kp": settings.kp_nm_s_per_rad / motor.count, "ki": ki / motor.count, "rotor": motor.rotor_inertia_kg_m2,
        "integral_time_s": settings.kp_nm_s_per_rad / ki if ki > 0.0 else 0.0, "nominal": motor.nominal_torque_nm,
        "inertia": float(feed_forward(SimpleNamespace(**fed), 0.0, 1.0)) / motor.count,
        "overload": machine.drive.overload, "filtered_s": machine.drive.speed_filter_s,
    }  # fmt: skip
    if ramp is not None:
        names["ramp_time_s"] = top * machine.lift_m_per_rad / ramp.acceleration_m_s2
        names["rounding_time_s"] = ramp.acceleration_m_s2 / ramp.jerk_m_s3

    def value(text: Any) -> Any:
        return _JINJA.compile_expression(str(text), undefined_to_none=False)(names)

    table = _table()
    parameters = {
        row["number"]: {
            "name": row["name"], "value": float(value(row["value"])), "unit": row.get("unit", ""), "why": row["why"],
            **({"source": table["sources"][row["source"]]} if "source" in row else {}),
        }
        for row in table["drives"][drive]["parameters"] if value(row.get("when", True))
    }  # fmt: skip
    differs = [_JINJA.from_string(row["say"]).render(names) for row in table["differs"] if value(row["when"])]
    head = {"drive": drive, "manual": table["drives"][drive]["manual"], "drives": motor.count}
    return {**head, "parameters": parameters, "differs": differs}


def settings_text(made: dict[str, Any]) -> str:
    """The parameters as YAML, with what differs; values of six digits."""
    rounded = {n: {**row, "value": float(f"{row['value']:.6g}")} for n, row in made["parameters"].items()}
    return dumps({**made, "parameters": rounded})


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


def _sections(program: Program) -> dict[str, list[dict[str, str]]]:
    """The variables of the function block by section: name, type, meaning and first value of each."""
    reasons = "; ".join(f"{check.reason} {check.meaning}" for check in CHECKS)
    takes_over = "takes over a load that torque_hold_nm holds, without a bump, ends a fault; TRUE in the first call"
    held = "a check failed: the last torque is held until a reset; wire it to the brake"
    rows: dict[str, list[tuple[str, ...]]] = {
        "VAR_INPUT": [
            ("reset", "BOOL", takes_over), ("torque_hold_nm", "LREAL"), (INPUTS[0], "LREAL"), (INPUTS[1], "LREAL"),
            (INPUTS[2], "BOOL", "one motor gives no torque"),
        ],
        "VAR_OUTPUT": [
            ("torque_motor_nm", "LREAL"), ("limited", "BOOL", "the command is at a limit"), ("fault", "BOOL", held),
            ("fault_reason", "INT", f"0 none; {reasons}"),
        ],
        "VAR CONSTANT": [(n.name, "LREAL", n.meaning, st_number(n.value)) for n in program.numbers],
        "VAR": [
            *((name, "LREAL") for name in (*program.memory, "speed_before", *program.locals, "most_nm")),
            ("fresh", "BOOL"),
        ],
    }  # fmt: skip
    columns = ("name", "kind", "meaning", "start")
    return {
        section: [dict(zip(columns, (*row, "", "")[:4], strict=True)) for row in variables]
        for section, variables in rows.items()
    }


def controller_files(
    form: Literal["st", "c", "yaml"],
    settings: PiSettings,
    machine: Hoist,
    payload_kg: float = 0.0,
    drive: str = "generic",
    ramp: Limits | None = None,
) -> dict[str, str]:
    """File name -> text. InputError for a term of the controller that is not exported."""
    if form == "yaml":
        return {"drive_parameters.yaml": settings_text(drive_settings(drive, settings, machine, payload_kg, ramp))}
    program, record = checked(settings, machine, payload_kg)
    name = machine.name.replace("*", " ").replace("\n", " ")  # ends no comment
    title = f"Sampled PI speed controller for {name}, by workbench {__version__}"
    columns = (record.reference_rad_s, record.speed_rad_s, record.motor_failed, record.torque_nm)
    rows = list(zip(*(map(float, column) for column in columns), strict=True))
    c = c_of(program)
    environment = Environment(
        loader=PackageLoader("workbench", "export/controller_templates"), undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters |= {
        "c": lambda text: expression(text, c), "c_line": lambda line: assignment(line, c, "="),
        "st": lambda text: expression(text, ST), "st_line": lambda line: assignment(line, ST, ":="),
        "lreal": st_number, "repr": repr,
    }  # fmt: skip
    values: dict[str, Any] = {
        "title": title, "version": __version__, "program": program, "record": record, "rows": rows,
        "checks": CHECKS, "hold": HOLD, "result": RESULT, "sections": _sections(program), "profile": PROFILE,
        "follows": FOLLOWS, "ripple": RIPPLE, "turn": 2.0 * math.pi * RIPPLES, "compared": COMPARED,
        "expected": record.torque_nm[COMPARED - 1 :: COMPARED].tolist(), "tolerance_nm": AGREES * record.largest_nm,
        "inputs": INPUTS,
    }  # fmt: skip
    values["body"] = environment.get_template("body.st").render(values)
    endings = {"c": (".h", ".c", "_test.c"), "st": (".st", ".xml", "_test.st")}[form]
    names = [f"speed_controller{ending}" for ending in endings]
    return {name: environment.get_template(name).render(values) for name in ("test_record.csv", *names)}
