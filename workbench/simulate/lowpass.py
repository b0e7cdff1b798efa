"""A zero-phase low-pass, the same for what is measured and what is predicted, and the band, in Hz (-3 dB), that it
leaves to compare them in.

`LowpassAt` is the same filter, computed only where it is looked at. Far from the ends a filtered sample is a weighted
sum of its neighbours, the same for every sample: the impulse response of `lowpass` on its circle, cut off where what is
left out is below `REST`. A block of them is one product with a matrix of shifted weights, which blocks of samples as
far apart share. Near the ends the series is continued as `lowpass` does it, and then treated alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.machines import Machine, Plant

POWER = 8  # gain 1/(1 + (f/f0)^8): a 4th-order Butterworth run forth and back
EDGE_PERIODS = 2.0  # what the filter may spoil at each end, in periods of the band
GRIDS_KEPT = 64
_grids: dict[int, tuple[Array, tuple[float, Array, bool]]] = {}  # id of times -> the times, and their grid


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
    @lru_cache(maxsize=64)
    def of(samples: int, step: float, band_hz: float) -> Circle:
        from scipy.fft import next_fast_len

        pad = min(samples - 1, int(np.ceil(3.0 / (band_hz * step))))
        size = next_fast_len(samples + 2 * pad, real=True)
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
    """The median step, the even grid of it, and whether the times are that grid. A fit asks for those of the same few
    runs thousands of times: the last ones are kept."""
    kept = _grids.get(id(time_s))
    if kept is None or kept[0] is not time_s:
        while len(_grids) >= GRIDS_KEPT:
            _grids.pop(next(iter(_grids)), None)
        kept = _grids[id(time_s)] = (time_s, _grid_of(time_s))
    return kept[1]


def _grid_of(time_s: Array) -> tuple[float, Array, bool]:
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
    steps and bursts out: sigma = 1.4826 median|d2| / sqrt(6). A command, or a log that repeats its values, shows none:
    then what its smallest step hides, evenly spread over that, SILENT of the signal at most.
    """
    second = np.abs(np.diff(values, 2))
    sigma = 1.4826 * float(np.median(second)) / np.sqrt(6.0)
    steps = np.abs(np.diff(values))
    if sigma == 0.0 and steps.any():
        most = SILENT * float(np.sqrt(np.mean(values**2)))
        sigma = min(float(np.min(steps[steps > 0.0])), most) / math.sqrt(12.0)
    nyquist = 0.5 / float(np.median(np.diff(time_s)))
    return sigma * float(np.sqrt(min(1.0, band_hz / nyquist)))


def _resampled(at: Array, time: Array, columns: Array) -> Array:
    return np.array([np.interp(at, time, column) for column in columns.T]).reshape(-1, len(at)).T


SILENT = 1e-3  # of a signal without noise, rms
# Of the sampling rate: where a Butterworth filter at a tenth of it, run both ways, has lost 3 dB.
SAMPLING_SHARE = 0.0896
LEAST_PERIODS = 4.0  # of the band in the shortest run


def default_band(machine: Machine, plant: Plant, values: Sequence[SimpleNamespace], runs: Sequence[Run]) -> float:
    """The highest frequency at which the plant is valid, limited by the slowest sampling rate.

    An identified machine is compared in the band it was identified in, so that its figures
    are those of its identification.
    """
    sampling = min(SAMPLING_SHARE / run.sample_time_s for run in runs)
    said = machine.identified.get("band_hz")
    if isinstance(said, int | float) and said > 0.0:
        return min(sampling, float(said))
    return min(sampling, *(plant.band_hz(p) for p in values))


def check_band(band_hz: float | None, runs: Sequence[Run]) -> None:
    """InputError if the runs are too short or sampled too slowly for this band, if there is one."""
    if band_hz is None:
        return
    highest = min(0.5 / run.sample_time_s for run in runs)
    lowest = max(LEAST_PERIODS / run.duration_s for run in runs)
    # Steps are differences of rounded times: half the sampling rate may come out a rounding error above itself.
    if not (math.isfinite(band_hz) and lowest <= band_hz < highest * (1.0 - 1e-6)):
        raise InputError(
            f"{band_hz:g} Hz, expected at least {lowest:.2g} Hz ({LEAST_PERIODS:g} periods in the shortest run) "
            f"and less than {highest:.3g} Hz (half the sampling rate)",
            place="band_hz",
        )


REST = 1e-7  # of the weights' sum: what the gain still is at half the sampling rate leaves a tail of that size
BLOCK = 32  # samples of one product, at most
DEAR = 8.0  # what an operation of a transform takes, of a product's

Blocks = list[tuple[int, Array, int]]  # the first of its rows, their weights, and where the sums begin


