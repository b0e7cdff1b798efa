"""Cycle after cycle: the baseline, events that are not the machine, alarms with their likeliest cause.

The baseline is learned from the first cycles that count, and anew as they grow in number while nothing alarms. A cycle
does not count that begins within the warm-up after a pause: friction is higher then, and falls by itself. A stated
payload that the baseline has not seen makes the load a free quantity: its direction is left out of the test while that
payload is carried, so that a model that is a little wrong for it raises no alarm, and a change of anything else still
does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from workbench.names import words_of
from workbench.run import Array
from workbench.watch.change import GROWTH, HEALTHY, Baseline, Detector, learn, threshold
from workbench.watch.estimate import Estimate
from workbench.watch.trend import Trend, trend

LOAD = "carriage.mass_kg"
SAME_PAYLOAD, SAME_PAYLOAD_KG = 0.02, 10.0  # relative, at least: stated payloads that are one
SAME_CAUSE = 0.5  # cosine between two changes, whitened, that are one
SINGLE = 1.5  # times the threshold: one cycle alone that far off is an event


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
    """One cycle as the judge takes it. start_s: on the campaign's clock."""

    name: str
    payload_kg: float
    start_s: float
    duration_s: float
    estimate: Estimate


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
    change that each explains."""

    cycle: int
    onset: int
    causes: tuple[Cause, ...]
    statistic: float


@dataclass
class Judged:
    """What one cycle brought. z: (r,) whitened, empty where the cycle did not count."""

    statistic: float = 0.0
    counted: bool = False
    events: list[Event] = field(default_factory=list)
    alarm: Alarm | None = None
    again: bool = False


class Judge:
    """Deterministic: the same cycles in the same order give the same alarms, so it is built anew after a restart."""

    def __init__(self, rules: Rules) -> None:
        self.rules = rules
        self.cycles: list[Cycle] = []
        self.counted: list[int] = []
        self.statistics: list[float] = []
        self.baseline: Baseline | None = None
        self.alarms: list[Alarm] = []
        self.detectors: dict[bool, Detector] = {}
        self._warm_from: float | None = None
        self._payloads: list[float] = []
        self._typical: Array = np.zeros(0)
        self._resolution: Array = np.zeros(0)
        self._direction: Array | None = None

    def add(self, cycle: Cycle) -> Judged:
        """Takes the next cycle."""
        k = len(self.cycles)
        before = self.cycles[-1] if self.cycles else None
        self.cycles.append(cycle)
        judged = Judged()
        cold = self._cold(k, cycle, before, judged)
        if not cold:
            judged.counted = True
            self.counted.append(k)
            if self.baseline is not None:
                self._test(k, cycle, before, judged)
            if not self.alarms and len(self.counted) in [self.rules.healthy * times for times in GROWTH]:
                self._learn(k, cycle, judged)
        self.statistics.append(judged.statistic)
        return judged

    def _cold(self, k: int, cycle: Cycle, before: Cycle | None, judged: Judged) -> bool:
        if before is not None and cycle.start_s < before.start_s:
            judged.events.append(
                Event(k, "clock", f"begins {before.start_s - cycle.start_s:g} s before the cycle that came before it")
            )
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
        self.detectors = {}
        for counted in chosen:
            if not self._known(counted.payload_kg):
                self._payloads.append(counted.payload_kg)
        judged.events.append(Event(k, "baseline", f"the baseline is learned from {len(chosen)} cycles"))

    def _known(self, payload_kg: float) -> bool:
        return any(abs(payload_kg - old_kg) <= max(SAME_PAYLOAD_KG, SAME_PAYLOAD * old_kg) for old_kg in self._payloads)

    def _test(self, k: int, cycle: Cycle, before: Cycle | None, judged: Judged) -> None:
        assert self.baseline is not None
        z = self._whitened(cycle)
        free_load = not self._known(cycle.payload_kg)
        if free_load:
            if before is None or abs(before.payload_kg - cycle.payload_kg) > SAME_PAYLOAD_KG:
                text = f"payload {cycle.payload_kg:g} kg is new: a change of the load is not the machine's"
                judged.events.append(Event(k, "payload", text))
            basis = self._without_load()
            z = basis @ z if basis is not None else z
        detector = self._detector(free_load, len(z))
        alone = 0.5 * float(z @ z) / (1.0 + 1.0 / self.baseline.count)
        ago = detector.add(z)
        judged.statistic = detector.statistic
        if ago is None:
            return
        if ago == 1 and alone > SINGLE * detector.threshold and not self._lasting(k):
            # One cycle far off and none before it: it is said, and the next ones tell whether it stays.
            judged.events.append(Event(k, "single", "is far from the baseline; the next cycles tell whether it stays"))
            return
        onset = self._counted_ago(ago)
        whole = self._mean_since(onset)
        causes = self.causes(whole)
        white = self.baseline.whiten @ whole
        judged.alarm = Alarm(k, onset, causes, judged.statistic)
        judged.again = self._direction is not None and _cosine(white, self._direction) > SAME_CAUSE
        self._direction = white + self._direction if judged.again and self._direction is not None else white
        self.alarms.append(judged.alarm)

    def _whitened(self, cycle: Cycle) -> Array:
        """A cycle that shows less than those of the baseline counts less."""
        assert self.baseline is not None
        shrink = np.maximum(1.0, cycle.estimate.errors / np.maximum(self._typical, 1e-300))
        off = self.baseline.deviation(cycle.estimate.values, cycle.payload_kg)
        return self.baseline.z(off / shrink, cycle.payload_kg)

    def _detector(self, free_load: bool, dimension: int) -> Detector:
        assert self.baseline is not None
        if free_load not in self.detectors:
            varied = len(self.baseline.line) > 1
            h = threshold(dimension, self.rules.healthy, self.rules.cycles_between, varied)
            self.detectors[free_load] = Detector(self.baseline.count, h)
        return self.detectors[free_load]

    def _without_load(self) -> Array | None:
        """(r - 1, r): an orthonormal basis of what is left beside the direction of a load."""
        assert self.baseline is not None
        keys = self.cycles[-1].estimate.keys
        if LOAD not in keys:
            return None
        load = self.baseline.whiten @ self._resolution[:, keys.index(LOAD)]
        size = float(np.linalg.norm(load))
        if size == 0.0:
            return None
        _, _, rows = np.linalg.svd((load / size)[None, :])
        return np.asarray(rows[1:])

    def _lasting(self, k: int) -> bool:
        """Whether the counted cycle before was far off too."""
        assert self.baseline is not None
        if len(self.counted) < 2:
            return True
        z = self._whitened(self.cycles[self.counted[-2]])
        return 0.5 * float(z @ z) > next(iter(self.detectors.values())).threshold

    def _counted_ago(self, ago: int) -> int:
        return self.counted[max(0, len(self.counted) - ago)]

    def _mean_since(self, onset: int) -> Array:
        assert self.baseline is not None
        since = [self.cycles[i] for i in self.counted if i >= onset]
        return np.asarray(np.mean([self.baseline.deviation(c.estimate.values, c.payload_kg) for c in since], axis=0))

    # What a change looks like.

    def causes(self, change: Array) -> tuple[Cause, ...]:
        """Single parameters, and friction both ways, by the share of a whitened change (m,) that each explains."""
        assert self.baseline is not None
        keys = self.cycles[-1].estimate.keys
        whole = self.baseline.whiten @ change
        total = float(whole @ whole)
        shares = []
        for name, chosen, weights in directions(keys):
            column = self._column(chosen, weights)
            white = self.baseline.whiten @ column
            size = float(white @ white)
            if size == 0.0 or total == 0.0:
                continue
            amount = float(white @ whole) / size
            shares.append(Cause(name, chosen, amount, amount * amount * size / total, weights))
        return tuple(sorted(shares, key=lambda cause: -cause.share))

    def _column(self, chosen: Sequence[str], weights: Sequence[float]) -> Array:
        """(m,) what a true change of those keys by their weights does to the estimates."""
        keys = self.cycles[-1].estimate.keys
        return np.asarray(self._resolution[:, [keys.index(key) for key in chosen]] @ np.array(weights))

    def amounts(self, cause: Cause, since: int) -> list[float]:
        """How much of a cause each counted cycle since then shows, in the unit of its first key."""
        assert self.baseline is not None
        column = self._column(cause.keys, cause.weights)
        white = self.baseline.whiten @ column
        size = float(white @ white)
        return [float(white @ self._whitened(self.cycles[i])) / size for i in self.counted if i >= since and size > 0.0]

    def trend_of(self, alarm: Alarm, nominal: Mapping[str, float]) -> Trend | None:
        """How the likeliest cause goes on since its onset. nominal: the machine's values by key."""
        cause = alarm.causes[0]
        key = cause.keys[0]
        limit = self.rules.limits.get(key) if min(cause.weights) > 0.0 else None
        return trend(self.amounts(cause, alarm.onset), None if limit is None else limit - nominal[key])


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


def _cosine(a: Array, b: Array) -> float:
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0.0 else 0.0
