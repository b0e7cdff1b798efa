"""Limits of each direction, jogs, recorded references, emergency stops: closed forms and laws."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.references import (
    LimitPair,
    Limits,
    MotionPlan,
    Plan,
    RecordedPlan,
    Step,
    StoppedPlan,
    plan_motion,
    planned_kinds,
)

# Kinds that know their machine have their laws in test_references_wire.py.
WITHOUT_A_MACHINE = sorted(name for name, kind in planned_kinds().items() if not kind.needs_load)
RAIL = (0.0, 25.0)
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
def test_samples_are_to_the_bit_what_the_plan_says_at_their_times(
    moves: list[float], limits: tuple[float, float, float], kind: str, sample_time: float
) -> None:
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
    long = jogged("ruckig", (0.6, 5.0), (0.0, 5.0)).moves[1][1]
    assert long.duration_s == pytest.approx(0.6 / 0.5 + 0.5 / 1.0)
    short = jogged("ruckig", (0.1, 5.0), (0.0, 5.0)).moves[1][1]
    assert short.duration_s == pytest.approx(2.0 * math.sqrt(0.1 / 1.0))
    hard = jogged("trapezoid", (0.6, 5.0), (0.0, 5.0)).moves[1][1]
    assert hard.duration_s == pytest.approx(0.6 / 0.5)
    equal = jogged("ruckig_equal_time", (0.6, 5.0), (0.0, 5.0)).moves[1][1]
    assert equal.duration_s == pytest.approx(0.6 / 0.5)


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
    given: dict[str, Any] = {
        "time_s": TIME,
        "speed_recorded_m_s": RECORDED,
        "start_position_m": 4.0,
        "rail_m": RAIL,
    } | changes
    return RecordedPlan(kind="recorded", smoothing_s=smoothing_s, **given)


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
