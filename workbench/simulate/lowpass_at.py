"""The low-pass at some samples of a series: the same filter, computed only where it is looked at.

Far from the ends a filtered sample is a weighted sum of its neighbours, the same for every sample: the impulse response
of `lowpass` on its circle, cut off where what is left out is below `REST`. Samples evenly apart share one matrix of
shifted weights, so that a block of them is one product of matrices. Near the ends the series is continued as `lowpass`
does it, and then treated alike.
"""

from __future__ import annotations

import math

import numpy as np

from workbench.run import Array
from workbench.simulate.lowpass import Circle, grid_of, lowpass

REST = 1e-12  # of the weights' sum
BLOCK = 32  # samples of one product, at most
DEAR = 8.0  # what an operation of a transform takes, of a product's

Blocks = list[tuple[int, int, int]]  # the first of its rows, how many, and where their sums begin


class LowpassAt:
    """`lowpass` of series at the times `time_s`, at the samples `rows`, which rise."""

    def __init__(self, time_s: Array, band_hz: float, rows: np.ndarray) -> None:
        self.time_s, self.band_hz, self.rows = time_s, band_hz, rows
        step, _, regular = grid_of(time_s)
        self.summed = regular and len(rows) > 1 and 2.0 * band_hz * step < 1.0
        if self.summed:
            self._prepare(Circle.of(len(time_s), step, band_hz))

    def __call__(self, values: Array) -> Array:
        """values: (n, k) -> (rows, k)."""
        if not self.summed:
            return lowpass(self.time_s, values, self.band_hz)[self.rows]
        out = np.empty((len(self.rows), values.shape[1]))
        self._sum(values, self._inner, out)
        for indices, blocks, lines in self._ends:
            if blocks:
                series, line = self._continued(values, indices, lines)
                self._sum(series, blocks, out)
                first, last = blocks[0][0], blocks[-1][0] + blocks[-1][1]
                out[first:last] += line
        return out

    def _sum(self, series: Array, blocks: Blocks, out: Array) -> None:
        width = 2 * self._reach + 1
        for first, many, begin in blocks:
            length = width + (many - 1) * self._stride
            np.matmul(self._shifted[:many, :length], series[begin : begin + length], out=out[first : first + many])

    def _prepare(self, circle: Circle) -> None:
        response = np.fft.irfft(circle.gain, circle.size)
        left_out = 2.0 * np.cumsum(np.abs(response[circle.size // 2 : 0 : -1]))[::-1]  # beyond 0, 1, 2, ... samples
        reach = self._reach = int(np.count_nonzero(left_out > REST))
        gaps = np.diff(self.rows)
        stride = self._stride = int(np.median(gaps))
        many = max(1, min(BLOCK, 2 * reach // stride))
        width = 2 * reach + 1
        sums = 2.0 * len(self.rows) * (width + many * stride)
        transforms = 5.0 * circle.size * math.log2(circle.size)
        if 4 * reach > circle.samples or sums > DEAR * transforms:
            self.summed = False
            return
        weights = np.concatenate([response[reach:0:-1], response[: reach + 1]])
        self._shifted = np.zeros((many, width + (many - 1) * stride))
        for i in range(many):
            self._shifted[i, i * stride : i * stride + width] = weights
        m, pad = circle.samples, circle.pad
        low = int(np.searchsorted(self.rows, reach))
        high = int(np.searchsorted(self.rows, m - reach))
        self._inner = self._blocks(low, high, reach)
        before = np.arange(pad - reach, pad + 2 * reach)  # on the circle
        after = np.arange(pad + m - 2 * reach, pad + m + reach)
        self._ends = []
        for indices, first, last, begin in ((before, 0, low, 0), (after, high, len(self.rows), m - reach)):
            at = (self.rows[first:last] + pad) / (circle.padded - 1)
            self._ends.append((_Sources(circle, indices), self._blocks(first, last, begin), at))

    def _blocks(self, first: int, last: int, shift: int) -> Blocks:
        """Of rows first to last: evenly apart, each sum beginning at its row less the shift."""
        blocks, most, i = [], len(self._shifted), first
        while i < last:
            k = i + 1
            while k < last and k - i < most and self.rows[k] - self.rows[k - 1] == self._stride:
                k += 1
            blocks.append((i, k - i, int(self.rows[i]) - shift))
            i = k
        return blocks

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
