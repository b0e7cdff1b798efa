"""The controller's program as C99 and as IEC 61131-3 structured text, each with a self-test on its record."""

from __future__ import annotations

import ast
import re

from workbench.export.program import Number, Program, Record, tree

_COMPARE = {ast.Lt: "<", ast.Gt: ">", ast.LtE: "<=", ast.GtE: ">="}
_ARITHMETIC = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_C_CALLS = {"abs": "fabs", "min": "fmin", "max": "fmax"}
INPUTS = ("speed_reference_rad_s", "speed_motor_rad_s", "motor_failed")


def c_expression(e: ast.expr) -> str:
    """An expression of the program in C."""
    return _printed(e, _c_call, _c_name, repr)


def st_expression(e: ast.expr) -> str:
    """An expression of the program in structured text."""
    return _printed(e, _st_call, _st_name, st_number)


def _printed(e: ast.expr, call, name, number) -> str:  # type: ignore[no-untyped-def]
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
                return f"{a} {_ARITHMETIC[type(op)]} {b}"
            case ast.UnaryOp(ast.USub(), operand):
                return f"-{show(operand)}"
            case ast.Compare(left, [op], [right]):
                return f"{show(left)} {_COMPARE[type(op)]} {show(right)}"
            case ast.Call(ast.Name(function), arguments):
                return str(call(function, [show(a) for a in arguments]))
            case ast.Name(word):
                return str(name(word))
            case ast.Constant(value):
                return str(number(float(value)))  # type: ignore[arg-type]
        raise TypeError(f"the program does not take {ast.unparse(x)}")

    return show(e)


def _c_call(function: str, arguments: list[str]) -> str:
    if function == "where":
        condition, a, b = arguments
        return f"({condition} ? {a} : {b})"
    return f"{_C_CALLS[function]}({', '.join(arguments)})"


def _st_call(function: str, arguments: list[str]) -> str:
    if function == "where":  # SEL gives the third where the first is TRUE
        condition, a, b = arguments
        return f"SEL({condition}, {b}, {a})"
    return f"{function.upper()}({', '.join(arguments)})"


def _c_name(word: str) -> str:
    return word


def _st_name(word: str) -> str:
    return {"reference": INPUTS[0], "speed": INPUTS[1]}.get(word, word)


def st_number(value: float) -> str:
    """A literal of structured text: digits on both sides of the point, E for the exponent."""
    mantissa, _, exponent = repr(float(value)).partition("e")
    mantissa = mantissa if "." in mantissa else f"{mantissa}.0"
    return f"{mantissa}E{int(exponent):+d}" if exponent else mantissa


def _c_member(expression: str, program: Program) -> str:
    """Constants and memory stand in the block `m`."""
    kept = {*program.memory, *(number.name for number in program.numbers)}
    return re.sub(r"[A-Za-z_]\w*", lambda word: f"m->{word[0]}" if word[0] in kept else word[0], expression)


def _c_line(line: str, program: Program, indent: str = "    ") -> str:
    name, _, right = line.partition(" = ")
    return f"{indent}{_c_member(name, program)} = {_c_member(c_expression(tree(right)), program)};"


def c_header(program: Program, title: str) -> str:
    numbers = "\n".join(f"    double {n.name}; /* {n.meaning} */" for n in program.numbers)
    memory = "\n".join(f"    double {name};" for name in program.memory)
    return f"""/* {title}
   SI units; hoisting is positive; torque is that of all motors together. */
#ifndef SPEED_CONTROLLER_H
#define SPEED_CONTROLLER_H

typedef struct {{
    /* constants, set by speed_controller_init */
{numbers}
    /* memory, set by speed_controller_reset */
{memory}
    double torque_motor_nm; /* the last command */
    int limited;            /* the command is at a limit */
    int fault;              /* an input was no finite number: the last command is held */
}} speed_controller;

void speed_controller_init(speed_controller *m);
/* Takes over a load that torque_hold_nm holds, without a bump. Call it before the first step. */
void speed_controller_reset(speed_controller *m, double torque_hold_nm);
/* One sample: call it every sample_time_s. Returns the torque command, N m. */
double speed_controller_step(speed_controller *m, double speed_reference_rad_s, double speed_motor_rad_s,
                             int motor_failed);

#endif
"""


def c_source(program: Program, title: str) -> str:
    numbers = "\n".join(f"    m->{n.name} = {float(n.value)!r};" for n in program.numbers)
    reset = "\n".join(_c_line(line, program) for line in program.reset)
    blocks = "\n".join(
        "\n".join([f"    /* {comment} */", *(_c_line(line, program) for line in lines)])
        for comment, lines in program.step
    )
    return f"""/* {title} */
#include "speed_controller.h"

#include <math.h>

void speed_controller_init(speed_controller *m) {{
{numbers}
    speed_controller_reset(m, 0.0);
}}

void speed_controller_reset(speed_controller *m, double torque_hold_nm) {{
{reset}
    m->torque_motor_nm = torque_hold_nm;
    m->limited = 0;
    m->fault = 0;
}}

double speed_controller_step(speed_controller *m, double speed_reference_rad_s, double speed_motor_rad_s,
                             int motor_failed) {{
    const double reference = speed_reference_rad_s, speed = speed_motor_rad_s;
    double {", ".join(program.locals)};
    m->fault = !(isfinite(reference) && isfinite(speed));
    if (m->fault) return m->torque_motor_nm;
{blocks}
    m->torque_motor_nm = torque;
    m->limited = torque != wanted;
    return torque;
}}
"""


