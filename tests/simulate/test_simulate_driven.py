"""The driven simulation undoes the closed loop; a replay of a run's own torque gives its speed; the command."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.commands import Commands
from tests.support.effect_machines import linear_axis, rotary_axis
from tests.support.log_campaign import AXIS, csv_text
from tests.support.noisy_runs import axis_runs, with_effects
from tests.support.simulated_campaign import TORQUE_NOISE_NM, simulated_campaign, true_machine
from workbench.control import PiSettings
from workbench.core.run import Array, Run
from workbench.effects import effects_for, parts, ranges_of, searchable, sizes_of
from workbench.engine import kernels
from workbench.logs import read_campaign
from workbench.machines import LINEAR, LinearAxis, default_hoist, save_machine, with_values
from workbench.simulate import driven
from workbench.simulate.driven import InverseSimulation, changed
from workbench.simulate.loop import LoopCase, simulate_loop
from workbench.simulate.lowpass import LowpassAt, lowpass, noise_rms
from workbench.simulate.motion import bridged, moving, repeated_impacts
from workbench.simulate.replay import replay_runs, simulate_replays

MACHINE = default_hoist()
SETTINGS = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)


def reference(top: float, end_s: float) -> np.ndarray:
    """Rest, up, rest, down, rest."""
    knots = np.array([0.0, 0.1, 0.3, 0.4, 0.5, 0.6, 0.8, 0.9, 1.0]) * end_s
    return np.interp(np.arange(round(end_s / 0.001)) * 0.001, knots, [0.0, 0.0, top, top, 0.0, 0.0, -top, -top, 0.0])


def logged(result_run: Run, **signals: np.ndarray) -> Run:
    """What a log would hold: torque and speed, not the rest."""
    kept = {name: result_run[name] for name in ("torque_motor_nm", "speed_motor_rad_s")}
    return Run(
        result_run.name, result_run.time_s, {**kept, **signals}, result_run.payload_kg, result_run.start_position_m
    )


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    """Two runs of unequal length and payload, at 100 Hz: torque between samples of the log is not held but moves."""
    cases = [
        LoopCase("fast", MACHINE, 9000.0, 6.0, SETTINGS, reference(100.0, 20.0)),
        LoopCase("slow", MACHINE, 0.0, 9.0, SETTINGS, reference(30.0, 14.0)),
    ]
    return [logged(result.run) for result in simulate_loop(cases, record_every=10)]


def test_the_driven_simulation_gives_back_the_torque_of_the_closed_loop(runs):
    for balance in InverseSimulation(MACHINE, runs).balances():
        residual = balance.residual[balance.inside]
        assert np.sqrt(np.mean(residual**2)) < 0.2  # N m of 600: what a log at 100 Hz does not show
        assert np.max(np.abs(balance.residual[balance.moving])) < 1.0


def test_every_part_of_the_effects_predicts_what_the_whole_does(runs):
    """Every effect at work alone: in the smallest part that has it, and with none left out. Each run alone, for runs
    that are simulated together take the same steps, and rounding may halve one of them."""
    active = searchable(MACHINE, runs)
    at_work: list[dict[str, float]] = [{}]
    for effect in effects_for("hoist").values():
        if not effect.on_sensor:
            at_work.append({r.symbol: r.start for r in ranges_of(effect, MACHINE, runs)})
    needed = set()
    for run in runs:
        whole = InverseSimulation(MACHINE, [run], 1.7, active)
        by_parts = InverseSimulation(MACHINE, [run], 1.7, active, parts(MACHINE, runs))
        for values in at_work:
            sets = [[changed(p, values) for p in whole.base]]
            table = np.array([[vars(sets[0][0])[symbol]] for symbol in whole.symbols])
            needed.add(int(by_parts.parts_needed([table])[0]))
            (full, _), (part, _) = whole.predict(sets)[0][0], by_parts.predict(sets)[0][0]
            assert part == pytest.approx(full, abs=1e-9 * np.max(np.abs(full)))
    assert needed == {0, 1, 2, 3}


def test_a_play_is_simulated_without_the_laws_of_friction_that_are_not_at_work():
    machine = linear_axis()
    (_, _, third, *_), whole = parts(machine), searchable(machine).effects
    play = {symbol for symbol in whole.parameters if symbol.startswith("backlash")}
    assert play and play <= {*third.effects.parameters}
    assert len(third.effects.parameters) < len(whole.parameters)


def test_a_play_logged_at_50_hz_is_followed_through_the_milliseconds_in_which_its_parts_meet(monkeypatch):
    """Steps of 0.3 ms left more of the torque than its sensors' noise does."""
    true, machine = (
        with_effects(rotary_axis(), {"backlash": {"play_rad": play, "load_share": share}})
        for play, share in ((0.06, 0.5), (0.0602, 0.501))
    )

    def residuals() -> Array:
        bench = InverseSimulation(machine, axis_runs(true))
        return np.concatenate([balance.residual[balance.moving] for balance in bench.balances()])

    found = residuals()
    monkeypatch.setattr(driven, "STEP_OF_PLAY_S", 2.5e-6)
    monkeypatch.setattr(driven, "TOLERANCE", 1e-7)
    exact = residuals()
    assert np.sqrt(np.mean((found - exact) ** 2)) < 0.3 * np.sqrt(np.mean(exact**2))


