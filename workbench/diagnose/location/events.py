"""Brief events: short stretches of one or a few runs in which a force acts that does so nowhere else.

Greedy search: pulses of all moments and widths are matched with what the base parameters, fitted robustly so that
an event does not bend them, leave unexplained. Whether they are events and not a force over some variable, the
marginal likelihood decides: each pulse pays for the choice of its run, moment and width.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.location.evidence import Evidence, Weigher
from workbench.diagnose.location.ports import SENSOR, Port
from workbench.diagnose.location.recurrence import comes_back, states_of
from workbench.diagnose.location.survey import Course, Survey, at_rows

SHORTEST_S, LONGEST_S, WIDTHS = 0.3, 5.0, 7  # of a pulse, from beginning to end
MOST, TRIED = 4, 16  # pulses
STEP = 0.125  # of a pulse's width: from one tried to the next
HUBER = 1.5  # of the robust scale
ROUNDS = 12  # of the robust fit
HATS = 5  # in a pulse's window: its shape is free
BESIDE = 0.25  # of its width, on either side


@dataclass(frozen=True)
class Pulse:
    """A stretch of one run, s on its own clock."""

    run: int
    from_s: float
    to_s: float


@dataclass(frozen=True)
class Pulses:
    """evidence: of the pulses, at no particular place. choices: the cost of choosing run, moment and width of each."""

    pulses: tuple[Pulse, ...]
    evidence: Evidence
    choices: float


def pulses_of(survey: Survey, weigher: Weigher) -> Pulses | None:
    """The pulses that explain most, as many as gain more than the cost of their choice; None without any.

    A part of the residual that comes back in the same state of the machine is no event."""
    left = robust_left(survey)
    times = [c.at for c in survey.runs]
    begins = np.cumsum([0, *map(len, times)])
    widths = widths_of(survey)
    choices = math.log(sum(max(float(len(t)), 1.0) for t in times) * len(widths))
    states, open_to = states_of(survey), np.array(left)
    pulses: list[Pulse] = []
    best: Pulses | None = None
    for _ in range(TRIED):
        pulse = _strongest(survey, open_to, times, begins, widths)
        if pulse is None or len(pulses) >= MOST:
            break
        mine = np.zeros(len(left), dtype=bool)
        j = pulse.run
        mine[begins[j] : begins[j + 1]] = (times[j] >= pulse.from_s) & (times[j] <= pulse.to_s)
        open_to[mine] = 0.0
        if comes_back(left, mine, states):
            continue
        pulses = _joined([*pulses, pulse])
        evidence = weigher.evidence(torque_columns(survey, pulses))
        price = choices * len(pulses)
        if best is not None and evidence.log - price <= best.evidence.log - best.choices:
            break
        best = Pulses(tuple(pulses), evidence, price)
    return best


def widths_of(survey: Survey) -> Array:
    shortest = max(SHORTEST_S if survey.hoist else 0.05, 0.7 / survey.band_hz)
    longest = min(LONGEST_S, 0.2 * min(float(np.ptp(c.time)) for c in survey.runs))
    return np.geomspace(shortest, max(longest, 2.0 * shortest), WIDTHS)


def robust_left(survey: Survey) -> Array:
    """(inputs,) the residual with the base parameters fitted so that single stretches do not bend them. P. J. Huber,
    Robust Statistics, 1981, 7.3: weights fall with the residual beyond HUBER scales."""
    y, base = survey.residual[: survey.inputs], survey.base[: survey.inputs]
    spread = survey.errors.white[: survey.inputs] / survey.noise  # of a row as if it stood for one independent value
    weights, left = np.ones(len(y)), y
    hold = np.eye(base.shape[1])
    for _ in range(ROUNDS):
        scale = max(1.4826 * float(np.median(np.abs(left))), survey.noise)
        weights = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(left), 1e-300))
        a = base / (spread * scale)[:, None]
        gram = a.T @ (a * weights[:, None]) + hold
        z = np.linalg.solve(gram, a.T @ (weights * y / (spread * scale)))
        left = y - base @ z
    return np.asarray(left, dtype=float)


def _strongest(survey: Survey, left: Array, times: list[Array], begins: Array, widths: Array) -> Pulse | None:
    """The smooth pulse, of a force or of the speed that is shown, that takes most of the squares."""
    best, most = None, 0.0
    for j, t in enumerate(times):
        mine = left[begins[j] : begins[j + 1]]
        if len(t) < 4:
            continue
        rate = np.interp(t, survey.runs[j].time, survey.runs[j].turn_rate)
        for width in widths:
            middle = np.arange(t[0], t[-1], STEP * width)
            away = (t[:, None] - middle) / width
            bump = np.where(np.abs(away) < 0.5, np.cos(math.pi * away) ** 2, 0.0)
            for shape in (bump, np.gradient(bump * rate[:, None], t, axis=0)):
                gain = (shape.T @ mine) ** 2 / np.maximum(np.sum(shape**2, axis=0), 1e-12)
                k = int(np.argmax(gain))
                if gain[k] > most:
                    most, half = float(gain[k]), (0.5 + BESIDE) * width
                    best = Pulse(j, float(middle[k] - half), float(middle[k] + half))
    return best


def _joined(pulses: list[Pulse]) -> list[Pulse]:
    """The pulses with overlapping ones merged."""
    joined: list[Pulse] = []
    for pulse in sorted(pulses, key=lambda p: (p.run, p.from_s)):
        if joined and joined[-1].run == pulse.run and pulse.from_s <= joined[-1].to_s:
            joined[-1] = Pulse(pulse.run, joined[-1].from_s, max(joined[-1].to_s, pulse.to_s))
        else:
            joined.append(pulse)
    return joined


def _hats(survey: Survey, pulses: list[Pulse] | tuple[Pulse, ...]) -> list[Array]:
    """Of each run (n, k): hats in each window, zero at its ends."""
    out = []
    for j, c in enumerate(survey.runs):
        parts = []
        for pulse in pulses:
            knots = np.linspace(pulse.from_s, pulse.to_s, HATS + 2)
            x = (c.time[:, None] - knots[1:-1]) / (knots[1] - knots[0])
            parts.append(np.maximum(1.0 - np.abs(x), 0.0) * float(pulse.run == j))
        out.append(np.hstack(parts))
    return out


def torque_columns(survey: Survey, pulses: list[Pulse] | tuple[Pulse, ...]) -> Array:
    return _scaled(survey, at_rows(survey, _hats(survey, pulses)), 0.0)


def _scaled(survey: Survey, rows: Array, pull: float, sensed: bool = False) -> Array:
    return survey.shown(rows / math.sqrt(max(float(np.mean(np.sum(rows**2, axis=1))), 1e-300)), pull, sensed)


def event_ports(survey: Survey, pulses: Pulses) -> Iterator[Port]:
    """A force of free shape within the pulses, at each part: friction turns over with the way, and only brakes."""
    shapes = _hats(survey, pulses.pulses)

    def rows(of: str) -> Array:
        return at_rows(survey, [x * _carrier(c, of)[:, None] for c, x in zip(survey.runs, shapes, strict=True)])

    def port(subsystem: str, of: str, pull: float, weight: float, positive: bool = False) -> Port:
        columns = _scaled(survey, rows(of), pull, subsystem == SENSOR)
        return Port(subsystem, "event", "its moment", columns, weight, positive)

    slipped = [np.gradient(x * c.turn_rate[:, None], c.time, axis=0) for c, x in zip(survey.runs, shapes, strict=True)]
    slip = Port("speed_sensor", "event", "its moment", _scaled(survey, at_rows(survey, slipped), 0.0), 1.0)
    if not survey.hoist:
        yield port("axis", "free", 0.0, 0.5)
        yield port("axis", "way", 0.0, 0.5, True)
        yield port(SENSOR, "free", 0.0, 1.0)
        yield slip
        return
    yield port("guide", "way", 1.0, 1.0, True)
    yield port("brake", "way", 0.0, 0.6, True)
    yield port("sheave", "way", -1.0, 0.3, True)
    yield port("motor", "free", 0.0, 0.6)
    yield port("drum", "free", 0.0, 0.4)
    yield port(SENSOR, "free", 0.0, 0.6)
    yield port("payload", "free", 1.0, 0.7)
    yield port("platform", "mass", 1.0, 0.7)
    yield slip


def _carrier(c: Course, of: str) -> Array:
    if of == "way":
        return c.way
    return np.full(len(c.time), c.mass) if of == "mass" else np.ones(len(c.time))
