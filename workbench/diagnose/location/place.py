"""Which part of the machine an unnamed gap lies in, by a stated rule; and on which side of the wire."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.location.profiles import Explained
from workbench.diagnose.location.variables import forward, of_rows, way
from workbench.diagnose.location.windows import Windows
from workbench.kinds import kind_of
from workbench.run import Array

CREEPING = 0.15  # of the fastest speed
EXPLAINS_LITTLE = 0.3
EVENT_TIME = 0.15  # of the time in motion
EVENT_RUN = 0.8  # of the energy, in one run
BOTH_WAYS = 0.5  # how alike the two directions are, of 1
FEWEST_BINS = 4
DRIVE, CARRIAGE = 0.4, 0.6  # of the pull that a force on the carriage would make in the dead line
GROWS = 1.2  # from the lightest to the heaviest payload
MOST_ORDER = 24
CLEARLY = 0.25  # of what a straight line leaves


@dataclass(frozen=True)
class Place:
    subsystem: str
    regime: str
    sentences: tuple[str, ...] = ()


# The part that such a gap most often lies in, and why, where nothing but motor signals are logged.
USUAL = {
    "low_speed": ("guide", "friction near standstill is that of rollers in rails"),
    "campaign_time": ("guide", "friction is what changes as a machine warms up"),
    "acceleration": ("gearbox", "what turns with the motors weighs most, by the ratio squared"),
    "since_start": ("brake", "what a start alone shows lets go late"),
    "run_time": ("platform", "what time alone governs comes from outside the machine"),
    "frequency": ("platform", "a wave in time, standing or moving, comes from outside the machine"),
    "drum_angle": ("drum", "it comes back with every turn of the drum"),
    "input": ("torque_sensor", "it follows the torque itself, whatever moves"),
    "angle": ("motor", "it comes back with every turn"),
}


def place_of(problem: Problem, gap: Array, best: Explained, windows: Windows, side: str) -> Place:
    """From what explains the gap best. On an axis everything is the axis'."""
    regime = _regime_of(problem, gap, best, windows)
    whole = kind_of(problem.machine).whole
    if whole:
        return Place(whole, regime)
    if regime == "event":
        return Place("guide", regime, ("No variable explains it: a single event, most likely something in the way.",))
    name = best.variable.name
    if name in ("speed", "payload", "direction") and regime != "low_speed":
        subsystem, why = _friction_or_load(best, problem)
    elif name == "wave":
        subsystem, why = _what_turns(problem, best)
    elif name == "position":
        subsystem, why = _along_the_way(best, problem, gap)
    else:
        subsystem, why = USUAL[regime if regime == "low_speed" else name]
    if side == "drive" and subsystem in ("guide", "payload"):
        subsystem = "drum" if regime == "position" else "motor"
        why = "the dead line's tension does not show it, so it is on the drive's side"
    if side == "carriage" and subsystem in ("motor", "gearbox"):
        subsystem, why = "guide", "the dead line's tension shows it too, so it is on the carriage's side"
    return Place(subsystem, regime, (f"Most likely it is in the {subsystem.replace('_', ' ')}: {why}.",))


def _regime_of(problem: Problem, gap: Array, best: Explained, windows: Windows) -> str:
    energy = np.bincount(problem.run_of_row[: problem.inputs], gap**2, len(problem.runs))
    alone = len(problem.runs) > 1 and float(np.max(energy)) > EVENT_RUN * float(energy.sum())
    if best.share < EXPLAINS_LITTLE and windows.time < EVENT_TIME and alone:
        return "event"
    if best.variable.name == "speed":
        slow = best.variable.at < CREEPING * float(np.max(best.variable.at))
        gone = gap**2 - (gap - best.part) ** 2
        if float(gone[slow].sum()) > 0.5 * float(gone.sum()):
            return "low_speed"
    return best.variable.regime


def _friction_or_load(best: Explained, problem: Problem) -> tuple[str, str]:
    """Speed, payload or direction: what turns over with the direction is friction, what does not is a weight."""
    ahead = forward(problem)
    if best.variable.name == "speed":
        if _bends(best, ahead):
            return "motor", "a drag that grows faster than the speed is the air's or oil's, around what turns fastest"
        return "guide", "a drag that grows with the speed is that of rollers and grease"
    if best.variable.name == "payload":
        up, down = (_slope(best.variable.at[way], best.part[way]) for way in (ahead, ~ahead))
    else:
        up, down = (float(np.mean(best.part[way])) if np.any(way) else 0.0 for way in (ahead, ~ahead))
    if up * down > BOTH_WAYS * max(up * up, down * down):
        if best.variable.name == "payload":
            return "payload", "it is the same both ways and grows with the payload: a weight"
        return "torque_sensor", "it is the same both ways and at every payload, as a sensor's offset is"
    return "guide", "it turns over with the direction, as friction does"


