"""How large an effect is: the input that it changes in each second of each run, known since the truth is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from workbench.blind.sources.simulator.campaign import Built, Simulated, built, simulated
from workbench.blind.sources.simulator.content import Content
from workbench.blind.sources.simulator.kind import Kind
from workbench.blind.sources.simulator.sensors import shown_input

Array = npt.NDArray[np.float64]
BOX = 0.32  # two boxes of this over f lose 3 dB at f


@dataclass(frozen=True)
class Change:
    """rms_nm: of the input, noise apart, low-passed, while the reference moves, over all runs; N on a linear axis.
    by_second_nm: run -> its rms in each second, standing included."""

    rms_nm: float
    by_second_nm: dict[str, list[float]]


def input_change(content: Content, seed: int | Sequence[int]) -> Change:
    """With the causes less without them, all else alike: the same machine, runs and noise of the drive.

    A late speed is counted as the input's change over that delay, a speed that is shown too low as the torque of the
    inertia that its change would take. What a refit within the tolerances would take up
    is still in it; so is what the machine then does differently.
    """
    seeds = (seed,) if isinstance(seed, int) else tuple(seed)
    well, kind = replace(content, causes=()), content.kind
    ill_machine, well_machine = built(content, seeds), built(well, seeds)
    width = max(1, round(BOX / kind.band_hz(content.logging.rate_hz) / kind.record_s))
    wander = 0.0
    walk = np.random.default_rng([*seeds, 8])
    pairs = []
    for number, plan in enumerate(content.runs):
        ill, sound = simulated(content, ill_machine, number, seeds), simulated(well, well_machine, number, seeds)
        shown, wander = _shown(kind, ill, ill_machine, walk, wander)
        pairs.append((plan.name, shown - _shown(kind, sound, well_machine, walk, 0.0)[0], ill.reference != 0.0))
    return change_of(pairs, width, kind.record_s)


def change_of(runs: Sequence[tuple[str, Array, npt.NDArray[np.bool_]]], width: int, step_s: float) -> Change:
    """runs: each one's name, what is shown more with the causes than without, and where it moves; a row each step.
    width: of the two boxes that smooth it, in steps."""
    squares, count = 0.0, 0
    by_second: dict[str, list[float]] = {}
    for name, difference, moving in runs:
        change = _smooth(difference, width)
        squares += float(np.sum(change[moving] ** 2))
        count += int(np.sum(moving))
        by_second[name] = _each_second(change, round(1.0 / step_s))
    return Change(float(f"{np.sqrt(squares / max(count, 1)):.4g}"), by_second)


def _shown(kind: Kind, run: Simulated, machine: Built, walk: np.random.Generator, wander: float) -> tuple[Array, float]:
    speed = run.record[:, kind.speed]
    shown, wander = shown_input(
        run.record[:, kind.input], speed, kind.record_s, machine.sensors, walk, wander, run.window
    )
    time = np.arange(len(shown), dtype=np.float64) * kind.record_s
    if run.window is not None and machine.sensors.slip:
        missed = machine.sensors.slip * run.window.pulse(time) * speed
        shown = shown + kind.inertia(run.truth) * np.gradient(missed, kind.record_s)
    return np.interp(time + machine.sensors.delay_s, time, shown), wander


def _smooth(values: Array, width: int) -> Array:
    box = np.full(width, 1.0 / width)
    padded = np.pad(values, width, mode="edge")
    out: Array = np.convolve(np.convolve(padded, box, "same"), box, "same")[width:-width]
    return out


def _each_second(values: Array, every: int) -> list[float]:
    whole = len(values) // every
    return [float(f"{rms:.3g}") for rms in np.sqrt(np.mean(values[: whole * every].reshape(whole, every) ** 2, axis=1))]
