"""The noise of the prediction that the measured motion drives."""

from __future__ import annotations

import numpy as np

from workbench.core.run import Array, Run
from workbench.diagnose.hypotheses.problem import Problem
from workbench.simulate.driven import InverseSimulation
from workbench.simulate.lowpass import lowpass
from workbench.simulate.noise import logged_motion, noises_of, noisier

DRAWS = 2
SPEED_BINS = 8


def with_motion_noise(problem: Problem, seed: int) -> Problem:
    """The campaign with the noise of the prediction that comes from the measured motion: encoder noise, differentiated,
    times inertia. Of each moving row in the band, at the base values, by Monte Carlo.

    Noise as large as the logged motion's is added to it once more; what that changes in the
    prediction is what the noise already there has changed. The same for all rows, unless time stamps jitter: then it
    grows with the speed. A run that reverses more often has more than its like: `run_noise`. Deterministic for one
    seed.
    """
    random = np.random.default_rng(seed)
    before = np.concatenate(_predicted(problem, problem.runs))
    noises = [noises_of(run, logged_motion(problem.bench, run)) for run in problem.runs]
    square = np.zeros_like(before)
    for _ in range(DRAWS):
        noisy = [noisier(run, noise, random) for run, noise in zip(problem.runs, noises, strict=True)]
        square += (before - np.concatenate(_predicted(problem, noisy))) ** 2 / DRAWS
    jittery = any(np.ptp(sizes) > 0.0 for noise in noises for sizes in noise.values())
    speed = [np.abs(motion.speed[rows]) for motion, rows in zip(problem.bench.motions, problem.rows, strict=True)]
    with_noise = problem.noisier(_by_speed(np.sqrt(square), np.concatenate(speed), SPEED_BINS if jittery else 1))
    of_run = np.split(square, np.cumsum(problem.run_lengths)[:-1])
    with_noise.run_noise = np.sqrt(problem.run_noise**2 + [float(np.mean(its)) if len(its) else 0.0 for its in of_run])
    return with_noise


def _by_speed(sizes: Array, speed: Array, bins: int) -> Array:
    """(n,) rms of the sizes over the samples of about each one's speed; bins: of as many samples each."""
    if not len(sizes):
        return sizes
    levels = np.empty_like(sizes)
    for alike in np.array_split(np.argsort(speed, kind="stable"), bins):
        levels[alike] = np.sqrt(np.mean(sizes[alike] ** 2)) if len(alike) else 0.0
    return levels


def _predicted(problem: Problem, runs: list[Run] | tuple[Run, ...]) -> list[Array]:
    """Each run's low-passed input at the base values, on the problem's rows."""
    bench = InverseSimulation(problem.machine, runs, problem.band_hz, impacts=problem.bench.impacts)
    return [
        lowpass(run.time_s, raw, problem.band_hz)[rows]
        for run, (raw, _), rows in zip(runs, bench.predict([bench.base])[0], problem.rows, strict=True)
    ]
