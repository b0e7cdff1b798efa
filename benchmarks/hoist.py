"""The hoist written down a second time, apart from the workbench, and its reference solution.

Plain functions on floats after docs/model.md, sharing no code with the package: what
the benchmarks call the error is the distance to this. Up and hoisting are positive.
State: motor angle, motor speed, sheave angle, sheave speed, carriage height, carriage speed.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import yaml
from numpy.typing import NDArray

Floats = NDArray[np.float64]
DEFAULT_MACHINE = Path(__file__).resolve().parent.parent / "workbench" / "machines" / "default_hoist.yaml"
STEP_S = 5e-6  # halving it moves the motor speed by less than 1e-9 of its largest value


class Hoist(NamedTuple):
    """The numbers in the equations, SI."""

    inertia: float  # kg m^2 at the motor: rotors and drum
    arm: float  # m of drum-side wire per rad of motor: R/ratio
    i: float  # drum speed over motor speed
    r: float  # m, sheave radius
    J_s: float  # kg m^2
    k: float  # N/m, one fall
    c: float  # N s/m
    line: float  # N/m, weight of a metre of wire
    L: float  # m
    m: float  # kg, carriage and payload
    g: float  # m/s^2
    m_s: float  # kg, sheave
    pin_s: float  # m: friction coefficient times pin radius, sheave
    pin_w: float  # m: the same, drum
    weight_w: float  # N, drum
    up: float  # N, guide friction hoisting
    down: float  # N, guide friction lowering
    slope: float  # s/m


def load_hoist(payload_kg: float, machine: Path = DEFAULT_MACHINE) -> Hoist:
    """The hoist of a machine.yaml with a payload."""
    d = yaml.safe_load(machine.read_text(encoding="utf-8"))
    i = 1.0 / d["gearbox"]["ratio"]
    g = d["gravity_m_s2"]
    mu = d["bearing"]["pin_friction_coefficient"]
    wire = d["wire"]
    k = wire["youngs_modulus_pa"] * wire["effective_area_m2"] / wire["segment_length_m"]
    return Hoist(
        inertia=d["motor"]["count"] * d["motor"]["rotor_inertia_kg_m2"] + d["winch"]["inertia_kg_m2"] * i * i,
        arm=i * d["winch"]["drum_diameter_m"] / 2.0,
        i=i,
        r=d["sheave"]["diameter_m"] / 2.0,
        J_s=d["sheave"]["inertia_kg_m2"],
        k=k,
        c=wire["damping_time_s"] * k,
        line=7850.0 * wire["effective_area_m2"] * g,
        L=wire["segment_length_m"],
        m=d["carriage"]["mass_kg"] + payload_kg,
        g=g,
        m_s=d["sheave"]["mass_kg"],
        pin_s=mu * d["sheave"]["pin_diameter_m"] / 2.0,
        pin_w=mu * d["winch"]["pin_diameter_m"] / 2.0,
        weight_w=d["winch"]["mass_kg"] * g,
        up=d["guide"]["coulomb_hoisting_n"],
        down=d["guide"]["coulomb_lowering_n"],
        slope=d["guide"]["atan_slope_s_per_m"],
    )


State = tuple[float, float, float, float, float, float]


def hanging(p: Hoist, height_m: float) -> tuple[State, float]:
    """Hanging still at a height: the state, and the torque that holds it, N m.

    Each fall carries half of what hangs from the sheave, m g + line (2 L - wound)/2;
    the wire wound, arm*angle, is twice the height and each fall's stretch. Iterated to a fixed point.
    """
    stretch = 0.0
    for _ in range(50):
        wound = 2.0 * (height_m + stretch)
        stretch = (p.m * p.g + p.line * (2.0 * p.L - wound) / 2.0) / (2.0 * p.k)
    wound = 2.0 * (height_m + stretch)
    hold = p.arm * (p.k * stretch + p.line * (p.L - height_m) / 2.0)
    return (wound / p.arm, 0.0, -(height_m + stretch) / p.r, 0.0, height_m, 0.0), hold


def rates(p: Hoist, th: float, w: float, th_s: float, w_s: float, x: float, v: float, torque: float) -> State:
    """The state's derivative under the torque of both motors, N m."""
    d1 = p.arm * th + p.r * th_s - x
    d2 = -p.r * th_s - x
    W1 = max(0.0, p.k * d1 + p.c * (p.arm * w + p.r * w_s - v)) if d1 > 0.0 else 0.0
    W2 = max(0.0, p.k * d2 + p.c * (-p.r * w_s - v)) if d2 > 0.0 else 0.0
    drum_pull = W1 + p.line * (p.L - x) / 2.0
    lift = W1 + W2 - p.line * (2.0 * p.L - p.arm * th) / 2.0
    guide = (p.up if v > 0.0 else p.down) * math.atan(p.slope * v) * (2.0 / math.pi)
    a = (lift - p.m * p.g - guide) / p.m
    pin_s = p.pin_s * abs(lift - p.m_s * (p.g + a)) * min(1.0, max(-1.0, w_s / 0.01))
    pin_w = p.pin_w * abs(p.weight_w + drum_pull) * min(1.0, max(-1.0, p.i * w / 0.01))
    return (
        w,
        (torque - p.arm * drum_pull - p.i * pin_w) / p.inertia,
        w_s,
        (p.r * (W2 - W1) - pin_s) / p.J_s,
        v,
        a,
    )