def test_sets_of_which_each_needs_another_part_are_simulated_with_all_of_it(runs):
    bench = InverseSimulation(MACHINE, runs[:1], 1.7, searchable(MACHINE, runs), parts(MACHINE, runs))
    sets = []
    for name in ("friction_step", "brake_drag"):
        ranges = ranges_of(effects_for("hoist")[name], MACHINE, runs)
        sets.append([changed(p, {r.symbol: r.start for r in ranges}) for p in bench.base])
    for (apart,), (together,) in zip([bench.predict([one])[0] for one in sets], bench.predict(sets), strict=True):
        assert together[0] == pytest.approx(apart[0], abs=1e-4 * np.max(np.abs(apart[0])))


def test_a_machine_with_effects_has_one_kernel_of_each_form_however_many_runs_it_is_replayed_on(runs, monkeypatch):
    widths = set[tuple[str, int]]()

    def counted(form):
        made = getattr(kernels, form)

        def kernel(plant, effects, lanes):
            widths.add((form, lanes))
            return made(plant, effects, lanes)

        return kernel

    for form in ("replay_kernel", "driven_kernel"):
        monkeypatch.setattr(kernels, form, counted(form))
    machine = MACHINE.model_copy(update={"effects": {"friction_viscous": {"viscous_n_s_per_m": 500.0}}})
    together, alone = (replay_runs(machine, some) for some in (runs, runs[:1]))
    assert len(widths) == 2
    assert alone.runs[0].residual_rms == pytest.approx(together.runs[0].residual_rms, rel=1e-4)


def test_runs_that_are_simulated_together_are_what_each_one_is_alone(runs):
    together = InverseSimulation(MACHINE, runs, 1.7).balances()
    for run, balance in zip(runs, together, strict=True):
        (alone,) = InverseSimulation(MACHINE, [run], 1.7).balances()
        assert balance.predicted == pytest.approx(alone.predicted, abs=1e-4 * np.max(np.abs(alone.predicted)))
        assert balance.states == pytest.approx(alone.states, abs=1e-4 * np.max(np.abs(alone.states)))


