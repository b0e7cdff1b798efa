"""Step responses of the linear loop: the reference, and a torque on the shaft."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.analysis.loop import LinearLoop, Sampled
from workbench.core.run import Array

RECOVERED = 0.1  # of the largest deviation: what counts as over


@dataclass(frozen=True)
class StepResponse:
    """Deviations after a unit step at time 0; time_s: (n,), signals by name: (n,)."""

    time_s: Array
    signals: dict[str, Array]


def step_response(loop: LinearLoop, of: str, duration_s: float) -> StepResponse:
    """of: one of the loop's inputs; 1 rad/s of the reference or 1 N m on the shaft, hoisting. Signals as `shown`."""
    n = max(2, round(duration_s / loop.dt) + 1)
    time: Array = np.arange(n, dtype=np.float64) * np.float64(loop.dt)
    out = _held(loop.closed, loop.inputs.index(of), n)
    return StepResponse(time, {name: out[:, i] for i, name in enumerate(loop.shown)})


def _held(system: Sampled, column: int, n: int) -> Array:
    """Outputs (n, outputs) from rest under one input held at 1.

    The block of states known so far is carried on by its own length until there are enough: as exact as
    step by step, and a hundred times as fast.
    """
    m = len(system.A)
    on = np.eye(m + 1)  # state and input together
    on[:m, :m], on[:m, m] = system.A, system.B[:, column]
    states = np.eye(m + 1)[:, [m]]
    while states.shape[1] < n:
        states, on = np.hstack([states, on @ states]), on @ on
    out: Array = (np.column_stack([system.C, system.D[:, column]]) @ states[:, :n]).T
    return out


@dataclass(frozen=True)
class LoadStep:
    """What 1 N m on the shaft does to the motor's speed.

    peak_rad_s: largest deviation, at peak_s. iae_rad: integral of its magnitude. recovery_s: from then on the
    deviation stays within a tenth of its peak.
    """

    peak_rad_s: float
    peak_s: float
    iae_rad: float
    recovery_s: float


def load_step(loop: LinearLoop) -> LoadStep:
    """By the exact linear loop, until its slowest mode that shows has died out to a thousandth."""
    sizes = np.abs(loop.poles())
    slowest = float(np.max(sizes[sizes < 1.0 - 1e-9], initial=0.5))
    n = int(min(max(np.log(1e-3) / np.log(slowest), 100), 60.0 / loop.dt))
    size = np.abs(_held(loop.closed, loop.inputs.index("load_torque"), n)[:, 0])
    k = int(np.argmax(size))
    off = np.flatnonzero(size > RECOVERED * size[k])
    return LoadStep(float(size[k]), k * loop.dt, float(size.sum() * loop.dt), (int(off[-1]) + 1) * loop.dt)


@dataclass(frozen=True)
class PositionAnswer:
    """What 1 N or N m on an axis does to its position, m or rad. peak: the largest way; left: at the end, where an
    integral has had its time."""

    peak: float
    left: float


def position_answer(loop: LinearLoop) -> PositionAnswer | None:
    """By the exact linear loop; None where nothing holds the position or it is no part of the loop."""
    if loop.kind.looped.position not in loop.outputs:
        return None
    row = loop.outputs.index(loop.kind.looped.position)
    sizes = np.abs(loop.poles())
    if not np.any(loop.plant.C[row]) or np.any(sizes >= 1.0 - 1e-12):
        return None
    n = int(min(max(np.log(1e-4) / np.log(float(np.max(sizes))), 100), 60.0 / loop.dt))
    way = np.abs(_held(loop.closed, loop.inputs.index("load_torque"), n)[:, row])
    return PositionAnswer(float(way.max()), float(way[-1]))
