"""Where the gap lies: in which windows of time, over which variable, in which part of the machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.fit import Fitted, parts_of
from workbench.diagnose.hypotheses.free_parameters import bounds_of
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.hypotheses.search import TOLERANCES
from workbench.diagnose.location.places import Placed, placed
from workbench.diagnose.location.profiles import Explained, Free, best_of, explain, profile_of, run_of, share_in_time
from workbench.diagnose.location.records import Event, PlaceProbability, Profile, Where, Window
from workbench.diagnose.location.side import side_of
from workbench.diagnose.location.spectrum import wave_along_the_way, wave_in_time
from workbench.diagnose.location.variables import spacing, times, variables
from workbench.diagnose.location.windows import Windows, windows_of
from workbench.effects import Effect

CREEPING = 0.15  # of the fastest speed
EXPLAINS_LITTLE = 0.3
EDGE = 0.1  # of an event's largest force: where it begins and ends
WORTH_SAYING = 0.1  # of a place's probability


def where_of(
    problem: Problem, near: Fitted, named: Fitted | None = None, effects: Sequence[Effect] = (), seed: int = 0
) -> Where:
    """Where the gap lies. near: the base parameters refitted within their tolerances; the gap is its residual.

    named, effects: the fit of the verdict and the effects it names; the windows are then where the
    larger effect's own part of the gap lies, and subsystem and regime are those it declares. Without
    them every port of the machine is a possible place of an unknown force.
    """
    profiles, best, other = _profiles(problem, near, seed)
    events: tuple[Event, ...] = ()
    if named is not None and effects:
        names = tuple(effect.id for effect in effects)
        *parts, whole = parts_of(problem, named, [*((name,) for name in names), names])
        gap = named.residual + whole
        largest = max(range(len(parts)), key=lambda k: _energy(problem, parts[k]))
        own = parts[largest][: problem.inputs]
        windows = windows_of(problem, own**2)
        subsystem, regime = effects[largest].subsystem(problem.active.kind), effects[largest].regime
        places: tuple[PlaceProbability, ...] = (PlaceProbability(subsystem, 1.0),)
        said: tuple[str, ...] = ()
    else:
        most_likely = placed(problem, near)
        gap, own = near.residual, most_likely.part
        windows = windows_of(problem, gap[: problem.inputs] ** 2 - problem.noise**2)
        if most_likely.pulses:
            windows, events = _events(problem, most_likely)
        subsystem, regime, places = most_likely.port.subsystem, most_likely.port.regime, most_likely.places
        said = _placed(most_likely)
    torque, side = gap[: problem.inputs], side_of(problem, gap)
    left = np.where(windows.inside, torque - own, torque)
    share, interval = share_in_time(problem, torque, left, seed)
    by_run = _by_run(problem, near.residual[: problem.inputs])  # the gap that profiles and figures show
    whose = "the gap's energy" if named is None or not effects else "what the named effect does"
    sentences = _sentences(problem, windows, best, other, by_run, said, side, whose)
    return Where(
        subsystem, regime, windows.windows, share, interval, tuple(profiles), by_run, side, tuple(sentences), places,
        events,
    )  # fmt: skip


def _energy(problem: Problem, rows: Array) -> float:
    return float(np.sum(spacing(problem) * rows[: problem.inputs] ** 2))


def _profiles(problem: Problem, near: Fitted, seed: int) -> tuple[list[Profile], Explained, Explained | None]:
    """All profiles, the best first; the best explanation and the next best."""
    gap, free = near.residual[: problem.inputs], free_of(problem, near)
    shares = [explain(problem, gap, v, free, seed) for v in variables(problem, gap)]
    profiles = [profile_of(problem, gap, share, regime_of(problem, gap, share)) for share in shares]
    for wave in (wave_in_time(problem, gap, seed), wave_along_the_way(problem, gap, seed)):
        if wave is not None:
            shares, profiles = [*shares, wave[0]], [*profiles, wave[1]]
    best = best_of(shares)
    order = sorted(range(len(shares)), key=lambda k: (shares[k] is not best, -shares[k].share))
    rest = [shares[k] for k in order[1:]]
    return [profiles[k] for k in order], best, rest[0] if rest else None


def free_of(problem: Problem, near: Fitted) -> Free:
    """How far the base parameters may still go from a fit, within their tolerances."""
    low, high, std = bounds_of(near.free)
    z = near.z
    tolerance = np.array([not parameter.logarithmic for parameter in near.free for _ in parameter.lowest])
    reach = np.where(tolerance, TOLERANCES * std, np.inf)
    low, high = np.maximum(low, -reach) - z, np.minimum(high, reach) - z
    hold = problem.noise / np.sqrt(problem.share) / std
    return Free(-near.jacobian[: problem.inputs], np.minimum(low, 0.0), np.maximum(high, 0.0), hold)


def regime_of(problem: Problem, gap: Array, explained: Explained) -> str:
    """A variable's regime; of the speed: whether its part lies where the machine creeps."""
    if explained.variable.name != "speed":
        return explained.variable.regime
    slow = explained.variable.at < CREEPING * float(np.max(explained.variable.at))
    gone = spacing(problem) * (gap**2 - (gap - explained.part) ** 2)
    return "low_speed" if float(gone[slow].sum()) > 0.5 * float(gone.sum()) > 0.0 else "speed"


def _by_run(problem: Problem, gap: Array) -> dict[str, float]:
    energy = np.bincount(run_of(problem), spacing(problem) * gap**2, len(problem.runs))
    return {run.name: float(e / energy.sum()) for run, e in zip(problem.runs, energy, strict=True)}


def _sentences(
    problem: Problem, windows: Windows, best: Explained, other: Explained | None, by_run: Mapping[str, float],
    said: Sequence[str], side: str, whose: str,
) -> list[str]:  # fmt: skip
    many = len(windows.windows)
    sentences = [
        f"{100.0 * windows.held:.0f} % of {whose} lies in {many} window{'s' if many != 1 else ''} that "
        f"take{'s' if many == 1 else ''} {100.0 * windows.time:.0f} % of the time in motion.",
        f"The {best.variable.label} explains {_percent(best)} of the gap on runs it was not fitted to"
        + (f"; the {other.variable.label} {_percent(other)}." if other is not None else "."),
    ]
    name = max(by_run, key=lambda run: by_run[run])
    even = 1.0 / len(by_run)
    if len(by_run) > 1 and by_run[name] > 2.0 * even:
        sentences.append(f"Run {name} holds {100.0 * by_run[name]:.0f} % of it.")
    sentences += said
    if side == "carriage":
        sentences.append("The dead line's tension shows the gap too: it is on the carriage's side of the wire.")
    elif side == "drive":
        sentences.append("The dead line's tension does not show the gap: it is on the drive's side of the wire.")
    if best.share < EXPLAINS_LITTLE:
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


def _placed(most_likely: Placed) -> tuple[str, ...]:
    """Where it most likely lies, and what else it may be."""
    first, *rest = most_likely.places
    text = f"Most likely it lies in the {_part(first)}; what it depends on is {most_likely.port.over}."
    also = [_part(place) for place in rest if place.probability > WORTH_SAYING]
    return (text, f"It may lie in the {' or the '.join(also)}, too.") if also else (text,)


def _part(place: PlaceProbability) -> str:
    return f"{place.subsystem.replace('_', ' ')} ({100.0 * place.probability:.0f} %)"


def _percent(explained: Explained) -> str:
    low, high = explained.interval
    return f"{100.0 * explained.share:.0f} % ({100.0 * low:.0f} to {100.0 * high:.0f} %)"