_rates = numba.njit(rates)


@numba.njit
def _rk4(p: Hoist, y: State, torque: float, rise: float, h: float, n: int) -> State:
    """n classical Runge-Kutta steps of length h; the torque rises linearly by `rise` per second."""
    a, b, c, d, e, f = y
    for j in range(n):
        u0 = torque + rise * (j * h)
        um = u0 + rise * (0.5 * h)
        u1 = u0 + rise * h
        k1 = _rates(p, a, b, c, d, e, f, u0)
        q = 0.5 * h
        k2 = _rates(p, a + q * k1[0], b + q * k1[1], c + q * k1[2], d + q * k1[3], e + q * k1[4], f + q * k1[5], um)
        k3 = _rates(p, a + q * k2[0], b + q * k2[1], c + q * k2[2], d + q * k2[3], e + q * k2[4], f + q * k2[5], um)
        k4 = _rates(p, a + h * k3[0], b + h * k3[1], c + h * k3[2], d + h * k3[3], e + h * k3[4], f + h * k3[5], u1)
        s = h / 6.0
        a += s * (k1[0] + 2.0 * (k2[0] + k3[0]) + k4[0])
        b += s * (k1[1] + 2.0 * (k2[1] + k3[1]) + k4[1])
        c += s * (k1[2] + 2.0 * (k2[2] + k3[2]) + k4[2])
        d += s * (k1[3] + 2.0 * (k2[3] + k3[3]) + k4[3])
        e += s * (k1[4] + 2.0 * (k2[4] + k3[4]) + k4[4])
        f += s * (k1[5] + 2.0 * (k2[5] + k3[5]) + k4[5])
    return a, b, c, d, e, f


@numba.njit
def _replay(p: Hoist, y: State, torque: Floats, interval_s: float, n: int) -> Floats:
    out = np.empty((torque.size, 6))
    for k in range(torque.size):
        out[k] = y
        if k + 1 < torque.size:
            y = _rk4(p, y, torque[k], (torque[k + 1] - torque[k]) / interval_s, interval_s / n, n)
    return out


def reference_replay(p: Hoist, start: State, torque_nm: Floats, interval_s: float, step_s: float = STEP_S) -> Floats:
    """The states at the samples, (n, 6), under torque that is linear between its samples."""
    return np.asarray(_replay(p, start, torque_nm, interval_s, round(interval_s / step_s)))


class SpeedLoop(NamedTuple):
    """A sampled PI speed controller with back-calculation, held between samples."""

    kp: float  # N m s/rad
    ki: float  # N m/rad
    limit_nm: float
    interval_s: float


def control(loop: SpeedLoop, integral: float, wanted: float, measured: float) -> tuple[float, float]:
    """One sample: (torque, N m; the integral term after it). At the limit the integral runs back in kp/ki seconds."""
    error = wanted - measured
    raw = loop.kp * error + integral
    torque = min(loop.limit_nm, max(-loop.limit_nm, raw))
    return torque, integral + loop.interval_s * (loop.ki * error + (torque - raw) * loop.ki / loop.kp)


_control = numba.njit(control)


@numba.njit
def _closed_loop(p: Hoist, y: State, hold: float, loop: SpeedLoop, wanted: Floats, n: int) -> tuple[Floats, Floats]:
    states = np.empty((wanted.size + 1, 6))
    torque = np.empty(wanted.size)
    integral = hold
    for k in range(wanted.size):
        states[k] = y
        torque[k], integral = _control(loop, integral, wanted[k], y[1])
        y = _rk4(p, y, torque[k], 0.0, loop.interval_s / n, n)
    states[wanted.size] = y
    return states, torque


def reference_loop(
    p: Hoist, start: State, hold_nm: float, loop: SpeedLoop, wanted_rad_s: Floats, step_s: float = STEP_S
) -> tuple[Floats, Floats]:
    """States at the n samples and at the end, (n + 1, 6), and the n torques, N m, of the sampled loop."""
    states, torque = _closed_loop(p, start, hold_nm, loop, wanted_rad_s, round(loop.interval_s / step_s))
    return np.asarray(states), np.asarray(torque)


def speed_error(speed_rad_s: Floats, reference_rad_s: Floats) -> float:
    """Largest deviation of the motor speed over its largest value."""
    return float(np.max(np.abs(speed_rad_s - reference_rad_s)) / np.max(np.abs(reference_rad_s)))
