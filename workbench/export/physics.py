"""The plant of one machine as C99: the traced equations as straight-line functions on plain arrays.

What depends on parameters alone is computed once, by `model_constants`, into an array that the other functions read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import SimpleNamespace
from typing import Any

from workbench.control import Controller
from workbench.engine.rodas3 import rodas3_step
from workbench.engine.source import state_symbols
from workbench.machines import Effects, Plant
from workbench.symbolic.derive import derivative
from workbench.symbolic.emit import Printer
from workbench.symbolic.expr import Expr, Scalar, Scalars, Signals, symbol

# Every printed line is one operation on names and numbers, `name = ...`.
_TRUTH = re.compile(r"^\S+ (<|<=|>|>=|&|\|) \S+$")
_CALL = re.compile(r"(\w+)\((.*)\)")
_FUNCTIONS = {"abs": "fabs"} | {f"{name}_": name for name in ("atan", "sin", "cos", "exp", "sqrt", "floor")}
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

    def function(self, name: str, arguments: str, reads: Mapping[str, str], outputs: Signals) -> None:
        """A C function `void name(arguments)`; reads: symbol -> where its value stands; outputs: by where each goes."""
        body, results, carried = self.printer.block(list(outputs.values()))
        used = set(re.findall(r"[A-Za-z_]\w*", "\n".join([*body, *results])))
        lines = ["".join(f"(void){word}; " for word in re.findall(r"(\w+)(?:,|$)", arguments)).rstrip()]
        lines += [f"const double {symbol} = {place};" for symbol, place in reads.items() if symbol in used]
        for constant in carried:
            row = self.rows.setdefault(constant, len(self.rows))
            setup = "" if constant.startswith("p_") else self.printer.setup[int(constant.removeprefix("c_"))]
            kind = "int" if _TRUTH.match(setup.partition(" = ")[2]) else "double"
            lines.append(f"const {kind} {constant} = c[{row}];")
        lines += map(_statement, body)
        lines += [f"{place} = {result};" for place, result in zip(outputs, results, strict=True)]
        self.functions.append("\n".join([f"void {name}({arguments}) {{", *(f"    {line}" for line in lines), "}"]))

    def text(self) -> str:
        """All functions, and behind them `model_constants`, for they say what it is to compute."""
        lines = [f"const double p_{symbol} = p[{i}];" for i, symbol in enumerate(self.parameters)]
        lines += map(_statement, self.printer.setup)
        lines += [f"c[{row}] = {constant};" for constant, row in self.rows.items()]
        # A parameter that no equation reads is none of the compiler's business.
        lines.append(" ".join(f"(void)p_{symbol};" for symbol in self.parameters))
        lines.append(" ".join(f"(void)c_{i};" for i in range(len(self.printer.setup))))
        body = "\n".join(f"    {line}" for line in lines)
        constants = f"void model_constants(const double *p, double *c) {{\n    (void)p; (void)c;\n{body}\n}}"
        return "\n\n".join([HEADER, *self.functions, constants]) + "\n"


def _statement(line: str) -> str:
    """One printed operation as a C statement; a truth is an int."""
    name, _, operation = line.partition(" = ")
    kind = "int" if _TRUTH.match(operation) else "double"
    if call := _CALL.fullmatch(operation):
        function, arguments = call[1], call[2]
        operation = f"{_FUNCTIONS.get(function, function)}({arguments})"
        if function == "select":
            operation = "{} ? {} : {}".format(*arguments.split(", "))
    return f"const {kind} {name} = {operation};"


def _symbols_of(value: Scalar) -> list[str]:
    """Names of the symbols that an expression reads, in order."""
    seen: set[int] = set()
    found: set[str] = set()
    waiting: list[Any] = [value]
    while waiting:
        e = waiting.pop()
        if isinstance(e, Expr) and e.id not in seen:
            seen.add(e.id)
            if e.op == "symbol":
                found.add(e.args[0])
            else:
                waiting += e.args
    return sorted(found)


def _to(array: str, outputs: Scalars) -> dict[str, Scalar]:
    return {f"{array}[{i}]": output for i, output in enumerate(outputs)}


@dataclass(frozen=True, eq=False)
class Physics:
    """A plant with its effects and, where there is one, the controller that drives it.

    p: the equations' parameters: symbols, and numbers where they are fixed. inputs: names of what is given at
    communication points, in the order of the array w; p may hold them as symbols `w_NAME`.
    """

    plant: Plant
    effects: Effects
    parameters: tuple[str, ...]
    p: SimpleNamespace
    inputs: tuple[str, ...]
    controller: Controller | None = None
    sample_time_s: float = 0.0
    lag: Scalar = 0.0
    text: CText = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "text", CText(self.parameters))

    @property
    def states(self) -> tuple[str, ...]:
        """Names of positions, speeds and the effects' memory."""
        return (*self.plant.positions, *self.plant.speeds, *(m.symbol for m in self.effects.memory))

    @property
    def unknowns(self) -> tuple[str, ...]:
        """What derivatives are known of: the plant's signals and the states' derivatives."""
        return (*(s.name for s in self.plant.signals), *(f"der({name})" for name in self.states))

    @property
    def shown(self) -> tuple[str, ...]:
        """Names of what `model_shown` gives: the plant's signals, states not among them, the states' derivatives."""
        signals = tuple(signal.name for signal in self.plant.signals)
        hidden = tuple(name for name in self.states if name not in signals)
        return (*signals, *hidden, *(f"der({name})" for name in self.states))

    @cached_property
    def _values(self) -> dict[str, Scalar]:
        """Everything that is shown, by name."""
        q, y = state_symbols(self.plant, self.effects)
        t, u = symbol("t"), symbol("u")
        signals = self.plant.shown(t, q, y, u, self.p, self.effects)
        rates = [*y[: len(q)], *self._rates(t, q, y, u)]
        states = dict(zip(self.states, (*q, *y), strict=True))
        return {**states, **signals, **dict(zip((f"der({name})" for name in self.states), rates, strict=True))}

    def _rates(self, t: Scalar, q: Scalars, y: Scalars, u: Scalar) -> Scalars:
        return self.plant.rates(t, q, y, u, self.p, self.effects)

    def dependencies(self) -> dict[str, tuple[str, ...]]:
        """By unknown: the states and inputs that its equation reads, and time."""
        q, y = state_symbols(self.plant, self.effects)
        known = {e.args[0]: name for e, name in zip((*q, *y), self.states, strict=True)}
        known |= {"t": "time", "u": self.plant.input} | {f"w_{name}": name for name in self.inputs}
        return {name: tuple(known[x] for x in _symbols_of(self._values[name]) if x in known) for name in self.unknowns}

    def model_text(self) -> str:
        """All functions of model.h. In C t, h, u, u_rate, hold are arguments; states stand in s, inputs in w."""
        plant, memory, c = self.plant, self.effects.memory, "const double *c, "
        q, y = state_symbols(plant, self.effects)
        t, h, u, u_rate, hold = (symbol(name) for name in ("t", "h", "u", "u_rate", "hold"))
        states = {e.args[0]: f"s[{i}]" for i, e in enumerate((*q, *y))}
        reads = states | {f"w_{name}": f"w[{i}]" for i, name in enumerate(self.inputs)}

        q1, y1, _, _ = rodas3_step(self._rates, t, h, q, y, u, u_rate, len(memory))
        arguments = "const double *w, double t, double h, double u, double u_rate, const double *s, double *next"
        self.text.function("model_step", c + arguments, reads, _to("next", [*q1, *y1]))

        shown = [self._values[name] for name in self.shown]
        arguments = "const double *w, double t, double u, const double *s, double *out"
        self.text.function("model_shown", c + arguments, reads, _to("out", shown))

        q0, y0, first_hold = (plant.guess or plant.start_of)(symbol("at"), symbol("speed"), self.p)
        start = _to("s", [*q0, *y0, *(m.start(self.p) for m in memory)]) | {"*hold": first_hold}
        self.text.function("model_first", c + "double at, double speed, double *s, double *hold", {}, start)

        # Accelerations at rest and their derivatives by the free positions and the input, row by row.
        n = len(plant.speeds)
        a = self._rates(t, q, [*[0.0] * n, *y[n:]], hold)[:n]
        unknown, memo = [*(x for i, x in enumerate(q) if i != plant.placed), hold], dict[tuple[int, int], Any]()
        slopes = [derivative(f, x, memo) for f in a for x in unknown]
        balance_reads = {name: place for name, place in reads.items() if place.startswith("s[")}
        arguments = "double t, double hold, const double *s, double *out"
        self.text.function("model_balance", c + arguments, balance_reads, _to("out", [*a, *slopes]))

        if self.controller is None:
            memo = {}
            rows = [derivative(self._values[name], x, memo) for name in self.unknowns for x in (*q, *y, u)]
            arguments = "const double *w, double t, double u, const double *s, double *out"
            self.text.function("model_slopes", c + arguments, reads, _to("out", rows))
        else:
            self._control(self.controller, reads)
        return self.text.text()

    def _control(self, controller: Controller, reads: Mapping[str, str]) -> None:
        q, y = state_symbols(self.plant, self.effects)
        t, u = symbol("t"), symbol("u")
        memory = [symbol(f"x{i}") for i in range(len(controller.memory))]
        reference = SimpleNamespace(**{name: symbol(f"w_{name}") for name in controller.references})
        measured = SimpleNamespace(t=t, **self.plant.shown(t, q, y, u, self.p, self.effects))
        command, after = controller.step(self.p, memory, reference, measured, self.sample_time_s)
        arguments = (
            "const double *w, double t, double u, double hold, const double *s, const double *memory, double *next"
        )
        kept = {f"x{i}": f"memory[{i}]" for i in range(len(memory))}
        outputs = _to("next", [*after, command])
        self.text.function("model_control", f"const double *c, {arguments}", {**reads, **kept}, outputs)
        start = controller.start(self.p, symbol("hold"), symbol("angle"))  # type: ignore[arg-type]
        arguments = "const double *c, double hold, double angle, double *memory"
        self.text.function("model_control_start", arguments, {}, _to("memory", start))
        self.text.function("model_lag", "const double *c, double *lag", {}, {"*lag": self.lag})
