"""Side studies: the same motion at its heaviest payload, at other payloads, under other limits. Metrics only.
How much a study's answer hangs on the damping assumed between drive and load: the heaviest load runs again on
another wire or coupling.
How far references are from the least peak that any motion in the trapezoid's time has, each followed exactly."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from workbench.errors import InputError
from workbench.kinds import kind_of, load_of
from workbench.kinds.load import Load
from workbench.machine import Axis, Hoist, with_values
from workbench.metrics import Metric, set_of
from workbench.references import BASELINE, LimitPair, Shape, move_shape, planned_kind, planned_kinds
from workbench.references.optimal import GIVEN_AWAY, least_peak_move
from workbench.references.response import peak_force_n
from workbench.study.findings import listed
from workbench.study.grid import RunSpec
from workbench.study.labels import field_label, words_of
from workbench.study.load import Study, changed, plan_study
from workbench.study.rows import Row, metrics_of
from workbench.study.run import peak_limit, run_specs
from workbench.study.scenario import Scenario, key_in

_ONLY_METRICS: dict[str, Any] = {"outputs": {"signals": "none"}, "sweep": None, "sample": None}

_LOOKED_AT = 1024  # runs among which the heaviest payload is sought


def at_heaviest(study: Study) -> list[RunSpec]:
    """A run for each reference at the heaviest payload, without signals, on the lumped machine: of the scenario without
    its sweep and sample, or of their first point where the scenario needs them."""
    try:
        bare = changed(study.scenario, {"sweep": None, "sample": None})
        specs = plan_study(bare, study.machine, study.recordings).specs
    except InputError:
        specs = study.specs
    looked = [spec for spec in specs[:_LOOKED_AT] if not spec.problem] or specs[:1]
    heaviest = max(looked, key=lambda spec: spec.payload_kg)
    runs = [s for s in looked if s.payload_kg == heaviest.payload_kg and s.assigned == heaviest.assigned]
    return [replace(spec, record_every=0, plant="lumped") for spec in runs]


def over_payload(scenario: Scenario, machine: Hoist, payloads_kg: Sequence[float]) -> Study:
    """The scenario at these payloads, with its own among them."""
    payloads = tuple(sorted({*payloads_kg, *(scenario.payloads_kg or ())}))
    return plan_study(changed(scenario, {"payloads_kg": payloads, **_ONLY_METRICS}), machine)


def over_ramps(
    scenario: Scenario, machine: Hoist | Axis, accelerations: Sequence[float], jerks: Sequence[float]
) -> Study:
    """The scenario's references at its heaviest payload, each acceleration with each jerk, both ways alike.

    accelerations, jerks: in m/s² and m/s³, of a rotary axis in rad/s² and rad/s³.
    """
    kind = kind_of(machine)
    unit = kind.moved.unit
    sweep = {
        f"limits.{key_in(unit, name)}": [float(value) for value in values]
        for name, values in (("acceleration_m_s2", accelerations), ("jerk_m_s3", jerks))
    }
    changes = {**_ONLY_METRICS, "sweep": sweep}
    if kind.payload:
        changes["payloads_kg"] = (max(scenario.payloads_kg or (0.0,)),)
    return plan_study(changed(scenario, changes), machine)


RINGING = 0.02  # damping ratio assumed for a wire or coupling that rings; a wire's range: the machine `lightly_damped`
PAPER_S = 0.1  # c/k of the paper's wire
# Damping ratio of a jaw coupling with an elastomer spider: relative damping 0.8 of DIN 740-2, as makers of the usual
# spiders of 92 and 98 Shore A state it, over 4 pi.
ELASTOMER = 0.064
HARDLY = 2.0  # per cent that a figure, points that a saving may move and still hang little on the damping


@dataclass(frozen=True)
class Elastic:
    """What swings between drive and load. path: of its damping in the machine record, which is the damping over the
    stiffness times `per_s`. swing: the metric beside the peak. ringing, damped: in words, one that rings and one that
    does not; damped_s: the latter's damping over stiffness."""

    name: str
    path: str
    per_s: float
    swing: str
    ringing: str
    damped: str
    damped_s: float


def damping_sentence(scenario: Scenario, machine: Hoist | Axis) -> str | None:
    """What another wire or coupling makes of the answer; None where a run fails."""
    return on_another_damping(plan_study(scenario, machine))


