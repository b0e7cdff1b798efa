"""Where the gap lies: in which windows of time, over which variable, in which part of the machine."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.numbers import whole_percent
from workbench.core.run import Array
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.fit import Fitted, parts_of
from workbench.diagnose.hypotheses.free_parameters import bounds_of
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import TOLERANCES
from workbench.diagnose.location.places import Event, Placed, PlaceProbability, placed
from workbench.diagnose.location.profiles import (
    Explained,
    Free,
    OnTop,
    Profile,
    basis,
    best_of,
    explain,
    profile_of,
    share_in_time,
    share_of,
    spacing,
    times,
    variables,
    wave_along_the_way,
    wave_in_time,
)
from workbench.effects import Effect
from workbench.machines import kind_of


@dataclass(frozen=True)
class Window:
    run: str
    from_s: float
    to_s: float


@dataclass(frozen=True)
class Where:
    """Where the gap lies. share: of its energy in the windows and the regime; time: of the time in motion that the
    windows take. side: drive, carriage, or unsaid.

    places: the likeliest first, probabilities that sum to one. events: the brief stretches, where that is what it is.
    """

    subsystem: str
    regime: str
    windows: tuple[Window, ...]
    share: float
    time: float
    interval: tuple[float, float]
    profiles: tuple[Profile, ...]
    side: str
    sentences: tuple[str, ...]
    places: tuple[PlaceProbability, ...] = ()
    events: tuple[Event, ...] = ()


DRIVE, CARRIAGE = 0.4, 0.6  # of the pull that a force on the carriage would make in the dead line


def side_of(problem: Problem, gap: Array) -> str:
    """drive or carriage, by whether the dead line's tension shows the gap of the torque; else unsaid.

    A force on the carriage shows as half of itself in each fall: T = i R W.
    """
    line = kind_of(problem.machine).dead_line
    if not problem.has_tension or line is None:
        return "unsaid"
    torque = gap[problem.pulled]
    energy = float(torque @ torque) - problem.noise**2 * len(torque)  # the noise is in the torque only
    newtons = line.pull_per_input(problem.machine)
    felt = gap[problem.inputs :] * problem.tension_noise / problem.noise
    if energy <= 0.0:
        return "unsaid"
    part = float(torque @ felt) / (newtons * energy)
    error = problem.tension_noise * np.sqrt(float(torque @ torque) / problem.share) / (newtons * energy)
    if part - error > CARRIAGE:
        return "carriage"
    return "drive" if part + error < DRIVE else "unsaid"


HELD = 0.75  # of the energy, in the windows
SHORTEST = 2.0  # periods of the band
APART = 1.0  # periods: windows nearer to one another are one


@dataclass(frozen=True)
class Windows:
    """inside: (inputs,) bool, the residuals in the windows. held: their share of the energy; time: their share of the
    time."""

    windows: tuple[Window, ...]
    inside: np.ndarray
    held: float
    time: float


def windows_of(problem: Problem, power: Array, held: float = HELD) -> Windows:
    """The windows above one level of the power, (inputs,), smoothed over a period of the band.

    The level is the highest one whose windows hold the wanted share of the energy.
    """
    step, at, period = spacing(problem), times(problem), 1.0 / problem.band_hz
    run_of = problem.run_of_row[: problem.inputs]
    smooth = np.maximum(_smoothed(power, at, run_of, period), 0.0)
    energy = step * np.maximum(power, 0.0)
    total = float(energy.sum())
    levels = np.unique(smooth)[::-1]
    inside, spans = np.ones(problem.inputs, dtype=bool), None
    low, high = 0, len(levels) - 1  # the share grows as the level falls
    while low <= high:
        middle = (low + high) // 2
        tried = _spans(smooth >= levels[middle], at, run_of, step, period)
        within = _within(tried, at, run_of)
        if float(energy[within].sum()) >= held * total:
            inside, spans, high = within, tried, middle - 1
        else:
            low = middle + 1
    if spans is None:
        spans = _spans(inside, at, run_of, step, period)
    digits = max(0, math.ceil(-math.log10(0.05 * period)))  # a twentieth of a period says no more
    named = tuple(Window(problem.runs[j].name, round(a, digits), round(b, digits)) for j, a, b in spans)
    share = float(energy[inside].sum()) / total if total > 0.0 else 0.0
    return Windows(named, inside, share, float(step[inside].sum() / step.sum()))


def _smoothed(power: Array, at: Array, run_of: np.ndarray, period: float) -> Array:
    """The mean over a period around each time, of the same run."""
    out = np.empty_like(power)
    for j in np.unique(run_of):
        mine = np.flatnonzero(run_of == j)
        t, total = at[mine], np.concatenate([[0.0], np.cumsum(power[mine])])
        first = np.searchsorted(t, t - 0.5 * period)
        last = np.searchsorted(t, t + 0.5 * period, side="right")
        out[mine] = (total[last] - total[first]) / (last - first)
    return out


def _spans(
    chosen: np.ndarray, at: Array, run_of: np.ndarray, step: Array, period: float
) -> list[tuple[int, float, float]]:
    """(run, from, to) s, merged and at least SHORTEST long, within what the run's residuals cover."""
    of_all_runs: list[tuple[int, float, float]] = []
    for j in np.unique(run_of):
        mine = run_of == j
        t, half = at[mine], 0.5 * float(step[mine][0])
        begin, end = float(t[0]) - half, float(t[-1]) + half
        spans: list[list[float]] = []
        for x in t[chosen[mine]]:
            middle_a, middle_b = float(x) - half, float(x) + half
            if spans and middle_a - spans[-1][1] < APART * period:
                spans[-1][1] = middle_b
            else:
                spans.append([middle_a, middle_b])
        widened: list[list[float]] = []
        for a, b in spans:
            more = max(0.5 * (SHORTEST * period - (b - a)), 0.0)
            a = max(a - more, begin)
            b = min(max(b + more, a + SHORTEST * period), end)
            a = max(min(a, b - SHORTEST * period), begin)
            if widened and a - widened[-1][1] < APART * period:
                widened[-1][1] = b
            else:
                widened.append([a, b])
        of_all_runs += [(int(j), a, b) for a, b in widened]
    return of_all_runs


