"""The closed loop: bumpless start, limits, the hold between samples, lanes, outcomes; its energy and slack."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.support import by_hand
from tests.support.ideal import ideal_hoist
from workbench.control import Events, PiSettings
from workbench.core.run import Array
from workbench.machines import PLANTS, Hoist, with_values
from workbench.simulate.loop import LoopCase, LoopResult, Outcome, simulate_loop, torque_limits

MACHINE = ideal_hoist()
SETTINGS = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)
NOMINAL_SPEED = MACHINE.motor.nominal_speed_rad_s


def case(
    reference: Array,
    payload_kg: float = 4500.0,
    machine: Hoist = MACHINE,
    settings: PiSettings = SETTINGS,
    height_m: float = 10.0,
    **more: Any,
) -> LoopCase:
    return LoopCase("run", machine, payload_kg, height_m, settings, reference, **more)


def one(reference: Array, record_every: int = 1, **more: Any) -> LoopResult:
    return simulate_loop([case(reference, **more)], record_every=record_every)[0]


def ramp(to: float, samples: int = 1500) -> Array:
    """Rest, a ramp over a second, and on at its end."""
    return np.interp(np.arange(samples) * 0.001, [0.1, 1.1], [0.0, to])


@pytest.fixture(scope="module")
def lift() -> LoopResult:
    """A short lift and a lowering after it, every sample recorded."""
    return one(np.interp(np.arange(3000) * 0.001, [0.1, 0.6, 1.2, 2.2, 2.6], [0.0, 40.0, 40.0, -40.0, 0.0]))


@pytest.mark.parametrize("payload", [0.0, 4500.0, 9000.0])
def test_a_hanging_load_is_taken_over_without_a_bump(payload):
    result = one(np.zeros(2000), payload_kg=payload)
    assert result.run["torque_motor_nm"] == pytest.approx(result.hold_torque_nm, rel=1e-9)
    assert result.run["position_carriage_m"] == pytest.approx(10.0, abs=1e-9)
    assert np.max(np.abs(result.run["speed_motor_rad_s"])) < 1e-8
    assert result.outcome is Outcome.COMPLETED


def test_the_torque_is_that_of_the_sampled_law_from_the_measured_speed(lift):
    error = lift.run["speed_reference_rad_s"] - lift.run["speed_motor_rad_s"]
    integral = lift.hold_torque_nm + 122.0 * 0.001 * np.concatenate([[0.0], np.cumsum(error)[:-1]])
    assert lift.run["torque_motor_nm"] == pytest.approx(31.0 * error + integral, abs=1e-8)


def test_the_torque_is_held_between_samples_and_the_plant_moves_as_in_the_reference(lift):
    """Sample by sample, the reference integrates the plant under a constant torque."""
    p = PLANTS["hoist"].values(MACHINE, 4500.0)
    q, _ = PLANTS["hoist"].equilibrium(10.0, p)
    state = np.array([*q, 0.0, 0.0, 0.0])
    torque, speed = lift.run["torque_motor_nm"], lift.run["speed_motor_rad_s"]
    for k in range(len(torque) - 1):
        assert state[3] == pytest.approx(speed[k], abs=2e-6 * NOMINAL_SPEED)
        state = by_hand.reference(p, state, np.array([0.0, 0.001]), np.full(2, torque[k]), step=2e-5)[-1]
    assert state[2] == pytest.approx(lift.end_position_m, abs=1e-6)


def test_the_torque_stops_at_the_limit_of_the_drive():
    result = one(np.full(300, 140.0))
    limit = torque_limits(MACHINE)["u_all"]
    assert limit == pytest.approx(2 * 480.0 * 1.6)
    assert np.max(result.run["torque_motor_nm"]) == limit
    assert result.metrics["peak_torque_motor_nm"] == pytest.approx(limit / 2.0)
    assert result.metrics["peak_torque_percent"] == pytest.approx(160.0)
    assert np.min(one(np.full(300, -140.0)).run["torque_motor_nm"]) == -limit


def overshoot(anti_windup: str) -> float:
    reference = np.full(2000, 140.0)
    settings = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=400.0, anti_windup=anti_windup)
    return float(np.max(one(reference, settings=settings).run["speed_motor_rad_s"]) - 140.0)


def test_anti_windup_bounds_the_overshoot_after_the_limit():
    wound_up = overshoot("none")
    assert wound_up > 10.0
    assert overshoot("back_calculation") < 0.5 * wound_up
    assert overshoot("conditional") < 0.5 * wound_up


def many(n: int) -> list[LoopCase]:
    """Cases of different payloads, heights and speeds; some at rest, one at its limit."""
    return [
        case(ramp(0.0 if j % 5 == 0 else 15.0 * (j % 9 - 4), 600), 270.0 * j, height_m=5.0 + 0.3 * j) for j in range(n)
    ]


@pytest.fixture(scope="module")
def alone() -> list[LoopResult]:
    return [simulate_loop([one_case])[0] for one_case in many(33)]


def assert_same(a: LoopResult, b: LoopResult) -> None:
    assert a.metrics == b.metrics
    assert a.end_position_m == b.end_position_m
    for name, values in a.run.signals.items():
        assert np.array_equal(values, b.run[name]), name


@pytest.mark.parametrize("n", [2, 7, 16, 17, 33])
def test_a_case_among_others_is_bit_for_bit_the_case_alone(n, alone):
    for together, single in zip(simulate_loop(many(n)), alone, strict=False):
        assert_same(together, single)


def test_cases_of_unequal_length_and_sample_time_come_back_in_order_each_as_it_is_alone():
    slow = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0, sample_time_s=0.002)
    mixed = [case(ramp(30.0, 600)), case(ramp(20.0, 400), settings=slow), case(ramp(10.0, 900)), case(ramp(-30.0, 600))]
    for together, one_case in zip(simulate_loop(mixed), mixed, strict=True):
        assert_same(together, simulate_loop([one_case])[0])
        assert len(together.run.time_s) == len(one_case.speed_reference_rad_s) // 10


def test_what_is_recorded_is_every_so_manyth_sample_and_metrics_do_not_hang_on_it(lift):
    reference = lift.run["speed_reference_rad_s"]
    thinned, silent = one(reference, record_every=7), one(reference, record_every=0)
    assert thinned.run.time_s == pytest.approx(np.arange(0, 3000, 7) * 0.001)
    assert np.array_equal(thinned.run["torque_motor_nm"], lift.run["torque_motor_nm"][::7])
    assert dict(silent.run.signals) == {}
    assert len(silent.run.time_s) == 0
    for name, value in lift.metrics.items():
        assert thinned.metrics[name] == value
        assert silent.metrics[name] == pytest.approx(value, rel=1e-9)


def test_the_work_of_the_motors_is_what_is_stored_and_lost(lift):
    """It starts and ends at rest, so what is not weight is loss, and that is what friction takes on the way."""
    p = PLANTS["hoist"].values(MACHINE, 4500.0)
    net = lift.metrics["energy_motoring_j"] - lift.metrics["energy_regenerated_j"]
    run = lift.run
    power = run["torque_motor_nm"][:-1] * 0.5 * (run["speed_motor_rad_s"][1:] + run["speed_motor_rad_s"][:-1])
    assert net == pytest.approx(float(np.sum(power)) * 0.001, rel=1e-5, abs=0.05)
    # It comes to rest lower or higher: what is left after weight is friction, and that is never given back.
    weight = (p.m_c + p.m_p) * p.g * (lift.end_position_m - 10.0)
    way = float(np.sum(np.abs(run["speed_carriage_m_s"]))) * 0.001
    assert 0.8 * 4500.0 * way < net - weight < 1.6 * 6000.0 * way
    assert lift.metrics["energy_motoring_j"] > 0.0 < lift.metrics["energy_regenerated_j"]


def strong() -> Hoist:
    """A drive that can outrun a falling load."""
    return with_values(MACHINE, {"drive.overload": 12.0})


def test_a_drum_that_outruns_the_load_makes_slack_that_is_reported():
    reference = np.where(np.arange(2000) < 100, 0.0, np.where(np.arange(2000) < 300, -400.0, 0.0))
    result = one(reference, machine=strong(), settings=PiSettings(kp_nm_s_per_rad=200.0, ki_nm_per_rad=0.0))
    tension = result.run["tension_min_n"]
    slack = tension <= 0.0
    assert result.metrics["min_wire_tension_n"] == 0.0
    assert result.metrics["slack_time_s"] == pytest.approx(np.count_nonzero(slack) * 0.001)
    assert result.metrics["slack_events"] == np.count_nonzero(slack[1:] & ~slack[:-1]) + slack[0]
    assert 0.01 < result.metrics["slack_time_s"] < 1.0
    assert tension[-1] > 0.0  # it came tight again


@pytest.mark.parametrize(("height", "speed"), [(0.05, -40.0), (24.95, 40.0)], ids=["below", "above"])
@pytest.mark.parametrize("record_every", [0, 1])
def test_a_carriage_that_leaves_the_rail_is_an_outcome_with_its_moment(height, speed, record_every):
    result = one(ramp(speed, 2500), height_m=height, record_every=record_every)
    assert result.outcome is Outcome.LEFT_THE_RAIL
    if record_every:
        heights = result.run["position_carriage_m"]
        first = int(np.argmax((heights < -0.01) | (heights > 25.01)))
        assert f"at {first * 0.001:.2f} s" in result.at


@pytest.mark.parametrize("record_every", [0, 10])
def test_a_carriage_that_left_the_rail_and_came_back_has_left_it(record_every):
    reference = np.interp(np.arange(3000) * 0.001, [0.0, 0.5, 1.0, 1.5], [0.0, -40.0, 40.0, 0.0])
    result = one(reference, height_m=0.05, record_every=record_every)
    assert result.end_position_m > 0.0
    assert result.outcome is Outcome.LEFT_THE_RAIL


@pytest.mark.parametrize("record_every", [0, 10])
def test_a_state_without_bound_is_an_outcome_with_its_moment(record_every):
    # No file may ask for such an overload; the outcome is there for what else may run away.
    drive = MACHINE.drive.model_copy(update={"overload": 1e150, "field_weakening": False})
    unheld = MACHINE.model_copy(update={"drive": drive})
    wild = PiSettings(kp_nm_s_per_rad=1.0, ki_nm_per_rad=0.0).model_copy(update={"kp_nm_s_per_rad": 1e300})
    result = one(ramp(50.0), machine=unheld, settings=wild, record_every=record_every)
    assert result.outcome is Outcome.DIVERGED
    assert result.at == ("by 0.01 s" if record_every else "")


@pytest.mark.parametrize(("share", "lag_s"), [(0.5, 0.002), (0.6, 0.02), (0.5, 0.0)])
def test_a_motor_that_fails_takes_its_torque_at_once_and_the_other_s_rises_behind_its_lag(share, lag_s):
    machine = with_values(MACHINE, {"drive.torque_lag_s": lag_s, "drive.torque_share": share})
    result = one(np.zeros(700), machine=machine, events=Events(motor_fails_s=0.5))
    works, fails = (result.run[f"torque_motor{k}_nm"] for k in (1, 2))
    failed, held = result.run.time_s >= 0.5 - 1e-9, result.hold_torque_nm
    assert np.all(fails[failed] == 0.0)
    at_first = works[failed][:2]  # the loop has hardly noticed: the lag alone brings back what is held
    rise = 1.0 - (1.0 - share) * (np.exp(-np.array([0.0, 0.001]) / lag_s) if lag_s else np.zeros(2))
    assert at_first / held == pytest.approx(rise, rel=0.02)