def on_another_damping(study: Study) -> str | None:
    """The heaviest load on its wire or coupling and on one that rings; on a well damped one where its own rings. Of
    the multi-body machine the lumped one says it. None where a run fails."""
    own = heaviest_runs(study)
    load = load_of(own[0].machine, own[0].payload_kg)
    if load is None or load.rigid:
        return (
            "No damping is assumed: the axis is one stiff inertia, so that a vibration of what it carries, and what a "
            "jerk limit saves of it, is in none of these figures."
        )
    elastic = _elastic(load)
    rings = load.damping <= 1.5 * RINGING
    time_s = elastic.damped_s if rings else 2.0 * RINGING / load.angular_frequency_rad_s
    changes = {elastic.path: elastic.per_s * time_s}
    other = [replace(spec, machine=with_values(spec.machine, changes)) for spec in own]
    rows = [{row.reference: row for row, _ in run_specs(specs)} for specs in (own, other)]
    if any(not row.ok for by_kind in rows for row in by_kind.values()):
        return None
    swept = "".join(f", {field_label(name).of(value)}" for name, value in own[0].assigned.items())
    heavy = f"{own[0].payload_kg:g} kg{swept} and " if load.hangs else f"{swept.removeprefix(', ')} and " * bool(swept)
    where = f"at {heavy}the damping ratio assumed, {load.damping:.2g}"
    lumped = "" if study.scenario.plant == "lumped" else ", on the lumped machine"
    ratio = replace(load, damping_time_s=time_s).damping
    there = f"at {ratio:.2g}, {elastic.damped if rings else elastic.ringing}"
    say = _savings if len(own) > 1 else _figures
    said, moved = say(rows, elastic.swing, where, there)
    return (
        f"The answer {'hangs little' if moved < HARDLY else 'hangs'} on the {elastic.name}'s damping{lumped}: {said}."
    )


def _elastic(load: Load) -> Elastic:
    """What carries an elastic load: the wire of one that hangs, else a coupling."""
    if load.hangs:
        paper = f"the paper's assumption of c/k = {PAPER_S:g} s"
        return Elastic(
            "wire", "wire.damping_time_s", 1.0, "wire_tension_swing_n", "a wire that rings", paper, PAPER_S
        )  # fmt: skip
    return Elastic(
        "coupling", "coupling.damping_nm_s_per_rad", load.stiffness_n_per_m, "settling_time_s",
        "a coupling that rings", "a coupling with an elastomer spider",
        2.0 * ELASTOMER / load.angular_frequency_rad_s,
    )  # fmt: skip


def heaviest_runs(study: Study) -> list[RunSpec]:
    """At the heaviest payload the trapezoid and another planned reference, or what there is of them, else the first
    reference; without sweep, sample and signals, on the lumped machine."""
    runs = at_heaviest(study)
    known = planned_kinds()
    others = [spec for spec in runs if spec.reference in known and spec.reference != BASELINE]
    return [spec for spec in runs if spec.reference == BASELINE] + others[:1] or runs[:1]


Rows = Sequence[dict[str, Row]]


def _judged(rows: Rows, swing: str) -> tuple[Metric, Metric]:
    """The metrics that say it: the peak above static and what swings."""
    judged = metrics_of(list(rows[0].values()))
    return judged.by_name[judged.above], judged.by_name[swing]


def _savings(rows: Rows, swing: str, where: str, there: str) -> tuple[str, float]:
    """What the other reference takes off the trapezoid's figures; by how many points that moves."""
    kind = next(name for name in rows[0] if name != BASELINE)
    metrics = _judged(rows, swing)
    (peak, peak_there), (least, least_there) = (
        tuple(_off(by_kind[BASELINE][metric.name], by_kind[kind][metric.name]) for by_kind in rows)
        for metric in metrics
    )
    first, second = (metric.label.removeprefix("wire ") for metric in metrics)
    said = (
        f"{where}, {words_of(kind)} {_change(peak)} the trapezoid's {first} and "
        f"{_same_verb(peak, least)} its {second}; {there}, {_percent(peak, peak_there)} and "
        f"{_percent(least, least_there)}"
    )
    return said, max(abs(peak_there - peak), abs(least_there - least))


def _off(base: float, other: float) -> float:
    """Per cent that the other has less than the base; 0 where there is nothing to take off."""
    return 100.0 * (1.0 - other / base) if base else 0.0


def _change(percent: float) -> str:
    return f"adds {-percent:.0f} % to" if percent <= -0.5 else f"takes {abs(percent):.0f} % off"


def _same_verb(before: float, percent: float) -> str:
    """The change after one that has said its verb already."""
    said = _change(percent)
    return said.partition(" ")[2] if said.partition(" ")[0] == _change(before).partition(" ")[0] else said


def _percent(before: float, percent: float) -> str:
    """The figure there; with its verb where it has the other sign."""
    if (before <= -0.5) == (percent <= -0.5):
        return f"{abs(percent):.0f} %"
    return f"it {_change(percent).removesuffix(' to').removesuffix(' off')} {'more' if percent <= -0.5 else 'less'}"


def _figures(rows: Rows, swing: str, where: str, there: str) -> tuple[str, float]:
    """One reference's own figures; by how many per cent they move."""
    (kind,) = rows[0]
    metrics = _judged(rows, swing)
    texts = [
        " and a ".join(f"{metric.label.removeprefix('wire ')} of {metric.text(row[metric.name])} {metric.shown_unit}"
                       for metric in metrics)
        for row in (by_kind[kind] for by_kind in rows)
    ]  # fmt: skip
    moved = [abs(_off(*(by_kind[kind][metric.name] for by_kind in rows))) for metric in metrics]
    return f"{where}, {words_of(kind)} has a {texts[0]}; {there}, a {texts[1]}", max(moved)


FREE, EQUAL = "ruckig_least_peak", "ruckig_equal_time"
SAME = 0.005  # relative: limits and peaks that are alike
Moves = Sequence[Shape]


