"""One run in the index of a study."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

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


@dataclass(frozen=True)
class Row:
    """What a run was, how it went, its metrics under the names of the format.

    assigned: what a sweep or a sample has set in this run, by the field's place in the scenario.
    """

    run_id: str
    scenario: str
    status: str
    reason: str
    payload_kg: float
    reference: str
    metrics: Mapping[str, float | None]
    assigned: Mapping[str, float | str] = field(default_factory=dict)

    def __getitem__(self, metric: str) -> float:
        value = self.metrics[metric]
        return float("nan") if value is None else value

    @property
    def ok(self) -> bool:
        return self.status == "ok"
