"""The plant of one machine as C99: the traced equations as straight-line functions on plain arrays.

What depends on parameters alone is computed once, by `model_constants`, into an array that the other functions read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from workbench.control import Controller
from workbench.engine.rodas3 import rodas3_step
from workbench.engine.source import state_symbols
from workbench.machines import Effects, Plant
from workbench.symbolic.derive import derivative
from workbench.symbolic.emit import Printer
from workbench.symbolic.expr import Expr, Scalar, symbol

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


def _symbols_of(value: Scalar) -> list[str]:
    """Names of the symbols that an expression reads, in order."""
    seen: set[int] = set()
    found: set[str] = set()
    waiting = [value]
    while waiting:
        e = waiting.pop()
        if not isinstance(e, Expr) or e.id in seen:
            continue
        seen.add(e.id)
        if e.op == "symbol":
            found.add(e.args[0])
        else:
            waiting += e.args
    return sorted(found)


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
        memory = (m.symbol for m in self.effects.memory)
        return (*self.plant.positions, *self.plant.speeds, *memory)

    @property
    def shown(self) -> tuple[str, ...]:
        """Names of what `model_shown` gives: the plant's signals, states not among them, the states' derivatives."""
        signals = tuple(signal.name for signal in self.plant.signals)
        hidden = tuple(name for name in self.states if name not in signals)
        return (*signals, *hidden, *(f"der({name})" for name in self.states))

    @property
    def unknowns(self) -> tuple[str, ...]:
        """What derivatives are known of: the plant's signals and the states' derivatives."""
        return (*(s.name for s in self.plant.signals), *(f"der({name})" for name in self.states))

    def model_text(self) -> str:
        """All functions of model.h."""
        self._step()
        self._shown()
        self._first()
        self._balance()
        if self.controller is None:
            self._slopes()
        else:
            self._control(self.controller)
        return self.text.text()

    # In C: t, h, u, u_rate, hold are arguments; q0 ..., y0 ... stand in s, inputs in w.
    def _reads(self) -> dict[str, str]:
        q, y = state_symbols(self.plant, self.effects)
        states = {e.args[0]: f"s[{i}]" for i, e in enumerate((*q, *y))}
        return {**states, **{f"w_{name}": f"w[{i}]" for i, name in enumerate(self.inputs)}}

    def _rates(self, t: Scalar, q: Sequence[Scalar], y: Sequence[Scalar], u: Scalar) -> Sequence[Scalar]:
        return self.plant.rates(t, q, y, u, self.p, self.effects)

    def _step(self) -> None:
        q, y = state_symbols(self.plant, self.effects)
        t, h, u, u_rate = (symbol(name) for name in ("t", "h", "u", "u_rate"))
        q1, y1, _, _ = rodas3_step(self._rates, t, h, q, y, u, u_rate, len(self.effects.memory))
        self.text.function(
            "model_step",
            "const double *c, const double *w, double t, double h, double u, double u_rate, const double *s, "
            "double *next",
            self._reads(),
            [*q1, *y1],
            [f"next[{i}]" for i in range(len(q1) + len(y1))],
        )

    def _values(self, t: Expr, q: Sequence[Expr], y: Sequence[Expr], u: Expr) -> dict[str, Scalar]:
        """Everything that is shown, by name."""
        signals = self.plant.shown(t, q, y, u, self.p, self.effects)
        rates = [*y[: len(q)], *self._rates(t, q, y, u)]
        states = dict(zip(self.states, (*q, *y), strict=True))
        slopes = {f"der({name})": rate for name, rate in zip(self.states, rates, strict=True)}
        return {**states, **signals, **slopes}

    def _shown(self) -> None:
        q, y = state_symbols(self.plant, self.effects)
        values = self._values(symbol("t"), q, y, symbol("u"))
        self.text.function(
            "model_shown",
            "const double *c, const double *w, double t, double u, const double *s, double *out",
            self._reads(),
            [values[name] for name in self.shown],
            [f"out[{i}]" for i in range(len(self.shown))],
        )

    def _first(self) -> None:
        at, speed = symbol("at"), symbol("speed")
        q, y, hold = (self.plant.guess or self.plant.start_of)(at, speed, self.p)
        kept = [m.start(self.p) for m in self.effects.memory]
        self.text.function(
            "model_first",
            "const double *c, double at, double speed, double *s, double *hold",
            {},
            [*q, *y, *kept, hold],
            [*(f"s[{i}]" for i in range(len(self.states))), "*hold"],
        )

    def _balance(self) -> None:
        """Accelerations at rest and their derivatives by the free positions and the input, row by row."""
        plant = self.plant
        q, y = state_symbols(plant, self.effects)
        n, hold = len(plant.speeds), symbol("hold")
        a = self._rates(symbol("t"), q, [*[0.0] * n, *y[n:]], hold)[:n]
        unknown = [*(x for i, x in enumerate(q) if i != plant.placed), hold]
        memo: dict[tuple[int, int], Any] = {}
        slopes = [derivative(f, x, memo) for f in a for x in unknown]
        self.text.function(
            "model_balance",
            "const double *c, double t, double hold, const double *s, double *out",
            {name: place for name, place in self._reads().items() if place.startswith("s[")},
            [*a, *slopes],
            [f"out[{i}]" for i in range(n + n * n)],
        )

    def _slopes(self) -> None:
        """Derivatives of the unknowns by states and input, row by row."""
        q, y = state_symbols(self.plant, self.effects)
        u = symbol("u")
        values = self._values(symbol("t"), q, y, u)
        memo: dict[tuple[int, int], Any] = {}
        knowns = [*q, *y, u]
        rows = [derivative(values[name], x, memo) for name in self.unknowns for x in knowns]
        self.text.function(
            "model_slopes",
            "const double *c, const double *w, double t, double u, const double *s, double *out",
            self._reads(),
            rows,
            [f"out[{i}]" for i in range(len(rows))],
        )

    def dependencies(self) -> dict[str, tuple[str, ...]]:
        """By unknown: the states and inputs that its equation reads, and time."""
        q, y = state_symbols(self.plant, self.effects)
        values = self._values(symbol("t"), q, y, symbol("u"))
        known = {e.args[0]: name for e, name in zip((*q, *y), self.states, strict=True)}
        known |= {"t": "time", "u": self.plant.input} | {f"w_{name}": name for name in self.inputs}
        return {name: tuple(known[x] for x in _symbols_of(values[name]) if x in known) for name in self.unknowns}

    def _control(self, controller: Controller) -> None:
        q, y = state_symbols(self.plant, self.effects)
        t, u = symbol("t"), symbol("u")
        memory = [symbol(f"x{i}") for i in range(len(controller.memory))]
        reference = SimpleNamespace(**{name: symbol(f"w_{name}") for name in controller.references})
        measured = SimpleNamespace(t=t, **self.plant.shown(t, q, y, u, self.p, self.effects))
        command, after = controller.step(self.p, memory, reference, measured, self.sample_time_s)
        n = len(memory)
        self.text.function(
            "model_control",
            "const double *c, const double *w, double t, double u, double hold, const double *s, const double *memory, "
            "double *next",
            {**self._reads(), **{f"x{i}": f"memory[{i}]" for i in range(n)}},
            [*after, command],
            [f"next[{i}]" for i in range(n + 1)],
        )
        start = controller.start(self.p, symbol("hold"), symbol("angle"))  # type: ignore[arg-type]
        self.text.function(
            "model_control_start",
            "const double *c, double hold, double angle, double *memory",
            {},
            start,
            [f"memory[{i}]" for i in range(n)],
        )
        self.text.function("model_lag", "const double *c, double *lag", {}, [self.lag], ["*lag"])