def from_the_bound(study: Study) -> list[str]:
    """At the heaviest payload the least peak in the trapezoid's time, how far the study's planned references are above
    it, and which pair of limits is free in that time. [] without a trapezoid, with jogs or a stop on the way, and
    where the load is not known or goes with its angle."""
    specs = {spec.reference: spec for spec in at_heaviest(study)}
    own = specs.get(BASELINE)
    load = None if own is None else load_of(own.machine, own.payload_kg)
    if own is None or own.limits is None or load is None or own.events.emergency_stop_s is not None:
        return []
    distances = _distances(own)
    if not distances:
        return []
    asked = _Asked(own, load)
    moves = {name: _moves(name, distances, own.limits, load) for name in specs if name in planned_kinds()}
    where = f" at {own.payload_kg:g} kg" if set_of(kind_of(own.machine).name).payload else ""
    try:
        best = [
            least_peak_move(d, own.limits.towards(d).speed_m_s, shape.duration_s, load)
            for d, shape in zip(distances, moves[BASELINE], strict=True)
        ]
    except InputError:
        return [f"No motion in the {BASELINE}'s time{where} keeps to {asked.word}, speed and a taut wire."]
    least = asked.peak(best) / (1.0 + GIVEN_AWAY)
    away = [(100.0 * (asked.peak(own_moves) / least - 1.0), name) for name, own_moves in moves.items()]
    beside = "pin" if kind_of(own.machine).name == "hoist" else "viscous"
    said = (
        f"Followed exactly, no motion in the {BASELINE}'s time{where} has a {asked.word} peak below "
        f"{asked.said(least)}, {beside} friction and the loop's errors left out."
    )
    for side, chosen in (("Above", [a for a in away if a[0] >= 0.0]), ("Below", [a for a in away if a[0] < 0.0])):
        names = [
            f"{words_of(name)} by {abs(percent):.0f} %{_longer(moves[name], moves[BASELINE])}"
            for percent, name in chosen
        ]
        said += f" {side} it {'is' if len(names) == 1 else 'are'} {listed(names)}." if names else ""
    return [said, *_free_pair(moves, distances, own.limits, asked)]


@dataclass(frozen=True)
class _Asked:
    """What motions ask of the drive, in the unit of the study's tables: of a hoist one motor's torque."""

    spec: RunSpec
    load: Load

    @property
    def word(self) -> str:
        return set_of(kind_of(self.spec.machine).name).input_words

    def peak(self, moves: Moves) -> float:
        limit, of_load = peak_limit(self.spec.machine), self.load.force_limit_n
        scale = limit / of_load if math.isfinite(of_load) else 1.0
        return scale * max(peak_force_n(shape, self.load) for shape in moves)

    def said(self, peak: float) -> str:
        judged = set_of(kind_of(self.spec.machine).name)
        return f"{judged.by_name[judged.peak].text(peak)} {judged.input_unit}"


def _distances(spec: RunSpec) -> list[float]:
    """Of the moves from rest to rest; [] where there is a jog."""
    here, distances = spec.start_position_m, []
    for step in spec.moves:
        if step.speed_m_s is not None:
            return []
        if step.dwell_s is None:
            target = here + step.by_m if step.by_m is not None else step.to_m
            assert target is not None
            distances.append(target - here)
            here = target
    return list(dict.fromkeys(distances))


def _moves(name: str, distances: Sequence[float], limits: LimitPair, load: Load) -> Moves:
    return [move_shape(planned_kind(name), d, limits.towards(d), load) for d in distances]


def _longer(moves: Moves, base: Moves) -> str:
    more = sum(shape.duration_s for shape in moves) - sum(shape.duration_s for shape in base)
    return f" ({abs(more):.2g} s {'longer' if more > 0.0 else 'shorter'})" if abs(more) > 1e-3 else ""


def _free_pair(moves: Mapping[str, Moves], distances: Sequence[float], limits: LimitPair, asked: _Asked) -> list[str]:
    """Where the study takes one of the pairs of acceleration and jerk that give the trapezoid's time: which are free,
    and which has the least peak."""
    if not {EQUAL, FREE} & set(moves):
        return []
    unit = kind_of(asked.spec.machine).moved.unit
    pairs = []
    for name in (EQUAL, FREE):
        own = moves.get(name) or _moves(name, distances, limits, asked.load)
        a, j = own[0].limits.acceleration_m_s2, own[0].limits.jerk_m_s3
        pairs.append(f"{a:.3g} {unit}/s² and {_short(j)} {unit}/s³ ({asked.said(asked.peak(own))})")
    trapezoid = limits.towards(distances[0]).acceleration_m_s2
    same = own[0].limits.acceleration_m_s2 < (1.0 + SAME) * trapezoid
    return [
        f"In that time the acceleration is free, and each has its jerk: {EQUAL} takes {pairs[0]}; of all pairs the "
        f"least peak is at {pairs[1]}{', the trapezoid but for its corners' if same else ''}."
    ]


def _short(value: float) -> str:
    return f"{value:.3g}" if value < 1000.0 else f"{float(f'{value:.3g}'):.0f}"
