"""The linear loop of an axis against closed forms and against python-control built by itself."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest

from tests.support.axes import CASCADE, emps, followed, ideal_axis, two_inertia
from workbench.analysis.linearise import OperatingPoint, linearise
from workbench.analysis.loop import linear_loop, load_step, position_answer
from workbench.analysis.margins import family, margins, operating_points, weakest
from workbench.analysis.tune import Goal, tune
from workbench.analysis.usual import usual_cascade
from workbench.control import LinearCascade
from workbench.core.errors import InputError
from workbench.references import Limits, Step, plan_motion
from workbench.study.loop_design import loop_case

POINT = OperatingPoint(0.0, 0.0)
DT = 0.001


def by_hand(
    mass: float, viscous: float, settings: LinearCascade, lag_s: float = 0.0, filter_s: float = 0.0, late: int = 0
):
    """The loop opened at the drive, from python-control alone: plant under a held force, filtered speed plus kv times
    position, both late, PI with the integral a sample behind."""
    continuous = control.ss([[-viscous / mass, 0.0], [1.0, 0.0]], [[1.0 / mass], [0.0]], np.eye(2), np.zeros((2, 1)))
    if lag_s:
        continuous = continuous * control.tf([1.0], [lag_s, 1.0])
    plant = control.c2d(control.ss(continuous), DT, "zoh")
    alpha = 1.0 - math.exp(-DT / filter_s) if filter_s else 1.0
    z = control.tf([1.0, 0.0], [1.0], DT)
    smooth = control.tf([alpha, 0.0], [1.0, alpha - 1.0], DT)
    pi = settings.kp + control.tf([settings.ki * DT], [1.0, -1.0], DT)
    speed, position = (control.tf(plant[i, 0]) for i in range(2))
    return pi * (smooth * speed + settings.kv_per_s * position) * z ** (-late)


@pytest.mark.parametrize("kv", [0.0, 17.5, 60.0])
def test_the_poles_are_those_of_python_control(kv: float):
    settings = CASCADE.model_copy(update={"kv_per_s": kv})
    loop = linear_loop(ideal_axis(friction__viscous_n_s_per_m=203.5), settings, POINT)
    expected = control.feedback(control.minreal(by_hand(95.1089, 203.5, settings), verbose=False)).poles()
    found = np.array(sorted(loop.poles(), key=lambda p: (abs(p), p.imag)))
    cancelled = (1.0, math.exp(-203.5 / 95.1089 * DT))  # the plant's own, in each of the sum's two fractions
    expected = [p for p in expected if min(abs(p - c) for c in cancelled) > 1e-6]
    expected = np.array(sorted(expected, key=lambda p: (abs(p), p.imag)))
    assert len(expected) == (3 if kv else 2)
    np.testing.assert_allclose(found[-len(expected) :], expected, atol=1e-6)


def test_the_margins_are_those_of_python_control():
    """A drive with lag, filter and two samples of delay; an ideal encoder, which counts no mean."""
    drive = emps().drive.model_copy(update={"encoder_counts_per_m": 0, "speed_delay_s": 2 * DT, "torque_lag_s": 0.0008})
    machine = ideal_axis(friction__viscous_n_s_per_m=203.5).model_copy(update={"drive": drive})
    m = margins(linear_loop(machine, CASCADE, POINT))
    L = by_hand(95.1089, 203.5, CASCADE, lag_s=0.0008, filter_s=0.001, late=2)
    f = np.geomspace(0.5, 499.0, 4_000)
    response = L(np.exp(2j * np.pi * f * DT))
    gain, phase, _, at_phase, at_gain, _ = control.stability_margins(L)
    assert m.stable
    assert m.gain_up == pytest.approx(gain, rel=1e-3)
    assert m.phase_deg == pytest.approx(phase, rel=1e-3)
    assert m.crossover_hz == pytest.approx(at_gain / (2.0 * np.pi), rel=1e-3)
    assert m.gain_up_hz == pytest.approx(at_phase / (2.0 * np.pi), rel=1e-3)
    assert m.ms == pytest.approx(np.max(np.abs(1.0 / (1.0 + response))), rel=1e-4)
    assert m.mt == pytest.approx(np.max(np.abs(response / (1.0 + response))), rel=1e-4)


def test_a_load_step_leaves_no_speed_and_no_place_with_an_integral():
    loop = linear_loop(emps(), CASCADE, POINT)
    answer, speed = position_answer(loop), load_step(loop)
    assert answer is not None and answer.left < 1e-3 * answer.peak
    assert speed.peak_rad_s > 0.0 and speed.recovery_s < 1.0


def test_a_load_step_without_an_integral_leaves_the_load_over_kp_kv():
    settings = CASCADE.model_copy(update={"ki_n_per_m": 0.0})
    answer = position_answer(linear_loop(ideal_axis(), settings, POINT))
    assert answer is not None
    assert answer.left == pytest.approx(1.0 / (settings.kp * settings.kv_per_s), rel=1e-3)


def test_the_linear_loop_is_the_compiled_one_for_a_small_motion():
    """Without friction all is linear: the exact linear loop driven by the same references gives the same force."""
    plan = plan_motion("ruckig", [Step(by_m=1e-3)], 0.0, Limits(0.01, 0.5, 20.0), (-np.inf, np.inf), 0.05, 0.3)
    drive = emps().drive.model_copy(update={"encoder_counts_per_m": 0})
    machine = ideal_axis().model_copy(update={"drive": drive})
    run, profile = followed(machine, CASCADE, plan).run, plan.sample(DT)
    loop = linear_loop(machine, CASCADE, POINT)
    zeros = np.zeros((len(profile.time_s), 2))
    out = loop.closed.run(np.column_stack([profile.position_m, profile.speed_m_s, zeros]))
    shown = dict(zip(loop.shown, out.T, strict=True))
    np.testing.assert_allclose(run["position_m"], shown["position_m"], atol=1e-9)
    np.testing.assert_allclose(run["velocity_m_s"], shown["velocity_m_s"], atol=1e-8)


def test_moving_an_axis_shows_its_viscous_friction_at_rest_its_standstill_slope():
    moving, still = (linearise(emps(), OperatingPoint(0.0, 0.0, way)) for way in ("hoisting", "at_rest"))
    M, B = emps().mass_kg, emps().friction.viscous_n_s_per_m
    assert moving.A[-1, -1] == pytest.approx(-B / M)
    slope = emps().friction.coulomb_forward_n / emps().friction.standstill_speed_m_s
    assert still.A[-1, -1] == pytest.approx(-(B + slope) / M)


def test_a_sine_load_is_a_spring_that_changes_its_sign_over_half_a_turn():
    axis = two_inertia(load__gravity__sine_nm=1.5)
    stiff = [linearise(axis, OperatingPoint(0.0, at), height_free=True).A[-1, 0] for at in (0.0, np.pi)]
    assert stiff[0] == pytest.approx(-1.5 / 0.003, rel=1e-6) == -stiff[1]


def test_a_coupling_s_resonance_and_anti_resonance_are_the_plant_s():
    plant = linearise(two_inertia(), POINT)
    f = np.abs(np.linalg.eigvals(plant.A).imag).max() / (2.0 * np.pi)
    assert f == pytest.approx(math.sqrt(20.0 * (1 / 0.002 + 1 / 0.003)) / (2.0 * np.pi), rel=1e-3)
    case = loop_case(two_inertia(), None, None, None, None)
    points = operating_points(case.machine, case.payloads_kg, case.heights_m)
    with pytest.raises(InputError, match=r"anti-resonance at 13 Hz .* swings on its coupling"):
        tune(case.machine, case.settings, points, case.trial(), Goal(40.0))


def test_the_controller_by_rule_is_stable_on_every_axis_with_a_sound_ms():
    for machine in (emps(), ideal_axis(), two_inertia(), two_inertia(coupling__stiffness_nm_per_rad=2.0)):
        points = operating_points(machine, (0.0,), (0.0,))
        worst = weakest(family(machine, usual_cascade(machine), points)).margins
        assert worst.stable and worst.ms < 2.0


def test_a_tuned_axis_has_the_bandwidth_asked_for_and_names_what_forbids_more():
    case = loop_case(emps(), CASCADE, None, None, None)
    points = operating_points(case.machine, case.payloads_kg, case.heights_m)
    tuned = tune(case.machine, case.settings, points, case.trial(), Goal(15.0))
    assert isinstance(tuned.winner.settings, LinearCascade)
    assert 14.9 < tuned.winner.bandwidth_hz < 15.8 and tuned.winner.ms < 1.4
    assert tuned.winner.settings.kv_per_s == CASCADE.kv_per_s
    with pytest.raises(InputError, match=r"200 Hz is out of reach.*phase is lost to the speed delay"):
        tune(case.machine, case.settings, points, case.trial(), Goal(200.0))
    # Where friction holds the speed as firmly as so slow a loop, there is a gap between the slowest and the next.
    with pytest.raises(InputError, match=r"the nearest that can be had is about 4\.\d Hz, the widest is 34\.\d Hz"):
        tune(case.machine, case.settings, points, case.trial(), Goal(4.0))
