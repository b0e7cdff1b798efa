"""Cycle after cycle: the baseline, events that are not the machine, and alarms, each with its likeliest cause.

The baseline is learned from the first cycles that count, and anew as they grow in number while nothing alarms. A cycle
does not count that begins within the warm-up after a pause: friction is higher then, and falls by itself. A stated
payload that the baseline has not seen makes the load a free quantity: its direction is left out of the test while that
payload is carried.

After an alarm the state that explains it is the baseline. With the whitened deviations z of the cycles since its onset,
their regressors x = (1, cycle, payload) and the prior precision P of drift and payload effect, the last n cycles are
expected at

    z* = x̄ᵀ A⁻¹ Σ x zᵀ,    A = Σ x xᵀ + P,    variance v = 1/n + x̄ᵀ A⁻¹ x̄,

so that a drift goes on being estimated. A change along the directions D of what has alarmed is the same change; the
test takes what is left of δ = z̄ − z* beside them, e, with the covariance v S + Σ (a θ)² I: S the scatter since the
onset, a the part of δ along each D, θ the angle by which that D may be wrong (its standard error over its length, and
NONLINEAR). A. Gelman et al., Bayesian Data Analysis, 3rd ed. 2013, section 14.8; M. Basseville, I. V. Nikiforov 1993,
section 7.2, on nuisance directions. A change that is not there any more after STAYS cycles was none.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from workbench.core.names import words_of
from workbench.core.run import Array
from workbench.watch.estimate import GROWTH, HEALTHY, LENGTHS, Baseline, Estimate, Number, learn, threshold

LOAD = "carriage.mass_kg"
SAME_PAYLOAD, SAME_PAYLOAD_KG = 0.02, 10.0  # relative, at least: stated payloads that are one
SINGLE = 1.5  # times the threshold: one cycle alone that far off is an event
GROWN = 1.5  # times as large as when it was last told: a change is told again
CYCLE_UNIT, PAYLOAD_UNIT_KG = 100.0, 10_000.0  # of the regressors
DRIFT, PAYLOAD_EFFECT = 100.0, 3.0  # prior standard deviations, in those units and in σ of a cycle
SCATTER = 20.0  # cycles: the weight of the healthy scatter beside that since a change
NONLINEAR = 0.05  # rad: by which a change may turn as it grows
STAYS, GONE = 20, 6.0  # after so many cycles a change is to be there still, with so much log likelihood ratio
AWAY = 1.0, 0.25  # σ of a cycle, and share of its drift so far: by which a known change may leave its line
RARER = 2.3  # log of the odds of friction both ways against friction of one way alone
LEAST_TREND, CLEAR = 5, 2.0  # cycles that a trend takes; standard errors that a slope must be away from zero


@dataclass(frozen=True)
class Rules:
    """What the user chooses. cycles_between: false alarms, on average. pause_s, warm_up_s: a standstill so long lets
    the machine cool; so long after it a cycle does not count. limits: key -> value that it must not reach."""

    cycles_between: float = 1000.0
    healthy: int = HEALTHY
    pause_s: float = 3600.0
    warm_up_s: float = 0.0
    limits: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Cycle:
    """One cycle. start_s: on the campaign's clock. digest, file, start_position_m, notes: of its log; the judge needs
    none of them."""

    name: str
    payload_kg: Number
    start_s: Number
    duration_s: Number
    estimate: Estimate
    digest: str = ""
    file: str = ""
    start_position_m: Number = 0.0
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Event:
    """Something that is not the machine, or a note. kind: baseline, payload, warm_up, clock, single."""

    cycle: int
    kind: str
    text: str


@dataclass(frozen=True)
class Cause:
    """A direction of change. name: in words; keys: what changes, each by its weight; amount: of the first key, in its
    unit."""

    name: str
    keys: tuple[str, ...]
    amount: float
    share: float
    weights: tuple[float, ...] = ()


@dataclass(frozen=True)
class Alarm:
    """cycle: when it was raised; onset: the likeliest first cycle; causes: the likeliest first, with the share of the
    change that each explains. again: the change of the alarm before it, grown."""

    cycle: int
    onset: int
    causes: tuple[Cause, ...]
    statistic: float
    again: bool = False


@dataclass
class Judged:
    """What one cycle brought."""

    statistic: float = 0.0
    counted: bool = False
    events: list[Event] = field(default_factory=list)
    alarm: Alarm | None = None

    @property
    def again(self) -> bool:
        return self.alarm is not None and self.alarm.again


@dataclass(frozen=True)
class Trend:
    """A straight line through the amounts since a change. rate: per cycle. left: cycles until the limit at that rate,
    with its 95 % interval; None where there is no limit ahead, or the rate is not clear."""

    now: float
    rate: float
    left: float | None
    left_ci95: tuple[float, float] | None


@dataclass(frozen=True)
class State:
    """What the machine is since `onset`. base: (2 r,) the expectation when the last change began, None where there was
    none; known: (r, q) directions of the changes before it, of length 1; angles: (q,) by which each may be wrong. told:
    the size of the last change when it was last told. raised: when; before: the state that it replaced."""

    onset: int = -1
    base: Array | None = None
    known: Array | None = None
    angles: tuple[float, ...] = ()
    told: float = 0.0
    raised: int = -1
    before: State | None = None


@dataclass(frozen=True)
class Look:
    """A window of the last n cycles. delta: (2 r,) from what was expected, with the variance of that in units of a
    cycle's; directions: (r, q) those known, with their angles; expected: (2 r,);
    drift: by how much the state has drifted since its onset."""

    n: int
    statistic: float
    delta: Array
    variance: float
    expected: Array
    directions: Array
    angles: tuple[float, ...]
    drift: float


class Track:
    """Cycles of known payloads, or of new ones: their deviations (2 r,), whitened with the payload's scatter evened out
    and as they are, and sums of products of them and their regressors."""

    def __init__(self, count: int, rank: int, free: Array | None) -> None:
        """count: cycles of the baseline; free: (r,) a direction that is left out of the test."""
        self.count, self.rank = count, rank
        self.free = np.zeros((rank, 0)) if free is None else free[:, None]
        self.cycles: list[int] = []
        self._xx, self._xz, self._zz = [np.zeros((3, 3))], [np.zeros((3, 2 * rank))], [np.zeros((rank, rank))]

    def add(self, cycle: int, payload_kg: float, z: Array) -> None:
        x = np.array([1.0, cycle / CYCLE_UNIT, payload_kg / PAYLOAD_UNIT_KG])
        self.cycles.append(cycle)
        self._xx.append(self._xx[-1] + np.outer(x, x))
        self._xz.append(self._xz[-1] + np.outer(x, z))
        self._zz.append(self._zz[-1] + np.outer(z[: self.rank], z[: self.rank]))

    def drop(self) -> None:
        """The last cycle is none of the machine's."""
        for kept in (self.cycles, self._xx, self._xz, self._zz):
            kept.pop()

    def mean(self, n: int) -> tuple[Array, Array]:
        """(3,) regressors and (2 r,) deviations, means of the last n cycles."""
        begin = len(self.cycles) - n
        return (self._xx[-1] - self._xx[begin])[0] / n, (self._xz[-1] - self._xz[begin])[0] / n

    def expected(self, state: State, before: int, x: Array) -> tuple[Array, float, Array] | None:
        """(2 r,) at these regressors by the cycles of a state before that one, the variance of that, and (r, r) the
        scatter of a cycle, in units of the baseline's; None where there is none."""
        if state.base is None:
            return np.zeros(2 * self.rank), 1.0 / self.count, np.eye(self.rank)
        first = bisect_left(self.cycles, state.onset)
        if before <= first:
            return None
        xx, xz = self._xx[before] - self._xx[first], self._xz[before] - self._xz[first]
        inverse = np.linalg.inv(xx + np.diag([1e-9, DRIFT**-2, PAYLOAD_EFFECT**-2]))
        line = inverse @ xz
        own, products = line[:, : self.rank], xz[:, : self.rank].T @ line[:, : self.rank]
        left = self._zz[before] - self._zz[first] - products - products.T + own.T @ xx @ own
        scatter = (SCATTER * np.eye(self.rank) + left) / (SCATTER + before - first)
        return np.asarray(x @ line), float(x @ inverse @ x), np.asarray(scatter)

    def directions(self, state: State, expected: Array, variance: float) -> tuple[Array, tuple[float, ...]]:
        """(r, q) of length 1, and angles: those left out, those of earlier changes, and the last one's by now."""
        if state.base is None or state.known is None:
            return self.free, (0.0,) * self.free.shape[1]
        last = (expected - state.base)[: self.rank]
        size = max(float(np.linalg.norm(last)), 1e-300)
        angle = math.hypot(math.sqrt(variance) / size, NONLINEAR)
        columns = np.column_stack([self.free, state.known, last / size])
        return columns, (*(0.0,) * self.free.shape[1], *state.angles, angle)

    def look(self, state: State) -> Look | None:
        """The window that shows most of a new change. After a change it is no longer than what came before it."""
        best, end = None, len(self.cycles)
        first = bisect_left(self.cycles, state.onset)
        for n in LENGTHS:
            begin = end - n
            if begin < 0 or (state.base is not None and n > begin - first):
                break
            x, z = self.mean(n)
            before = self.expected(state, begin, x)
            if before is None:
                break
            expected, variance, scatter = before
            known, angles = self.directions(state, expected, variance)
            delta = z - expected
            g = statistic(delta[: self.rank], known, angles, 1.0 / n + variance, scatter)
            if best is None or g > best.statistic:
                drift = self.drift(state, begin, x)
                best = Look(n, g, delta, 1.0 / n + variance, expected, known, angles, drift)
        return best

    def drift(self, state: State, before: int, x: Array) -> float:
        """σ of a cycle: from a state's onset to these regressors, by its line."""
        begun = np.array([x[0], state.onset / CYCLE_UNIT, x[2]])
        ends = [self.expected(state, before, at) for at in (begun, x)]
        return float(np.linalg.norm((ends[1][0] - ends[0][0])[: self.rank])) if ends[0] and ends[1] else 0.0

    def last_change(self, state: State) -> tuple[Array, float] | None:
        """(2 r,) the last change as it is by now, and its variance; None: unknown."""
        if state.base is None or not self.cycles:
            return None
        x = np.array([1.0, self.cycles[-1] / CYCLE_UNIT, self._xx[-1][0, 2] / len(self.cycles)])
        now = self.expected(state, len(self.cycles), x)
        return None if now is None else (now[0] - state.base, now[1])

    def has_gone(self, state: State) -> bool:
        """Whether the cycles since the alarm are those of the state before it: what alarmed did not stay."""
        first = bisect_left(self.cycles, state.onset)
        if state.before is None or len(self.cycles) - bisect_right(self.cycles, state.raised) != STAYS:
            return False
        x, z = self.mean(STAYS)
        before = self.expected(state.before, first, x)
        if before is None:
            return False
        known, angles = self.directions(state.before, before[0], before[1])
        return statistic((z - before[0])[: self.rank], known, angles, 1.0 / STAYS + before[1], before[2]) < GONE


