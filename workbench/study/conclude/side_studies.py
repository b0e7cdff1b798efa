"""Side studies: the same motion at other payloads and under other limits. Metrics only."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from workbench.machine import Hoist
from workbench.study.scenario.load import Study, plan_study
from workbench.study.scenario.record import Scenario
from workbench.study.scenario.standalone import changed

_ONLY_METRICS: dict[str, Any] = {"outputs": {"signals": "none"}, "sweep": None, "sample": None}


def over_payload(scenario: Scenario, machine: Hoist, payloads_kg: Sequence[float]) -> Study:
    """The scenario at these payloads, with its own among them."""
    payloads = tuple(sorted({*payloads_kg, *(scenario.payloads_kg or ())}))
    return plan_study(changed(scenario, {"payloads_kg": payloads, **_ONLY_METRICS}), machine)


def over_ramps(
    scenario: Scenario, machine: Hoist, accelerations_m_s2: Sequence[float], jerks_m_s3: Sequence[float]
) -> Study:
    """The scenario's references at its heaviest payload, each acceleration with each jerk, both ways alike."""
    sweep = {
        "limits.acceleration_m_s2": [float(value) for value in accelerations_m_s2],
        "limits.jerk_m_s3": [float(value) for value in jerks_m_s3],
    }
    heaviest = (max(scenario.payloads_kg or (0.0,)),)
    return plan_study(changed(scenario, {"payloads_kg": heaviest, **_ONLY_METRICS, "sweep": sweep}), machine)
