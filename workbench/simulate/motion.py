"""The motion of the driven coordinate, as a log shows it, and the impacts of a play in it.

An impact is an instant at which the logged motion changes its momentum though the logged input does not.
Where teeth meet at the end of a play, the motor loses momentum to what it strikes within milliseconds. Of an axis of
inertia M moved by the input u, M v − ∫u dt changes its slope with friction and load, and jumps with an impact only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.core.run import Array, Run, integrated, stretches
from workbench.machines import Plant, kind_of
from workbench.machines.declare import RESTS_BELOW
from workbench.simulate.lowpass import grid_of, lowpass

WINDOW_S = 0.006  # an impact's length, and the unit of the windows beside it that its jump is read from
WIDER = 3  # times that: an impact's jump is as large over a wider window, that of a kink in the speed grows with it
OF_NOISE, OF_SPEED = 20.0, 0.01  # an impact's jump: of the noise of jumps (robust), and of the largest momentum
PLAIN_OF_NOISE, PLAIN_OF_SPEED, SHARP = 25.0, 0.03, 0.8  # a plain impact's; its jump over that in the wider window
AGAIN, IN_RUNS = 4, 2  # plain impacts of a campaign whose impacts come again, and the runs that have some
APART_S = 0.04
NEAR_S = 0.5  # of log, in which the noise of jumps is judged: that of jittery time stamps grows with the speed
BRIDGED_S = 0.012
GUARD_S = 0.04  # around an impact, not looked at: how well its time can be foretold
PLAY = "backlash"  # the effect that makes them


@dataclass(frozen=True)
class Motion:
    """position, speed, acceleration: (n,) of the driven coordinate at the log's samples.

    A motor's position counts from the run's first sample; an axis' is the measured one.
    """

    position: Array
    speed: Array
    acceleration: Array


def motion_of(run: Run, plant: Plant, band_hz: float) -> Motion:
    """Speed as measured where it is logged, else the derivative of the low-passed position.

    The position is low-passed an octave above `band_hz` first: twice differentiated
    encoder noise grows with the square of frequency. The acceleration is the central
    difference of the speed; its noise goes with the later low-pass of the residual. Where times are irregular it does
    not, for over one short step it is many times that of the others: the speed is low-passed first, too.
    """
    t = run.time_s
    position_name, speed_name = plant.positions[0], plant.speeds[0]
    if speed_name in run:
        speed = run[speed_name]
        position = run.signals.get(position_name, integrated(speed, t))
    else:
        position = lowpass(t, run[position_name], 2.0 * band_hz)
        speed = np.gradient(position, t)
    even = grid_of(t)[2] or speed_name not in run
    return Motion(position, speed, np.gradient(speed if even else lowpass(t, speed, 2.0 * band_hz), t))


GOES = 0.1  # of the speed scale, on average: what turns again and again does not rest


def moving(time_s: Array, speed: Array, scale: float, band_hz: float) -> np.ndarray:
    """(n,) bool: False where the machine rests, and within half a period of the band around that.

    A machine at rest may stick anywhere within its friction: a held load says nothing
    about friction, and the low-pass smears that. It rests when it is slower than
    RESTS_BELOW of the speed scale for a period of the band or longer; a quick reversal is no
    rest, nor are many that follow one another, the overshoot of a stop belongs to it.
    """
    slow = np.abs(lowpass(time_s, speed, band_hz))
    keep = np.ones(len(time_s), dtype=bool)
    guard = 0.5 / band_hz
    spans: list[list[int]] = []
    for begin, end in zip(*stretches(slow < RESTS_BELOW * scale), strict=True):
        if spans and time_s[begin] - time_s[spans[-1][1] - 1] < 1.0 / band_hz:
            spans[-1][1] = end
        else:
            spans.append([begin, end])
    for begin, end in spans:
        since, until = time_s[begin], time_s[end - 1]
        if until - since >= 1.0 / band_hz and np.mean(slow[begin:end]) < GOES * scale:
            keep &= (time_s < since - guard) | (time_s > until + guard)
    return keep


def own_impacts(machine: Any, runs: Sequence[Run]) -> tuple[Array, ...]:
    """Times of the impacts of each run that the machine's own play makes, s; none for a machine without play."""
    return impacts_of(machine, runs) if PLAY in machine.effects else tuple(np.zeros(0) for _ in runs)


def audible(runs: Sequence[Run]) -> bool:
    """Whether the logs are fine enough to tell an impact from a kink."""
    return any(run.sample_time_s <= WINDOW_S for run in runs)


def impacts_of(machine: Any, runs: Sequence[Run]) -> tuple[Array, ...]:
    """Times of a play's impacts in each run, s; none for kinds whose laws have them (`Kind.bridged_impacts`)."""
    kind = kind_of(machine)
    if not kind.bridged_impacts:
        return tuple(np.zeros(0) for _ in runs)
    plant = kind.plant
    return repeated_impacts(runs, kind.rigid(machine, 0.0).inertia, plant.positions[0], plant.speeds[0], plant.input)


