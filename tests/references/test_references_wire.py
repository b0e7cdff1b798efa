"""References that know the load on its wire: shapers leave nothing to swing, the optimum is nowhere beaten."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from workbench.machines import Hoist, Load, default_hoist, load_of, with_values
from workbench.references import Limits, Shape, move_shape, move_time_s, planned_kind, planned_kinds
from workbench.references.least_peak import least_peak_limits, peak_force_n
from workbench.references.library.wire import EI, ZV, ZVD, impulses
from workbench.references.shape import raised, shortest_move
from workbench.study.load import plan_study
from workbench.study.run import run_study
from workbench.study.scenario import Scenario

MACHINE = default_hoist()
LIMITS = Limits(0.7, 0.6, 0.8)


def loaded(machine: Hoist) -> Load:
    load = load_of(machine, 9000.0)
    assert load is not None
    return load


RINGING = loaded(with_values(MACHINE, {"wire.damping_time_s": 0.0025}))
STEADY = loaded(MACHINE)


def left_to_swing(shape: Shape, load: Load) -> float:
    """What swings on after the move, as a speed over the largest one: the convolution of the acceleration with the
    load's own answer, by the trapezoidal rule."""
    w, zeta = load.angular_frequency_rad_s, load.damping
    s = complex(-zeta * w, w * math.sqrt(1.0 - zeta * zeta))
    t = np.linspace(0.0, shape.duration_s, 40001)
    return float(abs(np.trapezoid(shape.at(t)[2] * np.exp(s * (shape.duration_s - t)), t))) / 0.7


@pytest.mark.parametrize("name", ["zv", "zvd"])
@pytest.mark.parametrize("distance", [3.0, -3.0, 0.4])
def test_behind_a_shaper_nothing_is_left_to_swing(name: str, distance: float):
    plain = left_to_swing(move_shape(planned_kind("trapezoid"), distance, LIMITS), RINGING)
    shaped_left = left_to_swing(move_shape(planned_kind(name), distance, LIMITS, RINGING), RINGING)
    assert shaped_left < 2e-3
    assert plain > 5.0 * shaped_left


def test_a_shaper_of_more_impulses_bears_more_error_of_the_frequency():
    stiffer = replace(RINGING, stiffness_n_per_m=1.44 * RINGING.stiffness_n_per_m)
    left = [
        left_to_swing(move_shape(planned_kind(n), 3.0, LIMITS, RINGING), stiffer) for n in ("trapezoid", "zv", "zvd")
    ]
    undamped = {n: sum(a for _, a in impulses(parts, RINGING)) for n, parts in (("zv", ZV), ("zvd", ZVD), ("ei", EI))}
    assert left[2] < left[1]
    assert list(undamped.values()) == pytest.approx([1.0, 1.0, 1.0])


@pytest.mark.parametrize("name", ["zv", "zvd", "ei"])
def test_a_shaped_move_is_continuous_and_arrives(name: str):
    shape = move_shape(planned_kind(name), 5.0, LIMITS, RINGING)
    t = np.linspace(0.0, shape.duration_s, 20001)
    position, speed, acceleration = shape.at(t)
    assert position[-1] == pytest.approx(5.0)
    assert np.max(np.abs(np.diff(position))) <= 0.7 * (t[1] - t[0]) * (1.0 + 1e-6)
    assert speed.max() <= 0.7 + 1e-9 and np.abs(acceleration).max() <= 0.6 + 1e-9
    np.testing.assert_allclose(np.gradient(position, t)[5:-5], speed[5:-5], atol=2e-4)


WITH_A_MACHINE = sorted(name for name, kind in planned_kinds().items() if kind.needs_load)


@pytest.mark.parametrize("name", WITH_A_MACHINE)
@pytest.mark.parametrize("distance", [6.0, -0.7])
def test_a_kinds_duration_is_that_of_its_shape_and_it_goes_the_distance(name: str, distance: float):
    kind = planned_kind(name)
    shape = move_shape(kind, distance, LIMITS, RINGING)
    assert move_time_s(kind, distance, LIMITS, RINGING) == pytest.approx(shape.duration_s, abs=2e-6)
    position, speed, _ = shape.at(np.array([0.0, shape.duration_s * (1.0 - 1e-9)]))
    assert position[0] == 0.0 and position[1] == pytest.approx(distance, abs=1e-6)
    assert speed == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize(
    ("distance", "top", "exceeded"),
    [(12.0, 0.76, ["speed"]), (12.0, 0.71, ["speed", "jerk"]), (12.0, 0.0, ["jerk", "acceleration"]),
     (0.5, 0.76, ["jerk", "acceleration"])],
)  # fmt: skip
def test_equal_time_exceeds_no_dearer_limit_than_it_must_and_says_by_how_much(
    distance: float, top: float, exceeded: list[str]
):
    used = move_shape(planned_kind("ruckig_equal_time"), distance, LIMITS, replace(STEADY, top_speed_m_s=top)).limits
    of = {"speed": (used.speed_m_s, 0.7), "jerk": (used.jerk_m_s3, 0.8), "acceleration": (used.acceleration_m_s2, 0.6)}
    over = {name: value > 1.001 * own for name, (value, own) in of.items()}
    assert [name for name, more in over.items() if more] == exceeded
    said = raised(LIMITS, used)
    assert all((f"{name} from" in said) is more for name, more in over.items())
    assert used.speed_m_s <= max(top, 0.7) + 1e-12


