"""References against closed forms, laws over all kinds, jogs, records, stops; one that is declared is known."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.support.scenario_text import study_of
from workbench.cli import cli
from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.references import (
    LimitPair,
    Limits,
    MotionPlan,
    Move,
    Plan,
    PlannedKind,
    RecordedPlan,
    Shape,
    Step,
    allowed_carriage_speed_m_s,
    motion_time_s,
    motor_speed_rad_s,
    move_shape,
    plan_motion,
    planned_kind,
    planned_kinds,
)
from workbench.references.kind import add, forget_added, planned
from workbench.references.plan import StoppedPlan, move_time_s
from workbench.references.shape import shortest_move, shortest_ramp
from workbench.study.store import read_finished
from workbench.view.study import conclusions

# Kinds that know their machine have their laws in test_least_peak.py.
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
def test_no_limit_is_exceeded_and_the_distance_is_gone(kind, distance, v, a, j):
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
    assert sum(end - start for start, end in profile.move_windows) == pytest.approx(2 * one)
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


# Limits of each direction, jogs, recorded references, emergency stops: closed forms and laws.


UP, DOWN = Limits(0.7, 0.5, 1.0), Limits(0.4, 0.3, 0.6)
PAIR = LimitPair(UP, DOWN)


def jogged(kind: str, *steps: tuple[float, float], start: float = 10.0, limits: Limits | LimitPair = UP) -> MotionPlan:
    return plan_motion(kind, [Step(speed_m_s=v, for_s=t) for v, t in steps], start, limits, RAIL)


def ramp(time_s: Array, *corners: tuple[float, float]) -> Array:
    t, v = zip(*corners, strict=True)
    return np.interp(time_s, t, v)


def integral(time_s: Array, values: Array) -> float:
    return float(np.sum(0.5 * (values[1:] + values[:-1]) * np.diff(time_s)))


def test_each_direction_has_its_own_limits() -> None:
    plan = plan_motion("ruckig", (Step(by_m=12.0), Step(by_m=-12.0)), 4.0, PAIR, RAIL)
    profile = plan.sample(0.001)
    assert profile.speed_m_s.max() == pytest.approx(0.7) and profile.speed_m_s.min() == pytest.approx(-0.4)
    up, down = (end - start for start, end in plan.move_windows)
    assert up == pytest.approx(12.0 / 0.7 + 0.7 / 0.5 + 0.5 / 1.0)
    assert down == pytest.approx(12.0 / 0.4 + 0.4 / 0.3 + 0.3 / 0.6)


@pytest.mark.parametrize("kind", WITHOUT_A_MACHINE)
def test_a_jog_reaches_its_speed_holds_it_and_comes_to_rest(kind: str) -> None:
    plan = jogged(kind, (0.4, 5.0), (-0.2, 4.0), (0.0, 3.0))
    profile = plan.sample(0.001)
    assert profile.speed_m_s[4999] == pytest.approx(0.4) and profile.speed_m_s[8999] == pytest.approx(-0.2)
    assert profile.speed_m_s[-1] == 0.0
    assert plan.end_position_m == pytest.approx(profile.position_m[-1], abs=1e-9)
    assert np.abs(np.diff(profile.speed_m_s)).max() < 0.002  # no jump from one jog to the next
    assert np.abs(np.diff(profile.position_m)).max() < 0.001
    assert plan.duration_s == pytest.approx(12.0)


@given(
    st.lists(st.floats(0.01, 12.0), min_size=1, max_size=3),
    st.tuples(st.floats(0.05, 0.8), st.floats(0.05, 2.0), st.floats(0.1, 9.0)),
    st.sampled_from(["trapezoid", "ruckig", "ruckig_equal_time"]),
    st.sampled_from([0.001, 0.0037]),
)
def test_samples_are_to_the_bit_what_the_plan_says_at_their_times(moves, limits, kind, sample_time):
    steps = [Step(by_m=distance) for distance in moves] + [Step(dwell_s=0.3), Step(by_m=-sum(moves))]
    plan = plan_motion(kind, steps, 0.0, Limits(*limits), (-1.0, 40.0), 0.5, 0.5)
    profile = plan.sample(sample_time, plan.duration_s + 1.0)
    height, speed, acceleration = plan.at(profile.time_s)
    np.testing.assert_array_equal(profile.position_m, height)
    np.testing.assert_array_equal(profile.speed_m_s, speed)
    np.testing.assert_array_equal(profile.acceleration_m_s2, acceleration)
    np.testing.assert_array_equal(plan.speed_at(plan.times(sample_time, plan.duration_s + 1.0)), speed)


def test_a_jerk_limited_change_of_speed_takes_its_closed_form() -> None:
    # Δv/a + a/j when the acceleration limit is reached, 2·sqrt(Δv/j) when not.
    for kind, speed, seconds in (
        ("ruckig", 0.6, 0.6 / 0.5 + 0.5 / 1.0), ("ruckig", 0.1, 2.0 * math.sqrt(0.1 / 1.0)),
        ("trapezoid", 0.6, 0.6 / 0.5), ("ruckig_equal_time", 0.6, 0.6 / 0.5),
    ):  # fmt: skip
        assert jogged(kind, (speed, 5.0), (0.0, 5.0)).moves[1][1].duration_s == pytest.approx(seconds)


speeds = st.floats(-0.4, 0.4).map(lambda v: round(v, 3))


@given(st.lists(speeds, min_size=1, max_size=5), st.sampled_from(WITHOUT_A_MACHINE))
def test_any_jog_keeps_to_its_limits_and_its_position_integrates_its_speed(values: list[float], kind: str) -> None:
    values = [v for k, v in enumerate(values) if v != ([0.0, *values][k])] or [0.3]
    steps = [(v, 8.0) for v in values]
    plan = plan_motion(
        kind, [Step(speed_m_s=v, for_s=t) for v, t in [*steps, *([] if values[-1] == 0.0 else [(0.0, 8.0)])]],
        0.0, UP, (-100.0, 100.0),
    )  # fmt: skip
    profile = plan.sample(0.002)
    assert np.abs(profile.speed_m_s).max() <= max(map(abs, values)) + 1e-9
    assert np.abs(profile.acceleration_m_s2).max() <= plan.acceleration_m_s2 * (1 + 1e-9)
    assert integral(profile.time_s, profile.speed_m_s) == pytest.approx(plan.end_position_m, abs=1e-4)


@pytest.mark.parametrize(
    ("steps", "says"),
    [
        ([Step(speed_m_s=0.3, for_s=0.4), Step(speed_m_s=0.0, for_s=3.0)], r"moves\[0\]: .*takes 1.1 s .*gives 0.4 s"),
        ([Step(speed_m_s=0.9, for_s=9.0), Step(speed_m_s=0.0, for_s=3.0)], r"moves\[0\]: 0.9 m/s, the limit is 0.7"),
        ([Step(speed_m_s=0.3, for_s=4.0)], "moves: end at 0.3 m/s"),
        ([Step(speed_m_s=0.3, for_s=4.0), Step(by_m=1.0)], r"moves\[1\]: comes while the carriage goes at 0.3 m/s"),
        ([Step(speed_m_s=0.0, for_s=4.0)], r"moves\[0\]: a jog at 0 m/s from rest"),
        ([Step(speed_m_s=0.7, for_s=23.0), Step(speed_m_s=-0.6, for_s=9.0), Step(speed_m_s=0.0, for_s=4.0)], "rail"),
        ([Step(speed_m_s=0.3, for_s=4.0), Step(speed_m_s=0.0, for_s=4.0), Step(to_m=3.0)], r"moves\[2\]: to_m after"),
    ],
)  # fmt: skip
def test_a_jog_that_cannot_be_made_is_named_by_its_step(steps: list[Step], says: str) -> None:
    with pytest.raises(InputError, match=says):
        plan_motion("ruckig", steps, 10.0, UP, RAIL)


TIME = np.arange(0.0, 30.0, 0.02)
# 0.5 m/s up for a while, then down: ramps of 0.5 m/s².
RECORDED = ramp(TIME, (2, 0), (3, 0.5), (10, 0.5), (11, 0), (15, 0), (16, -0.5), (20, -0.5), (21, 0))


def recorded(smoothing_s: float = 0.0, **changes: Any) -> RecordedPlan:
    given: dict[str, Any] = {"time_s": TIME, "speed_recorded_m_s": RECORDED, "start_position_m": 4.0, "rail_m": RAIL}
    return RecordedPlan(kind="recorded", smoothing_s=smoothing_s, **given | changes)


def test_a_recorded_reference_is_followed_as_it_is() -> None:
    plan = recorded(lead_s=1.0, settle_s=2.0)
    profile = plan.sample(0.001)
    np.testing.assert_allclose(profile.speed_m_s, np.interp(profile.time_s - 1.0, TIME, RECORDED), atol=1e-12)
    assert plan.end_position_m == pytest.approx(4.0 + 8 * 0.5 - 5 * 0.5)
    assert plan.duration_s == pytest.approx(29.98 + 3.0)
    np.testing.assert_allclose(plan.move_windows, [(3.0, 12.0), (16.0, 22.0)], atol=0.03)
    assert plan.acceleration_m_s2 == pytest.approx(0.5, rel=1e-6)


def test_a_moving_average_makes_of_a_ramp_an_s_curve_of_jerk_a_over_t() -> None:
    plan = recorded(smoothing_s=0.8)
    profile = plan.sample(0.001)
    jerk = np.diff(profile.acceleration_m_s2[1:-1]) / 0.001
    assert np.abs(jerk).max() == pytest.approx(0.5 / 0.8, rel=0.02)
    assert np.abs(profile.acceleration_m_s2).max() == pytest.approx(0.5, rel=1e-3)
    assert profile.speed_m_s.max() == pytest.approx(0.5)  # nothing overshoots
    # Late by half the window at half speed.
    half = np.interp(0.25, profile.speed_m_s[2000:4000], profile.time_s[2000:4000])
    assert half == pytest.approx(2.5 + 0.4, abs=1e-3)


@settings(max_examples=40, deadline=None)
@given(st.one_of(st.just(0.0), st.floats(0.01, 3.0)), st.floats(0.0005, 0.01), st.integers(0, 2**32 - 1))
def test_smoothing_keeps_the_distance_whatever_the_sampling(smoothing: float, step: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.005, 0.1, 300))
    speed = np.convolve(rng.normal(0.0, 0.3, 300), np.ones(20) / 20, "same") * np.sin(np.linspace(0, np.pi, 300))
    plan = recorded(smoothing, time_s=time, speed_recorded_m_s=speed, rail_m=(-100.0, 100.0))
    profile = plan.sample(step)
    assert profile.position_m[-1] == pytest.approx(plan.end_position_m, abs=1e-9)
    assert plan.end_position_m - 4.0 == pytest.approx(integral(time, speed), abs=1e-9)
    assert np.abs(profile.speed_m_s).max() <= np.abs(speed).max() + 1e-12
    assert integral(profile.time_s, profile.speed_m_s) == pytest.approx(plan.end_position_m - 4.0, abs=2e-3)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"speed_recorded_m_s": np.zeros_like(TIME)}, "stands still throughout"),
        ({"speed_recorded_m_s": np.full_like(TIME, np.nan)}, "holds no numbers"),
        ({"speed_recorded_m_s": RECORDED + 0.3}, "begins at 0.3 m/s"),
        ({"time_s": TIME[:400], "speed_recorded_m_s": RECORDED[:400]}, "ends at 0.5 m/s"),
        ({"start_position_m": 22.0}, "leaves the rail"),
    ],
)
def test_a_record_that_is_no_reference_says_why(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        recorded(**changes)


@pytest.mark.parametrize("base", [recorded(), plan_motion("ruckig", (Step(by_m=12.0),), 4.0, UP, RAIL)])
def test_an_emergency_stop_ends_v_squared_over_two_a_further_on(base: Plan) -> None:
    stopped = StoppedPlan(base, 6.0, 1.25)
    before, speed, _ = base.at(np.array([6.0]))
    assert stopped.end_position_m == pytest.approx(before[0] + speed[0] ** 2 / 2.5)
    assert stopped.rest_s == pytest.approx(6.0 + speed[0] / 1.25)
    profile, undisturbed = stopped.sample(0.001), base.sample(0.001)
    np.testing.assert_array_equal(profile.speed_m_s[:6000], undisturbed.speed_m_s[:6000])
    assert np.all(profile.speed_m_s[profile.time_s > stopped.rest_s] == 0.0)
    assert profile.position_m[-1] == pytest.approx(stopped.end_position_m)
    assert np.abs(np.diff(profile.speed_m_s)).max() <= 1.25 * 0.001 * (1 + 1e-6)
    assert stopped.move_windows[-1][1] == pytest.approx(stopped.rest_s)


# A kind of reference that is declared is known everywhere: one is added here, and looked for in every place.


@planned(
    label="half acceleration",
    words="the trapezoid at half its acceleration",
    definition="a trapezoid under half of the acceleration limit",
    ramp=lambda ramp: shortest_ramp(ramp.speed_m_s, ramp.next_speed_m_s, _halved(ramp.limits)),
    needs_jerk=False,
    colour="#CC79A7",
    dash="4px,2px",
)
def half_acceleration(move: Move) -> Shape:
    return shortest_move(move.distance_m, _halved(move.limits))


def _halved(limits: Limits) -> Limits:
    return Limits(limits.speed_m_s, 0.5 * limits.acceleration_m_s2)


@pytest.fixture
def declared() -> Iterator[PlannedKind]:
    add(half_acceleration)
    yield half_acceleration
    forget_added()


@pytest.mark.usefixtures("declared")
def test_its_own_duration_counts_and_not_the_trapezoids() -> None:
    slower = 12.0 / 0.7 + 0.7 / 0.25
    assert move_time_s(planned_kind("half_acceleration"), 12.0, LIMITS) == pytest.approx(slower)
    steps = [Step(by_m=12.0), Step(dwell_s=1.0), Step(by_m=-12.0)]
    assert motion_time_s(["trapezoid", "half_acceleration"], steps, 4.0, LIMITS, RAIL) == pytest.approx(1 + 2 * slower)
    plan = plan_motion("half_acceleration", steps, 4.0, LIMITS, RAIL)
    assert plan.duration_s == pytest.approx(1.0 + 2.0 * slower)
    assert np.abs(plan.sample(0.01).acceleration_m_s2).max() == pytest.approx(0.25)


@pytest.mark.usefixtures("declared")
def test_a_scenario_runs_it_and_all_that_shows_a_study_shows_it(tmp_path: Path) -> None:
    study = study_of(tmp_path, "", "references: [trapezoid, ruckig]", "references: [trapezoid, half_acceleration]")
    assert study.plans["half_acceleration"].duration_s > study.plans["trapezoid"].duration_s
    assert study.duration_s == study.plans["half_acceleration"].duration_s
    out, report = tmp_path / "out", tmp_path / "report.html"
    done = CliRunner().invoke(
        cli, ["study", str(tmp_path / "scenario.yaml"), "--out", str(out)], catch_exceptions=False
    )
    assert done.exit_code == 0, done.output
    result = read_finished(out)
    rows = {(row.payload_kg, row.reference): row for row in result.rows}
    longer = (rows[9000.0, "half_acceleration"]["move_time_s"] - rows[9000.0, "trapezoid"]["move_time_s"]) / 2.0
    assert longer == pytest.approx(0.7 / 0.3 - 0.7 / 0.6)
    assert "the trapezoid at half its acceleration" in " ".join(done.output.split())
    assert "the trapezoid at half its acceleration" in " ".join(conclusions(result))
    CliRunner().invoke(cli, ["report", str(out), "--out", str(report)], catch_exceptions=False)
    for file in (out / "study.html", report):
        text = file.read_text(encoding="utf-8")
        assert "half acceleration" in text and "#CC79A7" in text, file.name


def test_a_kind_may_take_the_time_of_any_other(declared: PlannedKind) -> None:
    quick = Limits(LIMITS.speed_m_s, 1.5 * LIMITS.acceleration_m_s2)
    add(replace(declared, name="quick", move=lambda move: shortest_move(move.distance_m, quick)))
    as_long = replace(planned_kind("ruckig_equal_time"), name="as_long_as_quick", same_time_as="quick")
    wanted = 12.0 / 0.7 + 0.7 / 0.75
    assert move_shape(as_long, 12.0, LIMITS).duration_s == pytest.approx(wanted, abs=1e-9)
    assert move_time_s(as_long, 12.0, LIMITS) == pytest.approx(wanted, abs=1e-9)
