"""How large a machine's discrepancy is: the share of torque that a lumped model of it may miss and still be right.

The defaults are round numbers, set on simulated machines without a gap that are larger than their sensors' noise hides
(docs/diagnosis.md has the sensitivity of the score to each); a campaign's own size is estimated beside them, as one
factor with a log-normal prior (`SPREAD`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.diagnose.hypotheses.error_model import ErrorModel
from workbench.diagnose.readiness.rigid import nominal
from workbench.machine import Axis
from workbench.run import Array
from workbench.simulate.driven import Bench
from workbench.simulate.lowpass import lowpass


@dataclass(frozen=True)
class Shares:
    """Standard deviations of the discrepancy. load: of the transmitted torque. inertia: of the torque that
    accelerates. standstill: of the friction level, falling with speed over `slow` of the speed scale. time_s: over
    which it hangs together."""

    load: float
    inertia: float
    standstill: float
    slow: float
    time_s: float


HOIST = Shares(load=0.0002, inertia=0.003, standstill=0.02, slow=0.08, time_s=0.6)
AXIS = Shares(load=0.004, inertia=0.004, standstill=0.05, slow=0.05, time_s=0.06)
SPREAD = 0.7  # standard deviation of the logarithm of a campaign's own size over the default


def shares_of(machine: object) -> Shares:
    return AXIS if isinstance(machine, Axis) else HOIST


def discrepancy_of(bench: Bench, rows: list[np.ndarray]) -> Array:
    """(all rows,) of the input, in its unit."""
    machine, share = bench.machine, shares_of(bench.machine)
    friction = friction_level(bench)
    largest = max(float(np.max(np.abs(u))) for u in bench.measured)
    parts = []
    for run, motion, measured, at in zip(bench.runs, bench.motions, bench.measured, rows, strict=True):
        speed = lowpass(run.time_s, motion.speed, bench.band_hz)
        acceleration = np.gradient(speed, run.time_s)
        inertia, _ = nominal(machine, run)
        load = np.full(len(speed), largest) if isinstance(machine, Axis) else np.abs(measured)
        near = friction * np.exp(-np.abs(speed) / (share.slow * bench.scale))
        total = (
            (share.load * load) ** 2 + (share.inertia * inertia * acceleration) ** 2 + (share.standstill * near) ** 2
        )
        parts.append(np.sqrt(total)[at])
    return np.concatenate(parts)


def friction_level(bench: Bench) -> float:
    """Coulomb friction at the driven coordinate, both ways on average, in the input's unit; 2 % of the largest input
    at least, for a machine.yaml may know of none."""
    machine = bench.machine
    if isinstance(machine, Axis):
        level = 0.5 * (machine.role("coulomb_forward") + machine.role("coulomb_backward"))
    else:
        level = 0.5 * (machine.guide.coulomb_hoisting_n + machine.guide.coulomb_lowering_n) * machine.lift_m_per_rad
    return max(level, 0.02 * max(float(np.max(np.abs(u))) for u in bench.measured))


def carries(bench: Bench, rows: list[np.ndarray]) -> Array:
    """(all rows,): the correlation of each row's discrepancy with that of the row before it in its run."""
    parts = []
    for run, at in zip(bench.runs, rows, strict=True):
        apart = np.diff(run.time_s[at], prepend=-math.inf)
        parts.append(np.exp(-apart / shares_of(bench.machine).time_s) if len(at) else apart)
    return np.concatenate(parts)


def error_model(bench: Bench, rows: list[np.ndarray], noise: float, share: float, tension: float | None) -> ErrorModel:
    """noise: rms in the band. share: how many independent values one row of it stands for.

    tension: None, or the discrepancy of the dead line's tension in the unit of its rows, which follow the input's.
    """
    d, rho = discrepancy_of(bench, rows), carries(bench, rows)
    if tension is not None:
        d, rho = np.concatenate([d, np.full(len(d), tension)]), np.concatenate([rho, rho])
    return ErrorModel(np.full(len(d), noise / math.sqrt(share)), d, rho)