def statistic(delta: Array, known: Array, angles: Sequence[float], variance: float, scatter: Array) -> float:
    """The log likelihood ratio of a change (r,) beside the known directions (r, q)."""
    q = known.shape[1]
    if q == 0:
        y, covariance = delta, variance * scatter
    else:
        left_out = np.linalg.qr(known, mode="complete")[0][:, q:]
        part = np.linalg.lstsq(known, delta, rcond=1e-6)[0]
        leak = float(np.sum((part * np.array(angles)) ** 2))
        y = left_out.T @ delta
        covariance = variance * left_out.T @ scatter @ left_out + leak * np.eye(len(y))
    return 0.5 * float(y @ np.linalg.solve(covariance, y)) if len(y) else 0.0


class Judge:
    """Deterministic: the same cycles in the same order give the same alarms, so it is built anew after a restart."""

    def __init__(self, rules: Rules) -> None:
        self.rules = rules
        self.cycles: list[Cycle] = []
        self.results: list[Judged] = []  # of each cycle
        self.counted: list[int] = []
        self.baseline: Baseline | None = None
        self.alarms: list[Alarm] = []
        self.state = State()
        self.limit: float | None = None  # what the statistic must not exceed
        self._tracks: dict[bool, Track] = {}
        self._warm_from: float | None = None
        self._payloads: list[float] = []
        self._typical: Array = np.zeros(0)
        self._resolution: Array = np.zeros(0)
        self._wild: tuple[int, float, Array] | None = None

    def add(self, cycle: Cycle) -> Judged:
        """Takes the next cycle."""
        k = len(self.cycles)
        before = self.cycles[-1] if self.cycles else None
        self.cycles.append(cycle)
        judged = Judged()
        self.results.append(judged)
        if not self._cold(k, cycle, before, judged):
            judged.counted = True
            self.counted.append(k)
            if self.baseline is not None:
                self._test(k, cycle, before, judged)
            if not self.alarms and len(self.counted) in [self.rules.healthy * times for times in GROWTH]:
                self._learn(k, cycle, judged)
        return judged

    def _cold(self, k: int, cycle: Cycle, before: Cycle | None, judged: Judged) -> bool:
        if before is not None and cycle.start_s < before.start_s:
            text = f"begins {before.start_s - cycle.start_s:g} s before the cycle that came before it"
            judged.events.append(Event(k, "clock", text))
        rest = None if before is None else cycle.start_s - before.start_s - before.duration_s
        if self.rules.warm_up_s <= 0.0:
            return False
        if rest is None or rest >= self.rules.pause_s:
            self._warm_from = cycle.start_s
            since = "at the start" if rest is None else f"after {rest / 3600.0:.1f} h of rest"
            judged.events.append(Event(k, "warm_up", f"warm-up {since}: cycles do not count for a while"))
        return self._warm_from is not None and 0.0 <= cycle.start_s - self._warm_from < self.rules.warm_up_s

    def _learn(self, k: int, cycle: Cycle, judged: Judged) -> None:
        chosen = [self.cycles[i] for i in self.counted]
        self._typical = np.sqrt(np.mean([c.estimate.errors**2 for c in chosen], axis=0))
        self._resolution = np.mean([c.estimate.resolution for c in chosen], axis=0)
        keys = cycle.estimate.keys
        load = self._resolution[:, keys.index(LOAD)] if LOAD in keys else None
        payloads = np.array([c.payload_kg for c in chosen])
        self.baseline = learn(np.array([c.estimate.values for c in chosen]), payloads, load, keys)
        self._tracks = {}
        for counted in chosen:
            if not self._known(counted.payload_kg):
                self._payloads.append(counted.payload_kg)
        judged.events.append(Event(k, "baseline", f"the baseline is learned from {len(chosen)} cycles"))

    def _known(self, payload_kg: float) -> bool:
        return any(abs(payload_kg - old_kg) <= max(SAME_PAYLOAD_KG, SAME_PAYLOAD * old_kg) for old_kg in self._payloads)

    def _test(self, k: int, cycle: Cycle, before: Cycle | None, judged: Judged) -> None:
        new_payload = not self._known(cycle.payload_kg)
        if new_payload and (before is None or abs(before.payload_kg - cycle.payload_kg) > SAME_PAYLOAD_KG):
            text = f"payload {cycle.payload_kg:g} kg is new: a change of the load is not the machine's"
            judged.events.append(Event(k, "payload", text))
        track = self._track(new_payload)
        if self._wild is not None and self._far(track, k, cycle):
            track.add(*self._wild)  # two far off, one after the other, are the machine
        lasts, self._wild = self._wild is not None, None
        track.add(k, cycle.payload_kg, self._whitened(cycle))
        if track.has_gone(self.state) and self.state.before is not None:
            since = self.cycles[self.state.onset].name
            judged.events.append(Event(k, "gone", f"the change since {since} has gone: it is as it was before"))
            self.state = self.state.before
        look = track.look(self.state)
        if look is None:
            return
        judged.statistic = look.statistic
        limit = self._limit(track.rank - look.directions.shape[1])
        if limit is None or look.statistic <= limit:
            judged.alarm = self._grown(k, track, look.statistic)
        elif look.n == 1 and look.statistic > SINGLE * limit and not lasts:
            # One cycle far off and none before it: it is said, and the next ones tell whether it stays.
            judged.events.append(Event(k, "single", "is far from the baseline; the next cycles tell whether it stays"))
            self._wild = k, cycle.payload_kg, self._whitened(cycle)
            track.drop()
        else:
            judged.alarm = self._raised(k, track, look)
        if judged.alarm is not None:
            self.alarms.append(judged.alarm)

    def _track(self, new_payload: bool) -> Track:
        assert self.baseline is not None
        if new_payload not in self._tracks:
            keys, free = self.cycles[-1].estimate.keys, None
            if new_payload and LOAD in keys:
                load = self.baseline.whiten @ self._resolution[:, keys.index(LOAD)]
                size = float(np.linalg.norm(load))
                free = load / size if size > 0.0 else None
            self._tracks[new_payload] = Track(self.baseline.count, len(self.baseline.whiten), free)
        return self._tracks[new_payload]

    def _limit(self, dimension: int) -> float | None:
        """The threshold of a test in so many dimensions; None where nothing is left to be tested."""
        assert self.baseline is not None
        if dimension < 1:
            return None
        varied = len(self.baseline.line) > 1
        self.limit = threshold(dimension, self.rules.healthy, self.rules.cycles_between, varied)
        return self.limit

    def _whitened(self, cycle: Cycle) -> Array:
        """(2 r,): with the payload's scatter evened out, and as it is. A cycle that shows less than those of the
        baseline counts less."""
        assert self.baseline is not None
        shrink = np.maximum(1.0, cycle.estimate.errors / np.maximum(self._typical, 1e-300))
        off = self.baseline.deviation(cycle.estimate.values, cycle.payload_kg) / shrink
        return np.concatenate([self.baseline.z(off, cycle.payload_kg), self.baseline.whiten @ off])

    def _far(self, track: Track, k: int, cycle: Cycle) -> bool:
        """Whether this cycle alone is off too."""
        track.add(k, cycle.payload_kg, self._whitened(cycle))
        look, limit = track.look(self.state), self.limit
        track.drop()
        return look is not None and limit is not None and look.statistic > limit

    def _raised(self, k: int, track: Track, look: Look) -> Alarm:
        """A new change; the state that explains it is what is expected from now on."""
        onset, free = track.cycles[-look.n], track.free.shape[1]
        size = float(np.linalg.norm(look.delta[: track.rank]))
        causes = self.causes(look.delta[track.rank :], look.directions, look.variance, look.drift)
        known, angles = look.directions[:, free:], look.angles[free:]
        self.state = State(onset, look.expected, known, angles, size, k, self.state)
        return Alarm(k, onset, causes, look.statistic)

    def _grown(self, k: int, track: Track, g: float) -> Alarm | None:
        """The last change, told again where it has grown, and told anew where it looks like another one by now."""
        state, last = self.state, track.last_change(self.state)
        if last is None or state.known is None or len(track.cycles) - bisect_right(track.cycles, state.raised) < STAYS:
            return None
        size = float(np.linalg.norm(last[0][: track.rank])) - 2.0 * math.sqrt(last[1])
        if size <= GROWN * state.told:
            return None
        self.state = replace(state, told=size)
        causes = self.causes(last[0][track.rank :], state.known, last[1])
        name = next(alarm.causes[0].name for alarm in reversed(self.alarms) if not alarm.again)
        same = next((cause.share for cause in causes if cause.name == name), 1.0) > 0.5 * causes[0].share
        return Alarm(k, state.onset, causes, g, again=same)

    # What a change looks like.

    def causes(self, change: Array, known: Array, variance: float, drift: float = 0.0) -> tuple[Cause, ...]:
        """Single parameters, and friction both ways, by how well each explains a whitened change (r,), with the share
        that it explains. Along directions (r, q) that are known the machine may have left its line, which drifted."""
        basis = np.linalg.qr(known)[0] if known.shape[1] else known
        away = math.hypot(AWAY[0], AWAY[1] * drift)
        inverse = np.linalg.inv(variance * np.eye(len(change)) + away**2 * basis @ basis.T)
        total = float(change @ inverse @ change)
        ranked = []
        for name, chosen, weights in directions(self.cycles[-1].estimate.keys):
            column = self._column(chosen, weights)
            size = float(column @ inverse @ column)
            if total == 0.0 or size == 0.0:
                continue
            amount = float(column @ inverse @ change) / size
            share = amount * amount * size / total
            one_way = len(chosen) == 1 and "coulomb" in chosen[0]
            evidence = 0.5 * share * total - (RARER if one_way else 0.0)
            ranked.append((evidence, Cause(name, chosen, amount, share, weights)))
        if not ranked:
            return (Cause("unknown", self.cycles[-1].estimate.keys[:1], 0.0, 0.0, (1.0,)),)
        return tuple(cause for _, cause in sorted(ranked, key=lambda pair: -pair[0]))

    def _column(self, chosen: Sequence[str], weights: Sequence[float]) -> Array:
        """(r,) whitened: what a true change of those keys by their weights does to the estimates."""
        assert self.baseline is not None
        keys = self.cycles[-1].estimate.keys
        return np.asarray(
            self.baseline.whiten @ self._resolution[:, [keys.index(key) for key in chosen]] @ np.array(weights)
        )

    def amounts(self, alarm: Alarm) -> list[float]:
        """How much of an alarm's likeliest cause each counted cycle since its onset shows beside those of the other
        alarms, in the unit of its first key."""
        assert self.baseline is not None
        others = [a.causes[0] for a in self.alarms if not a.again and a.onset != alarm.onset]
        chosen = [alarm.causes[0], *others]
        columns = np.column_stack([self._column(cause.keys, cause.weights) for cause in chosen])
        since = [self.cycles[i] for i in self.counted if i >= alarm.onset]
        rank = len(self.baseline.whiten)
        white = np.column_stack([self._whitened(cycle)[rank:] for cycle in since])
        return list(map(float, np.linalg.lstsq(columns, white, rcond=1e-6)[0][0]))

    def trend_of(self, alarm: Alarm, nominal: Mapping[str, float]) -> Trend | None:
        """How the likeliest cause goes on since its onset. nominal: the machine's values by key."""
        cause = alarm.causes[0]
        key = cause.keys[0]
        limit = self.rules.limits.get(key) if min(cause.weights) > 0.0 else None
        return trend(self.amounts(alarm), None if limit is None else limit - nominal[key])


