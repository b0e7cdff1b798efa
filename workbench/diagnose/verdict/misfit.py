"""How much structure a hypothesis leaves in the residual, against the noise floor."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.diagnose.hypotheses.fits import Fitted
from workbench.diagnose.hypotheses.problem import Problem
from workbench.run import Array

SLOW = 0.04  # of the speed scale: nearer to standstill the friction law is anybody's
TRIMMED = 0.02  # of the samples, the largest: single blows that no machine model has
BLOCK_PERIODS = 2.0  # of the band, that a block lasts
BLOCKS_TRIMMED = 0.05  # of the blocks, the largest


@dataclass(frozen=True)
class Misfit:
    """All in units of the noise floor; 1 is noise alone.

    everywhere: rms of the residual. clear: rms away from standstill, without the largest 2 %.
    slow: rms of the means over blocks of two periods of the band, scaled so that noise gives 1: what is
    structured stays in such means, what is noise goes.
    """

    everywhere: float
    clear: float
    slow: float


def misfit_of(problem: Problem, fitted: Fitted, noise: float) -> Misfit:
    """The misfit of the input's residual; noise: rms in the band, in the input's unit."""
    residual = fitted.residual[: problem.inputs]
    motions = zip(problem.bench.motions, problem.rows, strict=True)
    speed = np.concatenate([np.abs(motion.speed[rows]) for motion, rows in motions]) / problem.bench.scale
    time = np.concatenate([run.time_s[rows] for run, rows in zip(problem.runs, problem.rows, strict=True)])
    run = problem.run_of_row[: problem.inputs]
    return misfit(residual / noise, speed, time, run, problem.band_hz, problem.share)


def misfit(residual: Array, speed: Array, time_s: Array, run: np.ndarray, band_hz: float, share: float) -> Misfit:
    """residual: (n,) over the noise; speed: (n,) size, of the speed scale; run: (n,) number of the run.

    share: how many independent values one sample of the noise stands for.
    """
    clear = residual[speed > SLOW]
    if len(clear) < 8:
        clear = residual
    return Misfit(
        everywhere=float(np.sqrt(np.mean(residual**2))),
        clear=_trimmed_rms(clear, TRIMMED),
        slow=_slow(residual, speed, time_s, run, band_hz, share),
    )


def _trimmed_rms(values: Array, trimmed: float) -> float:
    """The rms without the largest `trimmed` of them, scaled so that a unit Gaussian's is 1."""
    kept = max(1, math.ceil((1.0 - trimmed) * len(values)))
    share = kept / len(values)
    left = 1.0 - 2.0 * _tail(1.0 - share) if kept < len(values) else 1.0
    return float(np.sqrt(np.mean(np.sort(values**2)[:kept]) * share / left))


def _tail(share: float) -> float:
    """The part of a unit Gaussian's variance that lies in one tail of `share`/2 probability."""
    from statistics import NormalDist

    normal = NormalDist()
    x = normal.inv_cdf(1.0 - share / 2.0)
    return x * normal.pdf(x) + share / 2.0


def _slow(residual: Array, speed: Array, time_s: Array, run: np.ndarray, band_hz: float, share: float) -> float:
    length = BLOCK_PERIODS / band_hz
    block = np.floor(time_s / length).astype(int) + run * (int(np.max(time_s) / length) + 2)
    keep = speed > SLOW
    if np.count_nonzero(keep) < 8:
        keep = np.ones(len(residual), dtype=bool)
    _, at, count = np.unique(block[keep], return_inverse=True, return_counts=True)
    mean = np.bincount(at, residual[keep]) / count
    independent = np.maximum(count * share, 1.0)
    full = independent >= 0.5 * np.max(independent)
    return _trimmed_rms(mean[full] * np.sqrt(independent[full]), BLOCKS_TRIMMED)
