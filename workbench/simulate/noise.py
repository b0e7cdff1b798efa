"""The noise of the logs: of a channel, and the band that the noise of the motion leaves."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from workbench.core.run import Array, Run
from workbench.machines import kind_of
from workbench.simulate.driven import InverseSimulation

ORDER = 4  # of the differences: what is smooth over five samples leaves no trace in them
MANY = 5  # steps between values, to judge by
ROUNDED = 0.95  # of the steps are whole multiples of the smallest one
SWIFT, SLOW = 0.6, 0.2  # of a channel's fastest change: where jitter of its time stamps shows, and where not
JITTERS = 2.0  # noise of swift samples over that of slow ones, at least
ENOUGH = 50  # samples of each
STEADY = 9  # samples, over which a channel's change is averaged


def channel_noise(values: Array, time_s: Array) -> Array:
    """(n,) Standard deviation of each sample's noise: the white one, and the change of the channel within the jitter
    of its time stamps, sigma^2 = sigma_0^2 + (jitter dy/dt)^2."""
    jitter = jitter_s(values, time_s)
    if not jitter:
        return np.full(len(values), white_noise(values, time_s))
    change = _change(values, time_s)
    return np.hypot(_typical(_off(values, time_s), _inner(change) < SLOW * _fastest(change), values), jitter * change)


def jitter_s(values: Array, time_s: Array) -> float:
    """Standard deviation of the time stamps about the moments at which a channel was sampled, from how much noisier it
    is where it changes swiftly; 0 where that is less than twice as noisy, or hardly ever so."""
    if len(values) <= ORDER:
        return 0.0
    change = _change(values, time_s)
    inner, fastest = _inner(change), _fastest(change)
    swift, slow = inner > SWIFT * fastest, inner < SLOW * fastest
    if min(np.count_nonzero(swift), np.count_nonzero(slow)) < ENOUGH:
        return 0.0
    off = _off(values, time_s)
    loud, quiet = (_typical(off, which, values) for which in (swift, slow))
    if loud < JITTERS * quiet:
        return 0.0
    return float(np.sqrt((loud**2 - quiet**2) / np.mean(inner[swift] ** 2)))


def white_noise(values: Array, time_s: Array) -> float:
    """Standard deviation of a channel's white noise, in its unit; of its rounding, where that is larger.

    sigma = 1.4826 median of what each sample is off the cubic through its four neighbours, over what white noise
    of size 1 makes of that; exact for uneven steps. A step of q rounds by q/sqrt(12).
    """
    if len(values) <= ORDER:
        return resolution(values) / np.sqrt(12.0)
    return _typical(_off(values, time_s), np.ones(len(values) - ORDER, dtype=bool), values)


def _off(values: Array, time_s: Array) -> Array:
    """(n - ORDER,) What each sample is off its neighbours, white noise of size 1 making it of size 1."""
    t, y = (list(sliding_window_view(series, ORDER + 1).T) for series in (time_s, values))
    # of the divided difference
    weights = [1.0 / math.prod(one - other for other in t if other is not one) for one in t]
    off = sum(weight * (one - y[0]) for weight, one in zip(weights, y, strict=True))
    return np.abs(off) / np.sqrt(sum(weight**2 for weight in weights))


def _typical(off: Array, which: np.ndarray, values: Array) -> float:
    """Standard deviation of some samples' noise, by its median; of the rounding, where that is larger."""
    return max(1.4826 * float(np.median(off[which])), resolution(values) / np.sqrt(12.0))


def _change(values: Array, time_s: Array) -> Array:
    """(n,) |dy/dt|, averaged over a few samples."""
    box = np.ones(STEADY) / STEADY
    return np.abs(np.convolve(np.gradient(values, time_s), box, mode="same"))