def _what_turns(problem: Problem, best: Explained) -> tuple[str, str]:
    """A wave over the height: whose turn it comes back with, as far as the way resolves it."""
    frequency, resolution = float(best.variable.at[0]), 1.0 / float(np.ptp(way(problem)))
    for part in kind_of(problem.machine).turning:
        name, turns = part.part, part.turns_per_way(problem.machine)
        order = frequency / turns
        nearest = round(order)
        if 1 <= nearest <= MOST_ORDER and abs(order - nearest) * turns < 0.5 * resolution < 0.1 * turns:
            return name, f"it comes back {nearest} times with every turn of the {name}"
    return "guide", f"it comes back every {1.0 / frequency:.2g} m, as a roller does"


def _along_the_way(best: Explained, problem: Problem, gap: Array) -> tuple[str, str]:
    """Over the height: friction in the rail turns over with the direction; what does not is wire, or wound on a drum
    where it grows with the load."""
    v, ahead = best.variable, forward(problem)
    bins = np.clip(np.searchsorted(v.edges, v.at, side="right") - 1, 0, len(v.edges) - 2)
    both = [np.bincount(bins[way], minlength=len(v.edges) - 1) > 0 for way in (ahead, ~ahead)]
    common = both[0] & both[1]
    if np.sum(common) < FEWEST_BINS:
        return "guide", "what depends on the height stands beside the rail"
    # Levels are left out: base parameters shift those.
    curves = [np.bincount(bins[way], best.part[way], len(common))[common] for way in (ahead, ~ahead)]
    counts = [np.bincount(bins[way], minlength=len(common))[common] for way in (ahead, ~ahead)]
    up, down = (c / n - np.mean(c / n) for c, n in zip(curves, counts, strict=True))
    if float(up @ down) < BOTH_WAYS * max(float(up @ up), float(down @ down)):
        return "guide", "it depends on the height and on the direction, as friction along the rail does"
    payload = of_rows(problem, lambda b, j: np.full(len(b.runs[j].time_s), b.runs[j].payload_kg))
    sizes = [
        float(gap[mine] @ best.part[mine]) / max(float(best.part[mine] @ best.part[mine]), 1e-300)
        for load in (np.min(payload), np.max(payload))
        for mine in [payload == load]
    ]
    if sizes[1] > GROWS * max(sizes[0], 0.0) and np.ptp(payload) > 0.0:
        return (
            "drum",
            "it depends on the height, the same both ways, and grows with the load, as the drum's radius does",
        )
    return "wire", "it depends on the height, the same both ways and at every payload, as what hangs does"


def _slope(x: Array, y: Array) -> float:
    away = x - np.mean(x) if len(x) else x
    return float(away @ y) / max(float(away @ away), 1e-300)


def _bends(best: Explained, ahead: np.ndarray) -> bool:
    """Whether a square of the speed fits the part clearly better than the speed itself, levels each way beside it."""
    fast = best.variable.at > CREEPING * float(np.max(best.variable.at))
    v = best.variable.at * np.where(ahead, 1.0, -1.0)
    left = []
    for shape in (v, v * np.abs(v)):
        a = np.stack([ahead, ~ahead, shape], axis=1)[fast].astype(float)
        amounts = np.linalg.lstsq(a, best.part[fast], rcond=None)[0]
        left.append(float(np.sum((best.part[fast] - a @ amounts) ** 2)))
    return left[1] < CLEARLY * left[0]


def side_of(problem: Problem, gap: Array) -> str:
    """drive or carriage, from whether the dead line feels the force that the torque misses; else unsaid.

    A force on the carriage shows as half of itself in each fall: T = i R W.
    """
    line = kind_of(problem.machine).dead_line
    if not problem.has_tension or line is None:
        return "unsaid"
    torque = gap[: problem.inputs]
    energy = float(torque @ torque) - problem.noise**2 * problem.inputs  # the noise is in the torque only
    newtons = line.pull_per_input(problem.machine)
    felt = gap[problem.inputs :] * problem.tension_noise / problem.noise
    if energy <= 0.0:
        return "unsaid"
    part = float(torque @ felt) / (newtons * energy)
    error = problem.tension_noise * np.sqrt(float(torque @ torque) / problem.share) / (newtons * energy)
    if part - error > CARRIAGE:
        return "carriage"
    return "drive" if part + error < DRIVE else "unsaid"
