"""The delay of a signal behind its reference, to a fraction of a sample."""

from __future__ import annotations

import numpy as np

from workbench.core.run import Array

LONGEST_S = 2.0  # a signal that is later than that follows something else
REFINEMENTS = 20
LARGEST_CHANGE_S = 0.02  # of one refinement: noise may put the correlation's peak some samples off


def lateness(time_s: Array, reference: Array, signal: Array) -> float | None:
    """The delay in s of `signal`, (n,), behind `reference`, (n,); None if neither moves.

    Cross-correlation finds it to a sample; then the shift d is refined that leaves the least of
    signal − gain·reference(t − d) − offset, by Gauss-Newton. Negative where the signal leads.
    """
    step = float(np.median(np.diff(time_s)))
    even = np.arange(time_s[0], time_s[-1] + 0.5 * step, step)
    r, s = (np.interp(even, time_s, values) for values in (reference, signal))
    r, s = r - r.mean(), s - s.mean()
    if not (r.any() and s.any()):
        return None
    n = len(even)
    most = min(int(LONGEST_S / step), n // 4)
    if most < 2:
        return None
    size = 1 << (2 * n - 1).bit_length()
    product = np.fft.irfft(np.fft.rfft(s, size) * np.conj(np.fft.rfft(r, size)), size)
    lags = np.arange(-most, most + 1)
    shift = float(lags[int(np.argmax(product[lags]))]) * step
    # Away from the ends every shifted sample has its reference.
    rows = slice(most, n - most)
    for _ in range(REFINEMENTS):
        at = even[rows] - shift
        moved = np.interp(at, even, r)
        slope = np.interp(at, even, np.gradient(r, step))
        x = np.stack([moved, np.ones_like(moved), -slope], axis=1)
        coefficients, *_ = np.linalg.lstsq(x, s[rows], rcond=1e-10)
        if abs(coefficients[0]) < 1e-9:
            return None
        change = float(coefficients[2] / coefficients[0])
        shift += float(np.clip(change, -LARGEST_CHANGE_S, LARGEST_CHANGE_S))
        if abs(change) < 1e-3 * step:
            break
    return shift if abs(shift) < LONGEST_S else None
