"""What is called once a sample, as compiled functions of their own: the plant's step, the controller's, the observer.

The same traced functions as in the kernel `loop`, so the loop that is tuned there is the loop that runs here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.core.run import Array
from workbench.engine.native import load_functions
from workbench.engine.rodas3 import rodas3_step
from workbench.engine.source import LAG, KernelSource, KernelText, delay_rows, parameter_symbols, state_symbols
from workbench.machines import Effects, Plant
from workbench.symbolic.expr import symbol

MEASURED = ("t", "speed_motor_rad_s", "angle_motor_rad")


def step_source(controller: Any, parameters: Sequence[str]) -> KernelSource:
    """Kernel `step`: (references, measured) at sample k -> the command in `out`, the memory advanced in place."""
    k = KernelText(1, parameters)
    p = parameter_symbols(parameters)
    memory = [symbol(f"x{i}") for i in range(len(controller.memory))]
    reference = SimpleNamespace(**{name: symbol(f"r{i}") for i, name in enumerate(controller.references)})
    measured = SimpleNamespace(late=symbol("w_late"), **{name: symbol(f"s{i}") for i, name in enumerate(MEASURED)})
    command, memory1 = controller.step(p, memory, reference, measured, symbol("dt"))
    k.add(1, "l = 0")
    k.load(1, "references", [f"r{i}" for i in range(len(controller.references))])
    k.load(1, "measured", [f"s{i}" for i in range(len(MEASURED))])
    k.load(1, "memory", [e.args[0] for e in memory])
    if controller.sensed is not None:
        k.delayed(1, controller.sensed(p, memory, measured, symbol("dt")))
    results = k.block(1, [command, *memory1])
    k.add(1, f"out[0] = {results[0]}")
    k.store(1, "memory", results[1:])
    k.add(1, "return 0")
    arrays = dict.fromkeys(("references", "measured", "memory", "line", "out"), "a")
    return k.finish("step", {"c": "a", "k": "i", "dt": "f", **arrays})


def observe_source(observer: Any, signals: Sequence[str]) -> KernelSource:
    """Kernel `observe`: the observer's sums over samples (n, signals) that each last until the next one, dt."""
    k = KernelText(1, observer.parameters)
    p = parameter_symbols(observer.parameters)
    sums = [symbol(f"a{i}") for i in range(observer.size)]
    given = {name: symbol(f"s{i}") for i, name in enumerate(signals)}
    sums1 = observer.update(sums, given, p, symbol("dt"))
    k.add(1, "l = 0", "for k in range(n):")
    k.add(2, *(f"s{i} = samples[k * {len(signals)} + {i}]" for i in range(len(signals))))
    k.load(2, "sums", [e.args[0] for e in sums])
    k.store(2, "sums", k.block(2, sums1))
    k.add(1, "return n")
    return k.finish("observe", {"c": "a", "samples": "a", "n": "i", "dt": "f", "sums": "a"})


@cache
def _functions(source: KernelSource) -> Mapping[str, Any]:
    return load_functions(source.text, {"prepare": "aa", "run": source.letters})


def _constants(source: KernelSource, names: Sequence[str], p: Any) -> Array:
    c = np.empty(source.rows)
    _functions(source)["prepare"](np.array([float(getattr(p, name)) for name in names] or [0.0]), c)
    return c


@cache
def _step(controller: Any, parameters: tuple[str, ...]) -> KernelSource:
    return step_source(controller, parameters)


@cache
def _observe(observer: Any, signals: tuple[str, ...]) -> KernelSource:
    return observe_source(observer, signals)


class Step:
    """One controller at work: its numbers p by symbol, its memory at the start; called once a sample."""

    def __init__(self, controller: Any, p: Any, memory: Sequence[float], sample_time_s: float):
        names = tuple(sorted(vars(p)))  # a feed-forward reads the machine's own values
        source = _step(controller, names)
        self._run, self._dt = _functions(source)["run"], sample_time_s
        self._c = _constants(source, names, p)
        self._memory = np.array(memory, dtype=float)
        self._references, self._measured = np.zeros(len(controller.references)), np.zeros(len(MEASURED))
        self._line = np.zeros(1 if controller.sensed is None else delay_rows(p.late))
        self._out = np.zeros(1)
        self._sample = 0

    def __call__(self, reference: float, t: float, speed: float, angle: float) -> float:
        """The command, N m, at a sample: reference and speed in rad/s, angle in rad of the motor."""
        self._references[0] = reference
        self._measured[:] = t, speed, angle
        measured = (self._references, self._measured, self._memory, self._line)
        self._run(self._c, self._sample, self._dt, *measured, self._out)
        self._sample += 1
        return float(self._out[0])


def observe(observer: Any, p: Any, signals: Mapping[str, Array], sample_time_s: float) -> list[float]:
    """The observer's sums over signals (n,) taken at every sample; `time_s` among them."""
    names = tuple(sorted(signals))
    source = _observe(observer, names)
    samples = np.ascontiguousarray(np.stack([signals[name] for name in names], axis=-1), dtype=float)
    sums = np.array(observer.start, dtype=float)
    run = _functions(source)["run"]
    run(_constants(source, observer.parameters, p), samples.reshape(-1), len(samples), sample_time_s, sums)
    return [float(x) for x in sums]


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
