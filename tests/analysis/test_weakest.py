"""The least of each margin, and what ends a bandwidth."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from tests.support.ideal import ideal_hoist
from workbench.analysis.family import family, operating_points, weakest
from workbench.analysis.linearise import OperatingPoint, linearise
from workbench.analysis.search import anti_resonances
from workbench.analysis.tune import Goal, TuneProgress, tune
from workbench.analysis.usual import usual_controller
from workbench.control import Events, PiSettings
from workbench.machines import with_values
from workbench.study.loop_design import loop_case
from workbench.view.loop import sentences

SLOW = {"drive.torque_lag_s": 0.004, "drive.speed_filter_s": 0.003, "drive.speed_delay_s": 0.002}
MACHINE = with_values(ideal_hoist(), SLOW)
RINGING = with_values(ideal_hoist(), SLOW | {"wire.damping_time_s": 0.002})


def test_the_weakest_has_the_least_of_each_margin_and_names_its_member():
    members = family(MACHINE, usual_controller(MACHINE), operating_points(MACHINE, (0.0, 9000.0), (0.0, 20.0)))
    worst = weakest(members)
    for name, least in (
        ("phase_deg", min),
        ("gain_up", min),
        ("delay_s", min),
        ("disk", min),
        ("ms", max),
        ("mt", max),
    ):
        expected = least(getattr(m.margins, name) for m in members)
        assert getattr(worst.margins, name) == expected == getattr(worst.member[name].margins, name)
    assert worst.margins.rejection_hz == min(m.margins.rejection_hz for m in members)


def test_an_unstable_member_leaves_no_margin():
    wild = PiSettings(kp_nm_s_per_rad=2000.0, ki_nm_per_rad=300.0)
    worst = weakest(family(MACHINE, wild, operating_points(MACHINE, (0.0,), (5.0,))))
    assert not worst.margins.stable
    assert not worst.member["phase_deg"].margins.stable


def test_below_the_rejection_bandwidth_every_disturbance_is_held_below_3_db():
    (member,) = family(MACHINE, usual_controller(MACHINE), [OperatingPoint(4500.0, 10.0)])
    f = member.margins.rejection_hz
    assert abs(member.loop.responses(np.array([f])).S[0]) == pytest.approx(math.sqrt(0.5), rel=1e-9)
    assert np.all(np.abs(member.loop.responses(np.geomspace(1e-2, 0.999 * f, 200)).S) < math.sqrt(0.5))


def test_the_anti_resonance_is_the_load_on_its_two_falls_while_the_motor_stands():
    point = OperatingPoint(9000.0, 10.0)
    plant = linearise(RINGING, point)
    zero = anti_resonances(plant, point)[0]
    wire, mass = RINGING.wire, RINGING.carriage.mass_kg + 9000.0
    k = 2.0 * wire.youngs_modulus_pa * wire.effective_area_m2 / wire.segment_length_m
    assert zero.frequency_hz == pytest.approx(math.sqrt(k / mass) / (2.0 * math.pi), rel=0.01)
    assert zero.damping == pytest.approx(0.5 * 0.002 * math.sqrt(k / mass), rel=0.05)


class StopError(Exception):
    pass


def test_a_tuning_tells_its_steps_and_ends_where_it_is_told_to():
    case = loop_case(MACHINE, None, (0.0,), (10.0,), None)
    heard: list[TuneProgress] = []

    def stop(progress: TuneProgress) -> None:
        heard.append(progress)
        if progress.step == 2:
            raise StopError

    points = [OperatingPoint(0.0, 10.0)]
    with pytest.raises(StopError):
        tune(case.machine, case.settings, points, case.trial(), Goal(4.0), tell=stop)
    assert [p.step for p in heard] == [0, 1, 2]


def test_a_tuning_runs_under_the_scenarios_events():
    case = loop_case(None, None, None, (10.0,), "scenarios/motor_failure.yaml")
    assert case.trial().events == case.events != Events()


def test_a_loop_says_that_the_scenarios_events_leave_its_margins():
    case = loop_case(None, None, (9000.0,), (10.0,), "scenarios/motor_failure.yaml")
    members = family(case.machine, case.settings, operating_points(case.machine, (9000.0,), (10.0,)))
    said = " ".join(sentences(case, members))
    assert "The scenario's events (motor_fails_s 10) leave these margins as they are" in said


def test_a_loop_that_less_gain_makes_unstable_says_by_how_much_less():
    case = loop_case(None, None, None, None, "scenarios/axis.yaml")
    members = family(case.machine, case.settings, operating_points(case.machine, (0.0,), (0.0,)))
    (margins,) = (member.margins for member in members)
    assert 0.0 < margins.gain_down < 1.0
    said = re.search(r"smallest gain margin downwards ([\d.]+) dB", " ".join(sentences(case, members)))
    assert said is not None and float(said[1]) == pytest.approx(-20.0 * math.log10(margins.gain_down), abs=0.05)