def test_few_sets_of_thinned_runs_share_a_kernel_and_come_out_as_many_do_run_by_run(runs, monkeypatch):
    bench = InverseSimulation(MACHINE, runs, 1.7, searchable(MACHINE, runs), parts(MACHINE, runs), thin=0.07)
    made, calls = kernels.driven, []

    def counted(*given, **more):
        calls.append(more)
        return made(*given, **more)

    monkeypatch.setattr(kernels, "driven", counted)
    few, many = (
        bench.required([np.repeat(row[:, None], sets, 1) for row in bench.table], thin=True) for sets in (2, 9)
    )
    assert min(bench.every) > 1 and len(calls) == 1 + len(runs)
    for one, other in zip(few, many, strict=True):
        assert one == pytest.approx(other[..., :2], abs=1e-3 * np.max(np.abs(other[:, 0])))


def test_what_a_small_change_adds_is_in_proportion_to_it_where_friction_near_standstill_is_steep(runs):
    """Thinned, too: with too few steps between its samples the speed at rest went astray, each set's by its own way,
    and what a millionth of a value added was ten times that value's slope."""
    bench = InverseSimulation(MACHINE, runs, 1.7, searchable(MACHINE, runs), parts(MACHINE, runs), thin=0.07)
    bench.table[:, bench.row_of["slope"]] *= 300.0
    slopes = []
    for change in (1e-6, 1e-4):
        tables = [np.repeat(row[:, None], 2, 1) for row in bench.table]
        for table in tables:
            table[bench.row_of["m_c"], 1] *= 1.0 + change
        slopes.append([np.max(np.abs(out[:, 0, 1] - out[:, 0, 0])) / change for out in bench.required(tables, True)])
    assert slopes[0] == pytest.approx(slopes[1], rel=1e-3)


def test_a_force_that_the_model_lacks_shows_in_the_residual_with_its_size(runs):
    bench = InverseSimulation(MACHINE, runs)
    weaker = [changed(p, {"F_up": p.F_up - 1000.0}) for p in bench.base]
    for balance in bench.balances(weaker):
        up = balance.moving & (balance.motion.speed > 0.5 * np.max(balance.motion.speed))
        down = balance.moving & (balance.motion.speed < 0.5 * np.min(balance.motion.speed))
        assert np.median(balance.residual[up]) == pytest.approx(1000.0 * MACHINE.lift_m_per_rad, rel=0.05)
        assert abs(np.median(balance.residual[down])) < 0.2


def sensed(runs: list[Run], gain: float, offset: float) -> list[Run]:
    return [logged(run, torque_motor_nm=gain * run["torque_motor_nm"] + offset) for run in runs]


def test_gain_and_offset_of_the_torque_sensor_are_taken_out(runs):
    machine = with_values(MACHINE, {"sensors.torque_gain": 1.02, "sensors.torque_offset_nm": 12.0})
    bench = InverseSimulation(machine, sensed(runs, 1.02, 12.0))
    assert all(np.sqrt(np.mean(b.residual[b.inside] ** 2)) < 0.2 for b in bench.balances())
    result = replay_runs(machine, sensed(runs, 1.02, 12.0))
    assert result.speed_rmse_percent == pytest.approx(replay_runs(MACHINE, runs).speed_rmse_percent, rel=1e-3)


def test_a_replay_of_a_run_s_own_torque_gives_its_own_speed(runs):
    """At 1 kHz; held torque read as linear between samples is late by half a sample."""
    result = simulate_loop([LoopCase("own", MACHINE, 4500.0, 6.0, SETTINGS, reference(100.0, 12.0))], record_every=1)
    replay = replay_runs(MACHINE, [logged(result[0].run)])
    assert replay.speed_rmse_percent < 0.1
    assert replay.speed_rmse_percent_restarted_2s < 0.05
    assert replay.residual_rms < 0.2


def test_drift_fools_the_open_loop_and_not_the_restarted_replay(runs):
    biased = replay_runs(MACHINE, sensed(runs, 1.0, 10.0))
    assert biased.speed_rmse_percent > 3.0 * biased.speed_rmse_percent_restarted_2s
    assert biased.residual_rms == pytest.approx(10.0, rel=0.02)


