"""The hoist of docs/model.md written a second time, by hand, and a plain Runge-Kutta method for it.

Nothing here is shared with workbench/kinds: plain floats, no tracing, the table of
symbols in one order. `rates` runs as Python and, jitted, inside the reference.
"""

from __future__ import annotations

import math
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

ORDER = (
    "n_m", "J_m", "ratio", "D_w", "Dp_w", "J_w", "m_w", "D_s", "Dp_s", "J_s", "m_s", "mu",
    "E", "A", "L", "tau", "m_c", "m_p", "s_p", "F_up", "F_dn", "slope", "g",
)  # fmt: skip
STEP = 5e-6  # s, of the reference


def table(p: SimpleNamespace) -> Array:
    return np.array([getattr(p, name) for name in ORDER])


def rates(s: Any, T: float, p: Any) -> tuple[float, float, float, float, float, float]:
    """d/dt of (theta_m, theta_s, x, omega_m, omega_s, v) under the torque T of all motors; p: `table`."""
    n, J_m, ratio, D_w, Dp_w, J_w, m_w, D_s, Dp_s, J_s, m_sh, mu = p[:12]
    E, A, L, tau, m_carriage, m_payload, scale, F_up, F_dn, slope, g = p[12:23]
    theta_m, theta_s, x, omega_m, omega_s, v = s
    i_g = 1.0 / ratio
    R = D_w / 2.0
    r = D_s / 2.0
    theta_w = i_g * theta_m
    omega_w = i_g * omega_m
    rho = 7850.0 * A
    m = m_carriage + scale * m_payload

    delta1 = R * theta_w + r * theta_s - x  # Eq. 3
    delta2 = -r * theta_s - x  # Eq. 4
    delta1_dot = R * omega_w + r * omega_s - v  # Eq. 5
    delta2_dot = -r * omega_s - v  # Eq. 6
    k = E * A / L  # Eq. 7
    W1 = 0.0
    if delta1 > 0.0:
        W1 = max(0.0, k * delta1 + tau * k * delta1_dot)  # Eq. 1
    W2 = 0.0
    if delta2 > 0.0:
        W2 = max(0.0, k * delta2 + tau * k * delta2_dot)  # Eq. 2

    half_fall = 0.5 * rho * g * (L - x)
    w_c = 0.5 * rho * g * (2.0 * L - R * theta_w)

    F = 2.0 / math.pi * math.atan(slope * v)  # Eq. 17
    if v > 0.0:
        F = F * F_up
    else:
        F = F * F_dn
    v_dot = (W1 + W2 - w_c - m * g - F) / m  # Eq. 16

    N_w = abs(m_w * g + W1 + half_fall)  # Eq. 8
    N_sh = abs(W1 + W2 - w_c - m_sh * g - m_sh * v_dot)  # Eq. 9
    S_w = max(-1.0, min(1.0, omega_w / 0.01))  # Eq. 13
    S_s = max(-1.0, min(1.0, omega_s / 0.01))
    T_pin_w = mu * N_w * Dp_w / 2.0 * S_w  # Eq. 12
    T_pin_s = mu * N_sh * Dp_s / 2.0 * S_s  # Eq. 11

    J = n * J_m + J_w * i_g**2
    omega_m_dot = (T - i_g * R * (W1 + half_fall) - i_g * T_pin_w) / J  # Eq. 15
    omega_s_dot = (r * (W2 - W1) - T_pin_s) / J_s  # Eq. 14
    return omega_m, omega_s, v, omega_m_dot, omega_s_dot, v_dot


@cache
def _runge_kutta() -> Any:
    import numba

    f = numba.njit(rates)
    moved = numba.njit(_moved)

    @numba.njit
    def run(start: Array, times: Array, torques: Array, p_array: Array, step: float) -> Array:
        p = (p_array[0], p_array[1], p_array[2], p_array[3], p_array[4], p_array[5], p_array[6], p_array[7],
             p_array[8], p_array[9], p_array[10], p_array[11], p_array[12], p_array[13], p_array[14], p_array[15],
             p_array[16], p_array[17], p_array[18], p_array[19], p_array[20], p_array[21], p_array[22])  # fmt: skip
        out = np.empty((len(times), 6))
        a = (start[0], start[1], start[2], start[3], start[4], start[5])
        for k in range(len(times)):
            out[k, 0], out[k, 1], out[k, 2], out[k, 3], out[k, 4], out[k, 5] = a
            if k == len(times) - 1:
                break
            H = times[k + 1] - times[k]
            n = math.ceil(H / step - 1e-9)
            h = H / n
            slope = (torques[k + 1] - torques[k]) / H
            for j in range(n):
                T = torques[k] + slope * (j * h)
                b = f(a, T, p)
                c = f(moved(a, b, 0.5 * h), T + 0.5 * h * slope, p)
                d = f(moved(a, c, 0.5 * h), T + 0.5 * h * slope, p)
                e = f(moved(a, d, h), T + h * slope, p)
                a = moved(moved(moved(moved(a, b, h / 6.0), c, h / 3.0), d, h / 3.0), e, h / 6.0)
        return out

    return run


def _moved(a: Any, b: Any, h: float) -> Any:
    return (
        a[0] + h * b[0], a[1] + h * b[1], a[2] + h * b[2], a[3] + h * b[3], a[4] + h * b[4], a[5] + h * b[5]
    )  # fmt: skip


def reference(p: SimpleNamespace, start: Array, times: Array, torques: Array, step: float = STEP) -> Array:
    """States (n, 6) at the times, by the classical Runge-Kutta method; the torque is linear between them."""
    return np.asarray(_runge_kutta()(np.asarray(start, float), times, torques, table(p), step))
