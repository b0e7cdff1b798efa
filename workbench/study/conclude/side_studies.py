"""Side studies: the same motion at other payloads and under other limits. Metrics only."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from workbench.kinds import kind_of
from workbench.machine import Axis, Hoist
from workbench.study.scenario.load import Study, plan_study
from workbench.study.scenario.record import Scenario, key_in
from workbench.study.scenario.standalone import changed

_ONLY_METRICS: dict[str, Any] = {"outputs": {"signals": "none"}, "sweep": None, "sample": None}


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
