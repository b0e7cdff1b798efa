"""Side studies, metrics only: the heaviest payload, other payloads, other limits, another damping, equal times."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from workbench.control import Events
from workbench.core.errors import InputError
from workbench.machines import Axis, Hoist, kind_of, load_of, with_values
from workbench.references import BASELINE, LimitPair, Limits, motion_time_s, planned_kinds
from workbench.study.grid import RunSpec
from workbench.study.labels import field_label, words_of
from workbench.study.load import Study, changed, plan_study
from workbench.study.rows import Row, metrics_of
from workbench.study.run import run_specs
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
HARDLY = 2.0  # per cent that a figure may move and still depend little on the damping


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
    rings = load.damping <= 1.5 * RINGING
    if load.hangs:
        name, path, swing, scale = "wire", "wire.damping_time_s", "wire_tension_swing_n", 1.0
        damped_s, damped = PAPER_S, f"the paper's assumption of c/k = {PAPER_S:g} s"
    else:
        name, path, swing = "coupling", "coupling.damping_nm_s_per_rad", "settling_time_s"
        scale, damped_s = load.stiffness_n_per_m, 2.0 * ELASTOMER / load.angular_frequency_rad_s
        damped = "a coupling with an elastomer spider"
    time_s = damped_s if rings else 2.0 * RINGING / load.angular_frequency_rad_s
    changes = {path: scale * time_s}
    other = [replace(spec, machine=with_values(spec.machine, changes)) for spec in own]
    before, after = ([row for row, _ in run_specs(specs)] for specs in (own, other))
    if not all(row.ok for row in (*before, *after)):
        return None
    judged, pairs = metrics_of(before), list(zip(before, after, strict=True))
    metrics = [judged.by_name[judged.peak], judged.by_name[swing]]
    moved = max(abs(b[m.name] / a[m.name] - 1.0) for a, b in pairs for m in metrics if a[m.name])
    swept = ", ".join(field_label(column).of(value) for column, value in own[0].assigned.items())
    where = " and ".join(part for part in (f"{own[0].payload_kg:g} kg" if load.hangs else "", swept) if part)
    depends = "depends little" if 100.0 * moved < HARDLY else "depends"
    lumped = "" if study.scenario.plant == "lumped" else ", on the lumped machine"
    ratio = replace(load, damping_time_s=time_s).damping
    figures = []
    for a, b in pairs:
        texts = [f"{m.label} {m.text(b[m.name])} {m.shown_unit} (else {m.text(a[m.name])})" for m in metrics]
        figures.append(f"{words_of(a.reference)} {' and '.join(texts)}")
    return (
        f"The answer {depends} on the {name}'s damping{lumped}: {f'at {where}, ' if where else ''}at damping ratio "
        f"{ratio:.2g}, {damped if rings else f'a {name} that rings'}, in place of the {load.damping:.2g} assumed, "
        f"{'; '.join(figures)}."
    )


def heaviest_runs(study: Study) -> list[RunSpec]:
    """At the heaviest payload the trapezoid and another planned reference, or what there is of them, else the first
    reference; without sweep, sample and signals, on the lumped machine."""
    runs = at_heaviest(study)
    known = planned_kinds()
    others = [spec for spec in runs if spec.reference in known and spec.reference != BASELINE]
    return [spec for spec in runs if spec.reference == BASELINE] + others[:1] or runs[:1]


TIMES = (1.0, 1.02, 1.05, 1.1, 1.2)  # of the quickest: where the curves over move time have their points
JERKS = (1.0, 3.0, 9.0)  # times the limits' own ratio of jerk to acceleration, that the best is chosen from
GENTLEST = 1e-3  # of the acceleration that is given: slower is not sought
MOST_PAYLOADS = 3
MOST_SPECS = 4096  # of a sweep, among which the trapezoid's are sought
SAME_S = 5e-3


def beside(study: Study) -> list[Row]:
    """The runs that a study is compared with: at equal times, or the trapezoid in a sweep of jerk that lacks it."""
    sweep = study.scenario.sweep
    swept = {} if sweep is None else sweep.grid | sweep.zip
    if not any("jerk" in name for name in swept) or BASELINE in study.scenario.kinds or study.scenario.sample:
        return at_equal_times(study)
    specs: dict[tuple[object, ...], RunSpec] = {}
    for spec in study.specs[:MOST_SPECS]:
        rest = {name: value for name, value in spec.assigned.items() if "jerk" not in name}
        own = replace(spec, reference=BASELINE, assigned=rest, record_every=0, run_id=f"{spec.run_id}_{BASELINE}")
        if not spec.problem and spec.recording is None:
            specs.setdefault((spec.payload_kg, *rest.items()), own)
    return [row for row, _ in run_specs(list(specs.values()))]


def at_equal_times(study: Study) -> list[Row]:
    """Each family of references slowed down to each other's times and to points beyond, speed limit kept.

    Those with a jerk limit take several ratios of jerk to acceleration; the trapezoid is always among them. The limits
    stand in the rows as a sweep of them would. [] where sweep, sample, events or jogs leave no such comparison.
    """
    scenario = study.scenario
    jogs = any(step.speed_m_s is not None for step in study.specs[0].moves)
    if scenario.sweep or scenario.sample or scenario.events != Events() or scenario.plant != "lumped" or jogs:
        return []
    payloads = sorted({spec.payload_kg for spec in study.specs})
    if len(payloads) > MOST_PAYLOADS:
        payloads = [payloads[0], payloads[len(payloads) // 2], payloads[-1]]
    kinds = planned_kinds()
    specs: list[RunSpec] = []
    for payload in payloads:
        own = {s.reference: s for s in study.specs if s.payload_kg == payload and not s.problem}
        own = {name: spec for name, spec in own.items() if name in kinds}
        if not own:
            continue
        families = {n: s for n, s in own.items() if not kinds[n].same_time_as and not kinds[n].needs_load}
        families.setdefault(BASELINE, replace(next(iter(own.values())), reference=BASELINE))
        times = [_duration_s(spec, spec.limits) for spec in own.values()]
        wanted = sorted({round(time, 3) for time in (*times, *(min(times) * factor for factor in TIMES))})
        for name, spec in families.items():
            for ratio in JERKS if kinds[name].needs_jerk else (1.0,):
                specs += _slowed(spec, wanted, ratio)
    return [row for row, _ in run_specs(specs)]


def _slowed(spec: RunSpec, wanted: Sequence[float], ratio: float) -> Iterator[RunSpec]:
    """The run with acceleration and jerk lowered until its moves take each of the times; quicker ones are left out."""
    from scipy.optimize import brentq

    own = spec.limits
    assert own is not None
    unit = kind_of(spec.machine).moved.unit
    for time_s in wanted:

        def late(log_factor: float, time_s: float = time_s, own: LimitPair = own) -> float:
            return _duration_s(spec, _scaled(own, math.exp(log_factor), ratio)) - time_s

        if ratio == 1.0 and abs(late(0.0)) < SAME_S:
            continue  # the study's own run
        if late(0.0) > -SAME_S or late(math.log(GENTLEST)) < 0.0:
            continue
        limits = _scaled(own, math.exp(brentq(late, math.log(GENTLEST), 0.0, xtol=1e-6)), ratio)
        a, j = limits.hoisting.acceleration_m_s2, limits.hoisting.jerk_m_s3
        assigned = {f"sweep.limits.{key_in(unit, 'acceleration_m_s2')}": float(f"{a:.4g}")}
        if planned_kinds()[spec.reference].needs_jerk:
            assigned[f"sweep.limits.{key_in(unit, 'jerk_m_s3')}"] = float(f"{j:.4g}")
        yield replace(
            spec, run_id=f"{spec.run_id}_{time_s:g}s_{ratio:g}", limits=limits, assigned=assigned, record_every=0,
            duration_s=max(spec.duration_s, spec.lead_s + time_s + spec.settle_s),
        )  # fmt: skip


def _scaled(pair: LimitPair, factor: float, ratio: float) -> LimitPair:
    """Accelerations times the factor, jerks times it and the ratio."""
    ways = (
        Limits(one.speed_m_s, factor * one.acceleration_m_s2, factor * ratio * one.jerk_m_s3)
        for one in (pair.hoisting, pair.lowering)
    )
    return LimitPair(*ways)


def _duration_s(spec: RunSpec, limits: LimitPair | None) -> float:
    assert limits is not None
    rail, load = kind_of(spec.machine).looped.rail(spec.machine), load_of(spec.machine, spec.payload_kg)
    return motion_time_s((spec.reference,), spec.moves, spec.start_position_m, limits, rail, load)
