"""A sampled controller's step and an observer's sums as compiled functions of their own, for a plant that is not.

The same traced functions as in the kernel `loop`, so the loop that is tuned there is the loop that runs here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.engine.cache import load_functions
from workbench.engine.text import KernelSource, KernelText, delay_rows, parameter_symbols
from workbench.run import Array
from workbench.trace.expr import symbol

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
