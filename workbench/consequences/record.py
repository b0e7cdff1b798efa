"""The records of a comparison, without and with the effects, and their form as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from workbench.consequences.motion import SmallStudy
from workbench.json_records import plain
from workbench.kinds import Kind
from workbench.metrics import set_of

METRICS = (
    "peak_torque_motor_nm",
    "peak_torque_percent",
    "speed_error_max_rad_s",
    "speed_error_rms_rad_s",
    "min_wire_tension_n",
    "move_time_s",
)


def metrics_for(kind: Kind) -> tuple[str, ...]:
    """What a run of the small study is told by: METRICS of a hoist, the like of an axis."""
    if kind.payload:
        return METRICS
    judged = set_of(kind.name)
    return (
        judged.peak,
        judged.rms,
        judged.error,
        judged.rms_error,
        "settling_time_s",
        "energy_motoring_j",
        "move_time_s",
    )


@dataclass(frozen=True)
class RunFigures:
    """One run of the small study, metrics as in the index of a study: those of `metrics_for` its kind.

    All NaN but the move time where the run failed; `reason` says why.
    """

    reason: str
    values: Mapping[str, float]

    def __getitem__(self, metric: str) -> float:
        return self.values[metric]

    @property
    def ok(self) -> bool:
        return not self.reason


@dataclass(frozen=True)
class Change:
    """One payload under one reference, without (before) and with (after) the effects."""

    payload_kg: float
    reference: str
    before: RunFigures
    after: RunFigures

    @property
    def ok(self) -> bool:
        return self.before.ok and self.after.ok

    def percent(self, metric: str) -> float:
        """By how much a metric changes; NaN where a run failed."""
        return percent(self.before[metric], self.after[metric])


@dataclass(frozen=True)
class LoopFigures:
    """The least margins of a machine's loops over payloads and heights; none means anything of an unstable one.

    payload_kg, height_m: of the loop with the largest Ms, or of the unstable one. gain_margin_db: inf where no gain
    above loses it. ms: largest |S|.
    """

    payload_kg: float
    height_m: float
    stable: bool
    gain_margin_db: float
    phase_margin_deg: float
    ms: float
    crossover_hz: float
    bandwidth_hz: float


@dataclass(frozen=True)
class Gains:
    """What loop shaping recommends for one machine; NaN where it finds nothing, and `reason` says why.

    names: of the two in a controller block, with their units.
    """

    kp: float
    ki: float
    names: tuple[str, str]
    reason: str = ""

    @property
    def ok(self) -> bool:
        return not self.reason


@dataclass(frozen=True)
class Choice:
    """The better reference by a metric at a payload (None: the worst of all payloads), before and after.

    A name of a reference, "alike" where they differ by less than 0.5 %, "" where a run failed.
    """

    metric: str
    payload_kg: float | None
    before: str
    after: str

    @property
    def changed(self) -> bool:
        return bool(self.before and self.after) and self.before != self.after


@dataclass(frozen=True)
class Consequences:
    """What changes in the control study once the effects are known.

    effects: the new ones by name, `measured_correction` among them where there is a new table.
    gains_goal: (bandwidth in Hz, or None for best rejection of load steps; bound on Ms and Mt) that the
    recommended gains are for. old_gains_bandwidth_hz: what the old recommendation gives the machine with
    its effects, NaN where that is unstable or there is none. sentences: what a reader should know, in order.
    """

    effects: tuple[str, ...]
    study: SmallStudy
    rows: tuple[Change, ...]
    loop_before: LoopFigures
    loop_after: LoopFigures
    gains_goal: tuple[float | None, float]
    gains_before: Gains
    gains_after: Gains
    old_gains_bandwidth_hz: float
    choices: tuple[Choice, ...]
    sentences: tuple[str, ...]

    @property
    def better_reference_changes(self) -> bool:
        """By torque peak or tracking error, over all payloads or at one of them."""
        return any(choice.changed for choice in self.choices)


def percent(before: float, after: float) -> float:
    """Change in per cent; NaN where there is nothing to compare with."""
    return 100.0 * (after - before) / abs(before) if before else (0.0 if after == before else math.nan)


def as_json(consequences: Consequences) -> dict[str, Any]:
    """Plain mappings and lists, six significant digits; null for what is no finite number."""
    c, kind = consequences, consequences.study.kind
    bandwidth, ms = c.gains_goal
    said: dict[str, Any] = plain(
        {
            "effects": c.effects,
            "study": c.study.as_json(),
            "rows": [_row(row, kind) for row in c.rows],
            "loop": {"before": _loop(c.loop_before, kind), "after": _loop(c.loop_after, kind)},
            "gains": {
                "goal": {"bandwidth_hz": bandwidth, "ms": ms},
                "before": _gains(c.gains_before),
                "after": _gains(c.gains_after),
                "old_gains_bandwidth_hz": c.old_gains_bandwidth_hz,
            },
            "better_reference": [_placed(vars(choice), kind) | {"changed": choice.changed} for choice in c.choices],
            "sentences": c.sentences,
        }
    )
    return said


def _placed(record: Mapping[str, Any], kind: Kind) -> dict[str, Any]:
    """Without the payload where the kind carries none, the height as its place."""
    if kind.payload:
        return dict(record)
    said = {name: value for name, value in record.items() if name != "payload_kg"}
    return {f"position_{kind.moved.unit}" if name == "height_m" else name: value for name, value in said.items()}


def _row(row: Change, kind: Kind) -> dict[str, Any]:
    runs = {when: {"reason": run.reason, **run.values} for when, run in (("before", row.before), ("after", row.after))}
    change = {name: row.percent(name) for name in metrics_for(kind)}
    return _placed(vars(row), kind) | runs | {"change_percent": change}


def _loop(loop: LoopFigures, kind: Kind) -> dict[str, Any]:
    return _placed(vars(loop), kind)


def _gains(gains: Gains) -> dict[str, Any]:
    return {**dict(zip(gains.names, (gains.kp, gains.ki), strict=True)), "reason": gains.reason}