def c_test(record: Record, title: str) -> str:
    rows = ",\n".join(
        f"    {{{float(r)!r}, {float(w)!r}, {int(f)}, {float(u)!r}}}"
        for r, w, f, u in zip(
            record.reference_rad_s, record.speed_rad_s, record.motor_failed, record.torque_nm, strict=True
        )
    )
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
    printf("%d samples, largest difference %.3g N m\\n", n, worst);
    return worst <= {1e-9 * record.largest_nm!r} ? 0 : 1;
}}
"""


def st_block(program: Program, title: str) -> str:
    numbers = "\n".join(f"    {n.name} : LREAL := {st_number(n.value)}; (* {n.meaning} *)" for n in program.numbers)
    memory = "\n".join(f"    {name} : LREAL;" for name in program.memory)
    working = "\n".join(f"    {name} : LREAL;" for name in program.locals)
    reset = "\n".join(_st_line(line) for line in program.reset)
    blocks = "\n".join(
        "\n".join([f"    (* {comment} *)", *(_st_line(line) for line in lines)]) for comment, lines in program.step
    )
    return f"""(* {title}
   Call it every sample_time_s. SI units; hoisting is positive; torque is that of all motors together. *)
FUNCTION_BLOCK SpeedController
VAR_INPUT
    reset : BOOL; (* takes over a load that torque_hold_nm holds, without a bump; TRUE in the first call *)
    torque_hold_nm : LREAL;
    speed_reference_rad_s : LREAL;
    speed_motor_rad_s : LREAL;
    motor_failed : BOOL; (* one motor gives no torque *)
END_VAR
VAR_OUTPUT
    torque_motor_nm : LREAL;
    limited : BOOL; (* the command is at a limit *)
    fault : BOOL; (* an input was no finite number: the last command is held *)
END_VAR
VAR
{numbers}
{memory}
{working}
END_VAR
fault := NOT ((speed_reference_rad_s - speed_reference_rad_s = 0.0) AND (speed_motor_rad_s - speed_motor_rad_s = 0.0));
IF reset THEN
{reset}
    torque_motor_nm := torque_hold_nm;
    limited := FALSE;
ELSIF NOT fault THEN
{blocks}
    torque_motor_nm := torque;
    limited := torque <> wanted;
END_IF
END_FUNCTION_BLOCK
"""


def _st_line(line: str) -> str:
    name, _, right = line.partition(" = ")
    return f"    {name} := {st_expression(tree(right))};"


def st_test(record: Record, title: str) -> str:
    """A program that runs one sample a cycle and says in `passed` whether all agree."""
    n = len(record.torque_nm)

    def table(name: str, kind: str, values: list[str]) -> str:
        rows = ",\n        ".join(", ".join(values[i : i + 8]) for i in range(0, n, 8))
        return f"    {name} : ARRAY[0..{n - 1}] OF {kind} := [\n        {rows}];"

    tables = "\n".join(
        [
            table("given_reference", "LREAL", [st_number(x) for x in record.reference_rad_s]),
            table("given_speed", "LREAL", [st_number(x) for x in record.speed_rad_s]),
            table("given_failed", "BOOL", ["TRUE" if x > 0.5 else "FALSE" for x in record.motor_failed]),
            table("expected_torque", "LREAL", [st_number(x) for x in record.torque_nm]),
        ]
    )
    return f"""(* Self-test of: {title}
   Inputs and the torque that the controller of the studies gives, a sample in each cycle. *)
PROGRAM SpeedControllerTest
VAR
    controller : SpeedController;
    sample : INT := -1;
    worst_nm : LREAL := 0.0;
    done : BOOL := FALSE;
    passed : BOOL := FALSE;
{tables}
END_VAR
IF sample < 0 THEN
    controller(reset := TRUE, torque_hold_nm := {st_number(record.hold_nm)});
    sample := 0;
ELSIF NOT done THEN
    controller(reset := FALSE, speed_reference_rad_s := given_reference[sample],
        speed_motor_rad_s := given_speed[sample], motor_failed := given_failed[sample]);
    worst_nm := MAX(worst_nm, ABS(controller.torque_motor_nm - expected_torque[sample]));
    sample := sample + 1;
    done := sample > {n - 1};
    passed := done AND (worst_nm <= {st_number(1e-9 * record.largest_nm)});
END_IF
END_PROGRAM
"""


def record_csv(record: Record) -> str:
    """The test record as a table; its first line after the header is the first step after the reset."""
    lines = [f"# reset with torque_hold_nm {record.hold_nm!r}", ",".join((*INPUTS, "torque_motor_nm"))]
    lines += [
        f"{float(r)!r},{float(w)!r},{int(f)},{float(u)!r}"
        for r, w, f, u in zip(
            record.reference_rad_s, record.speed_rad_s, record.motor_failed, record.torque_nm, strict=True
        )
    ]
    return "\n".join(lines) + "\n"


__all__ = [
    "Number", "c_expression", "c_header", "c_source", "c_test", "record_csv", "st_block", "st_expression", "st_number",
    "st_test",
]  # fmt: skip
