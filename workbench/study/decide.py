"""Which motion and setting to take: criteria with limits and weights, and the sentence that says what the choice costs.

A candidate is a reference with the values that a sweep chooses; what a sweep or a sample only assumes (draws, events,
values of the machine) is not chosen, and a candidate is judged by its worst run over it. A candidate that breaks a
limit is out. Of the rest the least weighted sum of shares is taken: sum of w_i u_i, with u_i the value over its limit
(or its scale; without either, over the largest of the payload's candidates), or the limit over a value that is better
when it is higher. (Weighted sum: R. T. Marler, J. S. Arora, Struct. Multidisc. Optim. 41, 2010, eq. 2.)
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from workbench.core.errors import InputError, nearest
from workbench.core.names import listed
from workbench.machines import Hoist, Machine, kind_of, load_of
from workbench.metrics import Metric, MetricSet, find, set_with
from workbench.study.labels import FAILS, SweptAxis, reads, said, swept_axes, words_of
from workbench.study.rows import Row, hunts, is_astray, metrics_of
from workbench.study.scenario import CriterionBlock

TIME = "move_time_s"
RESERVE = "torque_reserve_percent"  # of the largest torque or force, what the peak leaves
SAME_TIME_S = 5e-3  # a smaller difference decides nothing
NEAR = 1e-3  # relative: a difference that counts
MOST_COMPARED = 256
ALIKE = 0.01  # relative difference of two sums that are alike
CHOSEN = ("sweep.limits.", "sweep.controller.", "sweep.drive.")  # a sweep of anything else is a condition to bear
FALLS = 2.0  # of wire that carry a hoist's load
WIRE_SAFETY = 4.5  # least breaking load over tension of a running rope, mechanism group M5 (ISO 4308-1)
OVERSPEED = 1.2  # of nominal speed, where the field is weakened: a drive's own limit (ABB ACS850 manual, 20.01)
SATURATED = 1e-6  # a peak that is this near to the limit is at it
Given = Mapping[str, CriterionBlock]


@dataclass(frozen=True)
class Criterion:
    """A metric that is weighed. most, least: its limits, None without; scale: what counts as one without a limit."""

    name: str
    weight: float
    most: float | None = None
    least: float | None = None
    scale: float | None = None

    @cached_property
    def metric(self) -> Metric:
        return find(self.name)

    def broken(self, value: float) -> bool:
        size = abs(value) if self.metric.better == "zero" else value
        return (self.most is not None and size > self.most) or (self.least is not None and size < self.least)

    def share(self, value: float, largest: float) -> float:
        """The value as a share of what is borne, the smaller the better."""
        if self.metric.better == "higher":
            least = self.least if self.least is not None else self.scale or 0.0
            return least / max(value, 1e-12) if value > 0.0 else math.inf
        one = self.most or self.scale or largest
        return abs(value) / one if one else 0.0

    def text(self, value: float) -> str:
        """A value with its unit."""
        return f"{self.metric.text(value)} {self.metric.shown_unit}".strip()

    def over(self, value: float) -> str:
        """A value that breaks the limit, with digits that tell it from the limit: `100.4 %, at most 100 %`."""
        bound, said = self.most if self.most is not None else self.least or 0.0, self.text(value)
        if said == self.text(bound):
            shown, limit = self.metric.scale * value, self.metric.scale * bound
            digits = next((d for d in range(4, 17) if f"{shown:.{d}g}" != f"{limit:.{d}g}"), 17)
            said = f"{shown:.{digits}g} {self.metric.shown_unit}".strip()
        return f"{said}, {self.limit_words}"

    @property
    def limit_words(self) -> str:
        if self.most is not None:
            return f"at most {self.text(self.most)}"
        return "–" if self.least is None else f"at least {self.text(self.least)}"

    @property
    def broken_words(self) -> str:
        """What is so where the limit is broken: `thermal load exceeds 100 %`."""
        if self.most is not None:
            return f"{self.metric.label} exceeds {self.text(self.most)}"
        return f"{self.metric.label} falls below {self.text(self.least or 0.0)}"


def criteria_for(
    judged: MetricSet, machine: Machine | None, payload_kg: float, given: Given | None = None
) -> tuple[Criterion, ...]:
    """The usual criteria at a payload, with what a scenario's `decide` sets over them; without a machine no limits.

    Usual limits: a tenth of the torque in reserve, thermal load and overload cycle 100 %, the speed that the drive
    bears, a hoist's wire above a tenth of its static tension and with the safety factor of a running rope; scales: 2 %
    of nominal speed, 50 mm and the static tension. InputError for what is no metric of the kind, and where nothing is
    weighed.
    """
    given = dict(given or {})
    reserve = given.pop(RESERVE, CriterionBlock())
    left = min(1.0 - (10.0 if reserve.least is None else reserve.least) / 100.0, 1.0 - SATURATED)
    weight = 2.0 if reserve.weight is None else reserve.weight
    limit, static, nominal, fastest = math.inf, None, None, None
    if machine is not None:
        loop, load = kind_of(machine).looped, load_of(machine, payload_kg)
        limit = loop.peak_limit(machine)
        if judged.payload and load is not None:
            static, nominal = load.hold_n / FALLS, loop.speed_scale(machine)
    usual = [
        Criterion(judged.peak, weight, most=left * limit if math.isfinite(limit) else None),
        Criterion("thermal_load_percent", 1.0, most=100.0),
        Criterion(TIME, 2.0),
        Criterion("energy_motoring_j", 0.5),
    ]
    if not judged.payload:
        usual += [Criterion(judged.rms_error, 1.0), Criterion(judged.error, 1.0), Criterion("settling_time_s", 1.0)]
    else:
        usual += [
            Criterion("wire_tension_swing_n", 1.0, scale=static),
            *([Criterion("min_wire_tension_n", 1.0, least=0.1 * static)] if static is not None else []),
            Criterion(judged.rms_error, 1.0, scale=None if nominal is None else 0.02 * nominal),
            Criterion("position_error_max_m", 1.0, scale=None if static is None else judged.astray),
            Criterion("overload_use_percent", 0.0, most=100.0),
        ]
    if isinstance(machine, Hoist):
        fastest = 100.0 * (OVERSPEED if machine.drive.field_weakening else 1.0)
        usual.append(Criterion("wire_safety_factor", 0.0, least=WIRE_SAFETY))
    elif machine is not None:
        fastest = machine.drive.top_speed
    if machine is not None and fastest is not None:
        usual.append(Criterion(judged.fastest, 0.0, most=fastest))
    chosen = {criterion.name: criterion for criterion in usual if criterion.name in judged.by_name}
    for name, block in given.items():
        if name not in chosen and (name not in judged.by_name or judged.by_name[name].better is None):
            known = [RESERVE, *(metric.name for metric in judged.metrics if metric.better is not None)]
            raise InputError(f"unknown criterion '{name}'; {nearest(name, known)}", place=f"decide.{name}")
        chosen[name] = replace(chosen.get(name, Criterion(name, 1.0)), **block.model_dump(exclude_none=True))
    if not any(criterion.weight for criterion in chosen.values()):
        raise InputError("every weight is 0, expected one above 0", place="decide")
    return tuple(chosen.values())


@dataclass(frozen=True)
class Candidate:
    """A reference with its chosen values at a payload. values: of each criterion, the worst of its runs.

    setting: the chosen values, in words; assigned: by column; broken: why it is out; shares: u of each criterion;
    total: their weighted sum; beside: not in the study, but run for the comparison. keeps: of one that is out, the
    values of a swept condition at which it keeps every limit.
    """

    payload_kg: float
    reference: str
    setting: str
    values: Mapping[str, float]
    runs: int
    broken: tuple[str, ...]
    beside: bool = False
    keeps: str = ""
    assigned: Mapping[str, float | str] = field(default_factory=dict)
    shares: Mapping[str, float] = field(default_factory=dict)
    total: float = math.nan

    @property
    def words(self) -> str:
        name = words_of(self.reference)
        return f"{name.removesuffix(' with the same limits')} with {self.setting}" if self.setting else name


@dataclass(frozen=True)
class Decision:
    """At one payload: the candidates from the best on, those that break a limit last."""

    payload_kg: float
    criteria: tuple[Criterion, ...]
    candidates: tuple[Candidate, ...]

    @property
    def judged(self) -> MetricSet:
        return set_with([criterion.name for criterion in self.criteria])

    @property
    def left(self) -> tuple[Candidate, ...]:
        return tuple(candidate for candidate in self.candidates if not candidate.broken)

    @property
    def dominated(self) -> list[Candidate]:
        """Of the study's own those that another one is no worse than in any criterion, and in one better by more than a
        thousandth."""
        left = self.left[:MOST_COMPARED]
        shares = np.array([list(one.shares.values()) for one in left]).reshape(len(left), -1)
        no_worse = np.all(shares[None] <= shares[:, None], axis=-1)
        better = np.any(shares[None] < shares[:, None] * (1.0 - NEAR), axis=-1)
        return [one for one, beaten in zip(left, np.any(no_worse & better, axis=1), strict=True)
                if beaten and not one.beside]  # fmt: skip

    def beyond(self, one: Candidate) -> float:
        """By how much a candidate breaks the limits at most, as a share of them."""
        over = (c.share(one.values[c.name], 1e-12) for c in self.criteria if c.broken(one.values[c.name]))
        return max(over, default=0.0)

    @property
    def taken(self) -> Candidate | None:
        """None where all break a limit."""
        return self.left[0] if self.left else None

    @property
    def at_equal_time(self) -> list[Candidate]:
        """Of each reference the best that takes no longer than the one taken, or its quickest where none is so quick.

        Those of references that all break a limit come last.
        """
        if self.taken is None:
            return []
        longest, best = self.taken.values[TIME] + SAME_TIME_S, list[Candidate]()
        for reference in dict.fromkeys(one.reference for one in self.left):
            own = [one for one in self.left if one.reference == reference]
            in_time = [one for one in own if one.values[TIME] <= longest]
            best.append(in_time[0] if in_time else min(own, key=lambda one: one.values[TIME]))
        best.sort(key=lambda one: (one.values[TIME] > longest, one.total))
        known = {one.reference for one in best}
        out = {one.reference: one for one in reversed(self.candidates) if one.reference not in known}
        return [*best, *reversed(out.values())]

    @property
    def rival(self) -> Candidate | None:
        """Whom the one taken is compared with: the best of another reference in its time; of one reference the quickest
        of the rest, or the next best where it is quickest itself."""
        rest = self.left[1:]
        if self.taken is None or not rest:
            return None
        others = [one for one in self.at_equal_time if one.reference != self.taken.reference and not one.broken]
        if others:
            return others[0]
        quickest = min(rest, key=lambda c: (round(c.values[TIME] / SAME_TIME_S), c.total))
        return quickest if quickest.values[TIME] < self.taken.values[TIME] - SAME_TIME_S else rest[0]


def decisions(
    rows: Sequence[Row], machine: Machine | None, given: Given | None = None, beside: Sequence[Row] = ()
) -> list[Decision]:
    """The decision at each payload, over all that the rows vary. beside: runs for the comparison at equal time."""
    judged, made = metrics_of(rows), []
    varied = any(name.startswith(("sweep.drive.", "sweep.machine.")) for row in rows for name in row.assigned)
    for payload in sorted({row.payload_kg for row in rows}):
        own, others = ([row for row in some if row.payload_kg == payload] for some in (rows, beside))
        criteria = criteria_for(judged, machine, payload, given)
        if varied:  # each run has a limit of its own, which its row does not know
            criteria = tuple(replace(c, most=None) if c.name == judged.peak else c for c in criteria)
        criteria = tuple(c for c in criteria if all(row.metrics.get(c.name) is not None for row in own if row.ok))
        found = [*candidates(own, criteria)]
        slowest = max((c.values[TIME] for c in found if not c.broken), default=math.inf)
        found += [
            replace(candidate, beside=True)
            for candidate in candidates(others, criteria)
            if candidate.values[TIME] <= slowest + SAME_TIME_S and not candidate.broken
        ]
        made.append(Decision(payload, criteria, _ranked(found, criteria)))
    return made


def candidates(rows: Sequence[Row], criteria: Sequence[Criterion]) -> Iterator[Candidate]:
    """Rows as candidates: those that are alike in reference and chosen values are one."""
    varied = swept_axes(rows)
    axes = [axis for axis in varied if axis.columns[0].startswith(CHOSEN)]
    conditions = [axis for axis in varied if axis not in axes]
    read = {
        kind: [axis for axis in axes if any(reads(kind, column) for column in axis.columns)]
        for kind in {row.reference for row in rows}
    }
    groups: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.reference, *(axis.at(row) for axis in read[row.reference])), []).append(row)
    for own in groups.values():
        reference = own[0].reference
        chosen = [axis for axis in read[reference] if any(column in own[0].assigned for column in axis.columns)]
        values, broken = _judged(own, criteria)
        values.setdefault(TIME, max((row[TIME] for row in own if row.ok), default=math.nan))
        yield Candidate(
            own[0].payload_kg, reference, ", ".join(axis.say(axis.at(own[0])) for axis in chosen), values, len(own),
            broken, keeps=_kept(own, conditions[0], criteria) if broken and len(conditions) == 1 else "",
            assigned={column: own[0].assigned[column] for axis in chosen for column in axis.columns},
        )  # fmt: skip


def _kept(own: Sequence[Row], axis: SweptAxis, criteria: Sequence[Criterion]) -> str:
    """The values of a condition at which all runs keep every limit, in words."""
    kept = [axis.short(point) for point, here in axis.grouped(own).items() if not _judged(here, criteria)[1]]
    return f"{axis.words} {listed(kept)}" if kept else ""


def _judged(own: Sequence[Row], criteria: Sequence[Criterion]) -> tuple[dict[str, float], tuple[str, ...]]:
    """The worst value of each criterion, NaN where every run fails; why the runs are out."""
    good, broken = [row for row in own if row.ok], list[str]()
    values = {c.name: float(c.metric.worst([row[c.name] for row in good])) if good else math.nan for c in criteria}
    if len(good) < len(own):
        broken.append(f"{len(own) - len(good)} of its {len(own)} runs fail" if good else FAILS)
    if any(hunts(row) for row in good):
        broken.append("its loop hunts")
    if any(is_astray(row) for row in good):
        broken.append("it does not end where its reference does")
    over = [c for c in criteria if good and c.broken(values[c.name])]
    return values, (*broken, *(f"{c.metric.label} {c.over(values[c.name])}" for c in over))


def _ranked(found: Sequence[Candidate], criteria: Sequence[Criterion]) -> tuple[Candidate, ...]:
    left = [candidate for candidate in found if not candidate.broken]
    largest = {c.name: max((abs(one.values[c.name]) for one in left), default=math.nan) for c in criteria}
    judged = []
    for candidate in found:
        shares = {c.name: c.share(candidate.values[c.name], largest[c.name]) for c in criteria}
        total = sum(c.weight * shares[c.name] for c in criteria if c.weight)
        judged.append(replace(candidate, shares=shares, total=total))
    return tuple(sorted(judged, key=lambda c: (bool(c.broken), c.total if math.isfinite(c.total) else math.inf)))


def take_sentences(made: Sequence[Decision]) -> list[str]:
    """One sentence a payload, payloads with the same choice together; [] where there is nothing to choose."""
    if not made or max(len(decision.candidates) for decision in made) < 2:
        return []
    groups: dict[str, list[Decision]] = {}
    for decision in made:
        groups.setdefault(decision.taken.words if decision.taken else "", []).append(decision)
    return [_take(alike, len(groups) == 1) for alike in groups.values()]


def _take(alike: Sequence[Decision], always: bool) -> str:
    decision, taken, rival = alike[-1], alike[-1].taken, alike[-1].rival
    figures = [
        f"{c.metric.label} {c.text(taken.values[c.name])}"
        for c in decision.criteria
        if taken and c.name in (TIME, decision.judged.peak, decision.judged.rms_error)
    ]
    least = min(decision.candidates, key=lambda one: (FAILS in one.broken, len(one.broken), decision.beyond(one)))
    loads = listed([f"{one.payload_kg:g} kg" for one in alike])
    return said.take(alike, always, loads, least, figures, _against(decision, taken, rival) if taken and rival else "")


def _against(decision: Decision, taken: Candidate, rival: Candidate) -> str:
    """What the choice gains and costs against its rival, and from which weight on the rival is the better one."""
    gains: list[str] = []
    costs: list[str] = []
    for criterion in sorted(
        decision.criteria, key=lambda c: -c.weight * abs(taken.shares[c.name] - rival.shares[c.name])
    ):
        a, b, metric = rival.values[criterion.name], taken.values[criterion.name], criterion.metric
        worse = metric.worse_by(a, b)
        if abs(worse) >= max(metric.visible, 0.005 * abs(a)) and metric.text(a) != metric.text(b):
            change = f"{metric.label} {metric.text(b)} instead of {metric.text(a)} {metric.shown_unit}".strip()
            (costs if worse > 0.0 else gains).append(change)
    alike = rival.total - taken.total < ALIKE * taken.total
    turn = weight_that_turns(decision, taken, rival)
    return said.against(rival, gains, costs, 100.0 * ALIKE if alike else 0.0, turn)


def weight_that_turns(decision: Decision, taken: Candidate, rival: Candidate) -> tuple[Criterion, float] | None:
    """The criterion in which the rival is ahead most, and the weight of it above which the rival's sum is the less:
    w + (S_rival − S_taken)/(u_taken − u_rival)."""
    behind = [c for c in decision.criteria if taken.shares[c.name] > rival.shares[c.name] + 1e-9]
    if not behind:
        return None
    criterion = max(behind, key=lambda c: max(c.weight, 1e-3) * (taken.shares[c.name] - rival.shares[c.name]))
    gap = taken.shares[criterion.name] - rival.shares[criterion.name]
    return criterion, criterion.weight + (rival.total - taken.total) / gap
