"""Tuning keeps its promises; terms beside the PI do what they are for, in the linear loop as in the compiled one."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.signal import detrend

import workbench as wb
from tests.support.ideal import ideal_hoist
from workbench.analysis.linearise import OperatingPoint, linearise
from workbench.analysis.loop import linear_loop, load_step, step_response
from workbench.analysis.margins import family, margins, operating_points, weakest
from workbench.analysis.search import Search, anti_resonances, best_rejection, for_bandwidth, make_search
from workbench.analysis.tune import Goal, Score, Trial, Tuned, Weights, try_out, tune, usual_trial
from workbench.analysis.usual import usual_controller
from workbench.cli import cli
from workbench.control import Events, PiSettings
from workbench.control.settings import read_controller
from workbench.core.errors import InputError
from workbench.machines import Hoist, default_hoist, save_machine, with_values
from workbench.references import Limits, Step, motor_speed_rad_s, plan_motion
from workbench.simulate.loop import LoopCase, simulate_loop
from workbench.study.loop_design import loop_case
from workbench.view.loop import sentences
from workbench.view.tune import active_limits

BASE = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)
PAYLOADS = (0.0, 9000.0)


def slow_drive() -> Hoist:
    return with_values(
        ideal_hoist(), {"drive.torque_lag_s": 0.004, "drive.speed_filter_s": 0.003, "drive.speed_delay_s": 0.002}
    )


POINTS = operating_points(slow_drive(), PAYLOADS, (2.0, 20.0))


@pytest.fixture(scope="module")
def search() -> Search:
    return make_search(slow_drive(), BASE, POINTS)


def with_gains(kp: float, ki: float) -> PiSettings:
    return BASE.model_copy(update={"kp_nm_s_per_rad": kp, "ki_nm_per_rad": ki})


def random_gains(search: Search, n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    kp = search.inertia_kg_m2 * np.exp(rng.uniform(np.log(2.0), np.log(1500.0), n))
    return kp, kp * np.exp(rng.uniform(np.log(0.2), np.log(300.0), n))


def test_the_search_calls_stable_what_the_poles_call_stable_and_sees_the_same_ms(search: Search):
    kp, ki = random_gains(search, 40)
    judged = search.judge(kp, ki)
    assert 5 < judged.stable.sum() < 35
    for k in range(len(kp)):
        members = family(slow_drive(), with_gains(kp[k], ki[k]), POINTS)
        assert all(m.margins.stable for m in members) == judged.stable[k], (kp[k], ki[k])
        if judged.stable[k] and judged.ms[k] < 2.0:
            assert judged.ms[k] == pytest.approx(max(m.margins.ms for m in members), rel=2e-3)
            assert judged.mt[k] == pytest.approx(max(m.margins.mt for m in members), rel=2e-3)
            assert judged.bandwidth_hz[k] == pytest.approx(min(m.margins.bandwidth_hz for m in members), rel=2e-3)


def test_what_is_looked_at_first_drops_nothing_that_all_frequencies_allow(search: Search):
    """Few frequencies bound Ms from below, and those up to a bandwidth tell whether it is reached; the turns are those
    of the phase, summed step by step."""
    kp, ratio = (a.ravel() for a in np.meshgrid(np.geomspace(0.5, 5000.0, 40), np.geomspace(0.01, 300.0, 30)))
    judged = search.judge(kp, kp * ratio)
    for limit in (1.2, 1.4, 2.0):
        allowed, looked_at = judged.ms <= limit, search.within(kp, kp * ratio, limit)
        assert np.all(looked_at[allowed]) and np.any(allowed)
    for wanted in (0.5, 2.0, 8.0):
        reached = search.reaches(kp, kp * ratio, np.full(len(kp), wanted))
        assert np.array_equal(reached, judged.bandwidth_hz >= wanted) and 0 < np.count_nonzero(reached) < len(kp)
    back = 1.0 + search.plants[None] * (kp[:, None] * search.per_kp + (kp * ratio)[:, None] * search.per_ki)[:, None]
    steps = np.angle(back[..., 1:] * np.conj(back[..., :-1])).sum(axis=-1) + np.angle(-back[..., 0])
    assert np.array_equal(judged.stable, np.all(np.abs(steps - search.turns) < 0.5 * np.pi, axis=1))


def test_best_rejection_keeps_to_ms_and_no_brute_grid_finds_a_larger_ki(search: Search):
    shaped = best_rejection(search, 1.4)
    members = family(slow_drive(), with_gains(shaped.kp, shaped.ki), POINTS)
    assert all(m.margins.stable for m in members)
    assert 1.39 < max(m.margins.ms for m in members) <= 1.4
    kp, ki = (a.ravel() for a in np.meshgrid(np.geomspace(2.0, 500.0, 150), np.geomspace(1.0, 20_000.0, 150)))
    judged = search.judge(kp, ki)
    allowed = judged.stable & (judged.ms <= 1.4)
    assert shaped.ki >= 0.995 * ki[allowed].max()


@pytest.mark.parametrize("wanted", [1.0, 4.0, 10.0])
def test_the_slowest_payload_gets_the_bandwidth_that_was_asked_for(search: Search, wanted: float):
    shaped = for_bandwidth(search, wanted, 1.4)
    members = family(slow_drive(), with_gains(shaped.kp, shaped.ki), POINTS)
    assert min(m.margins.bandwidth_hz for m in members) == pytest.approx(wanted, rel=2e-3)
    assert max(max(m.margins.ms, m.margins.mt) for m in members) <= 1.4
    assert all(m.margins.stable for m in members)


def test_a_bandwidth_that_the_delays_forbid_is_refused_with_one_that_they_allow(search: Search):
    with pytest.raises(InputError, match=r"40 Hz is out of reach: .* at most (\S+) Hz") as refused:
        for_bandwidth(search, 40.0, 1.4)
    attainable = float(str(refused.value).split("at most ")[1].split(" Hz")[0])
    # No gains beat it: a brute grid finds none wider. What it names is nearly had.
    kp, ki = (a.ravel() for a in np.meshgrid(np.geomspace(2.0, 500.0, 120), np.geomspace(0.1, 20_000.0, 120)))
    judged = search.judge(kp, ki)
    widest = judged.bandwidth_hz[judged.stable & (judged.ms <= 1.4)].max()
    assert 0.98 * widest <= attainable <= 1.02 * widest


@pytest.fixture(scope="module")
def undamped() -> Hoist:
    return with_values(default_hoist(), {"wire.damping_time_s": 0.0})


def test_a_wire_without_damping_has_a_least_ms_that_is_named_with_its_swing_and_no_gains_go_below(undamped: Hoist):
    """Exact margins of gains over three decades; and an Ms just above the one named is attained."""
    own = make_search(undamped, BASE, POINTS)
    with pytest.raises(InputError, match=r"an undamped swing at (\S+) Hz leaves Ms at (\S+) or more") as refused:
        best_rejection(own, 1.4)
    hz, least = (float(x) for x in re.findall(r"at (\d\S*) (?:Hz|or)", refused.value.problem))
    for kp in np.geomspace(0.5, 500.0, 7):
        members = family(undamped, with_gains(kp, 2.0 * kp), POINTS)
        worst = max(members, key=lambda member: member.margins.ms)
        assert worst.margins.ms > 0.995 * least
        if worst.margins.stable and kp < 100.0:
            assert worst.margins.ms_hz == pytest.approx(hz, rel=0.01)
    shaped = best_rejection(own, 1.05 * least)
    exact = family(undamped, with_gains(shaped.kp, shaped.ki), POINTS)
    assert all(member.margins.stable for member in exact) and shaped.ki > 0.0


def test_a_load_step_integrates_to_one_over_ki():
    settings = with_gains(40.0, 300.0)
    loop = linear_loop(slow_drive(), settings, OperatingPoint(4500.0, 10.0))
    response = step_response(loop, "load_torque", 8.0)
    assert response.signals["speed_motor_rad_s"].sum() * loop.dt == pytest.approx(1.0 / 300.0, rel=5e-3)
    assert load_step(loop).iae_rad >= 0.999 / 300.0
    assert load_step(loop).peak_rad_s == pytest.approx(np.abs(response.signals["speed_motor_rad_s"]).max(), rel=1e-6)


def short_trial(machine: Hoist) -> Trial:
    usual = usual_trial(machine, PAYLOADS, BASE.sample_time_s)
    return Trial(machine, PAYLOADS, usual.start_position_m, {"trapezoid": usual.references["trapezoid"]})


@pytest.fixture(scope="module", params=[None, 4.0], ids=["reject", "bandwidth"])
def tuned(request: pytest.FixtureRequest) -> Tuned:
    return tune(slow_drive(), BASE, POINTS, short_trial(slow_drive()), Goal(request.param))


def test_the_winner_keeps_to_the_goal_by_its_exact_margins_and_costs_least(tuned: Tuned):
    assert tuned.winner.cost == min(c.cost for c in tuned.tried) < 1.0
    for member in tuned.members:
        assert member.margins.stable
        assert member.margins.ms <= tuned.goal.ms_limit
    slowest = min(m.margins.bandwidth_hz for m in tuned.members)
    if tuned.goal.bandwidth_hz is not None:
        assert 0.997 * tuned.goal.bandwidth_hz <= slowest <= 1.053 * tuned.goal.bandwidth_hz
    else:
        assert tuned.winner.settings.ki_nm_per_rad >= 0.799 * tuned.shaped.settings.ki_nm_per_rad


def test_a_limit_that_is_said_to_be_active_costs_something_and_one_that_is_not_costs_next_to_nothing(tuned: Tuned):
    """Each limit loosened by a tenth, the rest as it was, and tuned again: by the weights of the first tuning."""
    goal, base, said = tuned.goal, tuned.shaped.score, active_limits(tuned)
    if goal.bandwidth_hz is None:
        floor = 0.8 * tuned.shaped.settings.ki
        assert ("ki at 80%" in said) == (tuned.winner.settings.ki < 1.01 * floor)
        return

    def least(other: Goal) -> float:
        found = tune(slow_drive(), BASE, POINTS, short_trial(slow_drive()), other)
        return min(Weights().cost(c.score, base) for c in found.tried if c.ms <= other.ms_limit)

    for name, other in (
        ("Ms ", Goal(goal.bandwidth_hz, 1.1 * goal.ms_limit)),
        ("the bandwidth asked for", Goal(0.9 * goal.bandwidth_hz, goal.ms_limit)),
    ):
        gain = tuned.winner.cost - least(other)
        assert gain > 1e-3 if name in said else gain < 0.02, (name, said, gain)


def test_the_front_holds_the_winner_and_nobody_beats_its_members(tuned: Tuned):
    front = tuned.front()
    assert len(front) >= 3
    # The cost rises with all that the front weighs but Ms, so the winner is on it.
    assert tuned.winner in front
    marks = {id(c): (c.score.tracking_percent, c.score.peak_percent, c.ms) for c in tuned.tried}
    for c in front:
        mine = np.array(marks[id(c)])
        assert not any(np.all(np.array(m) <= mine) and np.any(np.array(m) < mine) for m in marks.values())


def test_a_candidate_whose_run_fails_has_no_score_and_costs_without_bound():
    heavy = Trial(slow_drive(), (60_000.0,), 6.0, short_trial(slow_drive()).references)
    (score,) = try_out(heavy, [BASE])
    assert not score.ok
    assert Weights().cost(score, Score(1.0, 1.0, 1.0)) == np.inf
    with pytest.raises(InputError, match="lighter payloads"):
        tune(slow_drive(), BASE, POINTS, heavy, Goal())


def run(*words: str) -> tuple[int, str]:
    done = CliRunner().invoke(cli, list(words))
    if isinstance(done.exception, InputError):
        return 2, str(done.exception)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.exit_code, done.output


def test_the_tune_command_writes_a_block_that_the_loop_command_takes(tmp_path: Path):
    machine, out, folder = tmp_path / "machine.yaml", tmp_path / "tuned.yaml", tmp_path / "loop"
    save_machine(slow_drive(), machine)
    words = ("--machine", str(machine), "--payloads", "0,9000", "--heights", "2,20")
    code, said = run("tune", *words, "--bandwidth", "4", "--out", str(out))
    assert code == 0, said
    assert "winner" in said
    assert "13.9 Hz" in said  # the widest that this drive allows
    settings = read_controller(out)
    reached = [margins(linear_loop(slow_drive(), settings, p)) for p in POINTS]
    assert min(m.bandwidth_hz for m in reached) == pytest.approx(4.0, rel=0.06)
    code, said = run("loop", *words, "--controller", str(out), "--out", str(folder))
    assert code == 0, said
    assert {path.name for path in folder.iterdir()} == {"loop.html", "loop.json"}
    assert run("tune", *words, "--bandwidth", "4", "--out", str(out)) == (
        2, f"{out}: is there already; nothing is overwritten, choose another file"
    )  # fmt: skip


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("tune", "--bandwidth", "900"), "out of reach"),
        (("tune", "--bandwidth", "3", "--reject"), "one of them"),
        (("tune", "--out", "nowhere/at/all.yaml"), "there is no folder"),
        (("loop", "--heights", "99"), "off the rail"),
    ],
)
def test_bad_input_is_one_sentence(words: tuple[str, ...], said: str):
    code, text = run(*words)
    assert code == 2
    assert said in text


# The least of each margin, and what ends a bandwidth.


SLOW = {"drive.torque_lag_s": 0.004, "drive.speed_filter_s": 0.003, "drive.speed_delay_s": 0.002}
MACHINE = with_values(ideal_hoist(), SLOW)
RINGING = with_values(ideal_hoist(), SLOW | {"wire.damping_time_s": 0.002})


def test_the_weakest_has_the_least_of_each_margin_and_names_its_member():
    members = family(MACHINE, usual_controller(MACHINE), operating_points(MACHINE, (0.0, 9000.0), (0.0, 20.0)))
    worst = weakest(members)
    for name, least in {"phase_deg": min, "gain_up": min, "delay_s": min, "disk": min, "ms": max, "mt": max}.items():
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


def test_a_tuning_runs_under_the_scenarios_events():
    case = loop_case(None, None, None, (10.0,), "scenarios/motor_failure.yaml")
    assert case.trial().events == case.events != Events()


def test_a_loop_that_less_gain_makes_unstable_says_by_how_much_less():
    case = loop_case(None, None, None, None, "scenarios/axis.yaml")
    members = family(case.machine, case.settings, operating_points(case.machine, (0.0,), (0.0,)))
    (margins,) = (member.margins for member in members)
    assert 0.0 < margins.gain_down < 1.0
    said = re.search(r"smallest gain margin downwards ([\d.]+) dB", " ".join(sentences(case, members)))
    assert said is not None and float(said[1]) == pytest.approx(-20.0 * math.log10(margins.gain_down), abs=0.05)


# Terms beside the PI: the linear loop says of them what the compiled loop does, and they do what they are for.


DRIVE = {"drive.torque_lag_s": 0.004, "drive.speed_filter_s": 0.003, "drive.speed_delay_s": 0.0025}
BARE = with_values(ideal_hoist(), DRIVE)
RINGS = with_values(BARE, {"wire.damping_time_s": 0.002})
GAINS = {"kp_nm_s_per_rad": 31.0, "ki_nm_per_rad": 122.0}
SPEED = {"signal": "carriage_speed", "time_s": 0.05, "filter_hz": 20.0}
TENSION = {"signal": "tension", "time_s": 0.05, "filter_hz": 0.2}
TERMS: dict[str, dict[str, Any]] = {
    "position loop": {"kv_per_s": 3.0},
    "damping by carriage speed": {"load_damping": SPEED},
    "damping by tension": {"load_damping": TENSION},
    "all at once": {
        "kv_per_s": 2.0, "load_damping": TENSION, "set_point_weight": 0.7,
        "feed_forward": {"inertia": 0.5, "wire": 1.0},
        "gain_schedule": [{"payload_kg": 0.0} | GAINS, {"payload_kg": 9000.0} | dict.fromkeys(GAINS, 60.0)],
    },
}  # fmt: skip
HEIGHT, EVEN, SWING, RAMP = 6.0, 78.55, 0.5, 4.0  # m, rad/s: half of nominal speed, so that no friction turns round


def settings_with(**terms: Any) -> PiSettings:
    return PiSettings.model_validate(GAINS | terms)


def simulated_response(machine: Hoist, settings: PiSettings, payload: float, frequency_hz: float) -> complex:
    """Motor speed over reference at a frequency: two compiled runs, one with a sine on an even speed, after RAMP."""
    dt, periods = settings.sample_time_s, 3
    t = np.arange(round((RAMP + 4.0 + periods / frequency_hz) / dt)) * dt
    even = EVEN * np.clip(t / RAMP, 0.0, 1.0)
    sine = np.where(t > RAMP + 0.5, SWING * np.sin(2.0 * math.pi * frequency_hz * t), 0.0)
    cases = [LoopCase("a", machine, payload, HEIGHT, settings, r) for r in (even, even + sine)]
    still, moved = (r.run["speed_motor_rad_s"] for r in simulate_loop(cases, record_every=1, step_s=0.0005))
    last = slice(-round(periods / frequency_hz / dt), None)
    turning = np.exp(-2j * math.pi * frequency_hz * t[last])
    return complex(np.sum((moved - still)[last] * turning) / np.sum(sine[last] * turning))


@pytest.mark.parametrize("term", TERMS)
@pytest.mark.parametrize("frequency_hz", [0.8, 2.5, 8.0])
def test_the_linear_loop_has_the_simulated_frequency_response(term: str, frequency_hz: float):
    settings = settings_with(**TERMS[term])
    loop = linear_loop(RINGS, settings, OperatingPoint(9000.0, HEIGHT))
    assert loop.stable
    linear = complex(loop.responses(np.array([frequency_hz])).R[0])
    assert abs(simulated_response(RINGS, settings, 9000.0, frequency_hz) / linear - 1.0) < 0.01


def swing_left(machine: Hoist, settings: PiSettings) -> float:
    """Of the tension at the drum, N, beside its slow part, one to three seconds after a ramp: at even speed, where no
    standing friction damps it."""
    plan = plan_motion("trapezoid", [Step(by_m=6.0)], HEIGHT, Limits(0.6, 0.6), (0.0, 22.0), 0.5, 1.0)
    speed = motor_speed_rad_s(plan.sample(0.001).speed_m_s, machine.gearbox.ratio, machine.winch.drum_diameter_m)
    (result,) = simulate_loop([LoopCase("a", machine, 9000.0, HEIGHT, settings, speed)], record_every=1)
    return float(np.std(detrend(result.run["tension_drum_n"][2500:4500])))


@pytest.mark.parametrize("damping", [SPEED, TENSION], ids=["carriage speed", "tension"])
def test_load_damping_takes_the_swing_that_a_stiff_loop_leaves(damping: dict[str, Any]):
    stiff = {"kp_nm_s_per_rad": 80.0, "ki_nm_per_rad": 800.0}
    plain, damped = PiSettings.model_validate(stiff), PiSettings.model_validate(stiff | {"load_damping": damping})
    assert swing_left(RINGS, damped) < 0.5 * swing_left(RINGS, plain)


def test_a_followed_speed_damps_the_load_by_half_of_time_times_frequency():
    """A drive that follows exactly is a damper in series: ratio time · ω/2 of the load on a held drive."""
    fast = with_values(ideal_hoist(), {"wire.damping_time_s": 0.0005})
    stiff = {"sample_time_s": 0.0005, "kp_nm_s_per_rad": 900.0, "ki_nm_per_rad": 100.0}
    damping = {"signal": "tension", "time_s": 0.02, "filter_hz": 0.001}

    def light(**more: Any) -> tuple[float, float]:
        loop = linear_loop(fast, PiSettings.model_validate(stiff | more), OperatingPoint(9000.0, HEIGHT))
        z = loop.poles()
        s = np.log(z[np.abs(z) > 1e-6]) / loop.dt
        (pole,) = [x for x in s if 5.0 < x.imag < 40.0]
        return float(abs(pole)), float(-pole.real / abs(pole))

    w, own = light()
    _, ratio = light(load_damping=damping)
    assert ratio - own == pytest.approx(0.5 * 0.02 * w, rel=0.05)


def test_a_position_loop_leaves_no_error_of_a_load_that_a_speed_loop_leaves():
    """Without an integral a torque step leaves an angle of torque/(kp kv); the speed loop alone runs away with it."""
    heavier = BARE.model_copy(update={"effects": {"carriage_mass_error": {"mass_kg": 900.0}}})
    without_integral = {"kp_nm_s_per_rad": 40.0, "ki_nm_per_rad": 0.0}
    n = 12_000
    ends = []
    for more in ({}, {"kv_per_s": 4.0}):
        settings = PiSettings.model_validate(without_integral | more | {"feed_forward": {"weight": 0.9}})
        case = LoopCase("a", heavier, 0.0, HEIGHT, settings, np.concatenate([np.zeros(500), np.full(n, 10.0)]))
        (result,) = simulate_loop([case], record_every=1)
        lag = case.speed_reference_rad_s - result.run["speed_motor_rad_s"]
        ends.append(float(np.abs(lag[-1000:]).mean()))
    assert ends[1] < 1e-3 < ends[0]


def test_scheduled_gains_are_those_of_the_payload():
    rows = [{"payload_kg": 0.0, "kp_nm_s_per_rad": 30.0, "ki_nm_per_rad": 100.0}]
    rows += [{"payload_kg": 8000.0, "kp_nm_s_per_rad": 50.0, "ki_nm_per_rad": 200.0}]
    scheduled = settings_with(gain_schedule=rows)
    plain = PiSettings(kp_nm_s_per_rad=40.0, ki_nm_per_rad=150.0)
    reference = 20.0 * np.clip(np.arange(3000) / 1000.0, 0.0, 1.0)
    runs = simulate_loop([LoopCase("a", BARE, 4000.0, HEIGHT, s, reference) for s in (scheduled, plain)])
    assert runs[0].metrics == runs[1].metrics
    point = OperatingPoint(4000.0, HEIGHT)
    assert margins(linear_loop(BARE, scheduled, point)) == margins(linear_loop(BARE, plain, point))
    assert scheduled.at(9000.0).kp == 50.0  # beyond the last row nothing is extrapolated
    with pytest.raises(InputError, match="payload"):
        scheduled.at(None)


def test_tuning_chooses_no_notch_shaper_or_schedule_that_is_worse_than_none():
    points = [OperatingPoint(load, HEIGHT) for load in (0.0, 9000.0)]
    base = PiSettings.model_validate(GAINS)
    trial = usual_trial(RINGS, (0.0, 9000.0), base.sample_time_s)
    plain = tune(RINGS, base, points, trial, Goal())
    also = tune(RINGS, base, points, trial, Goal(), also=("notch", "shaper"))
    for term, better in (("notch", max), ("shaper", min)):
        results = {one.value: one.result for one in also.compared if one.term == term}
        chosen = getattr(also.winner.settings, "notch" if term == "notch" else "input_shaper")
        assert results[chosen] == better(results.values())
        assert len(results) > 3
    assert all(member.margins.ms <= 1.4 for member in also.members)
    assert also.winner.cost <= plain.winner.cost * 1.001
    scheduled = tune(RINGS, base, points, trial, Goal(), also=("schedule",))
    rows = scheduled.winner.settings.gain_schedule
    assert [row.payload_kg for row in rows] == [0.0, 9000.0]
    assert all(member.margins.ms <= 1.4 for member in scheduled.members)
    # One pair of gains for all is among the schedules, so a schedule never has less ki at any payload.
    assert min(row.ki_nm_per_rad for row in rows) >= 0.8 * plain.shaped.settings.ki


# State-space systems of plant and loop, and a controller written as a Python function around the sampled plant.


DOCS = Path(__file__).resolve().parents[2] / "docs" / "loop_design.md"


def test_the_systems_are_those_of_the_loop_whose_margins_are_shown():
    control = pytest.importorskip("control")
    analysis = wb.loop(payloads_kg=[9000.0], heights_m=[10.0])
    gain, phase, *_ = control.stability_margins(control.frd(analysis.open, np.geomspace(0.1, 3100.0, 20000)))
    shown = analysis.weakest.margins
    assert gain == pytest.approx(shown.gain_up, rel=1e-4) and phase == pytest.approx(shown.phase_deg, abs=1e-2)
    assert np.abs(analysis.closed.poles()).max() < 1.0
    assert analysis.closed.input_labels == ["speed_reference", "load_torque", "speed_noise"]


def test_closing_the_plant_by_hand_gives_the_closed_loop():
    control = pytest.importorskip("control")
    analysis = wb.loop(payloads_kg=[9000.0], heights_m=[10.0])
    K = analysis.members[0].loop.controller
    feedback = control.ss(K.A, K.B[:, [1]], K.C, K.D[:, [1]], K.dt)
    seen = analysis.plant[[analysis.plant.noutputs - 1], [0]]
    by_hand = control.feedback(seen, feedback, sign=1)
    ours = np.sort_complex(analysis.closed.poles())
    np.testing.assert_allclose(np.sort_complex(by_hand.poles()), ours, atol=1e-6)


def test_the_controller_of_the_docs_follows_within_a_rad_per_second(capsys: pytest.CaptureFixture[str]):
    pytest.importorskip("control")
    (code,) = re.findall(r"```python\n(import control.*?)```", DOCS.read_text(encoding="utf-8"), re.S)
    names: dict[str, object] = {}
    exec(code, names)
    error = float(re.search(r"error ([\d.]+) rad/s", capsys.readouterr().out)[1])  # type: ignore[index]
    assert error < 1.0
    assert np.asarray(names["speed"])[3400] == pytest.approx(60.0, abs=0.05)
