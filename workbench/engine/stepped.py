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
from workbench.engine.rodas3 import rodas3_step
from workbench.engine.source import LAG, Kernel, KernelText, bound, delay_rows, parameter_symbols, state_symbols
from workbench.machines import Effects, Plant
from workbench.symbolic.expr import symbol

MEASURED = ("t", "speed_motor_rad_s", "angle_motor_rad")


@cache
def step_kernel(controller: Any, parameters: tuple[str, ...]) -> Kernel:
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


@cache
def observe_kernel(observer: Any, signals: tuple[str, ...]) -> Kernel:
    """Kernel `observe`: the observer's accumulators over samples (n, signals) that each last until the next one, dt."""
    k = KernelText(1, observer.parameters)
    p = parameter_symbols(observer.parameters)
    accumulators = [symbol(f"a{i}") for i in range(observer.size)]
    given = {name: symbol(f"s{i}") for i, name in enumerate(signals)}
    accumulators1 = observer.update(accumulators, given, p, symbol("dt"))
    k.add(1, "l = 0", "for k in range(n):")
    k.add(2, *(f"s{i} = samples[k * {len(signals)} + {i}]" for i in range(len(signals))))
    k.load(2, "accumulators", [e.args[0] for e in accumulators])
    k.store(2, "accumulators", k.block(2, accumulators1))
    k.add(1, "return n")
    return k.finish("observe", {"c": "a", "samples": "a", "n": "i", "dt": "f", "accumulators": "a"})


def _constants(kernel: Kernel, p: Any) -> Array:
    return kernel.constants(np.array([float(getattr(p, name)) for name in kernel.parameters]).reshape(-1, 1))


class Step:
    """One controller at work: its numbers p by symbol, its memory at the start; called once a sample."""

    def __init__(self, controller: Any, p: Any, memory: Sequence[float], sample_time_s: float):
        names = tuple(sorted(vars(p)))  # a feed-forward reads the machine's own values
        kernel = step_kernel(controller, names)
        self._run, self._dt, self._c = kernel.run, sample_time_s, _constants(kernel, p)
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
    """The observer's accumulators over signals (n,) taken at every sample; `time_s` among them."""
    names = tuple(sorted(signals))
    kernel = observe_kernel(observer, names)
    samples = np.ascontiguousarray(np.stack([signals[name] for name in names], axis=-1), dtype=float)
    accumulators = np.array(observer.start, dtype=float)
    kernel.run(_constants(kernel, p), samples.reshape(-1), len(samples), sample_time_s, accumulators)
    return [float(x) for x in accumulators]


@cache
def live_kernel(plant: Plant, effects: Effects, parameters: tuple[str, ...], shown: tuple[str, ...]) -> Kernel:
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

    k.add(1, "l = 0", "h = dt / substeps", "for s in range(substeps):")
    k.load(2, "state", states)
    left, start, slope = (k.parameter(name) for name in LAG)
    k.add(2, "t = start_s + s * h", "gap = actual[0] - held", f"actual[0] = held + gap * {left}")
    k.add(2, f"u = held + gap * {start}", f"u_rate = gap * {slope}")
    q1, y1, _, _ = rodas3_step(bound(plant, effects, p), t, h, q, y, u, u_rate, len(effects.memory))
    k.store(2, "state", k.block(2, [*q1, *y1]))
    k.add(1, "t = start_s + dt", "u = actual[0]")
    k.load(1, "state", states)
    values = plant.shown(t, q, y, u, p, effects)
    k.store(1, "out", k.block(1, [values[name] for name in shown]))
    k.add(1, "return 0")
    numbers = {"start_s": "f", "dt": "f", "substeps": "i", "held": "f"}
    return k.finish("live", {"c": "a", **numbers, **dict.fromkeys(("state", "actual", "out"), "a")})


class LiveStep:
    """A plant that is stepped from outside. Numbers may change between two steps."""

    def __init__(self, plant: Plant, effects: Effects, parameters: Sequence[str], shown: Sequence[str]) -> None:
        self._kernel = live_kernel(plant, effects, tuple(parameters), tuple(shown))
        self._run, self._c = self._kernel.run, np.empty(0)
        self.shown = np.empty(len(shown))  # the signals at the end of the last step; the same array every time
        self._actual = np.zeros(1)

    def numbers(self, values: Array) -> None:
        """The parameters from the next step on, (parameters,)."""
        self._c = self._kernel.constants(np.reshape(values, (-1, 1)))

    def step(self, start_s: float, dt: float, substeps: int, held: float, state: Array, actual: float) -> float:
        """Advances `state` in place; returns the input at work at the end."""
        self._actual[0] = actual
        self._run(self._c, start_s, dt, substeps, held, state, self._actual, self.shown)
        return float(self._actual[0])
