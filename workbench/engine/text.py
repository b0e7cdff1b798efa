"""The text of one generated kernel: rows of lanes, printed blocks, and what is prepared once a scenario.

Every array of a kernel is flat: row r of lane l stands at r * lanes + l, so the
innermost loop, over the lanes, reads and writes side by side.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

from workbench.engine.preamble import PREAMBLE
from workbench.plants import NO_EFFECTS, Effects, Plant
from workbench.trace.emit import Printer
from workbench.trace.expr import Expr, Scalar, symbol

INDENT = "    "


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

    def block(self, indent: int, outputs: Sequence[Scalar]) -> list[str]:
        """Print a block; returns the names that its results have."""
        body, results, carried = self.printer.block(outputs)
        for name in carried:
            row = self.rows.setdefault(name, len(self.rows))
            self.add(indent, f"{name} = {self.at('c', row)}")
        self.add(indent, *body)
        return results

    def load(self, indent: int, array: str, names: Sequence[str], first: int = 0) -> None:
        self.add(indent, *(f"{name} = {self.at(array, first + i)}" for i, name in enumerate(names)))

    def parameter(self, name: str) -> str:
        """A parameter as the loops read it."""
        return self.at("c", self.rows.setdefault(f"p_{name}", len(self.rows)))

    def store(self, indent: int, array: str, names: Sequence[str], first: int = 0) -> None:
        self.add(indent, *(f"{self.at(array, first + i)} = {name}" for i, name in enumerate(names)))

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

    def finish(self, name: str, arguments: Mapping[str, str]) -> KernelSource:
        """The kernel whole; arguments: name -> letter of its type (see `native`)."""
        prepare = [
            "def prepare(parameters, c):",
            f"{INDENT}for l in range({self.lanes}):",
            *(f"{INDENT * 2}p_{p} = {self.at('parameters', i)}" for i, p in enumerate(self.parameters)),
            *(INDENT * 2 + line for line in self.printer.setup),
            *(f"{INDENT * 2}{self.at('c', row)} = {n}" for n, row in self.rows.items()),
            f"{INDENT}return 0",
        ]
        jit = '@njit(nogil=True, error_model="numpy", _nrt=False)'
        body = [f"def run({', '.join(arguments)}):", *self.lines]
        text = "\n".join([f"# Generated: {name}.", PREAMBLE, jit, *prepare, "", "", jit, *body, ""])
        return KernelSource(text, "".join(arguments.values()), len(self.parameters), max(1, len(self.rows)))


@dataclass(frozen=True)
class KernelSource:
    """A module with `prepare(parameters, c)` and `run`; letters: of run's arguments; the rows of both arrays."""

    text: str
    letters: str
    parameters: int
    rows: int
