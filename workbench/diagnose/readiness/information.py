"""The band in which the runs of an axis hold information: up to where motion outweighs its noise, and is the input's.

The torque that a motion takes is its inertia times the derivative of a logged speed. The spectrum of the motion falls
with frequency, that of differentiated noise rises with its square (for a position with its fourth power). Beyond
the frequency at which the two are equal the prediction is noise: a fit there is drawn to whatever makes the prediction
smaller, such as a low-pass filter or less inertia (errors in variables; W. Fuller, Measurement Error Models, 1987).

Motion that the input did not make is no information either. Cogging moves an axis faster than its loop can answer:
there the model asks for a torque that nobody gave, and a fit pays for it with less inertia or a lag (disturbances in a
closed loop correlate with the motion; L. Ljung, System Identification, 1999, 13.4). The coherence of predicted and
measured input shows it: a wrong inertia, gain, delay or filter leaves it at 1, what the input does not answer brings it
to 0. It is looked at from ANSWERED_FROM_HZ on: below, friction that the model has wrong takes coherence off as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.core.run import Array, Run
from workbench.diagnose.readiness.motion_noise import logged_motion, noises_of, noisier
from workbench.simulate.driven import InverseSimulation

EQUAL = 1.0  # energy of motion over energy of noise
WIDTH = 2.0 ** (1.0 / 3.0)  # of the bands that the spectra are averaged over: a third of an octave
SEGMENTS = 8  # of a run, at least, that its spectrum is averaged over
LOWEST_HZ = 2.0
ANSWERED = 0.25  # coherence, at least: else three quarters of the predicted energy come from elsewhere
ANSWERED_FROM_HZ = 25.0


def informative_band(bench: InverseSimulation, seed: int) -> float:
    """In Hz; at most the band of the bench."""
    random = np.random.default_rng(seed)
    noisy = [noisier(run, noises_of(run, logged_motion(bench, run)), random) for run in bench.runs]
    before = [raw for raw, _ in bench.predict([bench.base])[0]]
    beside = InverseSimulation(bench.machine, noisy, bench.band_hz, impacts=bench.impacts)
    after = [raw for raw, _ in beside.predict([beside.base])[0]]
    # The noise added once more is as large as that of the log: what it adds, the log's own has added already.
    with_noise = _spectrum(bench.runs, before)
    noise = _spectrum(bench.runs, [b - a for a, b in zip(before, after, strict=True)])
    answered = _answered(bench.runs, before, bench.inputs)
    frequency = LOWEST_HZ
    while frequency * WIDTH < bench.band_hz:
        total, part = (_energy(spectrum, frequency, frequency * WIDTH) for spectrum in (with_noise, noise))
        if total - part < EQUAL * part:
            return frequency
        share = _energy(answered, frequency, frequency * WIDTH)
        if frequency >= ANSWERED_FROM_HZ and share < ANSWERED * total:
            return frequency
        frequency *= WIDTH
    return bench.band_hz


Spectrum = list[tuple[Array, Array]]  # of each run: frequencies, Hz, and density


def _spectrum(runs: Sequence[Run], values: Sequence[Array]) -> Spectrum:
    from scipy.signal import welch

    return [welch(x, 1.0 / run.sample_time_s, nperseg=_segment(run)) for run, x in zip(runs, values, strict=True)]


def _answered(runs: Sequence[Run], predicted: Sequence[Array], measured: Sequence[Array]) -> Spectrum:
    """The part of the predicted input's spectrum that is coherent with the measured input."""
    from scipy.signal import csd, welch

    spectra = []
    for run, x, y in zip(runs, predicted, measured, strict=True):
        rate, length = 1.0 / run.sample_time_s, _segment(run)
        f, cross = csd(x, y, rate, nperseg=length)
        spectra.append((f, np.abs(cross) ** 2 / np.maximum(welch(y, rate, nperseg=length)[1], 1e-300)))
    return spectra


def _segment(run: Run) -> int:
    """Samples of a segment that a spectrum is averaged over."""
    return max(min(int(8.0 / (run.sample_time_s * LOWEST_HZ)), len(run.time_s) // SEGMENTS * 2), 16)


def _energy(spectrum: Spectrum, low: float, high: float) -> float:
    return sum(float(np.sum(density[(f >= low) & (f < high)]) * (f[1] - f[0])) for f, density in spectrum)
