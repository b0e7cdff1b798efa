"""The hoist under its sampled speed loop, one case or many."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from workbench.control import PI, PiSettings
from workbench.engine import kernels
from workbench.machine import Hoist
from workbench.metrics import HOIST_OBSERVER
from workbench.plants import HOIST
from workbench.run import Array, Run

RECORDED = (
    "torque_motor_nm",
    "speed_motor_rad_s",
    "speed_reference_rad_s",
    "position_carriage_m",
    "speed_carriage_m_s",
    "acceleration_carriage_m_s2",
    "tension_drum_n",
    "tension_dead_line_n",
    "tension_min_n",
)


class Outcome(enum.Enum):
    """How a simulation ended, as a sentence for the user."""

    COMPLETED = "completed"
    DIVERGED = "the state grew without bound: the loop is unstable or the load ran away"
    LEFT_THE_RAIL = "the carriage left the rail"


@dataclass(frozen=True)
class LoopCase:
    """One closed-loop run: a machine, a load, a controller and the motor speed it shall follow.

    speed_reference_rad_s: (n,) at the controller's samples.
    """

    name: str
    machine: Hoist
    payload_kg: float
    start_position_m: float
    controller: PiSettings
    speed_reference_rad_s: Array


@dataclass(frozen=True)
class LoopResult:
    """The run (signals at every `record_every`-th sample), its metrics, and how it ended.

    metrics are taken at every controller sample. end_position_m is the carriage's last height.
    """

    case: LoopCase
    run: Run
    metrics: dict[str, float]
    outcome: Outcome
    at: str
    end_position_m: float
    hold_torque_nm: float


def simulate_loop(
    cases: Sequence[LoopCase], *, record_every: int = 10, step_s: float = 0.001, threads: int | None = None
) -> list[LoopResult]:
    """Simulate cases that share a sample time; each starts hanging still, held without a bump.

    The plant takes steps of at most `step_s` (s) between samples. record_every = 0 keeps
    no signals. References of unequal length are held at their last value.
    """
    sample_time = _shared_sample_time(cases)
    n = max(len(case.speed_reference_rad_s) for case in cases)
    references = np.stack([_padded(case.speed_reference_rad_s, n) for case in cases], axis=-1)[:, None, :]
    values, starts, holds = [], [], []
    for case in cases:
        p = HOIST.values(case.machine, case.payload_kg)
        q, hold = HOIST.equilibrium(case.start_position_m, p)
        values.append(
            {**vars(p), **case.controller.values(torque_limit_nm(case.machine)), **_limits(case.machine, hold)}
        )
        starts.append([*q, 0.0, 0.0, 0.0])
        holds.append(hold)
    names = (*HOIST.parameters, *PI.parameters, *HOIST_OBSERVER.parameters)
    every = record_every or n + 1
    out, sums, ends = kernels.loop(
        HOIST,
        PI,
        HOIST_OBSERVER,
        RECORDED if record_every else (),
        np.array([[v[name] for v in values] for name in names]),
        references,
        sample_time,
        np.array(starts).T,
        np.array([holds]),
        every=every,
        substeps=max(1, round(sample_time / step_s)),
        threads=threads,
    )
    time = np.multiply(np.arange(out.shape[0]), sample_time * every, dtype=np.float64)
    return [
        _result(case, time, out[:, :, j], sums[:, j], ends[:, j], holds[j], values[j], n * sample_time)
        for j, case in enumerate(cases)
    ]


def torque_limit_nm(machine: Hoist) -> float:
    """The largest torque of all motors together."""
    return machine.motor.count * machine.motor.nominal_torque_nm * machine.drive.overload


def _limits(machine: Hoist, hold: float) -> dict[str, float]:
    return {"T_nominal": machine.motor.nominal_torque_nm, "T_hold": hold}


def _shared_sample_time(cases: Sequence[LoopCase]) -> float:
    times = {case.controller.sample_time_s for case in cases}
    if len(times) != 1:
        raise ValueError(f"cases of one call share a sample time; got {sorted(times)}")
    return times.pop()


def _padded(values: Array, n: int) -> Array:
    return np.concatenate([values, np.full(n - len(values), values[-1])])


def _result(
    case: LoopCase,
    time: Array,
    out: Array,
    sums: Array,
    end: Array,
    hold: float,
    values: dict[str, Any],
    duration: float,
) -> LoopResult:
    signals = dict(zip(RECORDED, out.T.copy(), strict=True)) if out.shape[1] else {}
    if signals:
        share = signals["torque_motor_nm"] / case.machine.motor.count
        signals |= {"torque_motor1_nm": share, "torque_motor2_nm": share}
    else:
        time = time[:0]
    run = Run(case.name, time, signals, case.payload_kg, case.start_position_m)
    outcome, at = _outcome(case.machine, time, signals, end)
    metrics = HOIST_OBSERVER.finish(sums, SimpleNamespace(**values), duration)
    return LoopResult(case, run, metrics, outcome, at, float(end[2]), hold)


def _outcome(machine: Hoist, time: Array, signals: dict[str, Array], end: Array) -> tuple[Outcome, str]:
    if not np.all(np.isfinite(end)):
        bad = ~np.isfinite(signals["speed_motor_rad_s"]) if signals else np.zeros(0, bool)
        return Outcome.DIVERGED, f"by {time[np.argmax(bad)]:.2f} s" if bad.any() else ""
    heights = signals.get("position_carriage_m", end[2:3])
    out = (heights < 0.0) | (heights > machine.wire.segment_length_m)
    if out.any():
        k = int(np.argmax(out))
        return Outcome.LEFT_THE_RAIL, f"at {time[k]:.2f} s, at height {heights[k]:.2f} m" if signals else "at the end"
    return Outcome.COMPLETED, ""
