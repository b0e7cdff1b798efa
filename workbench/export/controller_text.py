"""The controller's program as C99, as IEC 61131-3 structured text and as PLCopen XML, with self-tests on its record."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from workbench.export.controller_program import (
    CHECKS,
    FOLLOWS,
    HOLD,
    PROFILE,
    RESULT,
    RIPPLE,
    RIPPLES,
    Number,
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


def _block(program: Program, language: Language, sign: str, indent: str, comment: str) -> str:
    """The step's lines with their comments."""
    lines = []
    for title, block in program.step:
        lines.append(indent + comment.format(title))
        lines += [indent + assignment(line, language, sign) for line in block]
    return "\n".join(lines)


def c_header(title: str, program: Program) -> str:
    memory = "\n".join(f"    double {name};" for name in (*program.memory, "speed_before"))
    reasons = "\n".join(f"    /* {check.reason}: {check.meaning} */" for check in CHECKS)
    return f"""/* {title}
   SI units; hoisting is positive; torque is that of all motors together. */
#ifndef SPEED_CONTROLLER_H
#define SPEED_CONTROLLER_H

#ifdef __FAST_MATH__
#error "the checks compare with NaN: compile without -ffast-math"
#endif

typedef struct {{
    /* memory, set by speed_controller_reset */
{memory}
    int fresh;              /* no sample since the reset */
    double torque_motor_nm; /* the last command */
    int limited;            /* the command is at a limit */
    int fault;              /* a check failed: the last torque is held until a reset; wire it to the brake */
    int fault_reason;       /* 0: none; else */
{reasons}
}} speed_controller;

void speed_controller_init(speed_controller *m);
/* Takes over a load that torque_hold_nm holds, without a bump, and ends a fault. Call it before the first step. */
void speed_controller_reset(speed_controller *m, double torque_hold_nm);
/* One sample: call it every sample_time_s. Returns the torque command, N m. */
double speed_controller_step(speed_controller *m, double speed_reference_rad_s, double speed_motor_rad_s,
                             int motor_failed);

#endif
"""


def c_source(title: str, program: Program) -> str:
    c = c_of(program)
    numbers = "\n".join(f"static const double {n.name} = {n.value!r}; /* {n.meaning} */" for n in program.numbers)
    reset = "\n".join(f"    {assignment(line, c, '=')}" for line in program.reset)
    zero = "\n".join(f"    m->{name} = 0.0;" for name in program.memory)
    checks = "\n".join(
        f"    {'else ' if i else ''}if (!({expression(check.holds, c)})) m->fault_reason = {check.reason};"
        for i, check in enumerate(program.before)
    )
    return f"""/* {title} */
#include "speed_controller.h"

#include <math.h>

{numbers}

/* The last torque, as far as the motors that are left give it; a torque that is none is not held. */
static double held(speed_controller *m, int motor_failed) {{
    const double most = motor_failed ? torque_limit_one_failed_nm : torque_limit_nm;
    m->fault = 1;
    m->limited = 0;
    if (!(fabs(m->torque_motor_nm) <= torque_limit_nm)) m->torque_motor_nm = 0.0;
    m->torque_motor_nm = fmin(fmax(m->torque_motor_nm, -most), most);
    return m->torque_motor_nm;
}}

void speed_controller_init(speed_controller *m) {{
    m->torque_motor_nm = 0.0;
    speed_controller_reset(m, 0.0);
}}

void speed_controller_reset(speed_controller *m, double torque_hold_nm) {{
    m->fault_reason = 0;
    m->fresh = 1;
    m->speed_before = 0.0;
{zero}
    if (!({expression(HOLD.holds, c)})) {{
        m->fault_reason = {HOLD.reason};
        held(m, 0);
        return;
    }}
{reset}
    m->torque_motor_nm = torque_hold_nm;
    m->limited = 0;
    m->fault = 0;
}}

double speed_controller_step(speed_controller *m, double speed_reference_rad_s, double speed_motor_rad_s,
                             int motor_failed) {{
    const double reference = speed_reference_rad_s, speed = speed_motor_rad_s;
    double {", ".join(program.locals)};
    if (m->fault) return held(m, motor_failed);
{checks}
    if (m->fault_reason) return held(m, motor_failed);
{_block(program, c, "=", "    ", "/* {} */")}
    if (!({expression(RESULT.holds, c)})) {{
        m->fault_reason = {RESULT.reason};
        return held(m, motor_failed);
    }}
    m->speed_before = speed;
    m->fresh = 0;
    m->torque_motor_nm = command;
    m->limited = command != wanted;
    return command;
}}
"""


