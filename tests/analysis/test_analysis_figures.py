"""Figures of loops show every member, mark the margins that the table says, and tell members apart."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.support.ideal import ideal_hoist
from workbench.analysis.family import Member, family, operating_points, weakest
from workbench.analysis.linearise import OperatingPoint
from workbench.analysis.loop import step_response
from workbench.control import PiSettings
from workbench.machines import with_values
from workbench.study.loop_design import DesignCase
from workbench.view.loop import (
    bode,
    gang_of_four,
    member_name,
    nyquist,
    sentences,
    steps,
    table,
)

MACHINE = with_values(ideal_hoist(), {"drive.speed_delay_s": 0.005, "drive.torque_lag_s": 0.004})
SETTINGS = PiSettings(kp_nm_s_per_rad=40.0, ki_nm_per_rad=300.0, set_point_weight=0.8)


@pytest.fixture(scope="module")
def members() -> list[Member]:
    return family(MACHINE, SETTINGS, operating_points(MACHINE, (0.0, 4500.0, 9000.0), (2.0, 20.0)))


def case() -> DesignCase:
    return DesignCase(MACHINE, SETTINGS, "of a test", (0.0, 4500.0, 9000.0), (2.0, 20.0), None)


def lines(figure: Any, name: str) -> list[Any]:
    return [trace for trace in figure.data if trace.name == name]


def test_every_member_has_its_own_look_in_every_figure(members: list[Member]):
    for figure, panels in ((bode(members), 2), (nyquist(members, 1.4), 1), (gang_of_four(members, 1.4), 4)):
        looks = set()
        for member in members:
            traces = lines(figure, member_name(member))
            assert len(traces) == panels
            looks.add((traces[0].line.color, traces[0].line.dash))
        assert len(looks) == len(members)


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


def test_a_step_ends_at_what_the_loop_holds(members: list[Member]):
    response = step_response(members[0].loop, "speed_reference", 6.0)
    signals = response.signals
    assert signals["speed_motor_rad_s"][0] == 0.0
    assert signals["speed_motor_rad_s"][-1] == pytest.approx(1.0, abs=1e-3)
    assert signals["speed_carriage_m_s"][-1] == pytest.approx(MACHINE.lift_m_per_rad, rel=2e-3)
    # python-control's answer is that of the loop's own recursion.
    inputs = np.zeros((len(response.time_s), 3))
    inputs[:, 0] = 1.0
    own = members[0].loop.closed.run(inputs)
    np.testing.assert_allclose(signals["speed_motor_rad_s"], own[:, 0], atol=1e-9)
    assert len(lines(steps(members), member_name(members[0]))) == 4


def test_an_unstable_loop_gets_no_margins_in_table_or_figure():
    wild = PiSettings(kp_nm_s_per_rad=2000.0, ki_nm_per_rad=300.0)
    members = family(MACHINE, wild, [OperatingPoint(0.0, 5.0)])
    assert table(members).rows[0][2] == "unstable"
    assert "1 of 1 loops are unstable" in " ".join(sentences(case(), members))
    assert not any("margin" in (a.text or "") for a in bode(members).layout.annotations)
