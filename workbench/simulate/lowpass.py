"""A zero-phase low-pass, the same for what is measured and what is predicted."""

from __future__ import annotations

import numpy as np

from workbench.run import Array

POWER = 8  # gain 1/(1 + (f/f0)^8): a 4th-order Butterworth run forth and back
EDGE_PERIODS = 2.0  # what the filter may spoil at each end, in periods of the band


def lowpass(time_s: Array, values: Array, band_hz: float) -> Array:
    """`values` (n,) or (n, k) without what lies above `band_hz` (-3 dB), at the same times.

    The gain is that of a fourth-order Butterworth filter run forth and back, applied in
    the frequency domain; the ends are continued by reflection through the end point, and
    a line passes as it is. Irregular samples are filtered on an even grid of their median step.
    """
    n = len(time_s)
    step = float(np.median(np.diff(time_s)))
    if 2.0 * band_hz * step >= 1.0:  # nothing to take away below half the sampling rate
        return np.array(values, dtype=float)
    even = np.linspace(time_s[0], time_s[-1], max(1, round((time_s[-1] - time_s[0]) / step)) + 1)
    regular = len(even) == n and bool(np.all(np.abs(even - time_s) <= 0.02 * step))
    columns = np.asarray(values, dtype=float).reshape(n, -1)
    if not regular:
        columns = _resampled(even, time_s, columns)
    m = len(columns)
    pad = min(m - 1, int(np.ceil(3.0 / (band_hz * step))))
    ends = (2.0 * columns[0] - columns[pad:0:-1], 2.0 * columns[-1] - columns[-2 : -pad - 2 : -1])
    padded = np.concatenate([ends[0], columns, ends[1]])
    size = _good_size(len(padded))
    # Without the line from end to end there is no jump where the transform closes its circle.
    line = padded[0] + (padded[-1] - padded[0]) * np.linspace(0.0, 1.0, len(padded))[:, None]
    spectrum = np.fft.rfft(padded - line, size, axis=0)
    f0 = band_hz / (np.sqrt(2.0) - 1.0) ** (1.0 / POWER)
    gain = 1.0 / (1.0 + (np.fft.rfftfreq(size, step) / f0) ** POWER)
    smooth = (np.fft.irfft(spectrum * gain[:, None], size, axis=0)[: len(line)] + line)[pad : pad + m]
    if not regular:
        smooth = _resampled(time_s, even, smooth)
    return smooth.reshape(np.shape(values))


def inside(time_s: Array, band_hz: float) -> np.ndarray:
    """(n,) bool: the samples that the low-pass' end effects do not reach."""
    edge = EDGE_PERIODS / band_hz
    if time_s[-1] - time_s[0] < 4.0 * edge:  # a very short log keeps its middle half
        edge = 0.25 * float(time_s[-1] - time_s[0])
    return (time_s >= time_s[0] + edge) & (time_s <= time_s[-1] - edge)


def noise_rms(time_s: Array, values: Array, band_hz: float) -> float:
    """The white noise of a channel as it remains below `band_hz`, rms, in the channel's unit.

    From second differences, which hide slow signals; the median of their size keeps
    steps and bursts out: sigma = 1.4826 median|d2| / sqrt(6).
    """
    second = np.abs(np.diff(values, 2))
    sigma = 1.4826 * float(np.median(second)) / np.sqrt(6.0)
    nyquist = 0.5 / float(np.median(np.diff(time_s)))
    return sigma * float(np.sqrt(min(1.0, band_hz / nyquist)))


def _resampled(at: Array, time: Array, columns: Array) -> Array:
    return np.stack([np.interp(at, time, column) for column in columns.T], axis=-1)


def _good_size(n: int) -> int:
    """The next length of the form 2^a 3^b 5^c, quick to transform."""
    while True:
        rest = n
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return n
        n += 1
