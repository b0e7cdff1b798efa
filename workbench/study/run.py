"""A study run: every payload with every reference, as rows and signals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from workbench.machine import Hoist
from workbench.references import motor_speed_rad_s
from workbench.run import Run
from workbench.simulate.loop import LoopCase, LoopResult, Outcome, simulate_loop
from workbench.study.load import Study

# Metrics that must stand in every index, in this order; what a loop reports beside them follows.
METRICS = (
    "peak_torque_motor_nm",
    "peak_torque_percent",
    "peak_torque_above_static_nm",
    "rms_torque_motor_nm",
    "speed_error_rms_rad_s",
    "speed_error_max_rad_s",
    "position_error_end_m",
    "min_wire_tension_n",
    "max_wire_tension_n",
    "slack_time_s",
    "move_time_s",
    "energy_motoring_j",
    "energy_regenerated_j",
)
RECORDED_EVERY_S = 0.01


@dataclass(frozen=True)
class Row:
    """One run in the index: what it was, how it went, its metrics under the names of the format."""

    run_id: str
    scenario: str
    status: str
    reason: str
    payload_kg: float
    reference: str
    metrics: Mapping[str, float | None]

    def __getitem__(self, metric: str) -> float:
        value = self.metrics[metric]
        return float("nan") if value is None else value

    @property
    def ok(self) -> bool:
        return self.status == "ok"


@dataclass(frozen=True)
class StudyResult:
    """All rows in the order of the scenario, and the signals of the runs by run_id."""

    study: Study
    rows: Sequence[Row]
    runs: Mapping[str, Run] = field(default_factory=dict)


def run_study(study: Study) -> StudyResult:
    """Simulate every payload with every reference. A run that fails is a row with its reason."""
    scenario, machine = study.scenario, study.machine
    sample_time = scenario.controller.sample_time_s
    profiles = {kind: plan.sample(sample_time, study.duration_s) for kind, plan in study.plans.items()}
    speeds = {
        kind: motor_speed_rad_s(profile.speed_m_s, machine.gearbox.ratio, machine.winch.drum_diameter_m)
        for kind, profile in profiles.items()
    }
    cases = [
        LoopCase(
            name=f"{payload:g}kg_{kind}",
            machine=machine,
            payload_kg=payload,
            start_position_m=scenario.start_position_m,
            controller=scenario.controller,
            speed_reference_rad_s=speeds[kind],
        )
        for payload in scenario.payloads_kg
        for kind in scenario.references
    ]
    kinds = [kind for _ in scenario.payloads_kg for kind in scenario.references]
    results = simulate_loop(cases, record_every=max(1, round(RECORDED_EVERY_S / sample_time)))
    rows = [_row(study, kind, result) for kind, result in zip(kinds, results, strict=True)]
    return StudyResult(study, rows, {row.run_id: result.run for row, result in zip(rows, results, strict=True)})


def motor_torque_limit_nm(machine: Hoist) -> float:
    """The largest torque of one motor."""
    return machine.motor.nominal_torque_nm * machine.drive.overload


def _row(study: Study, kind: str, result: LoopResult) -> Row:
    plan = study.plans[kind]
    ok = result.outcome is Outcome.COMPLETED
    own: dict[str, float | None] = {
        "position_error_end_m": result.end_position_m - plan.end_position_m,
        "move_time_s": sum(shape.duration_s for _, shape in plan.moves),
        "moves": float(len(plan.moves)),
        "hold_torque_nm": result.hold_torque_nm,
        "acceleration_limit_m_s2": max(shape.limits.acceleration_m_s2 for _, shape in plan.moves),
    }
    measured = result.metrics | own
    names = [*METRICS, *(name for name in measured if name not in METRICS)]
    # A failed run's figures are those of a run that did not take place.
    metrics = {name: measured[name] if ok or name in _KNOWN_BEFORE else None for name in names}
    reason = "" if ok else _reason(study, result)
    return Row(
        run_id=result.case.name,
        scenario=study.scenario.name,
        status="ok" if ok else "failed",
        reason=reason,
        payload_kg=result.case.payload_kg,
        reference=kind,
        metrics=metrics,
    )


def _reason(study: Study, result: LoopResult) -> str:
    reason = ", ".join(part for part in (result.outcome.value, result.at) if part)
    most = motor_torque_limit_nm(study.machine) * study.machine.motor.count
    if result.hold_torque_nm > most:
        reason += f"; holding the load takes {result.hold_torque_nm:.0f} N m, the motors give at most {most:.0f} N m"
    return reason


_KNOWN_BEFORE = ("move_time_s", "moves", "hold_torque_nm", "acceleration_limit_m_s2")
