"""The references that follow a campaign's run; `workbench.references.recorded` plans them."""

from __future__ import annotations

from workbench.references.kind import RecordedKind

RECORDED = RecordedKind(
    name="recorded",
    label="recorded",
    definition="the logged set-point of a run (`speed_reference_rad_s`, or the measured speed where none was logged), "
    "from that run's start position",
)
S_CURVE = RecordedKind(
    name="s_curve",
    label="recorded, smoothed",
    definition="the same as a moving average over `smoothing_s`, which turns ramps into S-curves",
    smoothed=True,
)
