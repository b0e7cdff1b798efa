"""Figures of sweeps, fronts, samples and of the torque-speed plane carry the numbers of their rows."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.core.run import Run
from workbench.machines import default_hoist
from workbench.view.study_figures import plane

JERK, KP = "sweep.limits.jerk_m_s3", "sweep.controller.kp_nm_s_per_rad"


def one(figure, name):
    (trace,) = [trace for trace in figure.data if trace.name == name]
    return trace


def test_the_plane_keeps_the_corners_of_a_long_path():
    time = np.linspace(0.0, 40.0, 40_001)
    torque = np.where(np.abs(time - 20.0) < 0.0006, 900.0, 400.0 + 50.0 * np.sin(time))
    signals = {"speed_motor_rad_s": 145.0 * np.sin(time / 5.0), "torque_motor_nm": 2.0 * torque}
    path = one(plane([("ruckig", Run("x", time, signals, 0.0))], default_hoist()), "ruckig, same limits")
    assert len(path.x) < 2000
    assert path.y.max() == pytest.approx(900.0)
    assert path.x.max() == pytest.approx(145.0, rel=1e-4)
