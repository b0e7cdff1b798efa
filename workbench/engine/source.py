"""The text of a plant's compiled kernels: loops around straight-line blocks.

Every array of a kernel is flat: row r of lane l stands at r * lanes + l, so the innermost loop, over the lanes,
reads and writes side by side. Many scenarios run as lanes of one kernel: every array holds `lanes` columns, the
innermost loop goes over them, and the compiler makes it SIMD. All lanes take the
same steps, so a lane with a slightly changed parameter gives a derivative free of
step-size noise.

Steps are aligned with the samples of the log (or of the controller): input and
reference are smooth within a step. The interval between two samples is halved until
the embedded error of every lane is within the tolerance, and doubled again after.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.core.run import Array
from workbench.engine.native import FULL, load_functions
from workbench.engine.preamble import PREAMBLE
from workbench.engine.rodas3 import rodas3_step
from workbench.machines import NO_EFFECTS, Effects, Plant
from workbench.symbolic.derive import derivative
from workbench.symbolic.emit import Printer
from workbench.symbolic.expr import Expr, Scalar, Scalars, const_value, symbol

INDENT = "    "
VANISHED = 1e-120  # of a state, 1e-16 of it is none: processors take many times as long for numbers near 1e-308
HELD = 6  # rows of what is the same between two samples, at most
LAG = ("lag_left", "lag_start", "lag_slope")  # what a lagging drive's step needs, by symbol


def parameter_symbols(names: Sequence[str], keys: Mapping[str, str | float] | None = None) -> SimpleNamespace:
    """Symbols for parameters; the printer knows them by their prefix. keys: a plant's `parameters`: what is a fixed
    number there stays one, and what it makes zero is never computed."""
    fixed = {name: number for name, number in (keys or {}).items() if isinstance(number, float)}
    return SimpleNamespace(**{n: fixed.get(n, symbol(f"p_{n}")) for n in names})


def state_symbols(plant: Plant, effects: Effects = NO_EFFECTS) -> tuple[list[Expr], list[Expr]]:
    """Positions, and speeds with the effects' memory behind them."""
    q = [symbol(f"q{i}") for i in range(len(plant.positions))]
    y = [symbol(f"y{i}") for i in range(len(plant.speeds) + len(effects.memory))]
    return q, y


def delay_rows(late: float) -> int:
    """Rows of the ring that a delay of `late` samples needs: a power of two, the newest sample among them."""
    return 1 << (math.floor(late) + 1).bit_length()


