"""How much a study's answer hangs on the damping assumed between drive and load: the heaviest load runs again on
another wire or coupling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from workbench.kinds import Load, load_of
from workbench.machine import Axis, Hoist, with_values
from workbench.metrics import Metric
from workbench.references import BASELINE, planned_kinds
from workbench.study.conclude.side_studies import at_heaviest
from workbench.study.execute.chunk import run_specs
from workbench.study.results.labels import field_label
from workbench.study.results.row import Row, metrics_of
from workbench.study.scenario.load import Study, plan_study
from workbench.study.scenario.record import Scenario
from workbench.study.variations.run_spec import RunSpec
from workbench.study.variations.varying import words_of

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