def _within(spans: list[tuple[int, float, float]], at: Array, run_of: np.ndarray) -> np.ndarray:
    inside = np.zeros(len(at), dtype=bool)
    for j, a, b in spans:
        inside |= (run_of == j) & (at >= a) & (at <= b)
    return inside


CREEPING = 0.15  # of the fastest speed
EXPLAINS_LITTLE = 0.3
EDGE = 0.1  # of an event's largest force: where it begins and ends
WORTH_SAYING = 0.1  # of a place's probability
CARRIAGE_SIDE = {"guide", "payload", "platform", "wire"}  # of what the dead line's tension shows


def where_of(
    problem: Problem, near: Fitted, named: Fitted | None = None, effects: Sequence[Effect] = (), seed: int = 0
) -> Where:
    """Where the gap lies. near: the base parameters refitted within their tolerances; the gap is its residual.

    named, effects: the fit of the verdict and the effects it names; the windows are then where the
    larger effect's own part of the gap lies, and subsystem and regime are those it declares. Without
    them every port of the machine is a possible place of an unknown force.
    """
    profiles, best, other, law = _profiles(problem, near, seed)
    events: tuple[Event, ...] = ()
    if named is not None and effects:
        names = tuple(effect.id for effect in effects)
        *parts, whole = parts_of(problem, named, [*((name,) for name in names), names])
        gap = named.residual + whole
        largest = max(range(len(parts)), key=lambda k: _energy(problem, parts[k]))
        own = parts[largest][: problem.inputs]
        beside = gap[: problem.inputs] - own
        windows = windows_of(problem, own**2)
        subsystem, regime = effects[largest].subsystem(problem.active.kind), effects[largest].regime
        places: tuple[PlaceProbability, ...] = (PlaceProbability(subsystem, 1.0),)
        said: tuple[str, ...] = ()
    else:
        most_likely = placed(problem, near, holds=holding(problem, near, law, seed))
        gap, beside = near.residual, most_likely.left
        windows = windows_of(problem, gap[: problem.inputs] ** 2 - problem.noise**2)
        if most_likely.pulses:
            windows, events = _events(problem, most_likely)
        subsystem, regime, places = most_likely.port.subsystem, most_likely.port.regime, most_likely.places
        said = (f"What it depends on is {most_likely.port.over}.",)
        line, sides = kind_of(problem.machine).dead_line, {p.subsystem in CARRIAGE_SIDE for p in likely_of(places)}
        if line and not problem.has_tension and len(sides) > 1:
            said += (f"With {line.signal} logged runs tell which side of the wire a force acts on.",)
    torque, side = gap[: problem.inputs], side_of(problem, gap)
    left = np.where(windows.inside, beside, torque)
    share, interval = share_in_time(problem, torque, left, seed)
    whose = "what such a force does" if events else "the gap's energy"
    whose = f"what {effects[largest].id} does" if named is not None and effects else whose
    sentences = _sentences(windows, best, other, said, side, whose)
    return Where(
        subsystem, regime, windows.windows, share, windows.time, interval, tuple(profiles), side, tuple(sentences),
        places, events,
    )  # fmt: skip


