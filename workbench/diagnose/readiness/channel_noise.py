"""The noise of one logged channel, read from the log itself: white, of its rounding, and of jittery time stamps."""

from __future__ import annotations

import numpy as np

from workbench.core.run import Array

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
    n = ORDER + 1
    t = np.lib.stride_tricks.sliding_window_view(time_s, n)
    y = np.lib.stride_tricks.sliding_window_view(values, n)
    apart = t[:, :, None] - t[:, None, :] + np.eye(n)
    weights = 1.0 / np.prod(apart, axis=2)  # of the divided difference
    weights /= np.linalg.norm(weights, axis=1)[:, None]
    return np.abs(np.sum(weights * (y - y[:, :1]), axis=1))


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
