"""Figures of sweeps, fronts, samples and of the torque-speed plane carry the numbers of their rows."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.core.run import Run
from workbench.machines import default_hoist
from workbench.study.front import fronts
from workbench.study.labels import swept_axes
from workbench.study.rows import Row
from workbench.view.study_figures import envelope_nm, metrics_over_axis, pareto, plane

JERK, KP = "sweep.limits.jerk_m_s3", "sweep.controller.kp_nm_s_per_rad"
PEAK = "peak_torque_motor_nm"


def row(assigned: dict[str, float | str], kind: str = "ruckig", payload: float = 0.0, **changes: float) -> Row:
    metrics = {
        PEAK: 400.0, "speed_error_max_rad_s": 3.0, "min_wire_tension_n": 5e4, "wire_tension_swing_n": 8e3,
        "move_time_s": 30.0,
    }  # fmt: skip
    name = "_".join([kind, f"{payload:g}", *map(str, assigned.values())])
    return Row(name, "s", "ok", "", payload, kind, metrics | changes, assigned)


def trade() -> list[Row]:
    """Time for torque along a hyperbola, and one run that is beaten."""
    rows = [row({JERK: 8.0 / t}, move_time_s=30.0 + t, peak_torque_motor_nm=400.0 + 200.0 / t) for t in (1, 2, 4, 8)]
    return [*rows, row({JERK: 9.0}, move_time_s=39.0, peak_torque_motor_nm=650.0)]


def one(figure, name):
    (trace,) = [trace for trace in figure.data if trace.name == name]
    return trace


def test_a_front_joins_the_runs_that_none_beats_and_rings_its_knee():
    rows = trade()
    (front,) = fronts(rows)
    figure = pareto(rows, [front], swept_axes(rows), PEAK)
    line = one(figure, "front: beaten by no run")
    np.testing.assert_allclose(line.x, [31, 32, 34, 38])
    np.testing.assert_allclose(line.y, [600, 500, 450, 425])
    knee = one(figure, "knee")
    assert front.knee is not None
    assert (knee.x[0], knee.y[0]) == (front.knee["move_time_s"], front.knee[PEAK])
    (note,) = [note.text for note in figure.layout.annotations if "knee" in note.text]
    assert f"jerk {front.knee.assigned[JERK]:g} m/s³" in note
    assert len(one(figure, "ruckig, same limits").x) == 5


def test_over_an_axis_the_worst_of_the_other_runs_is_the_line():
    rows = [row({JERK: j, KP: k}, peak_torque_motor_nm=100.0 * j + k) for j in (1.0, 2.0) for k in (10.0, 30.0)]
    (jerk, _) = swept_axes(rows)
    figure = metrics_over_axis(rows, jerk, 480.0, 768.0)
    np.testing.assert_allclose(one(figure, "ruckig, same limits").y, [130.0, 230.0])
    band = one(figure, "ruckig, same limits: all")
    np.testing.assert_allclose(band.y, [130.0, 230.0, 210.0, 110.0])
    assert {shape.y0 for shape in figure.layout.shapes} == {480.0, 768.0}


def test_the_envelope_is_flat_to_nominal_speed_and_then_of_constant_power():
    speed = np.array([0.0, 157.0, -157.0, 314.0])
    np.testing.assert_allclose(envelope_nm(speed, 768.0, 157.0, True), [768.0, 768.0, 768.0, 384.0])
    np.testing.assert_allclose(envelope_nm(speed, 768.0, 157.0, False), 768.0)


def test_the_plane_keeps_the_corners_of_a_long_path():
    time = np.linspace(0.0, 40.0, 40_001)
    torque = np.where(np.abs(time - 20.0) < 0.0006, 900.0, 400.0 + 50.0 * np.sin(time))
    signals = {"speed_motor_rad_s": 145.0 * np.sin(time / 5.0), "torque_motor_nm": 2.0 * torque}
    path = one(plane([("ruckig", Run("x", time, signals, 0.0))], default_hoist()), "ruckig, same limits")
    assert len(path.x) < 2000
    assert path.y.max() == pytest.approx(900.0)
    assert path.x.max() == pytest.approx(145.0, rel=1e-4)