def axis_run(noise: float = 0.0) -> tuple[LinearAxis, Run]:
    """An axis that swings as a sine, and the force that takes, by hand."""
    machine = linear_axis(backward=25.0, constant=4.0)
    t = np.arange(8000, dtype=np.float64) * 0.001
    w = 2.0 * np.pi * 0.5
    x, v, a = 0.1 * np.sin(w * t), 0.1 * w * np.cos(w * t), -0.1 * w**2 * np.sin(w * t)
    force = 95.0 * a + 200.0 * v + np.where(v > 0.0, 20.0, -25.0) + 4.0
    force = force + noise * np.random.default_rng(1).normal(size=len(t))
    return machine, Run("swing", t, {"force_n": force, "position_m": x})


def test_the_balance_of_an_axis_is_its_equation_with_the_speed_derived_from_position():
    machine, run = axis_run()
    (balance,) = InverseSimulation(machine, [run]).balances()
    away = balance.inside & (np.abs(balance.motion.speed) > 0.05)  # from the reversal, where friction jumps
    assert np.max(np.abs(balance.residual[away])) < 0.3  # N of 80
    assert balance.states.shape == (8000, 0)


def test_a_log_whose_times_come_in_bunches_shows_the_balance_as_an_even_one_does():
    """As logs over a bus are: every other sample a twentieth of a step after the one before."""
    even, w, left = np.arange(0.0, 40.0, 0.03), 2.0 * np.pi * 0.3, []
    for time in (even, even - np.where(np.arange(len(even)) % 2, 0.95 * 0.03, 0.0)):
        v = 0.3 * np.sin(w * time)
        force = 95.0 * 0.3 * w * np.cos(w * time) + 200.0 * v + np.where(v > 0.0, 20.0, -25.0) + 4.0
        noisy = v + np.random.default_rng(4).normal(0.0, 0.01, len(time))
        run = Run("swing", time, {"force_n": force, "velocity_m_s": noisy})
        (balance,) = InverseSimulation(linear_axis(backward=25.0, constant=4.0), [run], 1.5).balances()
        left.append(float(np.std(balance.residual[balance.inside & (np.abs(v) > 0.2)])))
    assert left[1] < 2.0 * left[0]


# The zero-phase low-pass, its ends, the moving samples, and the noise of a channel.


TIME = np.arange(0.0, 40.0, 0.01)


def gain_at(frequency_hz: float, band_hz: float, time: np.ndarray = TIME) -> complex:
    """What the filter makes of a tone, as amplitude and phase."""
    wave = np.sin(2.0 * math.pi * frequency_hz * time)
    smooth = lowpass(time, wave, band_hz)
    keep = (time > 5.0) & (time < 35.0)
    basis = np.exp(2j * math.pi * frequency_hz * time[keep])
    model = np.column_stack([basis.imag, basis.real])
    (in_phase, quadrature), *_ = np.linalg.lstsq(model, smooth[keep], rcond=None)
    return complex(in_phase, quadrature)


@pytest.mark.parametrize("band", [0.5, 1.7, 8.0])
def test_the_gain_at_the_band_is_minus_3_db(band):
    assert abs(gain_at(band, band)) == pytest.approx(1.0 / math.sqrt(2.0), rel=1e-3)


@pytest.mark.parametrize("ratio", [0.2, 0.5, 1.5, 2.0, 4.0])
def test_the_gain_is_that_of_a_fourth_order_butterworth_run_both_ways(ratio):
    f0 = 1.7 / (math.sqrt(2.0) - 1.0) ** 0.125
    assert abs(gain_at(1.7 * ratio, 1.7)) == pytest.approx(1.0 / (1.0 + (1.7 * ratio / f0) ** 8), abs=1e-4)


@pytest.mark.parametrize("frequency", [0.3, 1.0, 1.7, 2.5])
def test_no_phase_is_turned(frequency):
    response = gain_at(frequency, 1.7)
    assert abs(response.imag) < 1e-4 * abs(response) + 1e-6