@pytest.mark.parametrize("load", [STEADY, RINGING], ids=["damped", "ringing"])
@pytest.mark.parametrize(("distance", "top"), [(12.0, 0.76), (-3.0, 0.76), (0.5, 0.76), (12.0, 0.71), (-3.0, 0.71)])
def test_no_speed_acceleration_and_jerk_of_equal_time_have_a_lower_peak(load: Load, distance: float, top: float):
    """Brute force over speeds and accelerations, each with the jerk for the time, that exceed no dearer limit."""
    known = replace(load, top_speed_m_s=top)
    own = move_shape(planned_kind("ruckig_equal_time"), distance, LIMITS, known)
    time = move_time_s(planned_kind("trapezoid"), distance, LIMITS)
    assert own.duration_s == pytest.approx(time, abs=1e-9)
    most = Limits(top, 0.6, 0.8)
    if shortest_move(distance, most).duration_s > time:
        most = Limits(top, 0.6, 8.0)
    if shortest_move(distance, most).duration_s > time:
        most = Limits(top, 3.6, 8.0)
    peak, tried = peak_force_n(own, known), 0
    for speed in np.linspace(0.7, top, 3):
        for acceleration in np.geomspace(0.2, most.acceleration_m_s2, 20):
            low, high = 1e-2, most.jerk_m_s3
            if shortest_move(distance, Limits(float(speed), float(acceleration), high)).duration_s > time:
                continue
            for _ in range(40):
                jerk = math.sqrt(low * high)
                slow = shortest_move(distance, Limits(float(speed), float(acceleration), jerk)).duration_s > time
                low, high = (jerk, high) if slow else (low, jerk)
            other = peak_force_n(shortest_move(distance, Limits(float(speed), float(acceleration), high)), known)
            assert peak <= 1.015 * other
            tried += 1
    assert tried > 3


def test_the_pair_of_least_peak_leaves_the_trapezoid_only_where_the_load_outweighs_the_drive():
    """A jerk phase takes its time from the ramp, and drive and load then accelerate harder for all of it; it saves the
    load's overshoot at most."""
    above = []
    for share in (1.0, 0.02):
        load = replace(RINGING, drive_kg=share * RINGING.drive_kg)
        above.append(least_peak_limits(12.0, LIMITS, 12.0 / 0.7 + 0.7 / 0.6, load).acceleration_m_s2 / 0.6)
    assert above[0] < 1.002 and above[1] > 1.3


def test_a_loop_whose_feed_forward_knows_the_wire_comes_within_a_few_per_cent_of_the_least_peak():
    study: dict[str, Any] = {
        "name": "near-the-bound", "payloads_kg": [9000.0], "moves": [{"by_m": 4.0}],
        "limits": {"speed_m_s": 0.7, "acceleration_m_s2": 0.6, "jerk_m_s3": 0.8}, "references": ["optimal"],
        "start_position_m": 4.0, "outputs": {"signals": "none"},
        "controller": {"kp_nm_s_per_rad": 31.0, "ki_nm_per_rad": 122.0},
    }  # fmt: skip
    peaks = {}
    for name, feed in {"none": (0.0, 0.0), "stiff": (1.0, 0.0), "wire": (1.0, 1.0)}.items():
        study["controller"]["feed_forward"] = {"inertia": feed[0], "weight": 1.0, "friction": feed[0], "wire": feed[1]}
        (row,) = run_study(
            plan_study(Scenario.model_validate(study), with_values(MACHINE, {"wire.damping_time_s": 0.0025}))
        ).rows
        peaks[name] = row["peak_torque_motor_nm"]
    shape = move_shape(planned_kind("optimal"), 4.0, LIMITS, RINGING)
    least = peak_force_n(shape, RINGING) * MACHINE.lift_m_per_rad / 2.0
    assert peaks["wire"] < min(peaks["none"], peaks["stiff"])
    assert least < peaks["wire"] < 1.05 * least


@pytest.mark.parametrize("name", WITH_A_MACHINE)
def test_no_kind_lets_a_library_warn_where_nothing_is_damped(name: str):
    undamped = replace(STEADY, damping_time_s=0.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert peak_force_n(move_shape(planned_kind(name), 2.0, LIMITS, undamped), undamped) > STEADY.hold_n
