"""The linear plant is the derivative of the compiled one; a delay is the same over frequency and as states."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.support.ideal import ideal_hoist
from workbench.analysis.linearise import MOTIONS, OUTPUTS, STIFFNESS_BY_LENGTH, LinearPlant, OperatingPoint, linearise
from workbench.analysis.loop import Sampled, linear_controller, sampled_plant
from workbench.control import PiSettings
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


WEIGHTED = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0, set_point_weight=0.4)


@pytest.mark.parametrize("delay_s", [0.0, 0.0004, 0.001, 0.0375, 0.2])
def test_a_delay_is_the_same_as_a_factor_over_frequency_and_as_states(delay_s: float):
    linear = linear_controller(WEIGHTED, with_drive(speed_filter_s=0.003, speed_delay_s=delay_s))
    f = np.geomspace(0.01, 500.0, 7)
    as_states = Sampled(linear.A, linear.B, linear.C, linear.D, linear.dt).response(f)
    np.testing.assert_allclose(linear.response(f), as_states, rtol=1e-9)
    assert len(linear.A) == 2 + math.ceil(delay_s / 0.001)


def test_the_design_of_a_loop_refuses_more_samples_of_delay_than_it_can_bear():
    settings = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0, sample_time_s=1e-4)
    with pytest.raises(InputError, match=r"drive.speed_delay_s: 0.05 s are 500 samples of the controller; .* most 200"):
        linear_controller(settings, with_drive(speed_delay_s=0.05))