def _inner(change: Array) -> Array:
    """Of the samples in the middle of `_off`."""
    return change[ORDER // 2 : len(change) - ORDER // 2]


def _fastest(change: Array) -> float:
    return float(np.quantile(change, 0.98))


def resolution(values: Array) -> float:
    """The step of a rounded channel, 0 for one that is not: its values lie anywhere between each other."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > 1e-12 * max(float(np.ptp(values)), 1e-300)]
    if len(steps) < MANY:
        return float(steps.min()) if len(steps) else 0.0
    near = steps[steps < 20.0 * steps.min()] / steps.min()
    whole = np.abs(near - np.round(near)) < 0.05
    return float(steps.min()) if len(near) >= MANY and np.mean(whole) > ROUNDED else 0.0


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


EQUAL = 1.0  # energy of motion over energy of noise
COHERENT = 0.1  # of a motion: less says that the input, or its noise, is another's; that much less than 1, noise
WIDTH = 2.0 ** (1.0 / 3.0)  # of the bands that the spectra are averaged over: a third of an octave
FAINT = 0.2  # of the predicted input is in the measured one: four times as much of its energy is noise
OCTAVE = 2.0  # a wider band, for what is told in much noise
SEGMENTS = 8  # of a run, at least, that its spectrum is averaged over
LOWEST_HZ = 2.0
REALISATIONS = 8  # of a log's noise


def usable_band(bench: InverseSimulation, seed: int = 0) -> float:
    """In Hz, the band of the bench, and where a machine's own motion is all that its logs show, `informative_band`."""
    if kind_of(bench.machine).floor != "own":
        return bench.band_hz
    return min(informative_band(bench, seed), bench.band_hz)


def informative_band(bench: InverseSimulation, seed: int) -> float:
    """In Hz, at most the band of the bench: up to where the motion outweighs its noise, and is the input's.

    The torque that a motion takes is its inertia times the derivative of a logged speed. The spectrum of the motion
    falls with frequency, that of differentiated noise rises with its square (for a position with its fourth power).
    Beyond the frequency at which the two are equal a fit is drawn to whatever makes the prediction smaller, such as a
    low-pass filter or less inertia (errors in variables; W. Fuller, Measurement Error Models, 1987).

    Motion that the input did not make is no information either: cogging moves an axis faster than its loop answers
    (disturbances in a closed loop correlate with the motion; L. Ljung, System Identification, 1999, 13.4). The
    coherence of predicted and measured input shows it: a wrong inertia, gain, delay or filter leaves it at 1. Friction
    that the model has wrong takes coherence off as well, but is in the measured input. So the motion is not the input's
    beyond the frequency at which the prediction is mostly not coherent, and what is not holds more than the measured
    input at all; also without friction, whose jumps at standstill no input made. The noise of the input may hide that:
    what holds next to nothing that is coherent must not come out at less than half of the prediction either, by two
    standard errors, compared with the lower frequencies: the measured input over the predicted one, by regression, is
    the share of the motion that the input made (J. S. Bendat, A. G. Piersol, Random Data, 2010, 9.2).

    Where a loop answers what shakes the machine, or its sensor's noise, input and motion are coherent, and yet their
    ratio is that of the controller, not of the machine: for a speed loop -K/(J s), which falls with frequency and leads
    by a quarter turn (direct identification in closed loop; T. Söderström, P. Stoica, System Identification, 1989,
    10.3). No delay does both, what filters an input lags, and noise that no loop answers is not coherent. Between the
    two stands the frequency at which both hold as much of the motion: there the coherence is least, and there the band
    ends. For a position loop it is K/(J omega^2), in phase, as a wrong inertia has it; but that leaves the coherence at
    1. So the band ends too where the measured input is less than a fifth, a tenth is not coherent, and no filter's lag
    tells why. A controller answers what it reads when it reads it: all this is of the motion as it is logged, however
    late.
    """
    log = bench.machine.log.model_copy(update={"speed_late_s": 0.0, "of_runs": {}})
    as_logged = bench.machine.model_copy(update={"log": log})
    bench = InverseSimulation(as_logged, bench.runs, bench.band_hz, impacts=bench.impacts)
    random = np.random.default_rng(seed)
    noises = [noises_of(run, logged_motion(bench, run)) for run in bench.runs]
    before = [raw for raw, _ in bench.predict([bench.base])[0]]
    # The noise added once more is as large as that of the log: what it adds, the log's own has added already.
    with_noise = _spectrum(bench.runs, before)
    noise: list[Spectrum] = []
    for _ in range(REALISATIONS):
        noisy = [noisier(run, sizes, random) for run, sizes in zip(bench.runs, noises, strict=True)]
        beside = InverseSimulation(bench.machine, noisy, bench.band_hz, impacts=bench.impacts)
        after = [raw for raw, _ in beside.predict([beside.base])[0]]
        noise.append(_spectrum(bench.runs, [b - a for a, b in zip(before, after, strict=True)]))
    smooth = [copy(values) for values in bench.base]
    for values in smooth:
        vars(values).update(dict.fromkeys(kind_of(bench.machine).friction.levels, 0.0))
    moving = [raw for raw, _ in bench.predict([smooth])[0]]
    measured = _spectrum(bench.runs, bench.inputs)
    predicted = [
        (
            _spectrum(bench.runs, one),
            _unanswered(bench.runs, one, bench.inputs),
            [_cross(run, x, y) for run, x, y in zip(bench.runs, one, bench.inputs, strict=True)],
        )
        for one in (before, moving)
    ]

    def made_by_others(own: Spectrum, unanswered: Spectrum, cross: Spectrum, low: float) -> tuple[bool, bool]:
        """Whether other things than the measured input made the motion in a band; whether the input answers them."""
        whole, strange, known = (_energy(one, low, low * WIDTH) for one in (own, unanswered, measured))
        alone, heard = strange > max(0.5 * whole, known), strange > COHERENT * whole
        high = low * OCTAVE  # of less in so noisy an input nothing could be told
        whole, strange, known = (_energy(one, low, high) for one in (own, unanswered, measured))
        count, slower = _averages(bench.runs, own, low, high), _energy(own, 0.0, low)
        if not (count and slower and whole):
            return alone, False
        error = 2.0 * math.sqrt(known / (2.0 * count * whole))
        answer, below = _sum(cross, low, high) / whole, abs(_sum(cross, 0.0, low)) / slower
        small = abs(answer) + error < 0.5 * below
        alone |= small and strange > (1.0 - COHERENT) * whole
        faint = abs(answer) + error < FAINT * below and strange > COHERENT * whole
        alone |= faint and heard and answer.imag > -abs(answer.real)
        return alone, small and strange < 0.5 * whole and answer.imag - error > abs(answer.real)

    bands = [LOWEST_HZ]
    while bands[-1] * WIDTH**2 < bench.band_hz:
        bands.append(bands[-1] * WIDTH)
    end, coherence = bench.band_hz, list[float]()
    own, unanswered, _ = predicted[0]
    for low in bands:
        whole, strange, total, *parts = (_energy(s, low, low * WIDTH) for s in (own, unanswered, with_noise, *noise))
        coherence.append(1.0 - strange / whole if whole else 0.0)
        alone, answered = (all(both) for both in zip(*(made_by_others(*s, low) for s in predicted), strict=True))
        noisy_there = total < (1.0 + EQUAL) * sum(parts) / REALISATIONS
        if alone or noisy_there:
            end = min(end, low)
        if answered:
            return min(end, bands[int(np.argmin(coherence))])
    return end


Spectrum = list[tuple[Array, np.ndarray]]  # of each run: frequencies, Hz, and density, of two signals complex


def _spectrum(runs: Sequence[Run], values: Sequence[Array]) -> Spectrum:
    return [(f, own.real) for f, own in (_cross(run, x, x) for run, x in zip(runs, values, strict=True))]


def _cross(run: Run, x: Array, y: Array) -> tuple[Array, np.ndarray]:
    """Frequencies, Hz, and the one-sided cross spectral density of two signals, averaged over segments that overlap by
    half, under Hann's window, each about its mean (P. D. Welch, IEEE Transactions on Audio and Electroacoustics 15,
    1967). By numpy: scipy.signal takes as long to import as a diagnosis to read its logs."""
    length = min(_segment(run), len(x))
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)

    def transformed(signal: Array) -> np.ndarray:
        segments = sliding_window_view(signal, length)[:: length - length // 2]
        return np.fft.rfft((segments - np.mean(segments, axis=1, keepdims=True)) * window, axis=1)

    both_sides = np.full(length // 2 + 1, 2.0)
    both_sides[[0, *([-1] if length % 2 == 0 else [])]] = 1.0
    frequency: Array = np.fft.rfftfreq(length, run.sample_time_s).astype(float)
    mean = np.mean(np.conj(transformed(x)) * transformed(y), axis=0)
    return frequency, mean * both_sides * run.sample_time_s / np.sum(window**2)


def _unanswered(runs: Sequence[Run], predicted: Sequence[Array], measured: Sequence[Array]) -> Spectrum:
    """The part of the predicted input's spectrum that is not coherent with the measured input.

    Over k segments the coherence of two independent signals comes out as 1/k: it is taken off (J. S. Bendat,
    A. G. Piersol, Random Data, 2010, 9.2.3).
    """
    spectra = []
    for run, x, y in zip(runs, predicted, measured, strict=True):
        f, cross = _cross(run, x, y)
        own, other = (np.maximum(_cross(run, signal, signal)[1].real, 1e-300) for signal in (x, y))
        k = max(2 * (len(x) // _segment(run)) - 1, 2)
        coherence = np.clip((k * np.abs(cross) ** 2 / np.maximum(own * other, 1e-300) - 1.0) / (k - 1.0), 0.0, 1.0)
        spectra.append((f, (1.0 - coherence) * own))
    return spectra


def _segment(run: Run) -> int:
    """Samples of a segment that a spectrum is averaged over."""
    return max(min(int(8.0 / (run.sample_time_s * LOWEST_HZ)), len(run.time_s) // SEGMENTS * 2), 16)


def _energy(spectrum: Spectrum, low: float, high: float) -> float:
    return abs(_sum(spectrum, low, high))


def _sum(spectrum: Spectrum, low: float, high: float) -> complex:
    return sum((complex(np.sum(density[(f >= low) & (f < high)]) * (f[1] - f[0])) for f, density in spectrum), 0j)


def _averages(runs: Sequence[Run], spectrum: Spectrum, low: float, high: float) -> float:
    """Independent values of a spectrum between two frequencies: of segments side by side, whose window is as wide as a
    frequency and a half."""
    return sum(
        len(run.time_s) // _segment(run) * np.count_nonzero((f >= low) & (f < high)) / 1.5
        for run, (f, _) in zip(runs, spectrum, strict=True)
    )
