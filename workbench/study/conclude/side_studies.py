"""Side studies: the same motion at its heaviest payload, at other payloads, under other limits. Metrics only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from workbench.errors import InputError
from workbench.machine import Hoist
from workbench.study.scenario.load import Study, plan_study
from workbench.study.scenario.record import Scenario
from workbench.study.scenario.standalone import changed
from workbench.study.variations.run_spec import RunSpec

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
    scenario: Scenario, machine: Hoist, accelerations_m_s2: Sequence[float], jerks_m_s3: Sequence[float]
) -> Study:
    """The scenario's references at its heaviest payload, each acceleration with each jerk, both ways alike."""
    sweep = {
        "limits.acceleration_m_s2": [float(value) for value in accelerations_m_s2],
        "limits.jerk_m_s3": [float(value) for value in jerks_m_s3],
    }
    heaviest = (max(scenario.payloads_kg or (0.0,)),)
    return plan_study(changed(scenario, {"payloads_kg": heaviest, **_ONLY_METRICS, "sweep": sweep}), machine)
