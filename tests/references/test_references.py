"""References against closed forms, and laws over all kinds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from workbench.core.errors import InputError
from workbench.references import (
    Limits,
    Step,
    allowed_carriage_speed_m_s,
    motor_speed_rad_s,
    move_shape,
    plan_motion,
    planned_kind,
    planned_kinds,
)

# Kinds that know their machine have their laws in test_references_wire.py.
WITHOUT_A_MACHINE = sorted(name for name, kind in planned_kinds().items() if not kind.needs_load)
RAIL = (0.0, 25.0)
LIMITS = Limits(0.7, 0.5, 1.0)


def duration(kind: str, distance_m: float, limits: Limits = LIMITS) -> float:
    return move_shape(planned_kind(kind), distance_m, limits).duration_s


def test_trapezoid_takes_distance_over_speed_plus_one_ramp() -> None:
    assert duration("trapezoid", 12.0) == pytest.approx(12.0 / 0.7 + 0.7 / 0.5, abs=1e-12)
    assert duration("trapezoid", -12.0) == pytest.approx(12.0 / 0.7 + 0.7 / 0.5, abs=1e-12)


def test_trapezoid_too_short_for_full_speed_is_a_triangle() -> None:
    assert duration("trapezoid", 0.3) == pytest.approx(2.0 * math.sqrt(0.3 / 0.5), abs=1e-12)


def test_jerk_limit_costs_acceleration_over_jerk() -> None:
    assert duration("ruckig", 12.0) == pytest.approx(12.0 / 0.7 + 0.7 / 0.5 + 0.5 / 1.0, abs=1e-12)


def test_jerk_limited_move_too_short_for_both_limits_is_four_jerk_phases() -> None:
    # d = 2 j t³ with four phases of t each.
    assert duration("ruckig", 0.01) == pytest.approx(4.0 * (0.01 / 2.0) ** (1.0 / 3.0), abs=1e-9)


def test_equal_time_factor_of_a_long_move_has_a_closed_form() -> None:
    shape = move_shape(planned_kind("ruckig_equal_time"), 12.0, LIMITS)
    factor = 1.0 + 0.5**2 / (0.7 * 1.0)
    assert shape.limits.acceleration_m_s2 == pytest.approx(0.5 * factor, rel=1e-9)
    assert shape.limits.jerk_m_s3 == pytest.approx(1.0 * factor**2, rel=1e-9)
    assert shape.limits.speed_m_s == 0.7


def test_the_seventh_order_polynomial_has_the_textbooks_peaks_and_no_jump_of_the_jerk() -> None:
    """Speed 35τ⁴ - 84τ⁵ + 70τ⁶ - 20τ⁷: slope at most 35/16, bend at most 7.5132 (Biagiotti, Melchiorri, 2008)."""
    limits = Limits(0.7, 0.6, 80.0)
    shape = move_shape(planned_kind("seventh_order"), 6.0, limits)
    ramp = 35.0 / 16.0 * 0.7 / 0.6
    assert shape.duration_s == pytest.approx(6.0 / 0.7 + ramp)
    t = np.linspace(0.0, shape.duration_s, 40001)
    _, speed, acceleration = shape.at(t)
    assert np.abs(acceleration).max() == pytest.approx(0.6, rel=1e-6)
    jerk = np.gradient(acceleration, t)
    assert np.abs(jerk).max() == pytest.approx(7.5132 * 0.7 / ramp**2, rel=1e-4)
    assert np.abs(np.diff(jerk)).max() < 1e-3 * np.abs(jerk).max()
    assert speed[len(t) // 2] == pytest.approx(0.7)


positive = st.floats(0.05, 5.0)
distances = st.one_of(st.floats(0.01, 40.0), st.floats(-40.0, -0.01))


@given(distances, positive, positive, positive)
def test_equal_time_takes_as_long_as_the_trapezoid(distance: float, v: float, a: float, j: float) -> None:
    limits = Limits(v, a, j)
    wanted = duration("trapezoid", distance, limits)
    assert duration("ruckig_equal_time", distance, limits) == pytest.approx(wanted, abs=1e-9)
    assert duration("ruckig", distance, limits) >= wanted - 1e-9


@given(st.sampled_from(WITHOUT_A_MACHINE), distances, positive, positive, positive)
def test_no_limit_is_exceeded_and_the_distance_is_gone(
    kind: str, distance: float, v: float, a: float, j: float
) -> None:
    shape = move_shape(planned_kind(kind), distance, Limits(v, a, j))
    time = np.linspace(-0.5, shape.duration_s + 0.5, 4001)
    position, speed, acceleration = shape.at(time)
    used = shape.limits
    assert np.abs(speed).max() <= used.speed_m_s * (1 + 1e-9)
    assert np.abs(acceleration).max() <= used.acceleration_m_s2 * (1 + 1e-9)
    assert position[0] == 0.0 and position[-1] == distance
    assert speed[0] == speed[-1] == 0.0
    if math.isfinite(used.jerk_m_s3):
        # An acceleration that stays within the jerk over every step, which no step between phases passes.
        assert np.abs(np.diff(acceleration)).max() <= used.jerk_m_s3 * (time[1] - time[0]) * (1 + 1e-6)
    # Position integrates the speed: trapezoidal rule, whose error is a·dt per unit of time at the kinks at most.
    step = time[1] - time[0]
    integral = float(np.sum(0.5 * (speed[1:] + speed[:-1])) * step)
    assert integral == pytest.approx(distance, abs=8 * used.acceleration_m_s2 * step**2)


@pytest.mark.parametrize("kind", ["trapezoid", "ruckig", "ruckig_equal_time"])
@pytest.mark.parametrize("distance", [12.0, -3.3, 0.2])
def test_our_evaluation_agrees_with_ruckig_itself(kind: str, distance: float) -> None:
    from ruckig import InputParameter, Ruckig, Trajectory

    shape = move_shape(planned_kind(kind), distance, LIMITS)
    wanted = InputParameter(1)
    wanted.current_position, wanted.target_position = [0.0], [distance]
    wanted.max_velocity = [shape.limits.speed_m_s]
    wanted.max_acceleration, wanted.max_jerk = [shape.limits.acceleration_m_s2], [shape.limits.jerk_m_s3]
    trajectory = Trajectory(1)
    Ruckig(1).calculate(wanted, trajectory)
    time = np.linspace(0.0, shape.duration_s, 57)[1:-1]
    ours = np.array(shape.at(time))
    theirs = np.array([trajectory.at_time(float(t)) for t in time])[:, :, 0].T
    np.testing.assert_allclose(ours[:2], theirs[:2], atol=1e-9)


def test_moves_follow_one_another_with_dwell_lead_and_settle() -> None:
    steps = (Step(by_m=12.0), Step(dwell_s=2.0), Step(to_m=4.0))
    plan = plan_motion("trapezoid", steps, 4.0, LIMITS, RAIL, lead_s=1.0, settle_s=3.0)
    one = 12.0 / 0.7 + 0.7 / 0.5
    profile = plan.sample(0.001)
    np.testing.assert_allclose(profile.move_windows, [(1.0, 1.0 + one), (3.0 + one, 3.0 + 2 * one)])
    assert plan.duration_s == pytest.approx(6.0 + 2 * one)
    assert profile.move_time_s == pytest.approx(2 * one)
    assert profile.position_m[0] == profile.position_m[-1] == 4.0
    assert profile.position_m.max() == pytest.approx(16.0, abs=1e-12)
    assert plan.end_position_m == pytest.approx(4.0)


def test_motor_turns_two_falls_over_drum_radius_times_ratio() -> None:
    # 0.7 m/s of carriage is 1.4 m/s of wire, 4.667 rad/s of a 0.6 m drum, 144.67 rad/s of the motor.
    assert motor_speed_rad_s(np.array([0.7]), 31.0, 0.6)[0] == pytest.approx(144.6667, abs=1e-4)
    assert allowed_carriage_speed_m_s(144.0 + 2.0 / 3.0, 31.0, 0.6) == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("limits", "word"),
    [((0.7, 0.5, 0.0), "jerk_m_s3"), ((math.inf, 0.5, 1.0), "speed_m_s"), ((0.7, math.nan, 1.0), "acceleration_m_s2")],
)
def test_a_limit_that_is_no_limit_is_named(limits: tuple[float, float, float], word: str) -> None:
    with pytest.raises(InputError, match=word):
        Limits(*limits)


@pytest.mark.parametrize(
    ("steps", "text"),
    [
        ((Step(by_m=22.0),), r"moves\[0\].*leaves the rail.*25 m"),
        ((Step(by_m=2.0), Step(by_m=-7.0)), r"moves\[1\].*to -1 m"),
        ((Step(by_m=2.0), Step(to_m=6.0)), r"moves\[1\].*move of 0 m"),
        ((Step(dwell_s=2.0),), "no move"),
    ],
)
def test_a_move_that_cannot_be_made_is_named_by_its_step(steps: tuple[Step, ...], text: str) -> None:
    with pytest.raises(InputError, match=text):
        plan_motion("ruckig", steps, 4.0, LIMITS, RAIL)


@pytest.mark.parametrize("fields", [{}, {"by_m": 1.0, "dwell_s": 1.0}, {"dwell_s": -1.0}, {"by_m": math.nan}])
def test_a_step_that_says_nothing_or_two_things_is_refused(fields: dict[str, float]) -> None:
    with pytest.raises(InputError):
        Step(**fields)


@given(st.lists(st.floats(0.0, 25.0), min_size=1, max_size=6), st.sampled_from(WITHOUT_A_MACHINE))
def test_any_list_of_heights_on_the_rail_is_reached_in_order(heights: list[float], kind: str) -> None:
    here = 12.0
    for height in heights:
        assume(abs(height - here) > 1e-3)
        here = height
    plan = plan_motion(kind, [Step(to_m=h) for h in heights], 12.0, LIMITS, RAIL, lead_s=0.5)
    profile = plan.sample(0.01)
    assert profile.position_m.min() >= min([12.0, *heights]) - 1e-9
    assert profile.position_m.max() <= max([12.0, *heights]) + 1e-9
    ends = [np.interp(end, profile.time_s, profile.position_m) for _, end in profile.move_windows]
    np.testing.assert_allclose(ends, heights, atol=1e-4)
