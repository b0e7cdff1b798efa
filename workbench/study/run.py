"""Some runs of a study, simulated together.
A study run in one go: all its rows and signals, held in memory.
The runs of a study, labelled for a file of their signals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.core.shown import Shown
from workbench.logs.signal_files import Labelled
from workbench.machines import AnyKind, Machine, kind_of
from workbench.metrics import RunFacts, columns, run_metrics, set_of
from workbench.references import Plan
from workbench.simulate.loop import LoopCase, LoopResult, Outcome, simulate_loop
from workbench.study.grid import RunSpec
from workbench.study.rows import Row

if TYPE_CHECKING:
    from workbench.study.load import Study


def run_specs(specs: Sequence[RunSpec], threads: int | None = None) -> list[tuple[Row, Run | None]]:
    """The row of each run, in the order given, and its signals where the run keeps them.

    Runs that share a kernel are simulated side by side. A run that is not possible, or goes
    wrong on its way, is a row with its reason; the others go on.
    """
    done: dict[int, tuple[Row, Run | None]] = {}
    cases: dict[tuple[int, float, str], list[tuple[int, RunSpec, Plan, LoopCase]]] = {}
    for index, spec in enumerate(specs):
        try:
            plan = spec.plan()
        except InputError as error:
            done[index] = (_row(spec, {}, str(error)), None)
            continue
        case = case_of(spec, plan)
        cases.setdefault((spec.record_every, spec.step_s, spec.plant), []).append((index, spec, plan, case))
    for (record_every, step_s, plant), group in cases.items():
        results = _side_by_side(plant, [case for *_, case in group], record_every, step_s, threads)
        for (index, spec, plan, _), result in zip(group, results, strict=True):
            if isinstance(result, str):
                done[index] = (_row(spec, {}, result), None)
            else:
                done[index] = (_finished(spec, plan, result), result.run if record_every else None)
    return [done[index] for index in range(len(specs))]


def case_of(spec: RunSpec, plan: Plan | None = None) -> LoopCase:
    """The closed loop of a run; plan: where it is made already. InputError where its motion is not possible."""
    speed, position = driven_motion(spec, spec.plan() if plan is None else plan)
    return LoopCase(
        name=spec.run_id,
        machine=spec.machine,
        payload_kg=spec.payload_kg,
        start_position_m=spec.start_position_m,
        controller=spec.controller,
        speed_reference_rad_s=speed,
        events=spec.events,
        position_reference=position,
    )


def _side_by_side(
    plant: str, cases: Sequence[LoopCase], record_every: int, step_s: float, threads: int | None
) -> list[LoopResult | str]:
    """The result of each case, or why it could not begin: such a case takes no other with it."""
    try:
        if plant == "multibody":  # one after the other: it has no lanes, and workers share a study's runs anyway
            from workbench.simulate.models import simulate_multibody_loop

            return [simulate_multibody_loop(case, record_every=record_every, step_s=step_s) for case in cases]
        return list(simulate_loop(cases, record_every=record_every, step_s=step_s, threads=threads))
    except (ArithmeticError, ValueError, InputError) as error:
        if len(cases) == 1:
            return [str(error)]
    return [result for case in cases for result in _side_by_side(plant, [case], record_every, step_s, threads)]


def driven_motion(spec: RunSpec, plan: Plan) -> tuple[Array, Array | None]:
    """The driven coordinate's speed at the controller's samples; its position where the controller follows that."""
    loop = kind_of(spec.machine).looped
    per_displacement = loop.per_displacement(spec.machine)
    return _sampled(plan, spec.controller.sample_time_s, spec.duration_s, per_displacement, loop.position_loop)


@lru_cache(maxsize=32)
def _sampled(
    plan: Plan, sample_time_s: float, duration_s: float, per_displacement: float, placed: bool
) -> tuple[Array, Array | None]:
    """Cached by the plan's identity: equal motions are one plan."""
    if not placed:
        return plan.speed_at(plan.times(sample_time_s, duration_s)) * per_displacement, None
    profile = plan.sample(sample_time_s, duration_s)
    return profile.speed_m_s * per_displacement, profile.position_m * per_displacement


