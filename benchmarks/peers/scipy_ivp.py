"""SciPy: solve_ivp with BDF and LSODA, and least_squares over it; the right-hand side in plain Python."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from ..case import LOG_INTERVAL_S, Loop, Replay
from ..hoist import Floats, Hoist, control
from .python_rhs import linear_between, make_rates


def replay(case: Replay, method: str, rtol: float, atol: float, max_step_s: float) -> Floats:
    """Motor speed at the log's samples, rad/s, in one call over the whole log."""
    return replay_with(case.hoist, case, method, rtol, atol, max_step_s)


def replay_with(p: Hoist, case: Replay, method: str, rtol: float, atol: float, max_step_s: float) -> Floats:
    """The same for other parameters than the log's machine has."""
    rates = make_rates(p)
    torque = linear_between(case.torque_nm, LOG_INTERVAL_S)

    def f(t: float, y: Any) -> tuple[float, ...]:
        return rates(y.tolist(), torque(t))

    span = (0.0, float(case.time_s[-1]))
    solution = solve_ivp(
        f, span, case.start, method=method, t_eval=case.time_s, rtol=rtol, atol=atol, max_step=max_step_s
    )
    if not solution.success:
        raise RuntimeError(f"{method} stopped at {solution.t[-1]:.3f} s: {solution.message}")
    return np.asarray(solution.y[1])


def closed_loop(case: Loop, rtol: float, atol: float) -> Floats:
    """Motor speed at the controller's samples, rad/s: LSODA started anew at each of them."""
    rates = make_rates(case.hoist)
    y = np.array(case.start)
    integral, end = case.hold_nm, case.loop.interval_s
    speeds = np.empty(case.wanted_rad_s.size)
    for k, wanted in enumerate(case.wanted_rad_s.tolist()):
        speeds[k] = y[1]
        torque, integral = control(case.loop, integral, wanted, float(y[1]))

        def f(t: float, y: Any, torque: float = torque) -> tuple[float, ...]:
            return rates(y.tolist(), torque)

        y = solve_ivp(f, (0.0, end), y, method="LSODA", rtol=rtol, atol=atol).y[:, -1]
    return speeds


def friction_fit(case: Replay, start: Hoist, rtol: float, atol: float, step: float, xtol: float) -> Floats:
    """Both friction levels, N, and the slope, s/m, by least squares over LSODA replays.

    step: relative, for the differences that least_squares takes.
    """
    nominal = np.array([start.up, start.down, start.slope])

    def residual(x: Floats) -> Floats:
        p = start._replace(up=float(x[0]), down=float(x[1]), slope=float(x[2]))
        return replay_with(p, case, "LSODA", rtol, atol, np.inf) - case.speed_rad_s

    solution = least_squares(residual, nominal, x_scale=nominal, diff_step=step, xtol=xtol, ftol=0.1 * xtol)
    return np.asarray(solution.x)
