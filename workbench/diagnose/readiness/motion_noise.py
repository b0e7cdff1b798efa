"""The noise of the predicted input that comes from the measured motion: encoder noise, differentiated, times inertia.

The sensor's own noise is all that `Problem.noise` knows. Where the band reaches high, as on an
axis, the motion's part is larger and is what the residual of a perfect machine would show.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.diagnose.hypotheses.problem import Problem
from workbench.run import Array, Run
from workbench.simulate.driven import Bench
from workbench.simulate.lowpass import lowpass

ORDER = 4  # of the differences: what is smooth over five samples leaves no trace in them
MANY = 5  # steps between values, to judge by
ROUNDED = 0.95  # of the steps are whole multiples of the smallest one
DRAWS = 2


def motion_noise(problem: Problem, seed: int) -> float:
    """rms on the moving rows in the band, in the input's unit, at the base values, by Monte Carlo.

    Noise as large as the logged motion's is added to it once more; what that changes in the
    prediction is what the noise already there has changed. Deterministic for one seed.
    """
    random = np.random.default_rng(seed)
    before = _predicted(problem, problem.runs)
    total, count = 0.0, 0
    for _ in range(DRAWS):
        noisy = [noisier(run, logged_motion(problem.bench, run), random) for run in problem.runs]
        for a, b in zip(before, _predicted(problem, noisy), strict=True):
            total += float(np.sum((a - b) ** 2))
            count += len(a)
    return float(np.sqrt(total / max(count, 1)))


def noisier(run: Run, channels: tuple[str, ...], random: np.random.Generator) -> Run:
    """The run with as much white noise once more on its channels."""
    added = {
        name: run[name] + random.normal(scale=white_noise(run[name], run.time_s), size=len(run.time_s))
        for name in channels
    }
    return replace(run, signals={**run.signals, **added})


def white_noise(values: Array, time_s: Array) -> float:
    """Standard deviation of a channel's white noise, in its unit; of its rounding, where that is larger.

    sigma = 1.4826 median of what each sample is off the cubic through its four neighbours, over what white noise
    of size 1 makes of that; exact for uneven steps. A step of q rounds by q/sqrt(12).
    """
    n = ORDER + 1
    if len(values) < n:
        return resolution(values) / np.sqrt(12.0)
    t = np.lib.stride_tricks.sliding_window_view(time_s, n)
    y = np.lib.stride_tricks.sliding_window_view(values, n)
    apart = t[:, :, None] - t[:, None, :] + np.eye(n)
    weights = 1.0 / np.prod(apart, axis=2)  # of the divided difference
    weights /= np.linalg.norm(weights, axis=1)[:, None]
    off = np.abs(np.sum(weights * (y - y[:, :1]), axis=1))
    return max(1.4826 * float(np.median(off)), resolution(values) / np.sqrt(12.0))


def resolution(values: Array) -> float:
    """The step of a rounded channel, 0 for one that is not: its values lie anywhere between each other."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > 1e-12 * max(float(np.ptp(values)), 1e-300)]
    if len(steps) < MANY:
        return float(steps.min()) if len(steps) else 0.0
    near = steps[steps < 20.0 * steps.min()] / steps.min()
    whole = np.abs(near - np.round(near)) < 0.05
    return float(steps.min()) if len(near) >= MANY and np.mean(whole) > ROUNDED else 0.0


def logged_motion(bench: Bench, run: Run) -> tuple[str, ...]:
    """Position and speed of the driven coordinate, as far as they are logged."""
    return tuple(name for name in (bench.plant.positions[0], bench.plant.speeds[0]) if name in run)


def _predicted(problem: Problem, runs: list[Run] | tuple[Run, ...]) -> list[Array]:
    """Each run's low-passed input at the base values, on the problem's rows."""
    bench = Bench(problem.machine, runs, problem.band_hz, blows=problem.bench.blows)
    return [
        lowpass(run.time_s, raw, problem.band_hz)[rows]
        for run, (raw, _), rows in zip(runs, bench.predict([bench.base])[0], problem.rows, strict=True)
    ]