class KernelText:
    """Collects one kernel's code: arrays in flat rows of lanes, blocks printed at an indent."""

    def __init__(self, lanes: int, parameters: Sequence[str]) -> None:
        self.lanes = lanes
        self.parameters = tuple(parameters)
        self.printer = Printer()
        self.rows: dict[str, int] = {}  # names computed by `prepare` -> row in its output
        self.lines: list[str] = []

    def add(self, indent: int, *lines: str) -> None:
        self.lines.extend(INDENT * indent + line for line in lines)

    def at(self, array: str, row: object) -> str:
        return f"{array}[{row * self.lanes if isinstance(row, int) else f'({row}) * {self.lanes}'} + l]"

    def block(self, indent: int, outputs: Scalars) -> list[str]:
        """Print a block; returns the names that its results have."""
        body, results, carried = self.printer.block(outputs)
        for name in carried:
            row = self.rows.setdefault(name, len(self.rows))
            self.add(indent, f"{name} = {self.at('c', row)}")
        self.add(indent, *body)
        return results

    def load(self, indent: int, array: str, names: Sequence[str]) -> None:
        self.add(indent, *(f"{name} = {self.at(array, i)}" for i, name in enumerate(names)))

    def samples(self, indent: int, rows: int, signals: Sequence[str]) -> None:
        """n samples, `rows` to each in `out`; a signal has a column for each lane, or one for all."""
        self.add(indent, f"n = out.shape[0] // {rows * self.lanes}")
        self.add(indent, *(f"{name}_row = {name}.shape[0] // n" for name in signals))
        self.add(indent, *(f"{name}_lane = {name}_row // {self.lanes}" for name in signals))

    def held(self, indent: int, values: Mapping[str, str]) -> None:
        """What is the same from one sample to the next, a row of `held` each; `name[k]` is a signal's at sample k."""
        self.add(indent, f"for l in range({self.lanes}):")
        for name, value in values.items():
            text = re.sub(r"(\w+)\[(\w+)\]", r"\1[\2 * \1_row + l * \1_lane]", value)
            self.add(indent + 1, f"{name} = {text}")
        self.store(indent + 1, "held", list(values))

    def parameter(self, name: str) -> str:
        """A parameter as the loops read it."""
        return self.at("c", self.rows.setdefault(f"p_{name}", len(self.rows)))

    def store(self, indent: int, array: str, names: Sequence[str]) -> None:
        self.add(indent, *(f"{self.at(array, i)} = {name}" for i, name in enumerate(names)))

    def delayed(self, indent: int, sensed: Scalar) -> None:
        """Keeps `sensed` in the ring `line` at sample k; `w_late` is what it was p.late samples before, by lines.

        line: (`delay_rows`, lanes), zero where nothing was kept yet.
        """
        (newest,) = self.block(indent, [sensed])
        older = self.at("line", "(k - back - 1) & newest_row")
        self.add(
            indent,
            f"newest_row = line.shape[0] // {self.lanes} - 1",
            f"{self.at('line', 'k & newest_row')} = {newest}",
            f"back = int({self.parameter('late')})",
            f"part = {self.parameter('late')} - back",
            f"w_late = (1.0 - part) * {self.at('line', '(k - back) & newest_row')} + part * {older}",
        )

    def finish(self, name: str, arguments: Mapping[str, str]) -> Kernel:
        """The kernel whole; arguments: name -> letter of its type (see `native`)."""
        prepare = [
            "def prepare(parameters, c):",
            f"{INDENT}for l in range({self.lanes}):",
            *(f"{INDENT * 2}p_{p} = {self.at('parameters', i)}" for i, p in enumerate(self.parameters)),
            *(INDENT * 2 + line for line in self.printer.setup),
            *(f"{INDENT * 2}{self.at('c', row)} = {n}" for n, row in self.rows.items()),
            f"{INDENT}return 0",
        ]
        body = [f"def run({', '.join(arguments)}):", *self.lines]
        said = f"# Generated: {name}, {FULL}." if self.lanes >= 8 else f"# Generated: {name}."
        text = "\n".join([said, PREAMBLE, *prepare, "", "", *body, ""])
        functions = load_functions(text, {"prepare": "aa", "run": "".join(arguments.values())})
        return Kernel(self.lanes, self.parameters, max(1, len(self.rows)), functions["prepare"], functions["run"])


@dataclass(frozen=True)
class Kernel:
    """One compiled loop for a fixed number of lanes; `run` takes flat arrays of rows of lanes.

    parameters: the names of the rows that `constants` takes; rows: how many it gives.
    """

    lanes: int
    parameters: tuple[str, ...]
    rows: int
    prepare: Callable[..., int]
    run: Callable[..., int]

    def constants(self, parameters: Array) -> Array:
        """parameters: (names, lanes) -> what the steps read of them, once a scenario."""
        if parameters.shape != (len(self.parameters), self.lanes):  # compiled code reads what it is told to, and beyond
            raise ValueError(f"{parameters.shape[0]} rows of parameters, the kernel takes {len(self.parameters)}")
        c = np.empty(self.rows * self.lanes)
        self.prepare(np.ascontiguousarray(parameters, dtype=float).reshape(-1), c)
        return c


def bound(plant: Plant, effects: Effects, p: Any) -> Callable[..., Scalars]:
    return lambda t, q, y, u: plant.rates(t, q, y, u, p, effects)


