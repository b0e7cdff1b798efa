"""One step of a plant at a time, as a compiled function, for whoever decides between two steps what comes next."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from workbench.engine.cache import load_functions
from workbench.engine.rodas3 import rodas3_step
from workbench.engine.source import LAG
from workbench.engine.text import KernelSource, KernelText, parameter_symbols, state_symbols
from workbench.plants import Effects, Plant
from workbench.run import Array
from workbench.trace.expr import symbol


def live_source(plant: Plant, effects: Effects, parameters: Sequence[str], shown: Sequence[str]) -> KernelSource:
    """Kernel `live`: the plant over `dt` in `substeps` equal steps under a held input, behind the drive's lag.

    state: positions, speeds, memory of the effects, advanced in place; actual: (1,) the input at work, which nears the
    held one (see `control.lag`); out: the signals named in `shown`, at the end of the step. parameters: names, LAG
    among them; without a lag its three numbers are zero.
    """
    k = KernelText(1, parameters)
    p = parameter_symbols(parameters)
    q, y = state_symbols(plant, effects)
    t, h, u, u_rate = (symbol(name) for name in ("t", "h", "u", "u_rate"))
    states = [e.args[0] for e in (*q, *y)]

    def rates(time: Any, q: Any, y: Any, u: Any) -> Any:
        return plant.rates(time, q, y, u, p, effects)

    k.add(1, "l = 0", "h = dt / substeps", "for s in range(substeps):")
    k.load(2, "state", states)
    left, start, slope = (k.parameter(name) for name in LAG)
    k.add(2, "t = start_s + s * h", "gap = actual[0] - held", f"actual[0] = held + gap * {left}")
    k.add(2, f"u = held + gap * {start}", f"u_rate = gap * {slope}")
    q1, y1, _, _ = rodas3_step(rates, t, h, q, y, u, u_rate, len(effects.memory))
    k.store(2, "state", k.block(2, [*q1, *y1]))
    k.add(1, "t = start_s + dt", "u = actual[0]")
    k.load(1, "state", states)
    values = plant.shown(t, q, y, u, p, effects)
    k.store(1, "out", k.block(1, [values[name] for name in shown]))
    k.add(1, "return 0")
    numbers = {"start_s": "f", "dt": "f", "substeps": "i", "held": "f"}
    return k.finish("live", {"c": "a", **numbers, **dict.fromkeys(("state", "actual", "out"), "a")})


@cache
def _source(plant: Plant, effects: Effects, parameters: tuple[str, ...], shown: tuple[str, ...]) -> KernelSource:
    return live_source(plant, effects, parameters, shown)


class LiveStep:
    """A plant that is stepped from outside. Numbers may change between two steps."""

    def __init__(self, plant: Plant, effects: Effects, parameters: Sequence[str], shown: Sequence[str]) -> None:
        source = _source(plant, effects, tuple(parameters), tuple(shown))
        functions = load_functions(source.text, {"prepare": "aa", "run": source.letters})
        self._prepare, self._run = functions["prepare"], functions["run"]
        self._c = np.empty(source.rows)
        self._out = np.empty(len(shown))
        self._actual = np.zeros(1)

    def numbers(self, values: Array) -> None:
        """The parameters from the next step on, (parameters,)."""
        self._prepare(np.ascontiguousarray(values, dtype=float), self._c)

    def step(self, start_s: float, dt: float, substeps: int, held: float, state: Array, actual: float) -> float:
        """Advances `state` in place; returns the input at work at the end."""
        self._actual[0] = actual
        self._run(self._c, start_s, dt, substeps, held, state, self._actual, self._out)
        return float(self._actual[0])

    @property
    def shown(self) -> Array:
        """The signals at the end of the last step; the same array every time."""
        return self._out
