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
from benchmarks.campaigns.size import Change, change_of

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
    wander = 0.0
    walk = np.random.default_rng([*seeds, 18])
    pairs = []
    for number, plan in enumerate(content.runs):
        ill, sound = simulated(content, ill_machine, number, seeds), simulated(well, well_machine, number, seeds)
        shown, wander = _shown(ill, ill_machine, walk, wander)
        pairs.append((plan.name, shown - _shown(sound, well_machine, walk, 0.0)[0], ill.reference != 0.0))
    return change_of(pairs, width, RECORD_S)


def _shown(run: Simulated, machine: Built, walk: np.random.Generator, wander: float) -> tuple[Array, float]:
    force, wander = shown_force(run.record, machine.sensors, walk, wander)
    time = np.arange(len(force)) * RECORD_S
    return np.interp(time + machine.sensors.delay_s, time, force), wander