def c_test(title: str, record: Record) -> str:
    rows = ",\n".join(f"    {{{r!r}, {w!r}, {int(f)}, {u!r}}}" for r, w, f, u in _rows(record))
    return f"""/* Self-test of: {title}
   Inputs and the torque that the controller of the studies gives. Exit status 0: they agree. */
#include "speed_controller.h"

#include <math.h>
#include <stdio.h>

static const struct {{ double reference, speed; int failed; double torque; }} record[] = {{
{rows}
}};

int main(void) {{
    speed_controller m;
    double worst = 0.0;
    const int n = (int)(sizeof record / sizeof record[0]);
    speed_controller_init(&m);
    speed_controller_reset(&m, {record.hold_nm!r});
    for (int k = 0; k < n; k++) {{
        double torque = speed_controller_step(&m, record[k].reference, record[k].speed, record[k].failed);
        worst = fmax(worst, fabs(torque - record[k].torque));
    }}
    printf("%d samples, largest difference %.3g N m, fault %d\\n", n, worst, m.fault_reason);
    return worst <= {1e-9 * record.largest_nm!r} && !m.fault ? 0 : 1;
}}
"""


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


def _st_body(program: Program) -> str:
    reset = "\n".join(f"        {assignment(line, ST, ':=')}" for line in program.reset)
    zero = "\n".join(f"    {name} := 0.0;" for name in program.memory)
    checks = "\n".join(
        f"    {word} NOT ({expression(check.holds, ST)}) THEN\n        fault_reason := {check.reason};"
        for word, check in zip(("IF", "ELSIF", "ELSIF", "ELSIF"), program.before, strict=True)
    )
    return f"""IF reset THEN
    fault := FALSE;
    fault_reason := 0;
    fresh := TRUE;
    speed_before := 0.0;
{zero}
    IF {expression(HOLD.holds, ST)} THEN
{reset}
        torque_motor_nm := torque_hold_nm;
        limited := FALSE;
    ELSE
        fault_reason := {HOLD.reason};
    END_IF;
ELSIF NOT fault THEN
{checks}
    END_IF;
    IF fault_reason = 0 THEN
{_block(program, ST, ":=", "        ", "(* {} *)")}
        IF {expression(RESULT.holds, ST)} THEN
            speed_before := {INPUTS[1]};
            fresh := FALSE;
            torque_motor_nm := command;
            limited := command <> wanted;
        ELSE
            fault_reason := {RESULT.reason};
        END_IF;
    END_IF;
END_IF;
fault := fault_reason <> 0;
IF fault THEN
    (* the last torque, as far as the motors that are left give it; a torque that is none is not held *)
    limited := FALSE;
    IF NOT (ABS(torque_motor_nm) <= torque_limit_nm) THEN
        torque_motor_nm := 0.0;
    END_IF;
    most_nm := SEL(motor_failed AND NOT reset, torque_limit_nm, torque_limit_one_failed_nm);
    torque_motor_nm := MIN(MAX(torque_motor_nm, -most_nm), most_nm);
END_IF;"""


def st_block(title: str, program: Program) -> str:
    sections = []
    for section, variables in _sections(program).items():
        lines = [
            f"    {v.name} : {v.kind}{f' := {v.start}' if v.start else ''};{f' (* {v.meaning} *)' if v.meaning else ''}"
            for v in variables
        ]
        sections.append("\n".join([section, *lines, "END_VAR"]))
    declared = "\n".join(sections)
    return f"""(* {title}
   Call it every sample_time_s. SI units; hoisting is positive; torque is that of all motors together. *)
FUNCTION_BLOCK SpeedController
{declared}
{_st_body(program)}
END_FUNCTION_BLOCK
"""


TC6 = "http://www.plcopen.org/xml/tc6_0201"
XHTML = "http://www.w3.org/1999/xhtml"
MOMENT = "2000-01-01T00:00:00"  # one controller, one file
_XML_SECTIONS = {"VAR_INPUT": "inputVars", "VAR_OUTPUT": "outputVars", "VAR CONSTANT": "localVars", "VAR": "localVars"}


