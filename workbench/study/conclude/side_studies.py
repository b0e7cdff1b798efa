"""Side studies: the same motion at its heaviest payload, at other payloads, under other limits. Metrics only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from workbench.errors import InputError
from workbench.kinds import kind_of
from workbench.machine import Axis, Hoist
from workbench.study.scenario.load import Study, plan_study
from workbench.study.scenario.record import Scenario, key_in
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