@pytest.mark.parametrize("band", [0.1, 1.7, 20.0])
@pytest.mark.parametrize(("level", "slope"), [(50.0, 0.0), (-3.0, 20.0)])
def test_a_constant_and_a_line_pass_unchanged_to_their_very_ends(level, slope, band):
    line = level + slope * TIME
    assert lowpass(TIME, line, band) == pytest.approx(line, abs=1e-9 * (1.0 + abs(level) + 40.0 * abs(slope)))


@pytest.mark.parametrize(("band", "summed"), [(0.1, False), (1.7, True), (8.0, True), (12.0, True), (60.0, False)])
def test_the_low_pass_at_some_samples_is_the_low_pass_there(band, summed):
    """Next to the ends, evenly apart and across a gap; by sums where they are quicker than a transform."""
    rows = np.concatenate([[0, 1, 5], np.arange(40, 1500, 12), np.arange(1777, 3990, 12), [3998, 3999]])
    series = np.array([5.0, -40.0, 0.0]) + np.cumsum(np.random.default_rng(3).normal(size=(len(TIME), 3)), axis=0)
    at = LowpassAt(TIME, band, rows)
    assert at.summed == summed
    assert at(series) == pytest.approx(lowpass(TIME, series, band)[rows], abs=1e-7 * np.max(np.abs(series)))


@pytest.mark.parametrize("band", [1.7, 60.0])
def test_between_two_samples_the_low_pass_is_straight(band):
    rows = np.array([0.25, 3.5, *(np.arange(80, 7400, 9) / 2.0), 3990.75, 3998.5])
    series = np.cumsum(np.random.default_rng(3).normal(size=(len(TIME), 3)), axis=0)
    smooth = lowpass(TIME, series, band)
    between = np.stack([np.interp(rows, np.arange(len(TIME)), column) for column in smooth.T], axis=1)
    assert LowpassAt(TIME, band, rows)(series) == pytest.approx(between, abs=1e-7 * np.max(np.abs(series)))


def test_machines_replayed_side_by_side_move_as_each_does_alone():
    runs = axis_runs(LINEAR.example())[:2]
    light, heavy = (with_values(LINEAR.example(), {"mass_kg": mass}) for mass in (90.0, 110.0))
    benches = [InverseSimulation(light, runs[:1]), InverseSimulation(heavy, runs[1:])]
    alone = [states for bench in benches for states in simulate_replays(bench)]
    for one, other in zip(alone, simulate_replays(*benches), strict=True):
        assert one == pytest.approx(other, rel=1e-4, abs=1e-4 * float(np.max(np.abs(one))))


def test_irregular_samples_are_filtered_at_their_own_times():
    rng = np.random.default_rng(2)
    time = np.sort(rng.uniform(0.0, 40.0, 8000))
    slow = np.sin(2.0 * math.pi * 0.3 * time)
    fast = np.sin(2.0 * math.pi * 9.0 * time)
    smooth = lowpass(time, slow + fast, 1.7)
    keep = (time > 5.0) & (time < 35.0)
    assert np.sqrt(np.mean((smooth - slow)[keep] ** 2)) < 0.02


def speed_profile(*spans: tuple[float, float]) -> np.ndarray:
    """10 of some speed, and rest in the given spans."""
    speed = np.full(len(TIME), 10.0)
    for begin, end in spans:
        speed[(begin <= TIME) & (end > TIME)] = 0.0
    return speed


def test_a_rest_is_left_out_with_half_a_period_around():
    keep = moving(TIME, speed_profile((10.0, 20.0)), 100.0, 2.0)
    left_out = TIME[~keep]
    assert 9.7 < left_out[0] < 10.15
    assert 19.85 < left_out[-1] < 20.3
    assert np.array_equal(left_out, TIME[(left_out[0] <= TIME) & (left_out[-1] >= TIME)])


def test_a_quick_reversal_is_no_rest():
    speed = 10.0 * np.sign(20.0 - TIME)
    assert np.all(moving(TIME, speed, 100.0, 2.0))