def _finished(spec: RunSpec, plan: Plan, result: LoopResult) -> Row:
    facts = RunFacts(
        move_windows=plan.move_windows,
        acceleration_m_s2=plan.acceleration_m_s2,
        hold_torque_nm=result.hold_torque_nm,
        end_position_m=result.end_position_m,
        reference_end_m=plan.end_position_m,
    )
    kinds_metrics = set_of(kind_of(spec.machine).name)
    own = {metric.name: float(metric.value(facts)) for metric in run_metrics(kinds_metrics)}
    reason = "" if result.outcome is Outcome.COMPLETED else _reason(spec, result)
    return _row(spec, result.metrics | own, reason)


def _row(spec: RunSpec, measured: dict[str, float], reason: str) -> Row:
    """The row of a run. A failed run has no metrics but those that are known before it runs."""
    known = set_of(kind_of(spec.machine).name)
    run = {metric.name: metric for metric in run_metrics(known)}
    # What only some machines have, such as a wire whose breaking load is known, is empty where a run has failed.
    optional = [name for name in measured if name not in run]
    if reason:
        optional += [metric.name for metric in known.observer.metrics if metric.optional]
    names = dict.fromkeys((*(name for name in columns(known) if name not in run or run[name].fixed), *optional, *run))
    return Row(
        run_id=spec.run_id,
        scenario=spec.scenario,
        status="failed" if reason else "ok",
        reason=reason,
        payload_kg=spec.payload_kg,
        reference=spec.reference,
        metrics={
            name: measured.get(name) if not reason or (name in run and run[name].known_before) else None
            for name in names
        },
        assigned=spec.assigned,
    )


def _reason(spec: RunSpec, result: LoopResult) -> str:
    reason = ", ".join(part for part in (result.outcome.value, result.at) if part)
    kind = kind_of(spec.machine)
    most, unit = kind.looped.input_limit(spec.machine), kind.drive.unit
    if abs(result.hold_torque_nm) > most:
        gives = f"{kind.looped.giver} at most {most:.0f} {unit}"
        reason += f"; holding the load takes {result.hold_torque_nm:.0f} {unit}, {gives}"
    return reason


@dataclass(frozen=True, repr=False)
class StudyResult(Shown):
    """All rows in the order of the scenario, and the signals of the runs by run_id. folder: where they are kept."""

    study: Study
    rows: Sequence[Row]
    runs: Mapping[str, Run] = field(default_factory=dict)
    folder: Path | None = None
    manifest: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.study.scenario.name

    @property
    def machine(self) -> AnyKind:
        return self.study.machine

    @property
    def scenario(self) -> dict[str, Any]:
        """As its file has it, complete."""
        return self.study.scenario.model_dump(mode="json", exclude_none=True)


def run_study(study: Study) -> StudyResult:
    """Simulate all runs of a study. A run that fails is a row with its reason."""
    done = run_specs(study.specs)
    runs = {row.run_id: run for row, run in done if run is not None}
    return StudyResult(study, [row for row, _ in done], runs)


def peak_limit(machine: Machine) -> float:
    """What the largest input of a run is held against: one motor's largest torque, an axis' largest force or torque.

    inf where none is stated.
    """
    return kind_of(machine).looped.peak_limit(machine)


def labelled_runs(result: StudyResult) -> list[Labelled]:
    """Each run that kept its signals, with its payload and reference."""
    return [
        Labelled(
            f"run_{row.reference}_{row.payload_kg:g}kg",
            {"run": row.run_id, "payload_kg": row.payload_kg, "reference": row.reference},
            result.runs[row.run_id],
        )
        for row in result.rows
        if row.run_id in result.runs
    ]
