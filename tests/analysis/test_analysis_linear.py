"""The linear plant is the derivative of the compiled one, and the linear controller that of its step."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.support.ideal import ideal_hoist
from workbench.analysis.linearise import (
    MOTIONS,
    OUTPUTS,
    STIFFNESS_BY_LENGTH,
    LinearPlant,
    OperatingPoint,
    linearise,
)
from workbench.analysis.loop import Sampled, linear_controller, sampled_plant
from workbench.control import FeedForward, Notch, PiSettings, delay_weights, full_pi, loop_values
from workbench.core.errors import InputError
from workbench.machines import HOIST, Hoist, with_values

PAYLOADS = (0.0, 4500.0, 9000.0)


def with_drive(**drive: float) -> Hoist:
    return with_values(ideal_hoist(), {f"drive.{key}": value for key, value in drive.items()})


def oscillation(plant: LinearPlant) -> tuple[float, float]:
    """(Hz, damping ratio) of the slowest oscillating mode."""
    s = min((e for e in np.linalg.eigvals(plant.A) if e.imag > 0.0), key=abs)
    return abs(s) / (2.0 * np.pi), -s.real / abs(s)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("payload", PAYLOADS)
def test_the_linear_plant_is_the_finite_difference_of_the_plant(payload: float, motion: Any):
    plant = linearise(ideal_hoist(), OperatingPoint(payload, 10.0, motion), height_free=True)
    p = HOIST.plant.values(ideal_hoist(), payload)
    q0, y0, u0 = plant.start
    _, even, _ = HOIST.plant.start_of(10.0, 1.0, p)
    T = np.eye(6)
    T[:2, 2] = np.array(even[:2]) / even[2]  # back from relative positions

    def rates(x: np.ndarray, u: float) -> np.ndarray:
        dx = T @ x
        q, y = list(q0 + dx[:3]), list(y0 + dx[3:])
        shown = HOIST.plant.outputs(0.0, q, y, u, p)
        rest = [shown[name] for name in OUTPUTS]
        return np.array([*np.linalg.solve(T[:3, :3], dx[3:]), *HOIST.plant.accelerations(0.0, q, y, u, p), *rest])

    # Steps of each state's own size; at rest one-sided, to the side the model takes at standstill.
    sizes = np.array([1e-3, 1e-4, 1e-3, 1e-6, 1e-7, -1e-8 if motion == "at_rest" else 1e-6])
    for i, h in enumerate(sizes):
        e = np.zeros(6)
        e[i] = h
        sided = motion == "at_rest" and i == 5
        slope = (rates(e, u0) - rates(-e, u0)) / (2.0 * h) if not sided else (rates(e, u0) - rates(0.0 * e, u0)) / h
        expected = np.concatenate([plant.A[:, i], plant.C[: len(OUTPUTS), i]])
        np.testing.assert_allclose(slope, expected, rtol=2e-4, atol=2e-4 * max(1.0, np.abs(expected).max()))
    gain = (rates(np.zeros(6), u0 + 1.0) - rates(np.zeros(6), u0))[:6]
    np.testing.assert_allclose(gain, plant.B[:, 0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("payload", "hz", "zeta"), [(0.0, 3.10, 0.97), (4500.0, 2.55, 0.80), (9000.0, 2.24, 0.70)])
def test_the_carriage_on_the_wire_with_a_free_motor_is_that_of_the_model_page(payload: float, hz: float, zeta: float):
    hz_and_zeta = oscillation(linearise(ideal_hoist(), OperatingPoint(payload, 10.0)))
    assert hz_and_zeta == pytest.approx((hz, zeta), abs=0.006)


@pytest.mark.parametrize(("payload", "hz", "zeta"), [(0.0, 2.93, 0.92), (4500.0, 2.35, 0.74), (9000.0, 2.01, 0.63)])
def test_with_a_held_motor_it_is_that_of_the_model_page_too(payload: float, hz: float, zeta: float):
    held = with_values(ideal_hoist(), {"motor.rotor_inertia_kg_m2": 1e6})
    hz_and_zeta = oscillation(linearise(held, OperatingPoint(payload, 10.0)))
    assert hz_and_zeta == pytest.approx((hz, zeta), abs=0.006)


def test_the_height_makes_one_slow_unstable_mode_and_nothing_else_where_a_loop_works():
    point = OperatingPoint(0.0, 10.0)
    free = linearise(ideal_hoist(), point, height_free=True)
    frozen = linearise(ideal_hoist(), point)
    assert np.linalg.eigvals(free.A).real.max() == pytest.approx(0.025, abs=0.001)
    assert np.linalg.eigvals(frozen.A).real.max() < 0.0
    f = np.geomspace(0.1, 400.0, 50)
    a, b = (sampled_plant(plant, 0.001, ideal_hoist().drive).response(f)[:, 0, 0] for plant in (free, frozen))
    np.testing.assert_allclose(a, b, rtol=2.5e-3)
    np.testing.assert_allclose(a[f > 1.0], b[f > 1.0], rtol=3e-5)


def test_a_wire_as_stiff_as_its_free_length_moves_the_mode_by_the_root_of_the_stiffness():
    held = with_values(ideal_hoist(), {"motor.rotor_inertia_kg_m2": 1e6, "wire.damping_time_s": 0.02})
    short = linearise(held, OperatingPoint(9000.0, 15.0), effects=STIFFNESS_BY_LENGTH)
    whole = linearise(held, OperatingPoint(9000.0, 15.0))
    assert oscillation(short)[0] / oscillation(whole)[0] == pytest.approx(np.sqrt(25.0 / 10.0), rel=2e-3)


def test_the_sampled_plant_is_the_exact_hold_of_the_continuous_one():
    import control

    plant = linearise(ideal_hoist(), OperatingPoint(4500.0, 10.0))
    ours = sampled_plant(plant, 0.004, ideal_hoist().drive)
    theirs = control.c2d(plant.system(), 0.004, "zoh")
    np.testing.assert_allclose(ours.A, theirs.A, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(ours.B[:, [0]], theirs.B, rtol=1e-9, atol=1e-12)


def test_behind_a_lag_the_sampled_plant_is_the_exact_hold_of_plant_and_lag_together():
    import control

    lag = 0.006
    plant = linearise(ideal_hoist(), OperatingPoint(4500.0, 10.0))
    ours = sampled_plant(plant, 0.002, with_values(ideal_hoist(), {"drive.torque_lag_s": lag}).drive)
    f = np.geomspace(0.1, 30.0, 30)
    lagged = plant.system()[0, 0] * control.tf(1, [lag, 1])
    theirs = control.c2d(lagged, 0.002, "zoh")(np.exp(2j * np.pi * f * 0.002))
    np.testing.assert_allclose(ours.response(f)[:, 0, 0], theirs, rtol=1e-6)
    assert ours.poles().real.min() >= 0.0
    assert np.min(np.abs(ours.poles() - np.exp(-0.002 / lag))) < 1e-12


def test_a_counting_encoder_gives_the_mean_speed_since_the_last_sample():
    import control

    plant = linearise(ideal_hoist(), OperatingPoint(4500.0, 10.0))
    counted = sampled_plant(plant, 0.002, ideal_hoist().drive.model_copy(update={"encoder_counts_per_turn": 4096}))
    f = np.geomspace(0.1, 200.0, 30)
    integral = control.c2d(plant.system()[0, 0] * control.tf(1, [1, 0]), 0.002, "zoh")
    z = np.exp(2j * np.pi * f * 0.002)
    np.testing.assert_allclose(counted.response(f)[:, -1, 0], integral(z) * (1.0 - 1.0 / z) / 0.002, rtol=1e-6)
    np.testing.assert_allclose(
        counted.response(f)[:, 0, 0], sampled_plant(plant, 0.002, ideal_hoist().drive).response(f)[:, 0, 0], rtol=1e-9
    )


SETTINGS = {
    "plain": PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0),
    "weighted": PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0, set_point_weight=0.4),
    "all": PiSettings(
        sample_time_s=0.002,
        kp_nm_s_per_rad=40.0,
        ki_nm_per_rad=300.0,
        set_point_weight=0.7,
        low_pass_hz=60.0,
        notch=Notch(frequency_hz=3.0, damping=0.4, depth=0.2),
        feed_forward=FeedForward(inertia=0.8),
    ),
}
DRIVES = {
    "ideal": with_drive(),
    "late": with_drive(speed_filter_s=0.003, speed_delay_s=0.0035),
}


def impulse_by_the_step(settings: PiSettings, machine: Hoist, n: int, of_reference: bool) -> np.ndarray:
    """The pure step run on numbers: torque after a unit sample of the reference or of the measured speed."""
    controller = full_pi(late=True)
    numbers = {
        **vars(HOIST.plant.values(machine, 0.0)),
        **loop_values(settings, machine.drive, 0.0),
        **dict.fromkeys(("u_all", "u_one", "t_fail", "w_weak"), 1e9),
    }
    p = SimpleNamespace(**numbers)
    memory, out, line = controller.start(p, 0.0, 0.0), [], [0.0] * 100
    for k in range(n):
        pulse = 1.0 if k == 0 else 0.0
        reference = SimpleNamespace(speed_reference_rad_s=pulse if of_reference else 0.0)
        speed = 0.0 if of_reference else pulse
        measured = SimpleNamespace(t=0.0, speed_motor_rad_s=speed, angle_motor_rad=0.0)
        assert controller.sensed is not None
        line.insert(0, controller.sensed(p, memory, measured, settings.sample_time_s))
        whole, near, far = delay_weights(p.late)
        measured.late = near * line[whole] + far * line[whole + 1]
        torque, memory = controller.step(p, memory, reference, measured, settings.sample_time_s)
        out.append(float(torque))
    return np.array(out)


@pytest.mark.parametrize("of_reference", [True, False], ids=["reference", "speed"])
@pytest.mark.parametrize("machine", DRIVES.values(), ids=DRIVES)
@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
def test_the_linear_controller_answers_a_pulse_as_the_step_does(settings: Any, machine: Hoist, of_reference: bool):
    linear = linear_controller(settings, machine)
    pulse = np.zeros((200, 2))
    pulse[0, 0 if of_reference else 1] = 1.0
    expected = impulse_by_the_step(settings, machine, 200, of_reference)
    np.testing.assert_allclose(linear.run(pulse)[:, 0], expected, rtol=1e-11, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("delay_s", [0.0, 0.0004, 0.001, 0.0375, 0.2])
def test_a_delay_is_the_same_as_a_factor_over_frequency_and_as_states(delay_s: float):
    linear = linear_controller(SETTINGS["weighted"], with_drive(speed_filter_s=0.003, speed_delay_s=delay_s))
    f = np.geomspace(0.01, 500.0, 7)
    as_states = Sampled(linear.A, linear.B, linear.C, linear.D, linear.dt).response(f)
    np.testing.assert_allclose(linear.response(f), as_states, rtol=1e-9)
    assert len(linear.A) == 2 + math.ceil(delay_s / 0.001)


def test_the_design_of_a_loop_refuses_more_samples_of_delay_than_it_can_bear():
    settings = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0, sample_time_s=1e-4)
    with pytest.raises(InputError, match=r"drive.speed_delay_s: 0.05 s are 500 samples of the controller; .* most 200"):
        linear_controller(settings, with_drive(speed_delay_s=0.05))
