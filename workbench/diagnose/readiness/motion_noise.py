"""The noise of the predicted input that comes from the measured motion: encoder noise, differentiated, times inertia.

The sensor's own noise is all that `Problem.noise` knows. Where the band reaches high, as on an
axis, the motion's part is larger and is what the residual of a perfect machine would show.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from workbench.core.run import Array, Run
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.readiness.channel_noise import channel_noise
from workbench.simulate.driven import InverseSimulation
from workbench.simulate.lowpass import lowpass

DRAWS = 2
SPEED_BINS = 8


def motion_noise(problem: Problem, seed: int) -> Array:
    """(inputs,) rms of each moving row in the band, in the input's unit, at the base values, by Monte Carlo.

    Noise as large as the logged motion's is added to it once more; what that changes in the
    prediction is what the noise already there has changed. The same for all rows, unless time stamps jitter: then it
    grows with the speed. Deterministic for one seed.
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
    return _by_speed(np.sqrt(square), np.concatenate(speed), SPEED_BINS if jittery else 1)


def _by_speed(sizes: Array, speed: Array, bins: int) -> Array:
    """(n,) rms of the sizes over the samples of about each one's speed; bins: of as many samples each."""
    if not len(sizes):
        return sizes
    levels = np.empty_like(sizes)
    for alike in np.array_split(np.argsort(speed, kind="stable"), bins):
        levels[alike] = np.sqrt(np.mean(sizes[alike] ** 2)) if len(alike) else 0.0
    return levels


def noises_of(run: Run, channels: tuple[str, ...]) -> dict[str, Array]:
    """Standard deviation of each sample's noise, (n,) a channel."""
    return {name: channel_noise(run[name], run.time_s) for name in channels}


def noisier(run: Run, noises: Mapping[str, Array], random: np.random.Generator) -> Run:
    """The run with as much noise once more on its channels."""
    added = {name: run[name] + random.normal(scale=sizes, size=len(run.time_s)) for name, sizes in noises.items()}
    return replace(run, signals={**run.signals, **added})


def logged_motion(bench: InverseSimulation, run: Run) -> tuple[str, ...]:
    """Position and speed of the driven coordinate, as far as they are logged."""
    return tuple(name for name in (bench.plant.positions[0], bench.plant.speeds[0]) if name in run)


def _predicted(problem: Problem, runs: list[Run] | tuple[Run, ...]) -> list[Array]:
    """Each run's low-passed input at the base values, on the problem's rows."""
    bench = InverseSimulation(problem.machine, runs, problem.band_hz, impacts=problem.bench.impacts)
    return [
        lowpass(run.time_s, raw, problem.band_hz)[rows]
        for run, (raw, _), rows in zip(runs, bench.predict([bench.base])[0], problem.rows, strict=True)
    ]
