"""SUNDIALS' CVODE through scikit-sundae, BDF with Newton, right-hand side in plain Python."""

from __future__ import annotations

from typing import Any

import numpy as np
from sksundae.cvode import CVODE

from ..case import LOG_INTERVAL_S, Replay
from ..hoist import Floats
from .python_rhs import linear_between, make_rates


def replay(case: Replay, rtol: float, atol: float, max_step_s: float) -> Floats:
    """Motor speed at the log's samples, rad/s, in one call over the whole log."""
    rates = make_rates(case.hoist)
    torque = linear_between(case.torque_nm, LOG_INTERVAL_S)

    def f(t: float, y: Any, rate: Any) -> None:
        rate[:] = rates(y.tolist(), torque(t))

    solver = CVODE(f, method="BDF", rtol=rtol, atol=atol, max_step=max_step_s, max_num_steps=1_000_000)
    solution = solver.solve(case.time_s, np.array(case.start))
    if not solution.success:
        raise RuntimeError(f"CVODE stopped at {solution.t[-1]:.3f} s: {solution.message}")
    return np.asarray(solution.y[:, 1])
