"""Replays of the default hoist in a few words, for the tests of the engine and of what stands on it."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np

from workbench.core.run import Array
from workbench.engine import kernels
from workbench.machines import NO_EFFECTS, PLANTS, Effects, default_hoist

HOIST = PLANTS["hoist"]
MACHINE = default_hoist()
NOMINAL_SPEED = MACHINE.motor.nominal_speed_rad_s


def values(payload_kg: float = 4500.0) -> SimpleNamespace:
    return HOIST.values(MACHINE, payload_kg)


def start(p: SimpleNamespace, height_m: float = 10.0, speed_motor_rad_s: float = 0.0) -> tuple[Array, float]:
    """A state (6,) in even motion, and the torque that holds the load there."""
    q, y, hold = HOIST.start_of(height_m, speed_motor_rad_s, p)
    return np.array([*q, *y]), hold


def replay(
    p: Sequence[SimpleNamespace],
    times: Array,
    torques: Array,
    starts: Sequence[Array],
    *,
    effects: Effects = NO_EFFECTS,
    tolerance: float = kernels.TOLERANCE,
    threads: int | None = None,
) -> Array:
    """States (n, 6, scenarios); times (n,) or (n, scenarios), torques (n, scenarios)."""
    return kernels.replay(
        HOIST,
        np.array([[getattr(one, name) for one in p] for name in HOIST.parameters]),
        times.reshape(len(times), -1),
        torques.reshape(len(times), -1),
        np.array(starts).T,
        np.array([np.abs(HOIST.start_of(0.0, NOMINAL_SPEED, one)[1]) for one in p]).T,
        effects=effects,
        tolerance=tolerance,
        threads=threads,
    )
