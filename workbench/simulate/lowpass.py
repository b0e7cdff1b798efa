"""A zero-phase low-pass, the same for what is measured and what is predicted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.run import Array

POWER = 8  # gain 1/(1 + (f/f0)^8): a 4th-order Butterworth run forth and back
EDGE_PERIODS = 2.0  # what the filter may spoil at each end, in periods of the band


@dataclass(frozen=True, eq=False)
class Circle:
    """The closed circle on which evenly sampled series of one length are filtered.

    samples: of a series; pad: reflected at each end; size: of the transform; gain: (size // 2 + 1,).
    """

    samples: int
    pad: int
    size: int
    gain: Array

    @staticmethod
    def of(samples: int, step: float, band_hz: float) -> Circle:
        pad = min(samples - 1, int(np.ceil(3.0 / (band_hz * step))))
        size = _good_size(samples + 2 * pad)
        f0 = band_hz / (np.sqrt(2.0) - 1.0) ** (1.0 / POWER)
        return Circle(samples, pad, size, 1.0 / (1.0 + (np.fft.rfftfreq(size, step) / f0) ** POWER))

    @property
    def padded(self) -> int:
        """Samples with both pads."""
        return self.samples + 2 * self.pad


def lowpass(time_s: Array, values: Array, band_hz: float) -> Array:
    """`values` (n,) or (n, k) without what lies above `band_hz` (-3 dB), at the same times.

    The gain is that of a fourth-order Butterworth filter run forth and back, applied in
    the frequency domain; the ends are continued by reflection through the end point, and
    a line passes as it is. Irregular samples are filtered on an even grid of their median step.
    """
    n = len(time_s)
    step, even, regular = grid_of(time_s)
    if 2.0 * band_hz * step >= 1.0:  # nothing to take away below half the sampling rate
        return np.array(values, dtype=float)
    columns = np.asarray(values, dtype=float).reshape(n, -1)
    if not regular:
        columns = _resampled(even, time_s, columns)
    smooth = _filtered(columns, Circle.of(len(columns), step, band_hz))
    if not regular:
        smooth = _resampled(time_s, even, smooth)
    return smooth.reshape(np.shape(values))


def grid_of(time_s: Array) -> tuple[float, Array, bool]:
    """The median step, the even grid of it, and whether the times are that grid."""
    step = float(np.median(np.diff(time_s)))
    even = np.linspace(time_s[0], time_s[-1], max(1, round((time_s[-1] - time_s[0]) / step)) + 1)
    return step, even, len(even) == len(time_s) and bool(np.all(np.abs(even - time_s) <= 0.02 * step))


def _filtered(columns: Array, circle: Circle) -> Array:
    rows, pad, m = columns.T, circle.pad, circle.samples  # a transform takes a row that lies together
    ends = 2.0 * rows[:, :1] - rows[:, pad:0:-1], 2.0 * rows[:, -1:] - rows[:, -2 : -pad - 2 : -1]
    padded = np.concatenate([ends[0], rows, ends[1]], axis=1)
    # Without the line from end to end there is no jump where the transform closes its circle.
    line = padded[:, :1] + (padded[:, -1:] - padded[:, :1]) * np.linspace(0.0, 1.0, padded.shape[1])
    spectrum = np.fft.rfft(padded - line, circle.size, axis=1)
    smooth = np.fft.irfft(spectrum * circle.gain, circle.size, axis=1)
    return np.asarray((smooth[:, pad : pad + m] + line[:, pad : pad + m]).T)


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
