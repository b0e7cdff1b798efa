"""CasADi: its CVODES integrator for the replay, its mapped RK4 for sampled loops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..case import Loop, Replay
from ..hoist import Floats, Hoist


def make_rates(p: Hoist, y: Any, torque: Any) -> Any:
    """The state's derivative as a CasADi expression."""
    th, w, th_s, w_s, x, v = ca.vertsplit(y)
    d1 = p.arm * th + p.r * th_s - x
    d2 = -p.r * th_s - x
    W1 = ca.if_else(d1 > 0.0, ca.fmax(0.0, p.k * d1 + p.c * (p.arm * w + p.r * w_s - v)), 0.0)
    W2 = ca.if_else(d2 > 0.0, ca.fmax(0.0, p.k * d2 - p.c * (p.r * w_s + v)), 0.0)
    pull = W1 + p.line * (p.L - x) / 2.0
    lift = W1 + W2 - p.line * (2.0 * p.L - p.arm * th) / 2.0
    guide = ca.if_else(v > 0.0, p.up, p.down) * ca.atan(p.slope * v) * (2.0 / np.pi)
    a = (lift - guide) / p.m - p.g
    pin_s = p.pin_s * ca.fabs(lift - p.m_s * (p.g + a)) * ca.fmin(1.0, ca.fmax(-1.0, w_s * 100.0))
    pin_w = p.pin_w * ca.fabs(p.weight_w + pull) * ca.fmin(1.0, ca.fmax(-1.0, p.i * w * 100.0))
    return ca.vertcat(
        w, (torque - p.arm * pull - p.i * pin_w) / p.inertia, w_s, (p.r * (W2 - W1) - pin_s) / p.J_s, v, a
    )


def make_replay(case: Replay, rtol: float, atol: float) -> Any:
    """CVODES over the whole log in one call, the torque a linear interpolant of time.

    (Torque and slope as piecewise constant inputs, where CVODES starts anew at each sample, took longer.)
    """
    torque = ca.interpolant("torque", "linear", [case.time_s.tolist()], case.torque_nm.tolist())
    y, t, u, x = ca.MX.sym("y", 6), ca.MX.sym("t"), ca.SX.sym("u"), ca.SX.sym("x", 6)
    rates = ca.Function("rates", [x, u], [make_rates(case.hoist, x, u)])
    dae = {"x": y, "t": t, "ode": rates(y, torque(t))}
    options = {"reltol": rtol, "abstol": atol, "max_num_steps": 1_000_000}
    return ca.integrator("replay", "cvodes", dae, float(case.time_s[0]), case.time_s[1:].tolist(), options)


def replay(case: Replay, integrator: Any) -> Floats:
    """Motor speed at the log's samples, rad/s."""
    end = integrator(x0=case.start)
    return np.append(case.start[1], np.asarray(end["xf"])[1])


def make_loop(case: Loop, steps: int) -> Any:
    """The sampled loop with `steps` Runge-Kutta steps between samples, rolled out over the whole run.

    What rolls on is the state, the integral, and what scenarios differ in: mass and both gains.
    """
    y, integral, wanted = ca.SX.sym("y", 6), ca.SX.sym("integral"), ca.SX.sym("wanted")
    mass, kp, ki = ca.SX.sym("mass"), ca.SX.sym("kp"), ca.SX.sym("ki")
    symbolic: dict[str, Any] = {"m": mass}
    p, dt, limit = case.hoist._replace(**symbolic), case.loop.interval_s, case.loop.limit_nm
    error = wanted - y[1]
    raw = kp * error + integral
    torque = ca.fmin(limit, ca.fmax(-limit, raw))
    after = integral + dt * (ki * error + (torque - raw) * ki / kp)
    h = dt / steps
    end = y
    for _ in range(steps):
        k1 = make_rates(p, end, torque)
        k2 = make_rates(p, end + 0.5 * h * k1, torque)
        k3 = make_rates(p, end + 0.5 * h * k2, torque)
        k4 = make_rates(p, end + h * k3, torque)
        end = end + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    rolling = ca.vertcat(y, integral, mass, kp, ki)
    sample = ca.Function("sample", [rolling, wanted], [ca.vertcat(end, after, mass, kp, ki)])
    return sample.mapaccum("rolled", case.wanted_rad_s.size)


def closed_loops(rolled: Any, cases: Sequence[Loop]) -> list[Floats]:
    """Motor speed at the controller's samples, rad/s, of every case; CasADi's map over the cases."""
    starts = np.array([(*c.start, c.hold_nm, c.hoist.m, c.loop.kp, c.loop.ki) for c in cases]).T
    wanted = np.concatenate([c.wanted_rad_s for c in cases])[None, :]
    mapped = rolled if len(cases) == 1 else rolled.map(len(cases), "serial")
    speeds = np.asarray(mapped(starts, wanted)[1, :]).reshape(len(cases), -1)
    return [np.append(case.start[1], s[:-1]) for case, s in zip(cases, speeds, strict=True)]
