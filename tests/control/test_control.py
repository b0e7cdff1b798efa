"""The controller's step in plain numbers: terms, limits, filters, delay, start; the torque's lag over a step."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError

from tests.support.ideal import ideal_hoist
from workbench.analysis.linearise import OperatingPoint, linearise
from workbench.analysis.loop import sampled_plant
from workbench.control import (
    PI,
    Controller,
    FeedForward,
    Notch,
    PiSettings,
    delay_weights,
    full_pi,
    lag_step,
    loop_values,
)
from workbench.control.pi import behind_the_wire, swing_of, weight_before
from workbench.engine.stepped import Step
from workbench.machines import PLANTS, Hoist, with_values
from workbench.simulate.loop import LoopCase, simulate_loop

MACHINE = ideal_hoist()
HOLD = 600.0
DT = 0.001
FREE = {"u_all": 1e9, "u_one": 5e8, "t_fail": 1e30, "w_weak": 1e30}


def numbers(settings: PiSettings, limits: dict[str, float] | None = None, **drive: float) -> SimpleNamespace:
    """Everything a step reads, with a drive changed from the default one."""
    machine_drive = MACHINE.drive.model_copy(update=drive)
    plant = vars(PLANTS["hoist"].values(MACHINE, 4500.0))
    return SimpleNamespace(**{**plant, **loop_values(settings, machine_drive, HOLD), **FREE, **(limits or {})})


def settings(**changes: object) -> PiSettings:
    return PiSettings.model_validate({"kp_nm_s_per_rad": 31.0, "ki_nm_per_rad": 122.0, **changes})


def torques(controller: Controller, p: SimpleNamespace, reference: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """The torque at each sample for given reference and measured speed, from the bumpless start."""
    memory = controller.start(p, HOLD, 0.0)
    out, angle, line = [], 0.0, [0.0] * 100
    for k, (r, w) in enumerate(zip(reference, speed, strict=True)):
        measured = SimpleNamespace(t=k * DT, speed_motor_rad_s=w, angle_motor_rad=angle)
        if controller.sensed is not None:
            line.insert(0, controller.sensed(p, memory, measured, DT))
            whole, near, far = delay_weights(p.late)
            measured.late = near * line[whole] + far * line[whole + 1]
        torque, memory = controller.step(p, memory, SimpleNamespace(speed_reference_rad_s=r), measured, DT)
        out.append(float(torque))
        angle += w * DT
    return np.array(out)


BOTH = pytest.mark.parametrize("controller", [PI, full_pi(), full_pi(late=True)], ids=["plain", "full", "delayed"])


@BOTH
@pytest.mark.parametrize(
    "more", [{}, {"notch": Notch(frequency_hz=20.0)}, {"feed_forward": FeedForward(weight=0.7)}], ids=str
)
def test_at_rest_it_holds_what_it_was_started_with(controller, more):
    controller = full_pi() if more and controller is PI else controller  # the plain one has neither
    held = torques(controller, numbers(settings(**more)), np.zeros(100), np.zeros(100))
    assert held == pytest.approx(np.full(100, HOLD), rel=1e-12)


@BOTH
def test_the_torque_is_gain_times_error_plus_what_was_integrated_before(controller):
    reference, speed = np.full(20, 3.0), np.linspace(0.0, 2.0, 20)
    error = reference - speed
    expected = HOLD + 31.0 * error + 122.0 * DT * np.concatenate([[0.0], np.cumsum(error)[:-1]])
    assert torques(controller, numbers(settings()), reference, speed) == pytest.approx(expected, rel=1e-12)


@BOTH
def test_the_set_point_weight_acts_on_the_proportional_term_only(controller):
    reference, speed = np.full(5, 3.0), np.zeros(5)
    weighted = torques(controller, numbers(settings(set_point_weight=0.4)), reference, speed)
    full = torques(controller, numbers(settings()), reference, speed)
    assert full - weighted == pytest.approx(np.full(5, 31.0 * 0.6 * 3.0))


@BOTH
@pytest.mark.parametrize(
    ("limits", "error", "speed", "torque"),
    [
        ({}, 50.0, [0.0, 0.0], [700.0, 700.0]),
        ({}, -50.0, [0.0, 0.0], [-700.0, -700.0]),
        ({"u_one": 350.0, "t_fail": 0.003}, 50.0, [0.0] * 5, [700.0, 700.0, 700.0, 350.0, 350.0]),  # one motor fails
        ({"w_weak": 150.0}, 500.0, [0.0, 150.0, 200.0], [700.0, 700.0, 700.0 * 150.0 / 200.0]),  # as one over speed
        ({"w_weak": 150.0}, 500.0, [0.0, 150.0, -200.0], [700.0, 700.0, 700.0 * 150.0 / 200.0]),
    ],
)
def test_the_torque_ends_at_its_limit(controller, limits, error, speed, torque):
    p = numbers(settings(), {"u_all": 700.0, **limits})
    assert torques(controller, p, np.full(len(speed), error), np.array(speed)) == pytest.approx(torque)


@BOTH
def test_back_calculation_lets_the_torque_leave_the_limit_as_soon_as_the_error_turns(controller):
    """Held at the limit for long, the integral settles where torque before the clip exceeds it by ki e Tt."""
    p = numbers(settings(), {"u_all": 700.0})
    error = np.concatenate([np.full(3000, 5.0), np.full(5, -1.0)])
    out = torques(controller, p, error, np.zeros(3005))
    tracking = 31.0 / 122.0
    settled = 700.0 + 122.0 * 5.0 * tracking - 31.0 * 5.0  # the integral: excess ki e Tt less the proportional term
    assert out[2999] == 700.0
    assert out[3000] == pytest.approx(min(700.0, settled - 31.0), rel=1e-3)


@pytest.mark.parametrize(("kind", "error", "torque"), [("none", -1.0, 700.0), ("conditional", 0.0, HOLD)])
def test_without_anti_windup_the_integral_runs_on_and_conditionally_it_stands_still(kind, error, torque):
    p = numbers(settings(anti_windup=kind), {"u_all": 700.0})
    out = torques(full_pi(), p, np.concatenate([np.full(3000, 5.0), np.full(5, error)]), np.zeros(3005))
    assert out[3000] == pytest.approx(torque, abs=1e-6)


def test_the_rate_limit_bounds_every_step_of_torque():
    p = numbers(settings(torque_rate_limit_nm_per_s=2000.0))
    out = torques(full_pi(), p, np.full(200, 5.0), np.zeros(200))
    assert np.max(np.abs(np.diff([HOLD, *out]))) <= 2.0 + 1e-9
    assert out[0] == pytest.approx(HOLD + 2.0)


def only_proportional(**changes: object) -> PiSettings:
    return settings(ki_nm_per_rad=0.0, **changes)


def test_the_low_pass_answers_a_step_with_its_time_constant():
    p = numbers(only_proportional(low_pass_hz=5.0))
    out = torques(full_pi(), p, np.ones(200), np.zeros(200)) - HOLD
    k = np.arange(1, 201)
    assert out == pytest.approx(31.0 * (1.0 - np.exp(-2.0 * math.pi * 5.0 * DT * k)), rel=1e-9)


def tone_gain(p: SimpleNamespace, frequency_hz: float) -> float:
    time = np.arange(8000) * DT
    out = torques(full_pi(), p, np.sin(2.0 * math.pi * frequency_hz * time), np.zeros(8000)) - HOLD
    return float(np.sqrt(2.0) * np.std(out[4000:]) / 31.0)


def test_the_notch_takes_out_its_frequency_to_its_depth_and_leaves_the_rest():
    p = numbers(only_proportional(notch=Notch(frequency_hz=20.0, damping=0.3, depth=0.1)))
    assert tone_gain(p, 20.0) == pytest.approx(0.1, rel=1e-3)
    assert tone_gain(p, 1.0) == pytest.approx(1.0, abs=0.01)
    assert tone_gain(p, 200.0) == pytest.approx(1.0, abs=0.01)


def test_the_filter_of_the_measured_speed_is_a_first_order_lag():
    p = numbers(only_proportional(), speed_filter_s=0.02)
    out = torques(full_pi(), p, np.zeros(100), np.ones(100))
    assert (HOLD - out) / 31.0 == pytest.approx(1.0 - np.exp(-np.arange(1, 101) * DT / 0.02), rel=1e-9)


def test_an_encoder_counts_whole_marks():
    p = numbers(only_proportional(), encoder_counts_per_turn=1024)
    speed = np.full(400, 7.3)
    seen = (HOLD - torques(full_pi(), p, np.zeros(400), speed)) / 31.0
    quantum = 2.0 * math.pi / 1024 / DT
    assert seen / quantum == pytest.approx(np.round(seen / quantum), abs=1e-6)
    assert np.mean(seen[1:]) == pytest.approx(7.3, abs=quantum / 100.0)


def test_feed_forward_asks_for_what_the_machine_s_own_values_say():
    lever = MACHINE.lift_m_per_rad
    J = 2 * 0.8 + 55.0 / 31.0**2 + 12500.0 * lever**2
    reference = 20.0 * DT * np.arange(10.0)  # 20 rad/s^2
    p = numbers(only_proportional(feed_forward=FeedForward(inertia=1.0, friction=0.5, weight=0.0)))
    out = torques(full_pi(), p, reference, reference)
    assert out[1:] - HOLD == pytest.approx(np.full(9, J * 20.0 + 0.5 * 6000.0 * lever))
    down = torques(full_pi(), p, -reference, -reference)
    assert down[1:] - HOLD == pytest.approx(np.full(9, -J * 20.0 - 0.5 * 4500.0 * lever))


def test_behind_the_wire_the_load_swings_as_its_step_response_says():
    from scipy.signal import TransferFunction, step

    p = numbers(only_proportional(feed_forward=FeedForward(inertia=1.0, wire=1.0)))
    squared, damping = swing_of(p)
    assert squared == pytest.approx(2.0 * 1e11 * 3.4e-4 / 25.0 / 12500.0)  # two falls carry it
    stretch, rate, loads = 0.0, 0.0, []
    for _ in range(800):
        carried, stretch, rate = behind_the_wire(p, stretch, rate, 20.0, DT)
        loads.append(carried)
    system = TransferFunction([damping, squared], [1.0, damping, squared])
    _, expected = step(system, T=0.5 * DT * np.arange(1600))
    assert np.array(loads) == pytest.approx(20.0 * expected[1::2], abs=20.0 * 5e-5)


@pytest.mark.parametrize("wire", [0.0, 0.4, 1.0])
def test_feed_forward_through_the_wire_ends_at_the_stiff_machine_s(wire):
    """At once it asks for what the shaft itself takes; once the load no longer swings, for all of the inertia."""
    lever = MACHINE.lift_m_per_rad
    reference = 20.0 * DT * np.arange(4000.0)
    p = numbers(only_proportional(feed_forward=FeedForward(inertia=1.0, wire=wire)))
    out = torques(full_pi(wire=wire > 0.0), p, reference, reference) - HOLD
    shaft, load = 20.0 * (2 * 0.8 + 55.0 / 31.0**2), 20.0 * 12500.0 * lever**2
    assert out[1] == pytest.approx(shaft + (1.0 - wire) * load, rel=0.01)
    assert out[-1] == pytest.approx(shaft + load, rel=1e-6)


@pytest.mark.parametrize("late", [0.4, 1.0, 2.25, 3.0, 70.25, 100.0])
def test_a_delay_shows_the_speed_so_many_samples_ago_linear_between_two(late):
    p = numbers(only_proportional(), speed_delay_s=late * DT)
    speed = np.random.default_rng(3).normal(size=300)
    controller = full_pi(late=True)
    compiled = Step(controller, p, controller.start(p, HOLD, 0.0), DT)
    out = [compiled(0.0, k * DT, w, 0.0) for k, w in enumerate(speed)]
    late_speed = np.interp(np.arange(300) - late, np.arange(-1, 300), [0.0, *speed], left=0.0)
    assert out == pytest.approx(HOLD - 31.0 * late_speed, abs=1e-9)


@pytest.mark.parametrize("sample_time_s", [0.001, 0.004])
def test_a_notch_that_the_sample_rate_cannot_hold_is_refused(sample_time_s):
    most = 0.5 / sample_time_s
    settings(notch=Notch(frequency_hz=0.99 * most), sample_time_s=sample_time_s)
    with pytest.raises(ValidationError, match=f"expected less than {most:g} Hz, half of the sample rate"):
        settings(notch=Notch(frequency_hz=most), sample_time_s=sample_time_s)


# The torque's lag over a step of the plant: exact at its end and in what it gives, nothing where there is none.


POINT, SETTINGS = OperatingPoint(4500.0, 10.0), PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)
H = 0.001
IDEAL = ideal_hoist()


def lagging(time_constant_s: float) -> Hoist:
    return with_values(IDEAL, {"drive.torque_lag_s": time_constant_s})


@pytest.mark.parametrize("time_constant_s", [1e-6, 1e-4, 1e-3, 0.004, 0.0499, 0.0501, 10.0])
def test_the_straight_line_has_the_exponentials_integral_and_first_moment(time_constant_s: float):
    from scipy.integrate import quad

    step = lag_step(time_constant_s, H)
    exact = [
        quad(lambda t, n=n: t**n * np.exp(-t / time_constant_s), 0.0, min(H, 60.0 * time_constant_s))[0] for n in (0, 1)
    ]
    line = [step.start * H + step.slope_per_s * H**2 / 2.0, step.start * H**2 / 2.0 + step.slope_per_s * H**3 / 3.0]
    np.testing.assert_allclose(line, exact, rtol=1e-8)
    assert step.left == pytest.approx(np.exp(-H / time_constant_s))
    assert step.mean * H == pytest.approx(exact[0], rel=1e-8)


def test_the_delay_of_a_lag_is_its_time_constant():
    """At low frequency the phase that a lag costs is that of a delay of its time constant."""
    f = np.array([1.0])
    plant = linearise(IDEAL, POINT)
    with_lag, without = (sampled_plant(plant, H, lagging(lag).drive).response(f)[0, 0, 0] for lag in (0.004, 0.0))
    assert np.angle(with_lag / without) == pytest.approx(-np.arctan(2.0 * np.pi * 0.004), rel=1e-3)


def test_the_simulated_run_goes_over_into_that_without_lag():
    speed = 20.0 * np.clip(np.arange(1500) / 1000.0, 0.0, 1.0)
    none, hardly, real = simulate_loop(
        [LoopCase("", lagging(lag), 4500.0, 5.0, SETTINGS, speed) for lag in (0.0, 1e-6, 0.004)], record_every=10
    )
    w = [result.run["speed_motor_rad_s"] for result in (none, hardly, real)]
    assert np.abs(w[1] - w[0]).max() < 1e-4 < np.abs(w[2] - w[0]).max()
    assert hardly.metrics["energy_motoring_j"] == pytest.approx(none.metrics["energy_motoring_j"], rel=1e-4)


@pytest.mark.parametrize("time_constant_s", [1e-6, 1e-3, 0.02])
def test_the_mean_torque_between_two_samples_is_that_of_the_exponential(time_constant_s: float):
    held, before = 300.0, 100.0
    now = held + (before - held) * np.exp(-H / time_constant_s)
    mean = held + (before - held) * time_constant_s / H * (1.0 - np.exp(-H / time_constant_s))
    w = weight_before(time_constant_s, H)
    assert w * before + (1.0 - w) * now == pytest.approx(mean, rel=1e-9)
