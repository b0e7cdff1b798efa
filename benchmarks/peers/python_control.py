"""python-control's input_output_response on a NonlinearIOSystem, with LSODA underneath."""

from __future__ import annotations

from typing import Any

import control
import numpy as np

from ..case import Replay
from ..hoist import Floats
from .python_rhs import make_rates


def replay(case: Replay, rtol: float, atol: float, max_step_s: float) -> Floats:
    """Motor speed at the log's samples, rad/s; the tool itself interpolates the torque linearly."""
    rates = make_rates(case.hoist)

    def f(t: float, y: Any, u: Any, params: Any) -> tuple[float, ...]:
        return rates(y.tolist(), float(u[0]))

    system = control.nlsys(f, None, inputs=1, states=6, outputs=6)
    response = control.input_output_response(
        system,
        case.time_s,
        case.torque_nm,
        np.array(case.start),
        solve_ivp_method="LSODA",
        solve_ivp_kwargs={"rtol": rtol, "atol": atol, "max_step": max_step_s},
    )
    return np.asarray(response.states[1])
