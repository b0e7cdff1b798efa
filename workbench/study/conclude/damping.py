"""How much a study's answer hangs on the damping assumed for the wire: its heaviest load again on another wire."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from workbench.kinds import load_of
from workbench.machine import Axis, Hoist
from workbench.references import BASELINE, planned_kinds
from workbench.study.conclude.side_studies import at_heaviest
from workbench.study.execute.chunk import run_specs
from workbench.study.results.labels import field_label
from workbench.study.results.row import Row
from workbench.study.scenario.load import Study, plan_study
from workbench.study.scenario.record import Scenario
from workbench.study.variations.run_spec import RunSpec

RINGING = 0.02  # damping ratio assumed for a wire that rings; its range: the machine `lightly_damped`
PAPER_S = 0.1  # c/k of the paper's wire
_PAPERS = f"the paper's assumption of c/k = {PAPER_S:g} s"
PEAK, SWING = "peak_torque_above_static_nm", "wire_tension_swing_n"
HARDLY = 2.0  # per cent that a figure, points that a saving may move and still hang little on the damping


def damping_sentence(scenario: Scenario, machine: Hoist | Axis) -> str | None:
    """What another wire makes of the answer; None where nothing hangs on a wire."""
    return on_another_wire(plan_study(scenario, machine))


def on_another_wire(study: Study) -> str | None:
    """The heaviest load on its wire and on one that rings; on the paper's where its own rings. Of the multi-body
    machine the lumped one says it. None where nothing hangs on a wire, or a run fails."""
    own = heaviest_runs(study)
    load = load_of(own[0].machine, own[0].payload_kg)
    if load is None or not load.hangs:
        return None
    rings = load.damping <= 1.5 * RINGING
    time_s = PAPER_S if rings else 2.0 * RINGING / load.angular_frequency_rad_s
    other = [replace(spec, machine=_on(cast(Hoist, spec.machine), time_s)) for spec in own]
    rows = [{row.reference: row for row, _ in run_specs(specs)} for specs in (own, other)]
    if any(not row.ok for by_kind in rows for row in by_kind.values()):
        return None
    swept = "".join(f", {field_label(name).of(value)}" for name, value in own[0].assigned.items())
    where = f"at {own[0].payload_kg:g} kg{swept} and the damping ratio assumed, {load.damping:.2g}"
    lumped = "" if study.scenario.plant == "lumped" else ", on the lumped machine"
    ratio = replace(load, damping_time_s=time_s).damping
    there = f"at {ratio:.2g}, {_PAPERS if rings else 'a wire that rings'}"
    said, moved = _savings(rows, where, there) if len(own) > 1 else _figures(rows, where, there)
    return f"The answer {'hangs little' if moved < HARDLY else 'hangs'} on the wire's damping{lumped}: {said}."


def heaviest_runs(study: Study) -> list[RunSpec]:
    """At the heaviest payload the trapezoid and another planned reference, or what there is of them, else the first
    reference; without sweep, sample and signals, on the lumped machine."""
    runs = at_heaviest(study)
    known = planned_kinds()
    others = [spec for spec in runs if spec.reference in known and spec.reference != BASELINE]
    return [spec for spec in runs if spec.reference == BASELINE] + others[:1] or runs[:1]


def _on(machine: Hoist, damping_time_s: float) -> Hoist:
    return machine.model_copy(update={"wire": machine.wire.model_copy(update={"damping_time_s": damping_time_s})})


Rows = Sequence[dict[str, Row]]


def _savings(rows: Rows, where: str, there: str) -> tuple[str, float]:
    """What the other reference takes off the trapezoid's figures; by how many points that moves."""
    kind = next(name for name in rows[0] if name != BASELINE)
    (peak, peak_there), (swing, swing_there) = (
        tuple(100.0 * (1.0 - by_kind[kind][metric] / by_kind[BASELINE][metric]) for by_kind in rows)
        for metric in (PEAK, SWING)
    )
    said = (
        f"{where}, {kind} takes {peak:.0f} % off the trapezoid's torque peak above static and {swing:.0f} % off its "
        f"tension swing; {there}, {peak_there:.0f} % and {swing_there:.0f} %"
    )
    return said, max(abs(peak_there - peak), abs(swing_there - swing))


def _figures(rows: Rows, where: str, there: str) -> tuple[str, float]:
    """One reference's own figures; by how many per cent they move."""
    (kind,) = rows[0]
    (peak, peak_there), (swing, swing_there) = (
        tuple(by_kind[kind][metric] for by_kind in rows) for metric in (PEAK, SWING)
    )
    said = (
        f"{where}, {kind} has a torque peak above static of {peak:.0f} N m and a tension swing of {swing / 1e3:.1f} "
        f"kN; {there}, {peak_there:.0f} N m and {swing_there / 1e3:.1f} kN"
    )
    return said, 100.0 * max(abs(peak_there / peak - 1.0), abs(swing_there / swing - 1.0))