def test_reversals_that_follow_one_another_within_a_period_of_the_band_are_no_rest():
    """A motor that turned to and fro twice a second was refused, where its band ended at 2.5 Hz: "hardly moves"."""
    assert np.all(moving(TIME, 10.0 * np.sin(2.0 * np.pi * 2.1 * TIME), 10.0, 2.5))


def test_a_command_without_noise_hides_what_its_smallest_step_does():
    """A robot's voltage in steps had a noise of 1e-12 V, and left 82,000,000,000 times as much."""
    t = 0.005 * np.arange(2000, dtype=np.float64)
    ramp, steps = np.floor(t / 0.1) * 0.001, np.where(t > 3.0, 5.0, 0.0)
    half = 0.5 * (0.5 / 0.005)  # of the band that the log holds
    assert noise_rms(t, 1.0 + ramp, half) == pytest.approx(0.001 / math.sqrt(12.0) * math.sqrt(0.5))
    assert noise_rms(t, steps, half) == pytest.approx(1e-3 * np.sqrt(np.mean(steps**2) / 24.0))
    assert noise_rms(t, np.full(2000, 5.0), half) == 0.0
    noise = np.random.default_rng(3).normal(size=2000)
    assert noise_rms(t, steps + noise, 2.0 * half) == pytest.approx(1.0, rel=0.1)


def test_noise_at_rest_is_no_motion():
    noise = np.random.default_rng(5).normal(0.0, 0.5, len(TIME))
    keep = moving(TIME, speed_profile((10.0, 20.0)) + noise, 100.0, 2.0)
    assert not np.any(keep[(TIME > 10.5) & (TIME < 19.5)])
    assert np.all(keep[(TIME < 9.0) | (TIME > 21.0)])


# Impacts of a play in a log: found where momentum is lost without the input, and only where they come again.


MASS, TIMES = 20.0, (0.73, 1.61, 2.48, 3.37)
NAMES = ("position_m", "velocity_m_s", "force_n")


def moved(impacts: tuple[float, ...] = (), loss: float = 0.3, seed: int = 1, ramp_s: float = 0.2) -> Run:
    """A carriage goes to and fro in ramps; at each impact it loses that share of 1 m/s and gets it back in 30 ms."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 4.0, 0.001)
    corners = np.arange(0.0, 4.5, 0.5)
    ends = [0.0, *(1.0 if k % 2 else -1.0 for k in range(1, len(corners)))]
    v = np.interp(t, np.sort([*corners[:-1], *(corners[1:] - 0.5 + ramp_s)]), [*np.repeat(ends[:-1], 2)[1:], ends[-1]])
    force = MASS * np.gradient(v, t) + 5.0 * np.sign(v)
    for at in impacts:
        lost = np.where((t >= at) & (t < at + 0.03), loss * (1.0 - (t - at) / 0.03), 0.0)
        force = force + np.where((t >= at) & (t < at + 0.03), MASS * loss / 0.03, 0.0)  # the drive brings it back
        v = v - lost
    signals = {"velocity_m_s": v + rng.normal(0.0, 1e-3, len(t)), "force_n": force + rng.normal(0.0, 0.5, len(t))}
    return Run("there and back", t, signals)


def found(*runs: Run) -> tuple[Array, ...]:
    return repeated_impacts(runs, MASS, *NAMES)


def test_impacts_that_come_again_are_found_at_their_times():
    first, second = found(moved(TIMES), moved(TIMES[1:], seed=2))
    assert first == pytest.approx(TIMES, abs=0.006)
    assert second == pytest.approx(TIMES[1:], abs=0.006)


@pytest.mark.parametrize("ramp_s", [0.02, 0.1, 0.4])
def test_what_the_input_moves_is_no_impact_however_steep(ramp_s: float):
    assert all(len(impacts) == 0 for impacts in found(moved(ramp_s=ramp_s), moved(ramp_s=ramp_s, seed=2)))


def test_impacts_of_one_run_alone_are_an_event_and_none_of_a_play():
    assert all(len(impacts) == 0 for impacts in found(moved(TIMES), moved(seed=2)))


def test_a_kick_at_a_logs_begin_is_no_impact():
    """Each of ten logs of a robot's wrist begins with 30 N m that move nothing: a play, at 0.50."""

    def kicked(begin: int, seed: int) -> Run:
        run = moved(seed=seed)
        force = run["force_n"].copy()
        force[begin : begin + 10] += 1200.0
        return Run(f"run {seed}", run.time_s, {**run.signals, "force_n": force})

    assert all(len(impacts) == 0 for impacts in found(*(kicked(10, seed) for seed in range(5))))
    assert all(len(impacts) == 1 for impacts in found(*(kicked(700, seed) for seed in range(5))))