def _energy(problem: Problem, rows: Array) -> float:
    return float(np.sum(spacing(problem) * rows[: problem.inputs] ** 2))


def _profiles(
    problem: Problem, near: Fitted, seed: int
) -> tuple[list[Profile], Explained, Explained | None, Explained]:
    """All profiles, the best first; the best explanation and the next best; the law that surely takes most."""
    gap, free = near.residual[: problem.inputs], free_of(problem, near)
    shares = [explain(problem, gap, v, free, seed) for v in variables(problem, gap)]
    law = max(shares, key=lambda one: one.interval[0])
    profiles = [profile_of(problem, gap, share, regime_of(problem, gap, share)) for share in shares]
    for wave in (wave_in_time(problem, gap, seed), wave_along_the_way(problem, gap, seed)):
        if wave is not None:
            shares, profiles = [*shares, wave[0]], [*profiles, wave[1]]
    best = best_of(shares)
    order = sorted(range(len(shares)), key=lambda k: (shares[k] is not best, -shares[k].share))
    rest = [shares[k] for k in order[1:]]
    return [profiles[k] for k in order], best, rest[0] if rest else None, law


def holding(problem: Problem, fit: Fitted, law: Explained, seed: int = 0) -> Callable[[Array], bool] | None:
    """Whether a part of the machine holds a law of one variable, by what it leaves of the gap, (inputs,): the law then
    takes less than HALF of what it takes on left-out runs by itself. None where no law foretells the gap."""
    if law.interval[0] <= settings.FORETOLD:
        return None
    gap, free, weight = fit.residual[: problem.inputs], free_of(problem, fit), spacing(problem)
    taken = float(weight @ (gap**2 - (gap - law.part) ** 2))

    def holds(left: Array) -> bool:
        more = explain(problem, left, law.variable, free, seed).part
        return float(weight @ (left**2 - (left - more) ** 2)) < settings.HALF * taken

    return holds


def free_of(problem: Problem, near: Fitted) -> Free:
    """How far the base parameters may still go from a fit, within their tolerances."""
    low, high, std = bounds_of(near.free)
    z = near.z
    tolerance = np.array([not parameter.logarithmic for parameter in near.free for _ in parameter.lowest])
    reach = np.where(tolerance, TOLERANCES * std, np.inf)
    low, high = np.maximum(low, -reach) - z, np.minimum(high, reach) - z
    hold = problem.noise / np.sqrt(problem.share) / std
    return Free(-near.jacobian[: problem.inputs], np.minimum(low, 0.0), np.maximum(high, 0.0), hold)


