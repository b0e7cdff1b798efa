"""Effects that a campaign cannot tell apart because a run, a payload, a speed or a direction is missing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.core.run import Array
from workbench.machines import kind_of
from workbench.simulate.driven import Bench
from workbench.simulate.lowpass import lowpass

ONE_WAY = 0.03  # of the moving time the other way: too little to tell friction from load
ONE_SPEED = 0.7  # of the larger cruising speeds over the smaller: slower and faster are then one speed
EVEN = 0.1  # of the largest acceleration: below it counts as cruising
PAYLOADS_ALIKE = 0.02  # of the moved mass: less is no other payload


def variety(bench: Bench, going: Sequence[int]) -> tuple[str, ...]:
    """Warnings as sentences; none if the campaign varies all of them."""
    sentences = []
    kind = kind_of(bench.machine)
    if len(going) == 1:
        sentences.append(
            "One run only: it can show neither what the payload changes nor what the campaign's time does, "
            "and nothing is left to test on; held-out figures are of parts of the same run."
            if kind.payload
            else "One run only: it cannot show what changes from run to run, and nothing is left to test on; "
            "held-out figures are of parts of the same run."
        )
    elif kind.payload and _one_payload(bench, going):
        sentences.append(
            f"All runs carry about {bench.runs[going[0]].payload_kg:g} kg: what grows with the load (gearbox "
            "efficiency, load-dependent friction, payload and torque scale) cannot be told from what does not."
        )
    speeds = [_speeds(bench, j) for j in going]
    ahead = float(np.mean(np.concatenate(speeds) > 0.0))
    if not ONE_WAY < ahead < 1.0 - ONE_WAY:
        way, other = kind.directions.one_way[ahead <= 0.5]
        sentences.append(f"All runs only {way}: without {other}, friction cannot be told from the load or an offset.")
    if _one_speed(bench, going):
        sentences.append(
            "All runs move at one speed: friction that grows or falls with the speed cannot be told from a "
            "constant level; a slow run beside a fast one would show it."
        )
    return tuple(sentences)


def _one_payload(bench: Bench, going: Sequence[int]) -> bool:
    """Whether all runs carry about the same payload, judged by the weight."""
    weight = kind_of(bench.machine).weight
    if weight is None:
        return False
    weights = [weight(bench.machine, bench.runs[j].payload_kg) for j in going]
    return max(weights) - min(weights) < PAYLOADS_ALIKE * max(weights)


def _speeds(bench: Bench, j: int) -> Array:
    """(k,) low-passed speeds of run j in motion."""
    run = bench.runs[j]
    return lowpass(run.time_s, bench.motions[j].speed, bench.band_hz)[bench.moving[j]]


def _one_speed(bench: Bench, going: Sequence[int]) -> bool:
    """Whether all phases of constant speed have the same speed; without such phases the speeds vary."""
    cruising, moving = [], 0
    for j in going:
        run = bench.runs[j]
        speed = lowpass(run.time_s, bench.motions[j].speed, bench.band_hz)
        acceleration = np.abs(np.gradient(speed, run.time_s))
        largest = float(np.max(acceleration[bench.moving[j]]))
        even = bench.moving[j] & (acceleration < EVEN * largest) & (np.abs(speed) > 0.02 * bench.scale)
        cruising.append(np.abs(speed[even]))
        moving += int(np.count_nonzero(bench.moving[j]))
    every = np.concatenate(cruising)
    if len(every) < 0.2 * moving:
        return False
    slow, fast = np.percentile(every, [5.0, 95.0])
    return bool(slow > ONE_SPEED * fast)
