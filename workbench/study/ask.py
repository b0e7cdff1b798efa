"""A scenario's own question: the largest or smallest value of one field at which every run keeps every limit.

The boundary is bracketed by closed-loop runs side by side and narrowed down until it is known to 0.2 %.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.machines import kind_of, with_values
from workbench.metrics import set_of
from workbench.references import LimitPair
from workbench.study.decide import Given, candidates, criteria_for
from workbench.study.grid import RunSpec
from workbench.study.labels import listed, words_of
from workbench.study.load import Study
from workbench.study.run import run_specs

POINTS = 8  # values a round: the lanes that run side by side
CLOSE = 2e-3  # relative: how well the boundary is known
MOST_SPECS, MOST_REFERENCES, MOST_LIMITS = 64, 2, 3


def _deceleration(spec: RunSpec) -> float:
    stop = spec.events.emergency_deceleration_m_s2
    if spec.events.emergency_stop_s is not None and stop is not None:
        return stop
    assert spec.limits is not None
    return spec.limits.hoisting.acceleration_m_s2


def _decelerating(spec: RunSpec, value: float) -> RunSpec:
    """The emergency stop's deceleration; without one the acceleration limit of the motion, both ways."""
    if spec.events.emergency_stop_s is not None:
        return replace(spec, events=spec.events.model_copy(update={"emergency_deceleration_m_s2": value}))
    assert spec.limits is not None
    ways = (replace(way, acceleration_m_s2=value) for way in (spec.limits.hoisting, spec.limits.lowering))
    return replace(spec, limits=LimitPair(*ways))


@dataclass(frozen=True)
class Question:
    """unit: of what is sought. most: the largest value, else the smallest. first: where the search begins."""

    unit: str
    most: bool
    first: Callable[[RunSpec], float]
    at: Callable[[RunSpec, float], RunSpec]


QUESTIONS = {
    "largest payload": Question(
        "kg", True, lambda s: s.machine.carriage.mass_kg, lambda s, x: replace(s, payload_kg=x)
    ),
    "highest deceleration": Question("m/s²", True, _deceleration, _decelerating),
    "smallest motor": Question(
        "N m nominal torque per motor", False, lambda s: s.machine.motor.nominal_torque_nm,
        lambda s, x: replace(s, machine=with_values(s.machine, {"motor.nominal_torque_nm": x})),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Asked:
    """value: the last one at which all limits are kept, None where there is none in reach; broken: what is, beyond."""

    reference: str
    value: float | None
    beyond: float
    broken: tuple[str, ...]


def answers(study: Study) -> list[Asked]:
    """Of the first references: the value under all limits, then without those that bind it, one after the other."""
    if study.scenario.ask is None:
        return []
    question, found = QUESTIONS[study.scenario.ask], []
    for reference in study.scenario.kinds[:MOST_REFERENCES]:
        specs = _specs(study, reference, question)
        left_out: frozenset[str] = frozenset()
        for _ in range(MOST_LIMITS):
            search = _Search(question, specs, study.scenario.decide, left_out)
            asked, binding = search.boundary(reference)
            found.append(asked)
            if asked.value is None or not binding:
                break
            left_out |= binding
    return found


def _specs(study: Study, reference: str, question: Question) -> list[RunSpec]:
    """The study's runs of a reference, without what only the sought field tells apart."""
    own: dict[str, RunSpec] = {}
    for spec in study.specs[: MOST_SPECS * len(study.scenario.kinds)]:
        if spec.reference == reference and not spec.problem:
            alike = question.at(spec, question.first(study.specs[0]))
            key = repr((alike.payload_kg, alike.machine, alike.events, alike.limits, alike.moves, alike.controller))
            own.setdefault(key, replace(spec, record_every=0))
    if not own:
        raise InputError(f"no run with {reference} can be made", place="ask")
    return list(own.values())


@dataclass(frozen=True)
class _Verdict:
    """What is broken, in words, and the criteria that are."""

    broken: tuple[str, ...]
    names: frozenset[str]


@dataclass(frozen=True)
class _Search:
    """left_out: criteria whose limits do not count."""

    question: Question
    specs: Sequence[RunSpec]
    given: Given
    left_out: frozenset[str]

    def boundary(self, reference: str) -> tuple[Asked, frozenset[str]]:
        """Between the last value that keeps the limits and the first that does not, and the criteria that bind."""
        step = 2.0 if self.question.most else 0.5
        values = self.question.first(self.specs[0]) * step ** np.arange(-3.0, 5.0)
        good, bad, verdict = self._first_bad(None, values)
        if verdict is None:
            return Asked(reference, good, float(values[-1]), ()), frozenset()
        if good is None:
            return Asked(reference, None, bad, verdict.broken), frozenset()
        while abs(bad - good) > CLOSE * good:
            inner = np.linspace(good, bad, POINTS + 2)[1:-1]
            better, nearer, closer = self._first_bad(good, inner)
            good = good if better is None else better
            bad, verdict = (bad, verdict) if closer is None else (nearer, closer)
        return Asked(reference, good, bad, verdict.broken), verdict.names

    def _first_bad(self, good: float | None, values: Array) -> tuple[float | None, float, _Verdict | None]:
        for value, verdict in zip(values, self._judged(values), strict=True):
            if verdict.broken:
                return good, float(value), verdict
            good = float(value)
        return good, float(values[-1]), None

    def _judged(self, values: Array) -> list[_Verdict]:
        runs = [replace(self.question.at(spec, float(value)), assigned={}) for value in values for spec in self.specs]
        rows = [row for row, _ in run_specs(runs)]
        verdicts, size = [], len(self.specs)
        for k in range(len(values)):
            broken: dict[str, None] = {}
            names: set[str] = set()
            for spec, row in zip(runs[k * size : (k + 1) * size], rows[k * size : (k + 1) * size], strict=True):
                judged = set_of(kind_of(spec.machine).name)
                criteria = criteria_for(judged, spec.machine, spec.payload_kg, self.given)
                known = [c for c in criteria if c.name not in self.left_out and row.metrics.get(c.name) is not None]
                (candidate,) = candidates([row], known)
                over = [c for c in known if c.broken(row[c.name])]
                names |= {c.name for c in over}
                other = candidate.broken[: len(candidate.broken) - len(over)]  # what is no criterion stands first
                broken |= dict.fromkeys([*other, *(f"{c.metric.label} {c.limit_words}" for c in over)])
            verdicts.append(_Verdict(tuple(broken), frozenset(names)))
        return verdicts


def asked_sentences(study: Study, found: Sequence[Asked]) -> list[str]:
    """The number that was asked for, what limits it, and how far it goes without that limit."""
    said, name = [], study.scenario.ask or ""
    for reference in dict.fromkeys(one.reference for one in found):
        parts: list[str] = []
        for one in (one for one in found if one.reference == reference):
            unit = QUESTIONS[name].unit
            lead = "without that limit it is" if parts else f"The {name} with {words_of(reference)} is"
            if one.value is None:
                side = "below" if QUESTIONS[name].most else "above"
                parts.append(f"{lead} {side} {one.beyond:.4g} {unit} ({listed(one.broken[:2])})")
            elif not one.broken:
                parts.append(f"{lead} beyond {one.value:.4g} {unit}, where the search ends")
            else:
                parts.append(f"{lead} {one.value:.4g} {unit} (beyond: {one.broken[0]})")
        said.append(f"{'; '.join(parts)}.")
    return said
