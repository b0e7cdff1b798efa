"""The size of a machine's discrepancy: the share of torque that a correct lumped model may still miss.

`Kind.model_error` has the defaults: round numbers, set on simulated machines without a gap and larger than sensor
noise would hide. A campaign's own sizes are estimated beside them, as factors with log-normal priors (`SPREAD`): of
the whole, and of the part near standstill, where no law of friction is exact.
"""

from __future__ import annotations

import math

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.error_model import ErrorModel
from workbench.machines import kind_of
from workbench.simulate.driven import InverseSimulation
from workbench.simulate.lowpass import lowpass

SPREAD = 0.7  # standard deviation of the logarithm of a campaign's own size over the default
LEAST_LEVEL = 0.02  # of the largest input: a friction level, for a machine.yaml may know of none


def discrepancy_of(bench: InverseSimulation, rows: list[np.ndarray]) -> tuple[Array, Array]:
    """(all rows,) each, of the input, in its unit: at any speed, and near standstill."""
    kind = kind_of(bench.machine)
    share = kind.model_error
    friction = friction_level(bench)
    largest = max(float(np.max(np.abs(u))) for u in bench.measured)
    moving, standstill = [], []
    for run, motion, measured, at in zip(bench.runs, bench.motions, bench.measured, rows, strict=True):
        speed = lowpass(run.time_s, motion.speed, bench.band_hz)
        inertia = kind.rigid(bench.machine, run.payload_kg).inertia
        load = share.load * (np.full(len(speed), largest) if share.of_largest else np.abs(measured))
        accelerating = share.inertia * inertia * np.gradient(speed, run.time_s)
        moving.append(np.hypot(load, accelerating)[at])
        standstill.append((share.standstill * friction * np.exp(-np.abs(speed) / (share.slow * bench.scale)))[at])
    return np.concatenate(moving), np.concatenate(standstill)


def friction_level(bench: InverseSimulation) -> float:
    """Coulomb friction at the driven coordinate, both ways on average, in the input's unit."""
    kind = kind_of(bench.machine)
    levels = [float(getattr(bench.base[0], symbol)) for symbol in kind.friction.levels]
    level = float(np.mean(levels)) * kind.transmission_of(bench.machine)
    return max(level, LEAST_LEVEL * max(float(np.max(np.abs(u))) for u in bench.measured))


def carries(bench: InverseSimulation, rows: list[np.ndarray]) -> Array:
    """(all rows,): the correlation of each row's discrepancy with that of the row before it in its run."""
    parts = []
    for run, at in zip(bench.runs, rows, strict=True):
        apart = np.diff(run.time_s[at], prepend=-math.inf)
        parts.append(np.exp(-apart / kind_of(bench.machine).model_error.time_s) if len(at) else apart)
    return np.concatenate(parts)


def error_model(
    bench: InverseSimulation,
    rows: list[np.ndarray],
    row_noise: Array,
    share: float,
    noise: float,
    tension: float | None,
) -> ErrorModel:
    """row_noise: (rows of the input,), rms in the band. share: how many independent values one row stands for.

    tension: None, or the discrepancy of the dead line's tension in the unit of its rows, which follow the input's;
    noise: that of these rows.
    """
    white = row_noise
    moving, standstill = discrepancy_of(bench, rows)
    rho = carries(bench, rows)
    if tension is not None:
        moving = np.concatenate([moving, np.full(len(moving), tension)])
        standstill = np.concatenate([standstill, np.zeros(len(standstill))])
        white = np.concatenate([white, np.full(len(rho), noise)])
        rho = np.concatenate([rho, rho])
    return ErrorModel(white / math.sqrt(share), moving, standstill, rho)