def directions(keys: Sequence[str]) -> list[tuple[str, tuple[str, ...], tuple[float, ...]]]:
    """Candidate changes with the weights of their keys: each parameter for itself, friction both ways alike; and, where
    no parameter is one, a constant load, which is friction of one way more and of the other way less."""
    made: list[tuple[str, tuple[str, ...], tuple[float, ...]]] = [(words_of(key), (key,), (1.0,)) for key in keys]
    friction = tuple(key for key in keys if "coulomb" in key)
    if len(friction) != 2:
        return made
    loads = [key for key in keys if key == LOAD or "offset" in key or "gravity" in key]
    constant = [] if loads else [("constant load or offset", friction, (1.0, -1.0))]
    return [("friction both ways", friction, (1.0, 1.0)), *constant, *made]


def trend(amounts: Sequence[float], limit: float | None) -> Trend | None:
    """amounts: one a cycle. None where they are too few. Times to a limit by the line's slope and its error."""
    n = len(amounts)
    if n < LEAST_TREND:
        return None
    x = np.arange(n, dtype=float) - 0.5 * (n - 1)
    y = np.asarray(amounts, dtype=float)
    sxx = float(x @ x)
    rate = float(x @ y) / sxx
    rest = y - y.mean() - rate * x
    error = math.sqrt(float(rest @ rest) / (n - 2) / sxx)
    now = float(y.mean() + rate * x[-1])
    if limit is None or abs(rate) < CLEAR * error or (limit - now) * rate <= 0.0:
        return Trend(now, rate, None, None)
    way = limit - now
    fast, slow = abs(rate) + 1.96 * error, abs(rate) - 1.96 * error
    latest = abs(way) / slow if slow > 0.0 else math.inf
    return Trend(now, rate, way / rate, (abs(way) / fast, latest))