def _adaptive_interval(
    k: KernelText, states: Sequence[str], step: Mapping[str, Any], crossed: Collection[str] = (), local: bool = False
) -> None:
    """Cross from sample k to k+1 in m equal steps, m doubled until the error of each is small enough. crossed: states
    that are there already. local: only where it is too large are steps cut, for what meets and parts within moments.

    `step` holds the outputs of one step (`next`, `errors`), the names of what is `held`, t0 and the interval H first,
    and lines for what it reads beside (`inputs`). work: (2 states, lanes), the end of a step and the interval's start.
    """
    L, count = k.lanes, len(states) * k.lanes
    k.add(2, f"for j in range({count}):", f"{INDENT}work[{count} + j] = state[j]")
    k.add(2, "s = 0", "over = 0.0", "while True:", f"{INDENT}part = 1.0 / m", f"{INDENT}for l in range({L}):")
    k.load(4, "held", step["held"])
    k.add(4, "h = H * part", "t = t0 + s * h", *step["inputs"])
    k.load(4, "state", states)
    results = k.block(4, [*step["next"], *step["errors"]])
    rows = [i for i, name in enumerate(states) if name not in crossed]
    k.add(4, *(f"{k.at('work', i)} = {name}" for i, name in zip(rows, results, strict=False)), "error = 0.0")
    for i, name in zip(rows, results[len(rows) :], strict=False):
        k.add(4, f"e = abs({name}) * {k.at('inverse_scale', i)}", "error = select(e > error, e, error)")
    k.add(4, "worst[l] = error")
    k.add(3, "largest = 0.0", f"for l in range({L}):", f"{INDENT}largest = max(largest, worst[l])", "steps += 1")
    k.add(3, "if largest <= tolerance or m >= most:", f"{INDENT}s += 1", f"{INDENT}for l in range({L}):")
    k.add(5, *(f"{k.at('state', i)} = ({k.at('work', i)} + {VANISHED}) - {VANISHED}" for i in rows))
    if local:
        k.add(4, "if s % 2 == 0 and largest < 0.1 * tolerance:", f"{INDENT}m //= 2", f"{INDENT}s //= 2")
    k.add(4, "over = max(over, largest)", "if s >= m:", f"{INDENT}break")
    k.add(3, "if largest > tolerance and m < most:", f"{INDENT}m *= 2", f"{INDENT}s *= 2")
    if not local:
        k.add(4, "s = 0", "over = 0.0", f"for j in range({count}):", f"{INDENT}state[j] = work[{count} + j]")
        k.add(2, "if m > 1 and over < 0.1 * tolerance:", f"{INDENT}m //= 2")


@cache
def replay_kernel(plant: Plant, effects: Effects, lanes: int) -> Kernel:
    """Kernel `replay`: the plant under an input given at samples, linear between them.

    times, inputs: (n, lanes or 1); state: (states, lanes), advanced in place; held: (HELD, lanes); out: (n, positions,
    speeds and the effects' memory, lanes).
    """
    k = KernelText(lanes, (*plant.parameters, *effects.parameters))
    q, y = state_symbols(plant, effects)
    t, h, u, u_rate = (symbol(s) for s in ("t", "h", "u", "u_rate"))
    model = bound(plant, effects, parameter_symbols(k.parameters, plant.parameters))
    q1, y1, _, errors = rodas3_step(model, t, h, q, y, u, u_rate, len(effects.memory))
    states = [e.args[0] for e in (*q, *y)]
    held = {"t0": "times[k]", "H": "times[after] - t0", "u0": "inputs[k]", "u_rate": "(inputs[after] - u0) / H"}
    k.samples(1, len(states), ("times", "inputs"))
    k.add(1, "m = 1", "steps = 0", "for k in range(n - 1):", f"{INDENT}after = k + 1")
    k.held(2, held)
    k.add(2, f"for j in range({len(states) * lanes}):", f"{INDENT}out[k * {len(states) * lanes} + j] = state[j]")
    inputs = ("u = u0 + u_rate * (s * h)",)
    _adaptive_interval(k, states, {"held": held, "inputs": inputs, "next": [*q1, *y1], "errors": errors})
    k.add(1, f"for j in range({len(states) * lanes}):")
    k.add(2, f"out[(n - 1) * {len(states) * lanes} + j] = state[j]")
    k.add(1, "return steps")
    arrays = dict.fromkeys(("c", "times", "inputs", "state", "work", "worst", "inverse_scale", "held"), "a")
    return k.finish("replay", {**arrays, "tolerance": "f", "most": "i", "out": "a"})


