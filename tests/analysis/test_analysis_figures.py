"""Figures of loops show every member, mark the margins that the table says, and tell members apart."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.support.ideal import ideal_hoist
from workbench.analysis.family import Member, family, operating_points, weakest
from workbench.control import PiSettings
from workbench.machines import with_values
from workbench.view.loop import bode, member_name, nyquist

MACHINE = with_values(ideal_hoist(), {"drive.speed_delay_s": 0.005, "drive.torque_lag_s": 0.004})
SETTINGS = PiSettings(kp_nm_s_per_rad=40.0, ki_nm_per_rad=300.0, set_point_weight=0.8)


@pytest.fixture(scope="module")
def members() -> list[Member]:
    return family(MACHINE, SETTINGS, operating_points(MACHINE, (0.0, 4500.0, 9000.0), (2.0, 20.0)))


def lines(figure: Any, name: str) -> list[Any]:
    return [trace for trace in figure.data if trace.name == name]


def test_the_bode_figure_draws_the_weakest_members_margins_where_its_curve_is(members: list[Member]):
    figure = bode(members)
    m = weakest(members).margins
    texts = [a.text for a in figure.layout.annotations]
    assert any(f"gain margin {20 * math.log10(m.gain_up):.1f} dB at {m.gain_up_hz:.3g} Hz" in t for t in texts)
    assert any(f"phase margin {m.phase_deg:.0f}° at {m.crossover_hz:.3g} Hz" in t for t in texts)
    bars = {round(shape.x0, 9): shape for shape in figure.layout.shapes if shape.x0 == shape.x1}
    gain, phase = bars[round(m.gain_up_hz, 9)], bars[round(m.crossover_hz, 9)]
    assert abs(gain.y1) == pytest.approx(20.0 * math.log10(m.gain_up), rel=1e-6)
    assert abs(phase.y1 - phase.y0) == pytest.approx(m.phase_deg, abs=0.1)
    assert figure.layout.xaxis.type == "log"


def test_the_ms_circle_touches_the_curve_that_comes_nearest(members: list[Member]):
    figure = nyquist(members, 1.4)
    worst = max(m.margins.ms for m in members)
    (circle,) = (t for t in figure.data if "the largest" in (t.name or ""))
    assert np.hypot(np.array(circle.x) + 1.0, circle.y) == pytest.approx(1.0 / worst)
    distances = [np.hypot(np.array(t.x) + 1.0, t.y).min() for m in members for t in lines(figure, member_name(m))]
    assert min(distances) == pytest.approx(1.0 / worst, rel=2e-3)
