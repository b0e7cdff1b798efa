"""The driven simulation undoes the closed loop, and a replay of a run's own torque gives its own speed."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.control import PiSettings
from workbench.core.run import Run
from workbench.effects import effects_for, parts, ranges_of, searchable
from workbench.machines import LinearAxis, default_hoist, with_values
from workbench.simulate.driven import InverseSimulation, changed
from workbench.simulate.loop import LoopCase, simulate_loop
from workbench.simulate.replay import replay_runs

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
    """Every effect at work alone: in the smallest part that has it, and with none left out."""
    active = searchable(MACHINE, runs)
    whole = InverseSimulation(MACHINE, runs, 1.7, active)
    by_parts = InverseSimulation(MACHINE, runs, 1.7, active, parts(MACHINE, runs))
    at_work: list[dict[str, float]] = [{}]
    for effect in effects_for("hoist").values():
        if not effect.on_sensor:
            at_work.append({r.symbol: r.start for r in ranges_of(effect, MACHINE, runs)})
    needed = set()
    for values in at_work:
        sets = [[changed(p, values) for p in whole.base]]
        tables = [np.array([[vars(p)[symbol]] for symbol in whole.symbols]) for p in sets[0]]
        needed.add(int(by_parts.parts_needed(tables)[0]))
        for (full, _), (part, _) in zip(whole.predict(sets)[0], by_parts.predict(sets)[0], strict=True):
            assert part == pytest.approx(full, abs=1e-9 * np.max(np.abs(full)))
    assert needed == {0, 1, 2}


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
    machine = LinearAxis.model_validate(
        {
            "mass_kg": 95.0,
            "friction": {"coulomb_forward_n": 20.0, "coulomb_backward_n": 25.0, "viscous_n_s_per_m": 200.0},
            "gravity": {"constant_n": 4.0},
        }
    )
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