@cache
def _driven_step(
    plant: Plant, effects: Effects
) -> tuple[list[str], Scalar, list[Scalar], list[Scalar], dict[str, Scalar]]:
    """The names of the following states; the input that the motion takes, one step of these states and its errors; and
    from sample to sample those that have a closed form: traced once for kernels of all widths."""
    p = parameter_symbols((*plant.parameters, *effects.parameters), plant.parameters)
    rates = bound(plant, effects, p)
    q, y = state_symbols(plant, effects)
    t, h, u = symbol("t"), symbol("h"), symbol("u")
    start, angle, speed, alpha = (symbol(s) for s in ("t0", "angle0", "speed0", "alpha"))

    def rest(time: Scalar, q_rest: Scalars, y_rest: Scalars, _: Scalar) -> Scalars:
        since = time - start
        w = speed + alpha * since
        th = angle + since * (speed + 0.5 * (alpha * since))
        return list(rates(time, [th, *q_rest], [w, *y_rest], 0.0))[1:]

    needed = (symbol("acceleration") - rates(t, q, y, 0.0)[0]) / derivative(rates(t, q, y, u)[0], u)
    states = [e.args[0] for e in (*q[1:], *y[1:])]
    closed = dict[str, Scalar]()
    if len(plant.speeds) == 1:  # nothing else moves
        s, s1 = (SimpleNamespace(**{plant.speeds[0]: v}) for v in (speed, speed + alpha * symbol("H")))
        kept, slopes = effects.with_memory(p, y[1:]), rest(t, (), y[1:], 0.0)
        for z, one in zip(y[1:], effects.memory, strict=True):
            apart = all(const_value(derivative(f, z)) == 0.0 for x, f in zip(y[1:], slopes, strict=True) if x is not z)
            if one.step is not None and apart:  # what hangs on it within the interval needs it there
                closed[z.args[0]] = one.step(s, s1, symbol("H"), kept)
    others = [z for z in y[1:] if z.args[0] not in closed]
    if not (q[1:] or others):
        return states, needed, [], [], closed

    def stepped(time: Scalar, q_rest: Scalars, y_rest: Scalars, u: Scalar) -> Scalars:
        whole = dict(zip((z.args[0] for z in others), y_rest, strict=True))
        found = rest(time, q_rest, [whole.get(z.args[0], z) for z in y[1:]], u)
        return [rate for z, rate in zip(y[1:], found, strict=True) if z.args[0] in whole]

    q1, y1, _, errors = rodas3_step(
        stepped, t, h, q[1:], others, symbol("u_none"), 0.0, len(effects.memory) - len(closed)
    )
    return states, needed, [*q1, *y1], errors, closed


@cache
def driven_kernel(plant: Plant, effects: Effects, lanes: int) -> Kernel:
    """Kernel `driven`: the first coordinate moves as measured, the rest follows; out: the input it takes.

    times, angles, speeds, accelerations: (n, lanes or 1) of the driven coordinate. Between
    samples its speed is linear. The input enters the first acceleration linearly,
    a = a|u=0 + (da/du) u, so the input that gives the measured acceleration is
    (a - a|u=0) / (da/du). out: (n, 1 + rest, lanes), the input, then the other states.
    """
    k = KernelText(lanes, (*plant.parameters, *effects.parameters))
    states, needed, following, errors, closed = _driven_step(plant, effects)
    n, L = len(states), lanes
    measured = ("times", "angles", "speeds", "accelerations")
    held = {
        "t0": "times[k]", "H": "times[after] - t0", "angle0": "angles[k]", "speed0": "speeds[k]",
        "alpha": "(speeds[after] - speed0) / H", "acceleration": "accelerations[k]",
    }  # fmt: skip
    k.samples(1, n + 1, measured)
    k.add(1, "m = 1", "steps = 0", "for k in range(n):", f"{INDENT}after = k + 1 - (k + 1) // n")
    k.held(2, held)
    k.add(2, f"for l in range({L}):")
    k.load(3, "held", ("t", "none", "q0", "y0", "none", "acceleration"))
    k.load(3, "state", states)
    (result,) = k.block(3, [needed])
    k.add(3, f"out[k * {(n + 1) * L} + l] = {result}")
    for i, name in enumerate(states):
        k.add(3, f"out[k * {(n + 1) * L} + {(i + 1) * L} + l] = {name}")
    if n:
        k.add(2, "if k == n - 1:", f"{INDENT}break")
    if closed:
        k.add(2, f"for l in range({L}):")
        k.load(3, "held", list(held))
        k.load(3, "state", states)
        for name, value in zip(closed, k.block(3, list(closed.values())), strict=True):
            k.add(3, f"{k.at('state', states.index(name))} = {value}")
    if following:
        step = {"held": held, "inputs": (), "next": following, "errors": errors}
        _adaptive_interval(k, states, step, closed, local=len(plant.speeds) == 1)
    k.add(1, "return steps")
    arrays = dict.fromkeys(("c", *measured, "state", "work", "worst", "inverse_scale", "held"), "a")
    return k.finish("driven", {**arrays, "tolerance": "f", "most": "i", "out": "a"})


def loop_parameters(plant: Plant, effects: Effects, controller: Any, observer: Any) -> tuple[str, ...]:
    """Every number that a closed loop needs, in the order of its kernel's parameter rows."""
    rows = (*plant.parameters, *effects.parameters, *controller.parameters, *observer.parameters, *LAG)
    return tuple(dict.fromkeys(rows))