def plcopen_xml(title: str, program: Program, version: str) -> str:
    """The function block as PLCopen TC6 2.01, which CODESYS, TwinCAT and Beremiz import."""
    ET.register_namespace("", TC6)
    ET.register_namespace("xhtml", XHTML)

    def add(parent: ET.Element, element: str, /, **attributes: str) -> ET.Element:
        return ET.SubElement(parent, f"{{{TC6}}}{element}", attributes)

    def words(parent: ET.Element, text: str) -> None:
        ET.SubElement(parent, f"{{{XHTML}}}p").text = text

    root = ET.Element(f"{{{TC6}}}project")
    add(root, "fileHeader", companyName="", productName="workbench", productVersion=version, creationDateTime=MOMENT)
    places = add(add(root, "contentHeader", name="SpeedController"), "coordinateInfo")
    for language in ("fbd", "ld", "sfc"):
        add(add(places, language), "scaling", x="1", y="1")
    types = add(root, "types")
    add(types, "dataTypes")
    pou = add(add(types, "pous"), "pou", name="SpeedController", pouType="functionBlock")
    interface = add(pou, "interface")
    for section, variables in _sections(program).items():
        constant = {"constant": "true"} if section == "VAR CONSTANT" else {}
        block = add(interface, _XML_SECTIONS[section], **constant)
        for v in variables:
            variable = add(block, "variable", name=v.name)
            add(add(variable, "type"), v.kind)
            if v.start:
                add(add(variable, "initialValue"), "simpleValue", value=v.start)
            if v.meaning:
                words(add(variable, "documentation"), v.meaning)
    words(add(add(pou, "body"), "ST"), _st_body(program))
    words(add(pou, "documentation"), title)
    add(add(root, "instances"), "configurations")
    ET.indent(root)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def st_test(title: str, record: Record) -> str:
    """A program that makes the record's inputs, one sample a cycle, and shows in `passed` whether the torques agree.

    Every COMPARED-th torque stands in it; a table of all would keep a PLC's memory and a parser busy."""
    n, top = len(record.torque_nm), record.top_rad_s
    expected = [st_number(float(x)) for x in record.torque_nm[COMPARED - 1 :: COMPARED]]
    rows = ",\n        ".join(", ".join(expected[i : i + 5]) for i in range(0, len(expected), 5))
    shapes = "\n".join(
        f"    {word} part < {st_number(until)} THEN\n"
        f"        asked := {st_number(top)} * ({st_number(level)} + {st_number(slope)} * (part - 0.05));"
        for word, (until, level, slope) in zip(["IF", *["ELSIF"] * (len(PROFILE) - 1)], PROFILE, strict=True)
    )
    ripple = f"{st_number(RIPPLE * top)} * SIN({st_number(2.0 * math.pi * RIPPLES)} * part)"
    return f"""(* Self-test of: {title}
   Inputs as in test_record.csv, a sample in each cycle, and the torque that the controller of the studies gives. *)
PROGRAM SpeedControllerTest
VAR
    controller : SpeedController;
    sample : INT := -1;
    part : LREAL;
    asked : LREAL;
    follows : LREAL := 0.0;
    worst_nm : LREAL := 0.0;
    done : BOOL := FALSE;
    passed : BOOL := FALSE;
    expected_nm : ARRAY[0..{len(expected) - 1}] OF LREAL := [
        {rows}];
END_VAR
IF sample < 0 THEN
    controller(reset := TRUE, torque_hold_nm := {st_number(record.hold_nm)});
    sample := 0;
ELSIF NOT done THEN
    part := INT_TO_LREAL(sample) / {st_number(n)};
{shapes}
    END_IF;
    controller(reset := FALSE, speed_reference_rad_s := asked,
        speed_motor_rad_s := follows + {ripple},
        motor_failed := sample >= {int(n - sum(record.motor_failed))});
    follows := follows + MIN(MAX({st_number(FOLLOWS)} * (asked - follows), {st_number(-record.fastest_rad_s)}),
        {st_number(record.fastest_rad_s)});
    IF sample MOD {COMPARED} = {COMPARED - 1} THEN
        worst_nm := MAX(worst_nm, ABS(controller.torque_motor_nm - expected_nm[sample / {COMPARED}]));
    END_IF;
    sample := sample + 1;
    done := sample > {n - 1};
    passed := done AND NOT controller.fault AND (worst_nm <= {st_number(1e-9 * record.largest_nm)});
END_IF;
END_PROGRAM
"""


def record_csv(record: Record) -> str:
    """The test record as a table; its first line after the header is the first step after the reset."""
    lines = [f"# reset with torque_hold_nm {record.hold_nm!r}", ",".join((*INPUTS, "torque_motor_nm"))]
    lines += [f"{r!r},{w!r},{int(f)},{u!r}" for r, w, f, u in _rows(record)]
    return "\n".join(lines) + "\n"


def _rows(record: Record) -> list[tuple[float, float, float, float]]:
    """Reference, speed, whether a motor has failed, torque, by sample."""
    columns = (record.reference_rad_s, record.speed_rad_s, record.motor_failed, record.torque_nm)
    return list(zip(*(map(float, column) for column in columns), strict=True))


def c_files(title: str, program: Program, record: Record) -> dict[str, str]:
    """File name -> text. title: it goes into comments and ends none."""
    return {
        "speed_controller.h": c_header(title, program),
        "speed_controller.c": c_source(title, program),
        "speed_controller_test.c": c_test(title, record),
    }


def st_files(title: str, program: Program, record: Record, version: str) -> dict[str, str]:
    return {
        "speed_controller.st": st_block(title, program),
        "speed_controller.xml": plcopen_xml(title, program, version),
        "speed_controller_test.st": st_test(title, record),
    }


__all__ = ["Number", "c_files", "expression", "record_csv", "st_files", "st_number"]
