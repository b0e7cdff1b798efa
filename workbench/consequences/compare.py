"""The same small study of a machine without and with its effects: runs, loops, recommended gains, the choices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.analysis.family import family, operating_points, weakest
from workbench.analysis.search import Search, best_rejection, for_bandwidth, make_search
from workbench.analysis.tune import Goal
from workbench.consequences.motion import LEAD_S, REFERENCES, SmallStudy, small_study
from workbench.consequences.phases import at_phases
from workbench.consequences.record import (
    Change,
    Choice,
    Consequences,
    Gains,
    LoopFigures,
    RunFigures,
    metrics_for,
    percent,
)
from workbench.consequences.words import sentences_of
from workbench.control import Settings
from workbench.errors import InputError
from workbench.kinds import LOOPED, Kind, kind_of, looped
from workbench.machine import Axis, Hoist
from workbench.metrics import find, set_of
from workbench.references import motion_time_s
from workbench.run import Run
from workbench.study.conclude.variation_sentences import NO_CHANGE
from workbench.study.execute.chunk import run_specs
from workbench.study.results.row import Row
from workbench.study.variations.run_spec import RunSpec

MS_LIMIT = 1.4
NOT_STUDIED = (
    f"What changes in the control study is not said for an {{}}: studies, loop and tune are for machines of {LOOPED}."
)


def consequences_of(
    nominal: Hoist | Axis,
    corrected: Hoist | Axis,
    *,
    runs: Sequence[Run] = (),
    payloads_kg: Sequence[float] | None = None,
    controller: Settings | None = None,
    goal: Goal | None = None,
) -> tuple[Consequences | None, str]:
    """(what changes from the nominal to the corrected machine, "") or, of a kind that no study is for, (None, why not).

    runs: the campaign's, for payloads, limits and travel; see `small_study`. goal: what gains are recommended
    for; without it the bandwidth that the controller gives the nominal machine, with Ms and Mt at most 1.4.
    A run that fails is a row with its reason. InputError for effects that are unknown and for a payload or
    a controller that cannot be.
    """
    was, now = looped(nominal), looped(corrected)
    if was is None or now is None:
        return None, NOT_STUDIED.format(kind_of(nominal).noun)
    study = small_study(was, runs, payloads_kg=payloads_kg, controller=controller)
    rows = _rows(study, was, now)
    loops = tuple(_weakest_loop(machine, study) for machine in (was, now))
    wanted = goal or Goal(_bandwidth(loops[0]), MS_LIMIT)
    before, after, old = _gains(study, was, now, wanted)
    consequences = Consequences(
        effects=_new(was, now),
        study=study,
        rows=rows,
        loop_before=loops[0],
        loop_after=loops[1],
        gains_goal=(wanted.bandwidth_hz, wanted.ms_limit),
        gains_before=before,
        gains_after=after,
        old_gains_bandwidth_hz=old,
        choices=_choices(rows, study.kind),
        sentences=(),
    )
    return replace(consequences, sentences=sentences_of(consequences, now)), ""


def _new(nominal: Hoist | Axis, corrected: Hoist | Axis) -> tuple[str, ...]:
    """The effects that the nominal machine lacks or has with other values."""
    effects = [name for name, values in corrected.effects.items() if nominal.effects.get(name) != values]
    table = corrected.measured_correction
    return (*effects, *(["measured_correction"] if table not in (None, nominal.measured_correction) else []))


def _rows(study: SmallStudy, nominal: Hoist | Axis, corrected: Hoist | Axis) -> tuple[Change, ...]:
    """One row for each case, with the runs of both machines."""
    cases = [(payload, reference) for payload in study.payloads_kg for reference in REFERENCES]
    rail = study.kind.looped.rail(nominal)
    length = motion_time_s(REFERENCES, study.moves, study.start_position_m, study.limit_pair, rail)
    before, after = (_runs(study, cases, machine, length) for machine in (nominal, corrected))
    return tuple(Change(*case, was, is_now) for case, was, is_now in zip(cases, before, after, strict=True))


def _runs(
    study: SmallStudy, cases: Sequence[tuple[float, str]], machine: Hoist | Axis, length_s: float
) -> list[RunFigures]:
    """The runs of a machine; if it has values that differ from run to run, such as a phase, the worst of several."""
    # Machine by machine: as many runs at a time, so that one compiled kernel serves all.
    rows = [
        [row for row, _ in run_specs([_spec(study, machine_at_phase, *case, length_s) for case in cases])]
        for machine_at_phase in at_phases(machine)
    ]
    return [_worst(alike, metrics_for(study.kind)) for alike in zip(*rows, strict=True)]


def _spec(study: SmallStudy, machine: Hoist | Axis, payload_kg: float, reference: str, length_s: float) -> RunSpec:
    return RunSpec(
        run_id=f"{payload_kg:g}kg_{reference}",
        scenario="consequences",
        machine=machine,
        payload_kg=payload_kg,
        start_position_m=study.start_position_m,
        reference=reference,
        moves=study.moves,
        limits=study.limit_pair,
        lead_s=LEAD_S,
        settle_s=study.settle_s,
        duration_s=LEAD_S + length_s + study.settle_s,
        controller=study.controller,
        record_every=0,
    )


def _worst(rows: Sequence[Row], names: Sequence[str]) -> RunFigures:
    """The worst of each figure over the runs of one case; a failed run fails the case."""
    reason = next((row.reason for row in rows if not row.ok), "")
    worst = {name: find(name).worst([row[name] for row in rows]) if not reason else math.nan for name in names}
    return RunFigures(reason, worst | {"move_time_s": rows[0]["move_time_s"]})


def _weakest_loop(machine: Hoist | Axis, study: SmallStudy) -> LoopFigures:
    points = operating_points(machine, study.payloads_kg, study.heights_m)
    worst = weakest(family(machine, study.controller, points))
    m = worst.margins
    return LoopFigures(
        payload_kg=worst.point.payload_kg,
        height_m=worst.point.height_m,
        stable=m.stable,
        gain_margin_db=20.0 * math.log10(m.gain_up) if math.isfinite(m.gain_up) else math.inf,
        phase_margin_deg=m.phase_deg,
        ms=m.ms,
        crossover_hz=m.crossover_hz,
        bandwidth_hz=m.bandwidth_hz,
    )


def _bandwidth(loop: LoopFigures) -> float | None:
    """The bandwidth that the controller gives the nominal machine, two digits; None if the loop is unstable."""
    usable = loop.stable and math.isfinite(loop.bandwidth_hz)
    return float(f"{loop.bandwidth_hz:.2g}") if usable else None


def _gains(study: SmallStudy, nominal: Hoist | Axis, corrected: Hoist | Axis, goal: Goal) -> tuple[Gains, Gains, float]:
    """Recommended for each machine, and the bandwidth (Hz) that the first ones give the second machine."""
    ends = (study.payloads_kg[0], study.payloads_kg[-1])
    heights = (study.heights_m[0], study.heights_m[-1])
    searches = [
        make_search(machine, study.controller, operating_points(machine, tuple(dict.fromkeys(ends)), heights))
        for machine in (nominal, corrected)
    ]
    before, after = (_shaped(search, goal, study.controller.GAINS) for search in searches)
    if not before.ok:
        return before, after, math.nan
    judged = searches[1].judge(np.array([before.kp]), np.array([before.ki]))
    return before, after, float(judged.bandwidth_hz[0]) if judged.stable[0] else math.nan


def _shaped(search: Search, goal: Goal, names: tuple[str, str]) -> Gains:
    try:
        if goal.bandwidth_hz is None:
            shaped = best_rejection(search, goal.ms_limit)
        else:
            shaped = for_bandwidth(search, goal.bandwidth_hz, goal.ms_limit)
    except InputError as error:
        return Gains(math.nan, math.nan, names, error.problem)
    return Gains(float(f"{shaped.kp:.4g}"), float(f"{shaped.ki:.4g}"), names)


def _choices(rows: Sequence[Change], kind: Kind) -> tuple[Choice, ...]:
    """By each judged metric: over all payloads, then at each one."""
    payloads = tuple(dict.fromkeys(row.payload_kg for row in rows))
    judged = set_of(kind.name)
    return tuple(
        Choice(metric, payload, _better(rows, metric, payload, "before"), _better(rows, metric, payload, "after"))
        for metric in (judged.peak, judged.error, judged.rms_error)
        for payload in (None, *payloads)
    )


def _better(rows: Sequence[Change], metric: str, payload_kg: float | None, when: str) -> str:
    """The reference whose worst run is the better one."""
    here = [(row.reference, getattr(row, when)) for row in rows if payload_kg in (None, row.payload_kg)]
    if not all(run.ok for _, run in here):
        return ""
    worst = {kind: max(run[metric] for reference, run in here if reference == kind) for kind in REFERENCES}
    first, second = REFERENCES
    if abs(percent(worst[first], worst[second])) < 100.0 * NO_CHANGE:
        return "alike"
    return min(REFERENCES, key=lambda kind: worst[kind])