class LowpassAt:
    """`lowpass` of series at the times `time_s`, at the samples `rows`, which rise; straight between two samples."""

    def __init__(self, time_s: Array, band_hz: float, rows: Array) -> None:
        self.time_s, self.band_hz, self.rows = time_s, band_hz, rows
        step, _, regular = grid_of(time_s)
        self.summed = regular and len(rows) > 1 and 2.0 * band_hz * step < 1.0
        if self.summed:
            self._prepare(Circle.of(len(time_s), step, band_hz))

    def __call__(self, values: Array) -> Array:
        """values: (n, k) -> (rows, k)."""
        if not self.summed:
            smooth, at = lowpass(self.time_s, values, self.band_hz), np.asarray(self.rows, dtype=int)
            part = (self.rows - at)[:, None]
            return np.asarray((1.0 - part) * smooth[at] + part * smooth[np.minimum(at + 1, len(smooth) - 1)])
        out = np.empty((len(self.rows), values.shape[1]))
        self._sum(values, self._inner, out)
        for indices, blocks, lines in self._ends:
            if blocks:
                series, line = self._continued(values, indices, lines)
                self._sum(series, blocks, out)
                first, last = blocks[0][0], blocks[-1][0] + len(blocks[-1][1])
                out[first:last] += line
        return out

    @staticmethod
    def _sum(series: Array, blocks: Blocks, out: Array) -> None:
        for first, weights, begin in blocks:
            many, length = weights.shape
            np.matmul(weights, series[begin : begin + length], out=out[first : first + many])

    def _prepare(self, circle: Circle) -> None:
        response = np.fft.irfft(circle.gain, circle.size)
        left_out = 2.0 * np.cumsum(np.abs(response[circle.size // 2 : 0 : -1]))[::-1]  # beyond 0, 1, 2, ... samples
        reach = int(np.count_nonzero(left_out > REST))
        stride = float(np.median(np.diff(self.rows)))
        self._many, self._longest = max(1, min(BLOCK, int(2 * reach / stride))), BLOCK * stride
        sums = 2.0 * len(self.rows) * (2 * reach + 1 + self._many * stride)
        transforms = 5.0 * circle.size * math.log2(circle.size)
        if 4 * reach > circle.samples or sums > DEAR * transforms:
            self.summed = False
            return
        self._weights = np.concatenate([response[reach:0:-1], response[: reach + 1]])
        self._made: dict[bytes, Array] = {}  # rows as far apart share their weights
        m, pad = circle.samples, circle.pad
        low = int(np.searchsorted(self.rows, reach))
        high = int(np.searchsorted(self.rows, m - reach - 1))
        self._inner = self._blocks(low, high, reach)
        before = np.arange(pad - reach, pad + 2 * reach + 1)  # on the circle
        after = np.arange(pad + m - 2 * reach - 1, pad + m + reach + 1)
        self._ends = []
        for indices, first, last, begin in ((before, 0, low, 0), (after, high, len(self.rows), m - reach - 1)):
            at = (self.rows[first:last] + pad) / (circle.padded - 1)
            self._ends.append((_Sources(circle, indices), self._blocks(first, last, begin), at))

    def _blocks(self, first: int, last: int, shift: int) -> Blocks:
        """Of rows first to last, each sum beginning at its row less the shift."""
        blocks, i = Blocks(), first
        while i < last:
            near = np.searchsorted(self.rows, self.rows[i] + self._longest)
            rows = self.rows[i : min(i + self._many, last, int(near))]
            begin = int(rows[0])
            if (key := (rows - begin).tobytes()) not in self._made:
                self._made[key] = self._of(rows - begin)
            blocks.append((i, self._made[key], begin - shift))
            i += len(rows)
        return blocks

    def _of(self, rows: Array) -> Array:
        """(rows, samples) the weights of samples from `reach` before the first row on."""
        weights = np.zeros((len(rows), len(self._weights) + int(rows[-1]) + 1))
        for own, row in zip(weights, rows, strict=True):
            before, part = own[int(row) :], row % 1.0
            before[: len(self._weights)] = (1.0 - part) * self._weights
            before[1 : len(self._weights) + 1] += part * self._weights
        return weights

    @staticmethod
    def _continued(values: Array, sources: _Sources, at: Array) -> tuple[Array, Array]:
        """The continued series less its line, and the line at the rows."""
        first = 2.0 * values[0] - values[sources.pad]
        slope = (2.0 * values[-1] - values[-1 - sources.pad]) - first
        series = sources.sign[:, None] * values[sources.sample]
        series += np.where(
            sources.before[:, None], 2.0 * values[0], np.where(sources.after[:, None], 2.0 * values[-1], 0.0)
        )
        series -= first + slope * sources.share[:, None]
        series[sources.beyond] = 0.0
        return series, first + slope * at[:, None]


class _Sources:
    """Where samples on the circle come from: sign times a sample of the series, beside twice its first or last."""

    def __init__(self, circle: Circle, indices: np.ndarray) -> None:
        on = indices % circle.size
        at, m = on - circle.pad, circle.samples
        self.pad = circle.pad
        self.before, self.after = at < 0, at >= m
        self.beyond = on >= circle.padded  # the circle's gap, where there is nothing
        self.sample = np.clip(np.where(self.before, -at, np.where(self.after, 2 * (m - 1) - at, at)), 0, m - 1)
        self.sign = np.where(self.before | self.after, -1.0, 1.0)
        self.share = on / (circle.padded - 1)
