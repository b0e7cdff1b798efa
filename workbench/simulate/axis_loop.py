"""What is an axis' own in a closed-loop run: its cascade, its numbers, its references, its end."""

from __future__ import annotations

from typing import Any

import numpy as np

from workbench.control import Controller, cascade, cascade_values, weight_before
from workbench.control.pi import NEVER
from workbench.core.run import Array
from workbench.machines import kind_of
from workbench.metrics.axis import SETTLED
from workbench.simulate.outcome import BOUNDLESS, Outcome


def controller_of(case: Any) -> Controller:
    """The cascade; with a delay line where the measured speed is late."""
    return cascade(kind_of(case.machine).looped, case.machine.drive.speed_delay_s > 0.0)


def numbers(case: Any, hold: float) -> dict[str, float]:
    """Loop, drive and what the metrics need, by symbol. hold: the input that holds the load at the start."""
    machine, drive = case.machine, case.machine.drive
    position = position_reference(case)
    return {
        **cascade_values(case.controller, drive, case.start_position_m),
        "hold": hold,
        "before": weight_before(drive.torque_lag_s, case.controller.sample_time_s),
        "settled": SETTLED * float(np.ptp(position)),
        "v_scale": kind_of(machine).looped.speed_scale(machine),
        "u_nominal": NEVER if drive.nominal is None else drive.nominal,
    }


def position_reference(case: Any) -> Array:
    """(n,): as the case has it or, for a speed loop alone, its speed summed up from the start."""
    if case.position_reference is not None:
        return np.asarray(case.position_reference, dtype=float)
    speed = np.asarray(case.speed_reference_rad_s, dtype=float)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) * case.controller.sample_time_s])
    return np.asarray(case.start_position_m + way)


def references(case: Any) -> Array:
    """(2, n): position and speed."""
    return np.stack([position_reference(case), np.asarray(case.speed_reference_rad_s, dtype=float)])


def outcome(
    machine: Any, time: Array, signals: dict[str, Array], end: Array, metrics: dict[str, float]
) -> tuple[Outcome, str]:
    """Whether the loop stayed bounded; when it did not, as far as signals were kept."""
    if np.all(np.abs(end) < BOUNDLESS):
        return Outcome.COMPLETED, ""
    speed = signals.get(kind_of(machine).looped.speed, np.zeros(0))
    bad = ~(np.abs(speed) < BOUNDLESS)
    return Outcome.DIVERGED, f"by {time[np.argmax(bad)]:.2f} s" if bad.any() else ""