@cache
def loop_kernel(
    plant: Plant, effects: Effects, lanes: int, controller: Any, observer: Any, recorded: tuple[str, ...], lagged: bool
) -> Kernel:
    """Kernel `loop`: a sampled controller on the plant, its output held between samples.

    At each sample: read the signals, step the controller, feed the observer's
    accumulators, record every `every`-th sample; then `substeps` steps of the plant
    under the held input or, `lagged`, under one that nears it as a first-order lag: exact from step to step
    (`lag_left` of the difference stays) and, within a step, the straight line of the same impulse and first moment
    (`lag_start`, `lag_slope` of the difference).
    references: (n, controller's references, lanes); actual: (lanes,) the input at work; line: see `delayed`.
    """
    k = KernelText(lanes, loop_parameters(plant, effects, controller, observer))
    p = parameter_symbols(k.parameters, plant.parameters)
    rates = bound(plant, effects, p)
    q, y = state_symbols(plant, effects)
    t, h, u, dt = symbol("t"), symbol("h"), symbol("u"), symbol("dt")
    states = [e.args[0] for e in (*q, *y)]
    memory = [symbol(f"x{i}") for i in range(len(controller.memory))]
    accumulators = [symbol(f"a{i}") for i in range(observer.size)]
    reference = SimpleNamespace(**{name: symbol(f"r{i}") for i, name in enumerate(controller.references)})
    measured = SimpleNamespace(t=t, late=symbol("w_late"), **plant.shown(t, q, y, u if lagged else 0.0, p, effects))
    command, memory1 = controller.step(p, memory, reference, measured, dt)
    at_work = u if lagged else command
    shown = plant.shown(t, q, y, at_work, p, effects)
    signals = {**shown, plant.input: at_work, "time_s": t, **vars(reference)}
    accumulators1 = observer.update(accumulators, signals, p, dt)
    L, nr = lanes, len(controller.references)
    memory_names, accumulator_names = [e.args[0] for e in memory], [e.args[0] for e in accumulators]

    k.add(1, f"n = references.shape[0] // {nr * L}", "h = dt / substeps", "row = 0")
    k.add(1, "for k in range(n):", f"{INDENT}now = k * dt", f"{INDENT}for l in range({L}):", f"{INDENT * 2}t = now")
    for i in range(nr):
        k.add(3, f"r{i} = references[k * {nr * L} + {i * L} + l]")
    k.add(3, "u = actual[l]")
    k.load(3, "state", states)
    if lagged and controller.left is not None:
        (result,) = k.block(3, [u * controller.left(p, t, dt)])
        k.add(3, f"u = {result}", "actual[l] = u")
    k.load(3, "memory", memory_names)
    k.load(3, "accumulators", accumulator_names)
    if controller.sensed is not None:
        k.delayed(3, controller.sensed(p, memory, measured, dt))
    results = k.block(3, [command, *memory1, *accumulators1, *(signals[name] for name in recorded)])
    k.add(3, f"held[l] = {results[0]}")
    k.store(3, "memory", results[1 : 1 + len(memory)])
    k.store(3, "accumulators", results[1 + len(memory) : 1 + len(memory) + len(accumulators)])
    k.store(3, "shown", results[1 + len(memory) + len(accumulators) :])
    size = len(recorded) * L
    k.add(2, "if k % every == 0:", f"{INDENT}for j in range({size}):")
    k.add(4, f"out[row * {size} + j] = shown[j]")
    k.add(3, "row += 1")
    k.add(2, "if k == n - 1:", f"{INDENT}break")
    k.add(2, "for s in range(substeps):", f"{INDENT}t1 = now + s * h", f"{INDENT}for l in range({L}):")
    k.add(4, "t = t1")
    k.load(4, "state", states)
    if lagged:
        left, start, slope = (k.parameter(name) for name in LAG)
        k.add(4, "gap = actual[l] - held[l]", f"actual[l] = held[l] + gap * {left}")
        k.add(4, f"u = held[l] + gap * {start}", f"u_rate = gap * {slope}")
    else:
        k.add(4, "u = held[l]")
    q1, y1, _, _ = rodas3_step(rates, t, h, q, y, u, symbol("u_rate") if lagged else 0.0, len(effects.memory))
    k.store(4, "state", k.block(4, [*q1, *y1]))
    k.add(1, "return row")
    numbers = {"c": "a", "references": "a", "dt": "f", "substeps": "i", "every": "i"}
    late = () if controller.sensed is None else ("line",)
    arrays = dict.fromkeys(("state", "memory", *late, "accumulators", "held", "actual", "shown", "out"), "a")
    return k.finish("loop", {**numbers, **arrays})