def repeated_impacts(runs: Sequence[Run], inertia: float, position: str, speed: str, driven: str) -> tuple[Array, ...]:
    """Times of the impacts of each run, s; none of any run unless plain ones come again.

    inertia: kg or kg m²; position, speed, driven (the input): names of the signals. An impact that comes
    once is an event, not a play's, and at a log's ends a drive is switched on or off.
    """
    motions = [_speed(run, position, speed) for run in runs]
    fastest = max(float(np.percentile(np.abs(v), 98.0)) for v in motions)
    impacts, plain = [], []
    for run, v in zip(runs, motions, strict=True):
        times, jumps, noise = _jumps(run, inertia * v, run[driven], 1)
        worth = np.abs(jumps)
        struck = _peaks(times, worth, (worth > OF_NOISE * noise) & (worth > OF_SPEED * inertia * fastest))
        struck = struck[np.minimum(times[struck] - run.time_s[0], run.time_s[-1] - times[struck]) > GUARD_S]
        impacts.append(times[struck])
        heavy = (worth[struck] > PLAIN_OF_NOISE * noise[struck]) & (worth[struck] > PLAIN_OF_SPEED * inertia * fastest)
        wide_at, wide, _ = _jumps(run, inertia * v, run[driven], WIDER)
        beside_it = [np.abs(wide[np.abs(wide_at - at) < 2.0 * WINDOW_S]) for at in times[struck]]
        sharp = [w > SHARP * np.max(near, initial=0.0) for w, near in zip(worth[struck], beside_it, strict=True)]
        plain.append(int(np.count_nonzero(heavy & np.array(sharp, dtype=bool))))
    if sum(plain) >= AGAIN and np.count_nonzero(plain) >= IN_RUNS:
        return tuple(impacts)
    return tuple(np.zeros(0) for _ in runs)


def impact_strength(
    machine: Any, runs: Sequence[Run], impacts: Sequence[Array], late_s: float = 0.0, lag_s: float = 0.0
) -> float:
    """By how much the speed jumps at impacts of each run beyond what the input makes of the machine's inertia, rms, if
    the log shows its motion `late_s` late, and its input behind a filter of `lag_s`."""
    kind, jumps = kind_of(machine), list[float]()
    inertia = kind.rigid(machine, 0.0).inertia
    for run, struck in zip(runs, impacts, strict=True):
        t, force = run.time_s, run[kind.plant.input]
        speed = np.interp(t + late_s, t, _speed(run, kind.plant.positions[0], kind.plant.speeds[0]))
        times, jump, _ = _jumps(run, inertia * speed - lag_s * force, force, 1)
        jumps += [np.max(np.abs(jump[np.abs(times - at) <= WINDOW_S]), initial=0.0) / inertia for at in struck]
    return float(np.sqrt(np.mean(np.square(jumps))))


def _speed(run: Run, position: str, speed: str) -> Array:
    return run[speed] if speed in run else np.gradient(run[position], run.time_s)


def bridged(time_s: Array, acceleration: Array, impacts: Array) -> Array:
    """The acceleration (n,) with straight lines across the impacts."""
    if not len(impacts):
        return acceleration
    clear = ~beside(time_s, impacts, BRIDGED_S)
    return np.interp(time_s, time_s[clear], acceleration[clear])


def beside(time_s: Array, impacts: Array, guard_s: float) -> np.ndarray:
    """(n,) bool: within `guard_s` of an impact."""
    near = np.zeros(len(time_s), dtype=bool)
    for impact in impacts:
        near |= np.abs(time_s - impact) <= guard_s
    return near


def _jumps(run: Run, momentum: Array, force: Array, wider: int) -> tuple[Array, Array, Array]:
    """(m,) each: times, the jump of the momentum there beyond what the input and the trend beside it make, its noise
    thereabouts."""
    t = run.time_s
    defect = momentum - integrated(force, t)
    gap = wider * max(round(WINDOW_S / run.sample_time_s), 1)
    w = 2 * gap
    if len(t) < 5 * w + gap or not audible([run]):
        return np.zeros(0), np.zeros(0), np.zeros(0)
    c = np.cumsum(np.concatenate([[0.0], defect]))
    i = np.arange(2 * w, len(t) - 2 * w - gap)
    before, earlier = (c[i] - c[i - w]) / w, (c[i - w] - c[i - 2 * w]) / w
    after, later = (c[i + gap + w] - c[i + gap]) / w, (c[i + gap + 2 * w] - c[i + gap + w]) / w
    jump = (after - before) - 0.5 * ((before - earlier) + (later - after)) * (w + gap) / w
    off = np.abs(jump - np.median(jump))
    parts = np.array_split(off, max(1, round((t[-1] - t[0]) / NEAR_S)))
    near = np.concatenate([np.full(len(part), np.median(part)) for part in parts])
    return t[i + gap // 2], jump, 1.4826 * np.maximum(near, np.median(off))


def _peaks(times: Array, worth: Array, candidates: np.ndarray) -> np.ndarray:
    """Indices of the largest of `candidates` within APART_S, in time's order."""
    left, peaks = candidates.copy(), []
    while left.any():
        peak = int(np.argmax(np.where(left, worth, -1.0)))
        peaks.append(peak)
        left &= np.abs(times - times[peak]) > APART_S
    return np.array(sorted(peaks), dtype=int)
