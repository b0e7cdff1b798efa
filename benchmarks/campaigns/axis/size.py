"""How large an effect is on an axis: the force that it changes in each second of each run, known since the truth is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from benchmarks.campaigns.axis.campaign import Built, Simulated, built, simulated
from benchmarks.campaigns.axis.content import Content
from benchmarks.campaigns.axis.kernel import RECORD_S
from benchmarks.campaigns.axis.sensors import shown_force
from benchmarks.campaigns.size import Change

Array = npt.NDArray[np.float64]
HIGHEST_HZ, OF_THE_RATE = 90.0, 0.09  # −3 dB of the smoothing: about where logs of that rate are compared
BOX = 0.32  # two boxes of this over f lose 3 dB at f


def force_change(content: Content, seed: int | Sequence[int]) -> Change:
    """With the causes less without them, all else alike; N on a linear axis, N m on a rotary one.

    A late motion is counted as the force's change over that delay. What a refit within the tolerances would take
    up is still in it; so is what the axis then does differently.
    """
    seeds = (seed,) if isinstance(seed, int) else tuple(seed)
    well = replace(content, causes=())
    ill_machine, well_machine = built(content, seeds), built(well, seeds)
    width = max(1, round(BOX / min(HIGHEST_HZ, OF_THE_RATE * content.rate_hz) / RECORD_S))
    squares, count, wander = 0.0, 0, 0.0
    walk = np.random.default_rng([*seeds, 18])
    by_second: dict[str, list[float]] = {}
    for number, plan in enumerate(content.runs):
        ill, sound = simulated(content, ill_machine, number, seeds), simulated(well, well_machine, number, seeds)
        shown, wander = _shown(ill, ill_machine, walk, wander)
        change = _smooth(shown - _shown(sound, well_machine, walk, 0.0)[0], width)
        moving = ill.reference != 0.0
        squares += float(np.sum(change[moving] ** 2))
        count += int(np.sum(moving))
        by_second[plan.name] = _each_second(change)
    return Change(float(f"{np.sqrt(squares / max(count, 1)):.4g}"), by_second)


def _shown(run: Simulated, machine: Built, walk: np.random.Generator, wander: float) -> tuple[Array, float]:
    force, wander = shown_force(run.record, machine.sensors, walk, wander)
    time = np.arange(len(force)) * RECORD_S
    return np.interp(time + machine.sensors.delay_s, time, force), wander


def _smooth(values: Array, width: int) -> Array:
    box = np.full(width, 1.0 / width)
    padded = np.pad(values, width, mode="edge")
    out: Array = np.convolve(np.convolve(padded, box, "same"), box, "same")[width:-width]
    return out


def _each_second(values: Array) -> list[float]:
    every = round(1.0 / RECORD_S)
    whole = len(values) // every
    return [float(f"{rms:.3g}") for rms in np.sqrt(np.mean(values[: whole * every].reshape(whole, every) ** 2, axis=1))]