def test_a_loss_of_a_hundredth_of_the_speed_is_no_plain_impact():
    assert all(len(impacts) == 0 for impacts in found(moved(TIMES, 0.01), moved(TIMES, 0.01, seed=2)))


def test_the_acceleration_runs_straight_across_an_impact_and_is_kept_beside_it():
    t = np.arange(0.0, 1.0, 0.001)
    a = 2.0 * t + np.where(np.abs(t - 0.5) < 0.005, 100.0, 0.0)
    assert bridged(t, a, np.array([0.5])) == pytest.approx(2.0 * t, abs=1e-12)
    assert bridged(t, a, np.zeros(0)) is a


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_the_replay_of_an_axis_that_stands_throughout_is_judged_by_the_speed_of_its_size():
    axis = LINEAR.example()
    t: Array = np.asarray(0.002 * np.arange(500), dtype=float)
    still = {"velocity_m_s": np.zeros_like(t), "position_m": np.full_like(t, 0.3)}
    bench = InverseSimulation(axis, [Run("still", t, {"force_n": np.full_like(t, 3.0), **still}, 0.0, 0.3, 0.0)], 90.0)
    assert bench.scale == sizes_of(axis).speed
    (states,) = simulate_replays(bench)
    assert np.isfinite(states[0]).all()


# `workbench replay`: figures that are right, files as the format says, bad input in one line.


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated_campaign(tmp_path_factory.mktemp("replay") / "lifts")