def laws_left(problem: Problem, fit: Fitted, seed: int = 0) -> list[Explained]:
    """Of each variable that the runs vary: what a law of it, one each way, takes off a fit's residual on runs that the
    law was not fitted to; on pieces of them, where there are fewer than three."""
    left = fit.residual[: problem.inputs]
    on_top, found = OnTop(problem, left, free_of(problem, fit)), []
    for variable in variables(problem, left):
        after = on_top.after(*basis(problem, variable))
        found.append(Explained(variable, left - after, *share_of(problem, left, after, seed)))
    return found


def regime_of(problem: Problem, gap: Array, explained: Explained) -> str:
    """A variable's regime; of the speed: whether its part lies where the machine creeps."""
    if explained.variable.name != "speed":
        return explained.variable.regime
    slow = explained.variable.at < CREEPING * float(np.max(explained.variable.at))
    gone = spacing(problem) * (gap**2 - (gap - explained.part) ** 2)
    return "low_speed" if float(gone[slow].sum()) > 0.5 * float(gone.sum()) > 0.0 else "speed"


def _sentences(
    windows: Windows, best: Explained, other: Explained | None, said: Sequence[str], side: str, whose: str
) -> list[str]:
    many = len(windows.windows)
    sentences = [
        f"{100.0 * windows.held:.0f} % of {whose} lies in {many} window{'s' if many != 1 else ''} that "
        f"take{'s' if many == 1 else ''} {100.0 * windows.time:.0f} % of the time in motion.",
    ]
    if told := best.interval[0] > settings.FORETOLD:
        sentences.append(
            f"The {best.variable.label} explains {_percent(best)} of the gap on runs it was not fitted to"
            + (f"; the {other.variable.label} {_percent(other)}." if other is not None else ".")
        )
    sentences += said
    if side == "carriage":
        sentences.append("The dead line's tension shows the gap too: it is on the carriage's side of the wire.")
    elif side == "drive":
        sentences.append("The dead line's tension does not show the gap: it is on the drive's side of the wire.")
    if not told or best.share < EXPLAINS_LITTLE:
        sentences.append("No single variable explains much of it.")
    return sentences


def _events(problem: Problem, most_likely: Placed) -> tuple[Windows, tuple[Event, ...]]:
    """The windows of the events, where their force lies, and the events."""
    at, step, run_of = times(problem), spacing(problem), problem.run_of_row[: problem.inputs]
    energy = step * most_likely.part**2
    inside, spans, events = np.zeros(problem.inputs, dtype=bool), [], []
    for pulse in most_likely.pulses:
        mine = np.flatnonzero((run_of == pulse.run) & (at >= pulse.from_s) & (at <= pulse.to_s))
        if not len(mine):
            continue
        strong = mine[np.abs(most_likely.part[mine]) > EDGE * np.max(np.abs(most_likely.part[mine]))]
        begin, end = (round(float(at[k]), 2) for k in (strong[0], strong[-1]))
        inside[strong[0] : strong[-1] + 1] = True
        name = problem.runs[pulse.run].name
        spans.append(Window(name, begin, end))
        largest = float(most_likely.part[mine][np.argmax(np.abs(most_likely.part[mine]))])
        share = float(energy[mine].sum() / max(float(energy.sum()), 1e-300))
        events.append(Event(name, begin, end, most_likely.port.subsystem, share, largest))
    held = float(energy[inside].sum() / max(float(energy.sum()), 1e-300))
    return Windows(tuple(spans), inside, held, float(step[inside].sum() / step.sum())), tuple(events)


def likely_of(places: Sequence[PlaceProbability]) -> list[PlaceProbability]:
    """The likeliest place, and those that are worth saying beside it."""
    return [place for k, place in enumerate(places) if k == 0 or place.probability > WORTH_SAYING]


def _percent(explained: Explained) -> str:
    low, high = explained.interval
    return whole_percent(explained.share) + ("" if low >= 0.995 else f" ({100.0 * low:.0f} to {100.0 * high:.0f} %)")
