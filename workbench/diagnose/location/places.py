"""Where an unknown cause lies: each part of the machine with its probability."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array, diags_array
from scipy.spatial import KDTree
from scipy.special import log_ndtr, logsumexp

from workbench.core.run import Array
from workbench.diagnose.hypotheses import settings
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.problem import Problem, once, rms
from workbench.diagnose.location.ports import SENSOR, TURN, Port, Ports, lag
from workbench.diagnose.location.survey import Survey, at_rows, since_reversal, smooth_at, survey_of
from workbench.machines import kind_of
from workbench.simulate.model_error import SPREAD, ErrorModel


@dataclass(frozen=True)
class PlaceProbability:
    """How likely the cause lies in a part of the machine, 0 to 1."""

    subsystem: str
    probability: float


@dataclass(frozen=True)
class Event:
    """A brief stretch of one run, s on its own clock, that a force of one part of the machine accounts for.

    energy: its share of the gap's. largest: the force's largest value, as input, N m (N)."""

    run: str
    from_s: float
    to_s: float
    subsystem: str
    energy: float
    largest: float


SIZES = 8  # of s
SMALLEST = 0.3  # s, of the noise
LARGEST = 2.0  # s, of the residual at the nominal machine
DISCREPANCIES = tuple(2.0**k for k in range(11))  # g
FEWER = 30.0  # of the logarithm: where a step of g is worse by so much, no further one that way is tried


@dataclass(frozen=True)
class Evidence:
    """log: of the marginal likelihood. size, discrepancy: s, N m (N), and g where it is largest."""

    log: float
    size: float
    discrepancy: float


@dataclass(frozen=True, eq=False)
class _Whitened:
    """At one size g of the discrepancy: data and base whitened, and the likelihood of the base alone."""

    size: float
    y: Array
    base: Array
    factor: tuple[Array, bool]
    z: Array
    alone: float


def _with(errors: ErrorModel, size: float) -> ErrorModel:
    """Near standstill the discrepancy is as large beside the rest as the search has left it."""
    return errors.sized((size, errors.sizes[1]))


class Weigher:
    """Marginal likelihoods on one survey, for a force of unknown shape at one port.

        y = B z + s Φ w + e,   z, w ~ N(0, 1),   e ~ N(0, C(g))

    y is the residual at the nominal machine, B what base parameters and nuisances add (each by its tolerance), Φ the
    port's columns, scaled so that s is the rms of what they add. C(g) is noise and model error as every fit weighs
    them, g the campaign's own size of the model error with its log-normal prior. z and w are integrated out; g and s,
    evenly on a logarithmic scale, are averaged over. C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for
    Machine Learning, 2006, sections 2.1 and 5.2.
    """

    def __init__(self, survey: Survey) -> None:
        self.survey = survey
        gap, nominal = (rms(rows[: survey.inputs]) for rows in (survey.left, survey.residual))
        self.sizes = np.geomspace(SMALLEST * survey.noise, max(LARGEST * max(nominal, gap), survey.noise), SIZES)
        self.whitened: list[_Whitened] = []
        for g in DISCREPANCIES:
            self.whitened.append(self._at(g))
            # A port takes something away: it never needs more discrepancy than nothing does.
            if self.whitened[-1].alone < max(w.alone for w in self.whitened) - FEWER:
                break

    def _at(self, g: float) -> _Whitened:
        s = self.survey
        errors = _with(s.errors, g)
        white = errors.whiten(np.column_stack([s.base, s.residual]))
        base, y = white[:, :-1], white[:, -1]
        pull = base.T @ y
        factor = cho_factor(np.eye(len(pull)) + base.T @ base)
        z = cho_solve(factor, pull)
        log = -0.5 * (float(y @ y) - float(pull @ z)) - float(np.sum(np.log(np.diag(factor[0]))))
        log -= 0.5 * (errors.log_det() + sum((math.log(size) / SPREAD) ** 2 for size in errors.sizes))
        return _Whitened(g, y, base, factor, z, log)

    def nothing(self) -> float:
        """The logarithm of the marginal likelihood of the base parameters alone."""
        return float(logsumexp([w.alone for w in self.whitened]) - math.log(len(self.whitened)))

    def evidences(self, columns: Sequence[Array], positive: Sequence[bool]) -> list[Evidence]:
        """Of several ports, which are whitened together. columns: (samples, k) of each; positive: whether its amounts
        cannot be negative, all in all.

        From the largest discrepancy down: what a port explains shows as less discrepancy, step by step, so that one
        for which a step is for the worse is followed no further."""
        tables = np.full((len(columns), len(self.whitened), SIZES), -np.inf)
        active = list(range(len(columns)))
        for i in reversed(range(len(self.whitened))):
            w = self.whitened[i]
            ends = np.cumsum([columns[k].shape[1] for k in active])[:-1]
            together = np.hstack([columns[k] for k in active])
            parts = np.split(_with(self.survey.errors, w.size).whiten(together), ends, axis=1)
            for k, phi in zip(active, parts, strict=True):
                tables[k, i] = w.alone + self._gain(w, phi, positive[k])
            active = [k for k in active if np.max(tables[k, i]) > np.max(tables[k]) - FEWER]
            if not active:
                break
        return [self._summed(table) for table in tables]

    def _gain(self, w: _Whitened, phi: Array, positive: bool) -> Array:
        """(SIZES,) what whitened columns add to the logarithm of the likelihood."""
        cross = phi.T @ w.base
        inner = phi.T @ phi - cross @ cho_solve(w.factor, cross.T)
        q = phi.T @ w.y - cross @ w.z
        value, vector = np.linalg.eigh(inner)
        value, along = np.maximum(value, 0.0), vector.T @ q
        s2 = self.sizes[:, None] ** 2
        gain = np.sum(0.5 * s2 * along**2 / (1.0 + s2 * value) - 0.5 * np.log1p(s2 * value), axis=1)
        if positive:
            c, share = np.sum(vector, axis=0), 1.0 / (1.0 + s2 * value)
            mean, spread = self.sizes * np.sum(share * c * along, axis=1), np.sqrt(np.sum(share * c**2, axis=1))
            gain += math.log(2.0) + log_ndtr(mean / spread)
        return np.asarray(gain, dtype=float)

    def _summed(self, table: Array) -> Evidence:
        i, j = (int(k) for k in np.unravel_index(int(np.argmax(table)), table.shape))
        log = float(logsumexp(table) - math.log(table.size))
        return Evidence(log, float(self.sizes[j]), self.whitened[i].size)

    def part(self, columns: Array, at: Evidence) -> tuple[Array, Array]:
        """(samples,) the posterior mean of the port's contribution, and what is left beside it and the base
        parameters."""
        w = next(w for w in self.whitened if w.size == at.discrepancy)
        phi = at.size * _with(self.survey.errors, at.discrepancy).whiten(columns)
        a = np.hstack([w.base, phi])
        z, amounts = np.split(np.linalg.solve(a.T @ a + np.eye(a.shape[1]), a.T @ w.y), [w.base.shape[1]])
        part = at.size * (columns @ amounts)
        return part, self.survey.residual - self.survey.base @ z - part


NEIGHBOURS = 5  # nearest states
RECURS = 0.4  # of a stretch's energy
FINE = 0.03  # of the range of places: as near they are one
NEAREST = 1e-4  # of that range: a reversal's own place


def states_of(survey: Survey) -> list[Array]:
    """Sets of state variables, (inputs, k) each and scaled to the order of one, with which a force may come back.
    Speed with acceleration; the way since the last reversal; the place: each with the direction."""
    parts: list[list[Array]] = [[], [], []]
    fastest = max(float(np.max(np.abs(c.speed))) for c in survey.runs)
    hardest = max(float(np.max(np.abs(c.acceleration))) for c in survey.runs)
    span = max(float(np.max(c.position)) for c in survey.runs) - min(float(np.min(c.position)) for c in survey.runs)
    for c in survey.runs:
        speed, hard, gone, place = (
            np.interp(c.at, c.time, x) for x in (c.speed, c.acceleration, since_reversal(c), c.position)
        )
        ahead = np.sign(speed)
        parts[0].append(np.stack([ahead, speed / fastest, hard / max(hardest, 1e-300)], axis=1))
        parts[1].append(np.stack([ahead, np.log(gone / span + NEAREST), speed / fastest], axis=1))
        parts[2].append(np.stack([ahead, place / max(span, 1e-300) / FINE], axis=1))
    return [np.concatenate(values) for values in parts]


def comes_back(left: Array, mine: np.ndarray, states: list[Array]) -> bool:
    """Whether the residual in a stretch, `mine`, comes back in the same state of the machine: the mean over the nearest
    states outside removes RECURS of its energy."""
    inside, outside = np.flatnonzero(mine), np.flatnonzero(~mine)
    if not len(inside) or len(outside) <= NEIGHBOURS:
        return False
    energy = float(left[inside] @ left[inside])
    for state in states:
        _, nearest = KDTree(state[outside]).query(state[inside], NEIGHBOURS)
        rest = left[inside] - np.mean(left[outside][nearest], axis=1)
        if float(rest @ rest) < (1.0 - RECURS) * energy:
            return True
    return False


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
    """columns: (samples, k), of a force of free shape within the pulses; evidence: of that, at no particular place.
    choices: the cost of choosing run, moment and width of each."""

    pulses: tuple[Pulse, ...]
    columns: Array
    evidence: Evidence
    choices: float


def pulses_of(survey: Survey, weigher: Weigher) -> Pulses | None:
    """The pulses that explain most, as many as gain more than the cost of their choice; None without any.

    A part of the residual that comes back in the same state of the machine is no event."""
    left = robust_left(survey)
    times = [c.at for c in survey.runs]
    begins = np.cumsum([0, *map(len, times)])
    shortest = max(SHORTEST_S if survey.hoist else 0.05, 0.7 / survey.band_hz)
    longest = min(LONGEST_S, 0.2 * min(float(np.ptp(c.time)) for c in survey.runs))
    widths = np.geomspace(shortest, max(longest, 2.0 * shortest), WIDTHS)
    choices = math.log(sum(max(float(len(t)), 1.0) for t in times) * len(widths))
    states, open_to, shapes = states_of(survey), np.array(left), _shapes(survey, times, widths)
    pulses: list[Pulse] = []
    best: Pulses | None = None
    for _ in range(TRIED):
        pulse = _strongest(shapes, open_to, begins)
        if pulse is None or len(pulses) >= MOST:
            break
        mine = np.zeros(len(left), dtype=bool)
        j = pulse.run
        mine[begins[j] : begins[j + 1]] = (times[j] >= pulse.from_s) & (times[j] <= pulse.to_s)
        open_to[mine] = 0.0
        if comes_back(left, mine, states):
            continue
        pulses = _joined([*pulses, pulse])
        columns = _scaled(survey, at_rows(survey, _hats(survey, pulses)), 0.0)
        (evidence,) = weigher.evidences([columns], [False])
        price = choices * len(pulses)
        if best is not None and evidence.log - price <= best.evidence.log - best.choices:
            break
        best = Pulses(tuple(pulses), columns, evidence, price)
    return best


def event_gain(problem: Problem, fit: Fitted, least: float = -math.inf) -> float:
    """What brief events, whose choice is paid for, add to the logarithm of the likelihood of a fit of base parameters,
    alone and beside the likeliest law of one place, the less: an axis' own ripple, or a sensor that wanders, is no
    event, nor is what a wrong law leaves, nor are as many as are tried, alone and beside it: waves have them anywhere.
    By the model error near standstill, too, that stays beside them: for that a single one there has passed. least: of
    events that add no more than that alone, it is not asked what they add beside a law.
    """
    alone, few, *_ = _brief(problem, fit, beside_law=False)
    if alone <= least:
        return alone
    beside, few_beside, *_ = _brief(problem, fit, beside_law=True)
    return min(alone, beside) if few or few_beside else -math.inf


def event_threshold(problem: Problem) -> float:
    """What brief events add, in the logarithm, where they tell of a cause: on a machine whose whole residual counts
    twice DECISIVE; one that sets off with a full load has had 18, true ones 48 and more."""
    return settings.DECISIVE / (1.0 if kind_of(problem.machine).floor == "own" else settings.HALF)


def _brief(problem: Problem, fit: Fitted, beside_law: bool) -> tuple[float, bool, float, Survey]:
    """What brief events add, whether they are fewer than are tried, the logarithm of the likelihood with them, and the
    survey that they are sought in."""

    def found() -> tuple[float, bool, float, Survey]:
        survey = survey_of(problem, fit) if not beside_law else _brief(problem, fit, beside_law=False)[-1]
        if beside_law:
            port, law = max(surveyed(problem, fit)[2], key=lambda one: one[1].log)
            survey = replace(survey, base=np.hstack([survey.base, law.size * port.columns]))
        tried = [_pulses_by(survey)]
        weigher, pulses = tried[0]
        if pulses is not None:
            (size, near), left = survey.errors.sizes, weigher.part(pulses.columns, pulses.evidence)[1]
            if (stays := survey.errors.likeliest(left)[1][1]) < near:
                tried.append(_pulses_by(replace(survey, errors=survey.errors.sized((size, stays)))))
        told = [pulses for _, pulses in tried if pulses is not None]
        most = max((pulses.evidence.log - pulses.choices for pulses in told), default=-math.inf)
        gain = most - max(weigher.nothing() for weigher, _ in tried)
        return gain, any(len(pulses.pulses) < MOST for pulses in told), most, survey

    return once(problem, (fit, "brief", beside_law, problem.errors.sizes), found)


def _pulses_by(survey: Survey) -> tuple[Weigher, Pulses | None]:
    weigher = Weigher(survey)
    return weigher, pulses_of(survey, weigher)


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


@dataclass(frozen=True)
class _Shape:
    """Pulses of one run and width, of a force or of the speed that is shown. rows: (k, n) sparse, one at each of the
    moments `middle`; energy: (k,) the sum of the squares of each."""

    run: int
    middle: Array
    half: float
    rows: csr_array
    energy: Array


def _shapes(survey: Survey, times: list[Array], widths: Array) -> list[_Shape]:
    found = []
    for j, t in enumerate(times):
        if len(t) < 4:
            continue
        rate = np.interp(t, survey.runs[j].time, survey.runs[j].turn_rate)
        before, after = np.diff(t)[:-1], np.diff(t)[1:]  # the gradient on unequal steps, as numpy.gradient has it
        ends = [1.0 / (t[1] - t[0]), 1.0 / (t[-1] - t[-2])]
        below = np.append(-after / (before * (before + after)), -ends[1])
        above = np.append(ends[0], before / (after * (before + after)))
        middles = np.concatenate([[-ends[0]], (after - before) / (before * after), [ends[1]]])
        gradient = diags_array([below, middles, above], offsets=[-1, 0, 1]).tocsr()
        for width in widths:
            middle = np.arange(t[0], t[-1], STEP * width)
            first, last = np.searchsorted(t, middle - 0.5 * width), np.searchsorted(t, middle + 0.5 * width)
            rows = np.concatenate([np.arange(*span) for span in zip(first, last, strict=True)]).astype(int)
            which = np.repeat(np.arange(len(middle)), last - first)
            values = np.cos(math.pi * (t[rows] - middle[which]) / width) ** 2
            bump = csr_array((values, (rows, which)), shape=(len(t), len(middle)))
            for columns in (bump, csr_array(gradient @ bump.multiply(rate[:, None]))):
                energy = np.maximum(np.asarray(columns.power(2).sum(axis=0)).ravel(), 1e-12)
                found.append(_Shape(j, middle, (0.5 + BESIDE) * float(width), csr_array(columns.T), energy))
    return found


def _strongest(shapes: list[_Shape], left: Array, begins: Array) -> Pulse | None:
    """The smooth pulse, of a force or of the speed that is shown, that takes most of the squares."""
    best, most = None, 0.0
    for shape in shapes:
        gain = (shape.rows @ left[begins[shape.run] : begins[shape.run + 1]]) ** 2 / shape.energy
        k = int(np.argmax(gain))
        if gain[k] > most:
            most, middle = float(gain[k]), float(shape.middle[k])
            best = Pulse(shape.run, middle - shape.half, middle + shape.half)
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


def _scaled(survey: Survey, rows: Array, pull: float, sensed: bool = False) -> Array:
    return survey.shown(rows / math.sqrt(max(float(np.mean(np.sum(rows**2, axis=1))), 1e-300)), pull, sensed)


def event_ports(survey: Survey, pulses: Pulses) -> Iterator[Port]:
    """A force of free shape within the pulses, at each part: friction turns over with the way, and only brakes."""
    shapes = _hats(survey, pulses.pulses)

    def rows(of: str) -> Array:
        carried = ({"way": c.way[:, None], "mass": np.array(c.mass), "free": np.ones(1)}[of] for c in survey.runs)
        return at_rows(survey, [x * carrier for carrier, x in zip(carried, shapes, strict=True)])

    def port(subsystem: str, of: str, pull: float, weight: float, positive: bool = False) -> Port:
        columns = _scaled(survey, rows(of), pull, subsystem == SENSOR)
        return Port(subsystem, "event", "its moment", columns, weight, positive)

    # A speed that is shown wrong for a while: its change, times the inertia, is a force that adds up to nothing.
    slipped = [-np.diff(x.reshape(len(x), -1, HATS)).reshape(len(x), -1) for x in shapes]
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


ORDERS = range(1, 9)  # of the polynomial that the input would be around an event without it


def evidence_of_motion(survey: Survey, weigher: Weigher, pulses: Pulses) -> dict[str, float]:
    """By how much likelier the motion is, in the logarithm, where a force acts within the pulses ("force") and where
    the motion's own sensor fails, than where it goes on as if nothing were.

    A force F moves the machine before the drive answers it: of the input that the measured motion takes, a smooth curve
    and friction otherwise, it makes -S F, S = s² / (s + w)² the sensitivity of a loop that holds what lasts, of unknown
    quickness w. A motion that is shown wrong has all of it (S = 1), an error of the input's sensor moves nothing
    (S = 0). F: what a force of free shape takes there. The curve: a polynomial of each order by its evidence (G.
    Schwarz, Annals of Statistics 6, 1978).
    """
    part, begins = weigher.part(pulses.columns, pulses.evidence)[0], np.cumsum([0, *(len(c.at) for c in survey.runs)])
    logs = np.zeros(2 + SIZES)
    for pulse in pulses.pulses:
        c, width, middle = survey.runs[pulse.run], pulse.to_s - pulse.from_s, 0.5 * (pulse.from_s + pulse.to_s)
        mine, near = np.abs(c.at - middle) <= 0.5 * width, np.abs(c.at - middle) <= width
        count = 2.0 * survey.band_hz * float(np.ptp(c.at[near]))  # of independent values
        force = np.interp(c.time, c.at, np.where(mine, part[begins[pulse.run] : begins[pulse.run + 1]], 0.0))
        quick = TURN * np.geomspace(0.5 / width, survey.band_hz, SIZES)
        made = np.stack([0.0 * force, -force, *(lag(force, c, float(w), 1.0) for w in quick)], axis=1)
        takes, way = np.split(
            smooth_at(c, np.column_stack([c.torque[:, None] - made, c.way]), survey.band_hz)[near], [-1], 1
        )
        by_order = [np.zeros(len(logs))] if count <= 4.0 else []
        for k in (k for k in ORDERS if 2.0 * (k + 1.0) < count):
            curve = np.hstack([legvander((c.at[near] - middle) / width, k), way])
            rest = takes - curve @ np.linalg.lstsq(curve, takes, rcond=None)[0]
            by_order.append(-0.5 * (count * np.log(np.mean(rest**2, axis=0)) + (k + 1) * math.log(count)))
        logs += logsumexp(by_order, axis=0)
    force_log = float(logsumexp(logs[2:])) - math.log(SIZES)
    return {"force": force_log - logs[0], "speed_sensor": float(logs[1] - logs[0]), SENSOR: 0.0}


SHOWN = 0.005  # probability
TOGETHER = 100  # columns that are whitened at once: as many as a cache holds


@dataclass(frozen=True)
class Placed:
    """The probabilities of all places, the largest first. port: the best one; part: (inputs,) its contribution, N m
    (N); left: (inputs,) the residual beside it, the base parameters refitted. pulses: the brief events, if the cause
    is one."""

    places: tuple[PlaceProbability, ...]
    port: Port
    part: Array
    left: Array
    gain: float
    pulses: tuple[Pulse, ...] = ()


def placed(
    problem: Problem, fit: Fitted, own: int | None = None, holds: Callable[[Array], bool] | None = None
) -> Placed:
    """The places where the residual of `fit`, the base parameters alone, may enter, with the best port and its part of
    the gap; probabilities sum to one. own: see `survey_of`; holds: see `weighed`.

    Of a machine that leaves laws of its own the place is that of brief events where no law foretells the residual on
    other runs, and the events tell of a cause (`event_threshold`), alone and beside the likeliest law: beside it, if
    both are likelier together."""
    least, alone = event_threshold(problem), holds is None and own is None and kind_of(problem.machine).floor == "own"
    if alone and event_gain(problem, fit, least) > least:
        ways = [_brief(problem, fit, beside_law) for beside_law in (False, True)]
        return weighed(max(ways, key=lambda way: way[2])[-1], ports=[])
    survey, weigher, ports = surveyed(problem, fit, own)
    return weighed(survey, holds, weigher, ports)


Ported = list[tuple[Port, Evidence]]
KEPT = "ports"  # under which a problem keeps the last ones weighed: their columns take much memory


def surveyed(problem: Problem, fit: Fitted, own: int | None = None) -> tuple[Survey, Weigher, Ported]:
    """The survey of a fit and its ports with their evidence: several steps ask for the same, one after the other."""
    asked = fit, None if own == len(fit.z) else own, problem.errors.sizes
    if KEPT not in problem.kept or problem.kept[KEPT][0] != asked:
        survey = survey_of(problem, fit, own)
        weigher = Weigher(survey)
        problem.kept[KEPT] = asked, (survey, weigher, list(evidence_of(weigher, Ports(survey).all())))
    found: tuple[Survey, Weigher, Ported] = problem.kept[KEPT][1]
    return found


def weighed(
    survey: Survey,
    holds: Callable[[Array], bool] | None = None,
    weigher: Weigher | None = None,
    ports: Ported | None = None,
) -> Placed:
    """The probabilities of all ports on a survey. holds: whether a port that leaves this, (inputs,), may be the place;
    only such are compared, where there is one: by an error model that is not the machine's a port may win with what
    lies beside the cause. weigher, ports: where they are known."""
    weigher = weigher or Weigher(survey)
    pulses = pulses_of(survey, weigher)
    every = ports if ports is not None else evidence_of(weigher, Ports(survey).all())
    weighed = [(evidence.log + float(np.log(port.weight)), port, evidence) for port, evidence in every]
    if pulses is not None:
        brief, moved = (
            list(evidence_of(weigher, event_ports(survey, pulses))),
            evidence_of_motion(survey, weigher, pulses),
        )
        logs_alone = np.array([evidence.log + np.log(port.weight) for port, evidence in brief])
        logs_moved = logs_alone + [moved.get(port.subsystem, moved["force"]) for port, _ in brief]
        # The motion tells events apart; that there is one, it does not say.
        logs_moved += logsumexp(logs_alone) - logsumexp(logs_moved) - pulses.choices
        weighed += [(float(log), *one) for log, one in zip(logs_moved, brief, strict=True)]
    weighed.sort(key=lambda one: -one[0])
    able: list[tuple[float, Port, Evidence]] = []
    for one in weighed if holds is not None else ():
        if able and one[0] < able[0][0] - FEWER:
            break
        if holds is not None and holds(weigher.part(one[1].columns, one[2])[1][: survey.inputs]):
            able.append(one)
    logs: dict[str, list[float]] = {}
    for log, port, _ in able or weighed:
        logs.setdefault(port.subsystem, []).append(log)
    score = {name: float(logsumexp(terms)) for name, terms in logs.items()}
    total = logsumexp(list(score.values()))
    order = sorted(score, key=lambda name: -score[name])
    _, port, evidence = next(one for one in able or weighed if one[1].subsystem == order[0])
    places = [PlaceProbability(name, float(np.exp(score[name] - total))) for name in order]
    kept = [place for place in places if place.probability > SHOWN]
    share = sum(place.probability for place in kept)
    part, left = weigher.part(port.columns, evidence)
    return Placed(
        places=tuple(PlaceProbability(place.subsystem, place.probability / share) for place in kept),
        port=port,
        part=part[: survey.inputs],
        left=left[: survey.inputs],
        gain=evidence.log - weigher.nothing(),
        pulses=pulses.pulses if pulses is not None and port.regime == "event" else (),
    )


def evidence_of(weigher: Weigher, ports: Iterable[Port]) -> Iterator[tuple[Port, Evidence]]:
    """Each port with its evidence; some of them are whitened together, which is quicker."""
    every = list(ports)
    batch = np.cumsum([port.columns.shape[1] for port in every]) // TOGETHER
    for k in np.unique(batch):
        mine = [port for port, its in zip(every, batch, strict=True) if its == k]
        yield from zip(mine, weigher.evidences([p.columns for p in mine], [p.positive for p in mine]), strict=True)
