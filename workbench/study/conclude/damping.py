"""How much a study's answer hangs on the damping assumed for the wire: the heaviest load again on one that rings."""

from __future__ import annotations

from typing import Any

from workbench.kinds import load_of
from workbench.machine import Axis, Hoist
from workbench.references import BASELINE
from workbench.study.execute.run import run_study
from workbench.study.results.row import Row
from workbench.study.scenario.load import Study, plan_study
from workbench.study.scenario.record import Scenario
from workbench.study.scenario.standalone import changed

RINGING = 0.02  # damping ratio assumed for a wire that rings; its range: the machine `lightly_damped`
PEAK, SWING = "peak_torque_motor_nm", "wire_tension_swing_n"
HARDLY = 2.0  # points that a saving may move and still hang little on the damping
_ONLY_METRICS: dict[str, Any] = {"outputs": {"signals": "none"}, "sweep": None, "sample": None}


def ringing_study(scenario: Scenario, machine: Hoist | Axis, *, ringing: bool) -> Study:
    """The scenario at its heaviest payload, without sweep or sample; on a wire that rings, or on its own."""
    heaviest = max(scenario.payloads_kg or (0.0,))
    changes: dict[str, Any] = {**_ONLY_METRICS, "payloads_kg": (heaviest,)}
    plain = plan_study(changed(scenario, changes), machine)
    if not ringing:
        return plain
    load = load_of(plain.machine, heaviest)
    assert load is not None
    time_s = 2.0 * RINGING / load.angular_frequency_rad_s
    changes["machine_overrides"] = {**scenario.machine_overrides, "wire.damping_time_s": time_s}
    return plan_study(changed(scenario, changes), machine)


def damping_sentence(scenario: Scenario, machine: Hoist | Axis) -> str | None:
    """What a wire that rings makes of the answer; None for a study without a trapezoid or another planned reference,
    on another plant, or on a wire that rings itself."""
    others = [kind for kind in scenario.planned_kinds if kind != BASELINE]
    if BASELINE not in scenario.planned_kinds or not others or scenario.plant != "lumped":
        return None
    if any(not isinstance(reference, str) for reference in scenario.references) or scenario.start_position_m is None:
        return None
    nominal = load_of(machine, max(scenario.payloads_kg or (0.0,)))
    if nominal is None or not nominal.hangs:
        return None
    own = ringing_study(scenario, machine, ringing=False)
    payload = max(scenario.payloads_kg or (0.0,))
    load = load_of(own.machine, payload)
    if load is None or load.damping <= 1.5 * RINGING:
        return None
    studies = own, ringing_study(scenario, machine, ringing=True)
    rows = [{row.reference: row for row in run_study(study).rows if row.ok} for study in studies]
    kind = others[0]
    if any(name not in by_kind for by_kind in rows for name in (BASELINE, kind)):
        return None
    (peak, peak_ringing), (swing, swing_ringing) = (
        tuple(_saving(by_kind, kind, metric) for by_kind in rows) for metric in (PEAK, SWING)
    )
    hangs = max(abs(peak_ringing - peak), abs(swing_ringing - swing))
    much = "hangs little" if hangs < HARDLY else "hangs"
    return (
        f"The answer {much} on the wire's damping: at {payload:g} kg and the damping ratio assumed, "
        f"{load.damping:.2g}, {kind} takes {peak:.0f} % off the trapezoid's torque peak and {swing:.0f} % off its "
        f"tension swing; at {RINGING:g}, a wire that rings, {peak_ringing:.0f} % and {swing_ringing:.0f} %."
    )


def _saving(rows: dict[str, Row], kind: str, metric: str) -> float:
    """Per cent that a reference takes off the trapezoid's."""
    return 100.0 * (1.0 - rows[kind][metric] / rows[BASELINE][metric])