def read_json(path: Path) -> Any:
    def refuse(word: str) -> float:
        raise AssertionError(f"{word} is no JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


def test_the_true_machine_leaves_only_noise(commands: Commands, campaign: Path, tmp_path: Path):
    save_machine(true_machine(), tmp_path / "true.yaml")
    done = commands("replay", campaign, "--machine", tmp_path / "true.yaml", "--out", tmp_path / "out")
    assert done.status == 0, done.err
    overall = read_json(tmp_path / "out" / "replay.json")["overall"]
    # The sum of two channels' white noise, of which the band keeps band / Nyquist of the power.
    noise = TORQUE_NOISE_NM * np.sqrt(2.0 * overall["band_hz"] / 50.0)
    assert overall["noise_rms_nm"] == pytest.approx(noise, rel=0.1)
    assert overall["torque_residual_rms_moving_nm"] < 1.2 * noise
    assert overall["speed_rmse_percent"] < 0.5
    assert "the model explains these runs" in " ".join(done.out.split())


def test_a_lack_of_friction_shows_as_the_torque_it_takes(commands: Commands, campaign: Path, tmp_path: Path):
    assert commands("replay", campaign, "--out", tmp_path / "out").status == 0
    overall = read_json(tmp_path / "out" / "replay.json")["overall"]
    # 1200 N and 900 N missing, on the lever of 0.6 m drum, two falls, ratio 31.
    lever = 0.6 / 4.0 / 31.0
    assert 900.0 * lever < overall["torque_residual_rms_moving_nm"] < 1200.0 * lever
    assert 1.0 < overall["speed_rmse_percent"] < 20.0
    assert overall["speed_rmse_percent_restarted_2s"] < overall["speed_rmse_percent"]


def axis_campaign(folder: Path, *, speed_logged: bool) -> Path:
    """A linear axis of exactly AXIS' values, moved by a sine, with the force that it takes."""
    time = np.arange(4000) * 0.001
    w = 2 * np.pi * 0.5
    position, speed = 0.1 * np.sin(w * time), 0.1 * w * np.cos(w * time)
    force = -95.1089 * 0.1 * w**2 * np.sin(w * time) + 203.5 * speed + 20.39 * np.clip(speed / 1e-4, -1.0, 1.0)
    columns = {"time_s": time, "force_n": force, "position_m": position}
    if speed_logged:
        columns["velocity_m_s"] = speed
    (folder / "runs").mkdir(parents=True)
    (folder / "runs" / "sine.csv").write_text(csv_text(columns))
    (folder / "machine.yaml").write_text(AXIS)
    (folder / "runs.yaml").write_text("runs:\n- {name: sine, file: runs/sine.csv}\n")
    return folder


@pytest.mark.parametrize("speed_logged", [True, False])
def test_a_linear_axis_says_force_and_newton(commands: Commands, tmp_path: Path, speed_logged: bool):
    folder = axis_campaign(tmp_path / "axis", speed_logged=speed_logged)
    done = commands("replay", folder, "--out", tmp_path / "out")
    assert done.status == 0, done.err
    overall = read_json(tmp_path / "out" / "replay.json")["overall"]
    assert {"force_residual_rms_n", "force_residual_percent"} <= overall.keys()
    assert not any("torque" in key for key in overall)
    assert overall["force_residual_percent"] < 2.0  # the Coulomb force's edges, and nothing else
    assert "force" in done.out
    assert "torque" not in done.out


BAD: list[tuple[list[str], str]] = [
    (["NOWHERE"], "no such campaign"),
    (["MACHINE"], "is a machine; expected a campaign's folder"),
    (["CAMPAIGN", "--runs", "empty,fulll"], "no run 'fulll'; did you mean 'full'?"),
    (["CAMPAIGN", "--band", "0"], "--band: 0 Hz, expected at least 0.25 Hz"),
    (["CAMPAIGN", "--band", "50"], "less than 50 Hz (half the sampling rate)"),
    (["CAMPAIGN", "--band", "nan"], "--band: nan Hz"),
    (["CAMPAIGN", "--machine", "NOWHERE"], "no such file"),
    (["CAMPAIGN", "--machine", "AXIS"], "is another kind of machine than the campaign's"),
]


@pytest.mark.parametrize("name", ["replay", "identify"])
@pytest.mark.parametrize(("words", "problem"), BAD)
def test_bad_input_is_one_line_and_leaves_nothing(commands, campaign, tmp_path, name, words, problem):
    (tmp_path / "axis.yaml").write_text(AXIS)
    places = {
        "CAMPAIGN": campaign,
        "NOWHERE": tmp_path / "nowhere",
        "MACHINE": campaign / "machine.yaml",
        "LOG": campaign / "runs" / "full.csv",
        "AXIS": tmp_path / "axis.yaml",
    }
    done = commands(name, *[places.get(word, word) for word in words], "--out", tmp_path / "out")
    assert done.status == 2
    assert problem in done.err
    assert "Traceback" not in done.err
    assert done.out == ""
    assert len([line for line in done.err.splitlines() if line.lower().startswith("error")]) == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["axis.yaml"]


def test_an_identified_machine_is_compared_in_its_own_band(campaign: Path):
    read = read_campaign(campaign)
    machine = with_values(default_hoist(), {"wire.youngs_modulus_pa": 8e10})
    known = machine.model_copy(update={"identified": {"band_hz": 1.25}})
    assert replay_runs(known, read.runs).band_hz == 1.25
    assert replay_runs(machine, read.runs).band_hz != 1.25
