"""The band in which the runs of an axis hold information: up to where motion outweighs its own noise.

The torque that a motion takes is its inertia times the derivative of a logged speed. The spectrum of the motion falls
with frequency, that of differentiated noise rises with its square (for a position with its fourth power). Beyond
the frequency at which the two are equal the prediction is noise: a fit there is drawn to whatever makes the prediction
smaller, such as a low-pass filter or less inertia (errors in variables; W. Fuller, Measurement Error Models, 1987).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.diagnose.readiness.motion_noise import logged_motion, noises_of, noisier
from workbench.run import Array, Run
from workbench.simulate.driven import Bench

EQUAL = 1.0  # energy of motion over energy of noise
WIDTH = 2.0 ** (1.0 / 3.0)  # of the bands that the spectra are averaged over: a third of an octave
SEGMENTS = 8  # of a run, at least, that its spectrum is averaged over
LOWEST_HZ = 2.0


def informative_band(bench: Bench, seed: int) -> float:
    """In Hz; at most the band of the bench."""
    random = np.random.default_rng(seed)
    noisy = [noisier(run, noises_of(run, logged_motion(bench, run)), random) for run in bench.runs]
    before = [raw for raw, _ in bench.predict([bench.base])[0]]
    beside = Bench(bench.machine, noisy, bench.band_hz, blows=bench.blows)
    after = [raw for raw, _ in beside.predict([beside.base])[0]]
    # The noise added once more is as large as that of the log: what it adds, the log's own has added already.
    with_noise = _spectrum(bench.runs, before)
    noise = _spectrum(bench.runs, [b - a for a, b in zip(before, after, strict=True)])
    frequency = LOWEST_HZ
    while frequency * WIDTH < bench.band_hz:
        total, part = (_energy(spectrum, frequency, frequency * WIDTH) for spectrum in (with_noise, noise))
        if total - part < EQUAL * part:
            return frequency
        frequency *= WIDTH
    return bench.band_hz


Spectrum = list[tuple[Array, Array]]  # of each run: frequencies, Hz, and density


def _spectrum(runs: Sequence[Run], values: Sequence[Array]) -> Spectrum:
    from scipy.signal import welch

    spectra = []
    for run, x in zip(runs, values, strict=True):
        rate = 1.0 / run.sample_time_s
        length = min(int(8.0 * rate / LOWEST_HZ), len(x) // SEGMENTS * 2)
        spectra.append(welch(x, rate, nperseg=max(length, 16)))
    return spectra


def _energy(spectrum: Spectrum, low: float, high: float) -> float:
    return sum(float(np.sum(density[(f >= low) & (f < high)]) * (f[1] - f[0])) for f, density in spectrum)
