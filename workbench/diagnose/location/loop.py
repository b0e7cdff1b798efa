"""Whether the drive's control loop asked for the logged input: a test for errors of the input's sensor.

A force on the machine disturbs the motion, and the loop answers it: the input follows the control error. An error of
the input's sensor disturbs nothing. With the reference logged, the input of a linear loop is

    u + k₀ u̇ = k₁ e + k₂ ∫e dt + k₃ ∫∫e dt² + k₄ ė + k₅ r + k₆ ṙ + k₇ r̈ + c + d t,   e = r − y

for any gains and any delay; c and d belong to each run (weight, drift). The residual of this fit is the sensor's error,
unless the loop is not linear: then the residual is large everywhere and carries little weight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.run import Array
from workbench.diagnose.hypotheses.problem import Problem
from workbench.machines import kind_of
from workbench.simulate.lowpass import lowpass

BLOCK = 2.0  # periods of the band: over so long a time what is left is averaged to see how it hangs together
MOST, NORMAL = 0.9, 1.645  # of the blocks: what a few of them leave may be an event; the same of a normal distribution
HUBER, ROUNDS = 1.5, 15
FREE = 10.0  # of what is left: how far the law may be put right beside a port


@dataclass(frozen=True)
class Loop:
    """Rows in the order of the input's. residual: (inputs,) logged input less the loop's. columns: (inputs, k) of the
    law, as far as it is open. noise: of a row taken as independent of the others."""

    residual: Array
    columns: Array
    noise: float


def loop_of(problem: Problem) -> Loop | None:
    """None if a run lacks the reference or the signal that follows it."""
    reference, follows = kind_of(problem.machine).reference
    if not all(reference in run and follows in run for run in problem.bench.runs):
        return None
    shared, own, inputs = [], [], []
    for j, (run, rows) in enumerate(zip(problem.bench.runs, problem.rows, strict=True)):
        t, r = run.time_s, run[reference]
        law = _law(t, problem.bench.measured[j], r, r - run[follows], problem.band_hz)
        inputs.append(problem.bench.measured[j][rows])
        shared.append(law[rows])
        line = np.zeros((len(rows), 2 * len(problem.runs)))
        line[:, 2 * j], line[:, 2 * j + 1] = 1.0, (t[rows] - t[0]) / max(float(np.ptp(t)), 1e-300)
        own.append(line)
    u, columns = np.concatenate(inputs), np.hstack([np.concatenate(shared), np.concatenate(own)])
    columns = columns / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
    residual = u - columns @ _robust(columns, u)
    noise = _independent(problem, residual)
    return Loop(residual, columns * FREE * noise, noise)


def _law(t: Array, u: Array, r: Array, e: Array, band_hz: float) -> Array:
    once = _integral(t, e)
    rate = np.gradient(lowpass(t, r, 2.0 * band_hz), t)
    every = np.stack([e, once, _integral(t, once), np.gradient(e, t), r, rate, np.gradient(rate, t)], axis=1)
    return np.column_stack([np.gradient(u, t), lowpass(t, every, band_hz)])


def _integral(t: Array, x: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(t))])


def _robust(columns: Array, y: Array) -> Array:
    """P. J. Huber, Robust Statistics, 1981, 7.3."""
    weights: Array = np.ones(len(y))
    z: Array = np.zeros(columns.shape[1])
    for _ in range(ROUNDS):
        root = np.sqrt(weights)[:, None]
        z = np.asarray(np.linalg.lstsq(columns * root, y * root[:, 0], rcond=1e-9)[0], dtype=float)
        left = np.abs(y - columns @ z)
        scale = max(1.4826 * float(np.median(left)), 1e-300)
        weights = np.asarray(np.minimum(1.0, HUBER * scale / np.maximum(left, 1e-300)), dtype=float)
    return np.asarray(z, dtype=float)


def _independent(problem: Problem, residual: Array) -> float:
    """The standard deviation of a row that would give the observed scatter of block means if rows were independent."""
    means, lengths, at = [], [], 0
    for run, rows in zip(problem.bench.runs, problem.rows, strict=True):
        mine, t = residual[at : at + len(rows)], run.time_s[rows]
        at += len(rows)
        if not len(rows):
            continue
        block = ((t - t[0]) * problem.band_hz / BLOCK).astype(int)
        counts = np.bincount(block)
        full = counts > 0.5 * counts.max()
        means.append((np.bincount(block, mine)[full]) / counts[full])
        lengths.append(counts[full])
    every = float(np.quantile(np.abs(np.concatenate(means) * np.sqrt(np.concatenate(lengths))), MOST)) / NORMAL
    return max(every, problem.noise)
