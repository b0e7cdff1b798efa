"""Running the generated kernels: scenarios into lanes, lanes onto threads.

Arrays here have the scenario as their last axis; what comes back has the same.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import numpy as np

from workbench.core.run import Array
from workbench.engine.source import HELD, Kernel, delay_rows, driven_kernel, loop_kernel, loop_parameters, replay_kernel
from workbench.machines import NO_EFFECTS, Effects, Plant

T = TypeVar("T")

LANES = (1, 4, 8, 16)  # kernels are made for; 16 fill the widest registers twice
FEW_LANES = LANES[2:]  # the same with effects, of which there are many sets: each kernel takes half a second to compile
TOLERANCE = 5e-7  # of the speed scale, per interval between samples; gives 1e-6 of it over a run
# The driven coordinate adds up its errors; the wire forgets those of the others within a fraction of a second.
FOLLOWERS = 2.0  # so many times its tolerance is theirs
MOST_STEPS = 64  # between two samples


def lanes_for(scenarios: int, effects: Effects = NO_EFFECTS) -> int:
    """The narrowest kernel that takes them all at once, else the widest."""
    widths = LANES if effects is NO_EFFECTS else FEW_LANES
    return next((lanes for lanes in widths if lanes >= scenarios), widths[-1])


def _groups(scenarios: int, lanes: int) -> list[np.ndarray]:
    """Indices of the scenarios in each call; the last call's spare lanes repeat its last scenario."""
    padded = -(-scenarios // lanes) * lanes
    return list(np.minimum(np.arange(padded), scenarios - 1).reshape(-1, lanes))


def _lanes(a: Array, group: np.ndarray) -> Array:
    """The columns of a group, flat: rows of lanes. A single column serves every scenario."""
    columns = np.take(a, group, axis=-1) if a.shape[-1] > 1 else np.broadcast_to(a, (*a.shape[:-1], len(group)))
    if columns.dtype == float and columns.flags.c_contiguous and columns.flags.owndata:
        return columns.reshape(-1)
    return np.array(columns, dtype=float, order="C").reshape(-1)  # a copy: kernels advance states in place


def _read(a: Array, group: np.ndarray) -> Array:
    """As `_lanes`, of a signal that a kernel only reads: not copied where it is in lanes already, or one for all."""
    whole = a.shape[-1] == len(group) and group[-1] == len(group) - 1
    return np.ascontiguousarray(a, dtype=float).reshape(-1) if whole or a.shape[-1] == 1 else _lanes(a, group)


def _interleaved(references: Sequence[Array]) -> Array:
    """(references, n) of each lane -> flat rows of lanes."""
    first = references[0]
    out = np.empty((first.shape[1], first.shape[0], len(references)))
    if all(reference is first for reference in references):
        np.copyto(out, first.T[:, :, None])
    else:
        for lane, reference in enumerate(references):
            out[:, :, lane] = reference.T
    return out.reshape(-1)


def _spread(work: Callable[[np.ndarray], T], groups: Sequence[np.ndarray], threads: int | None) -> list[T]:
    """Run the groups; kernels let go of the interpreter lock, so threads use all cores."""
    workers = min(len(groups), threads or os.cpu_count() or 1)
    first = work(groups[0])  # compiles, if need be, in one thread only
    if workers == 1 or len(groups) == 1:
        return [first, *(work(group) for group in groups[1:])]
    with ThreadPoolExecutor(workers) as pool:
        return [first, *pool.map(work, groups[1:])]


def _joined(parts: Sequence[Array], scenarios: int) -> Array:
    return parts[0][..., :scenarios] if len(parts) == 1 else np.concatenate(parts, axis=-1)[..., :scenarios]


def replay(
    plant: Plant,
    parameters: Array,
    times: Array,
    inputs: Array,
    start: Array,
    speed_scales: Array,
    *,
    effects: Effects = NO_EFFECTS,
    tolerance: float = TOLERANCE,
    threads: int | None = None,
    lanes: int | None = None,
) -> Array:
    """States under inputs given at samples, linear between them.

    parameters: (names, scenarios); times, inputs: (n, scenarios); start: (states,
    scenarios), positions first; speed_scales: (speeds, scenarios), what the tolerance
    is relative to. lanes: of the kernel, None for the narrowest that takes them all. Returns (n, states, scenarios).
    """
    kernel = replay_kernel(plant, effects, lanes or lanes_for(parameters.shape[1], effects))
    rows = start.shape[0]
    scales = np.concatenate([speed_scales[:1], FOLLOWERS * speed_scales[1:]])
    return _integrated(kernel, parameters, (times, inputs), start, scales, rows, tolerance, threads)


def _integrated(
    kernel: Kernel,
    parameters: Array,
    signals: Sequence[Array],
    start: Array,
    speed_scales: Array,
    rows: int,
    tolerance: float,
    threads: int | None,
    most_steps: int = MOST_STEPS,
) -> Array:
    """What `replay` and `driven` share: signals (n, scenarios) in, (n, rows, scenarios) out."""
    scenarios, n = parameters.shape[1], signals[0].shape[0]

    def work(group: np.ndarray) -> Array:
        result = np.empty((n, rows, kernel.lanes))
        state = _lanes(start, group)
        kernel.run(
            kernel.constants(parameters[:, group]),
            *(_read(signal, group) for signal in signals),
            state,
            np.empty(2 * state.size),
            np.empty(kernel.lanes),
            1.0 / _lanes(speed_scales, group),
            np.empty(HELD * kernel.lanes),
            tolerance,
            most_steps,
            result.reshape(-1),
        )
        return result

    return _joined(_spread(work, _groups(scenarios, kernel.lanes), threads), scenarios)


def driven(
    plant: Plant,
    parameters: Array,
    times: Array,
    angles: Array,
    speeds: Array,
    accelerations: Array,
    start: Array,
    speed_scales: Array,
    *,
    effects: Effects = NO_EFFECTS,
    tolerance: float = TOLERANCE,
    threads: int | None = None,
    lanes: int | None = None,
    most_steps: int = MOST_STEPS,
) -> Array:
    """The input that the measured motion of the driven coordinate takes, and the other states.

    times, angles, speeds, accelerations: (n, scenarios); start: (other states,
    scenarios). lanes: of the kernel, None for the narrowest that takes them all. most_steps: between two samples.
    Returns (n, 1 + other states, scenarios), the input first.
    """
    kernel = driven_kernel(plant, effects, lanes or lanes_for(parameters.shape[1], effects))
    signals, rows = (times, angles, speeds, accelerations), 1 + start.shape[0]
    return _integrated(kernel, parameters, signals, start, speed_scales[1:], rows, tolerance, threads, most_steps)


def loop(
    plant: Plant,
    controller: Any,
    observer: Any,
    recorded: tuple[str, ...],
    parameters: Array,
    references: Sequence[Array],
    sample_time: float,
    start: Array,
    memory: Array,
    *,
    every: int = 1,
    substeps: int = 1,
    actual: Array | None = None,
    effects: Effects = NO_EFFECTS,
    threads: int | None = None,
) -> tuple[Array, Array, Array]:
    """A sampled controller on the plant.

    parameters: (names, scenarios), rows as `loop_parameters` names them; references: one
    (references, n) array a scenario, the same object where it is the same; start:
    (states, scenarios); memory: (controller memory, scenarios); actual: (scenarios,) the
    input at work at the start where the drive lags, None where it does not. Returns
    recorded signals (rows, signals, scenarios), the observer's accumulators (accumulators, scenarios) and
    the final states (states, scenarios).
    """
    scenarios = parameters.shape[1]
    kept = 0
    if controller.sensed is not None:
        names = loop_parameters(plant, effects, controller, observer)
        kept = delay_rows(float(parameters[names.index("late")].max()))
    kernel = loop_kernel(plant, effects, lanes_for(scenarios), controller, observer, recorded, actual is not None)
    n = references[0].shape[-1]
    rows = -(-n // every)

    def work(group: np.ndarray) -> tuple[Array, Array, Array]:
        L = kernel.lanes
        result = np.empty((rows, len(recorded), L))
        state = _lanes(start, group)
        accumulators = np.repeat(np.asarray(observer.start, dtype=float), L)
        kernel.run(
            kernel.constants(parameters[:, group]),
            _interleaved([references[j] for j in group]),
            sample_time,
            substeps,
            every,
            state,
            _lanes(memory, group),
            *([np.zeros(kept * L)] if kept else []),
            accumulators,
            np.empty(L),
            np.zeros(L) if actual is None else _lanes(actual, group),
            np.empty(max(1, len(recorded)) * L),
            result.reshape(-1),
        )
        return result, accumulators.reshape(-1, L), state.reshape(-1, L)

    parts = _spread(work, _groups(scenarios, kernel.lanes), threads)
    out, totals, end = (_joined([part[i] for part in parts], scenarios) for i in range(3))
    return out, totals, end
