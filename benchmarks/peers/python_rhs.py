"""The hoist's equations as a user of a general solver writes them: plain Python on floats.

Constants are bound once and no array is touched inside, which is the fastest form that
CPython has for six states; numpy scalars would cost three times as much.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import atan, pi

from ..hoist import Floats, Hoist

Torque = Callable[[float], float]


def linear_between(samples: Floats, interval_s: float) -> Torque:
    """Torque at any time, linear between evenly spaced samples; constant beyond the last."""
    values = samples.tolist()
    rises = [b - a for a, b in pairwise(values)] + [0.0]
    last, rate = len(values) - 1, 1.0 / interval_s

    def torque(t: float) -> float:
        s = t * rate
        k = min(int(s), last)
        return float(values[k] + rises[k] * (s - k))

    return torque


def make_rates(p: Hoist) -> Callable[[list[float], float], tuple[float, ...]]:
    """f(state, torque), the state's derivative."""
    inertia, arm, i, r, J_s, k, c, line, L, m, g, m_s, pin_s, pin_w, weight_w, up, down, slope = p
    up, down = up * 2.0 / pi, down * 2.0 / pi

    def rates(y: list[float], torque: float) -> tuple[float, ...]:
        th, w, th_s, w_s, x, v = y
        d1 = arm * th + r * th_s - x
        d2 = -r * th_s - x
        W1 = W2 = 0.0
        if d1 > 0.0:
            W1 = k * d1 + c * (arm * w + r * w_s - v)
            if W1 < 0.0:
                W1 = 0.0
        if d2 > 0.0:
            W2 = k * d2 - c * (r * w_s + v)
            if W2 < 0.0:
                W2 = 0.0
        pull = W1 + line * (L - x) * 0.5
        lift = W1 + W2 - line * (2.0 * L - arm * th) * 0.5
        a = (lift - (up if v > 0.0 else down) * atan(slope * v)) / m - g
        s = w_s * 100.0
        s = 1.0 if s > 1.0 else -1.0 if s < -1.0 else s
        z = i * w * 100.0
        z = 1.0 if z > 1.0 else -1.0 if z < -1.0 else z
        return (
            w,
            (torque - arm * pull - i * pin_w * abs(weight_w + pull) * z) / inertia,
            w_s,
            (r * (W2 - W1) - pin_s * abs(lift - m_s * (g + a)) * s) / J_s,
            v,
            a,
        )

    return rates
