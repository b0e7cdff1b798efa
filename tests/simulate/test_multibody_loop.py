"""The multi-body machine beside the lumped plant: under one torque, and in the same closed loop."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.support.ideal import ideal_hoist
from workbench.control import PI, PiSettings, full_pi, loop_values
from workbench.control.settings import FeedForward
from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.engine.stepped import Step, observe
from workbench.machines import HOIST, with_values
from workbench.machines.multibody import motion
from workbench.metrics import observer
from workbench.metrics.registry import measure
from workbench.simulate.loop import LoopCase, LoopResult, Outcome, case_limits, simulate_loop
from workbench.simulate.models import compare_models
from workbench.simulate.multibody_loop import check_multibody, simulate_multibody_loop

MACHINE = ideal_hoist()
SETTINGS = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0, sample_time_s=0.004)
FULL = SETTINGS.model_copy(
    update={"anti_windup": "conditional", "feed_forward": FeedForward(inertia=0.8, friction=0.5)}
)
REFERENCE = np.interp(np.arange(1250) * 0.004, [0.2, 1.2, 2.0, 3.2, 4.4], [0.0, 60.0, 60.0, -60.0, 0.0])


def case(settings: PiSettings = SETTINGS, **drive: Any) -> LoopCase:
    machine = with_values(MACHINE, {f"drive.{name}": value for name, value in drive.items()})
    return LoopCase("run", machine, 4500.0, 9.0, settings, REFERENCE)


@pytest.fixture(scope="module")
def pair() -> tuple[LoopResult, LoopResult]:
    (lumped,) = simulate_loop([case()], record_every=1)
    return lumped, simulate_multibody_loop(case(), record_every=1, step_s=0.004)


def test_in_one_closed_loop_both_models_tell_the_same_story(pair):
    lumped, multibody = pair
    assert multibody.outcome is Outcome.COMPLETED
    off = multibody.run["speed_motor_rad_s"] - lumped.run["speed_motor_rad_s"]
    assert np.sqrt(np.mean(off**2)) < 1e-3 * MACHINE.motor.nominal_speed_rad_s
    for name in ("peak_torque_motor_nm", "rms_torque_motor_nm", "energy_motoring_j", "max_wire_tension_n"):
        assert multibody.metrics[name] == pytest.approx(lumped.metrics[name], rel=2e-3)
    assert multibody.metrics.keys() == lumped.metrics.keys()


def test_the_run_has_the_signals_of_the_lumped_one_and_more(pair):
    lumped, multibody = pair
    assert set(lumped.run.signals) <= set(multibody.run.signals)
    assert sum(name.startswith("force_roller") for name in multibody.run.signals) == 4


def test_under_one_torque_the_motor_speeds_agree_within_half_a_per_cent(pair):
    """Where the lumped assumptions hold: measured 0.02 % of nominal, rms."""
    run = pair[0].run
    compared = compare_models(MACHINE, [run])
    assert compared.runs[0].apart_percent < 0.05
    # Both replays take the held torque as linear between samples, and are off the record by that alike.
    assert abs(compared.runs[0].multibody_rmse_percent - compared.runs[0].lumped_rmse_percent) < 0.05
    assert compared.runs[0].multibody_cpu_s > 0.0 and compared.ratio > 1.0


@pytest.mark.parametrize("settings", [SETTINGS, FULL], ids=["plain", "full"])
def test_the_compiled_step_is_the_controllers_own(settings: PiSettings):
    """Sample by sample the same as the function that both come from, called with plain numbers."""
    controller = PI if settings.plain else full_pi()
    values = {
        **vars(HOIST.plant.values(MACHINE, 0.0)), **loop_values(settings, MACHINE.drive, 300.0),
        **case_limits(case(settings)),
    }  # fmt: skip
    p = SimpleNamespace(**values)
    step = Step(controller, p, controller.start(p, 300.0, 0.0), 0.004)
    memory = controller.start(p, 300.0, 0.0)
    for k in range(300):
        r, t, w = 80.0 * math.sin(0.02 * k), 0.004 * k, 75.0 * math.sin(0.02 * k - 0.1)
        reference = SimpleNamespace(speed_reference_rad_s=r)
        measured = SimpleNamespace(t=t, speed_motor_rad_s=w, angle_motor_rad=0.3 * k)
        wanted, memory = controller.step(p, memory, reference, measured, 0.004)
        assert step(r, t, w, 0.3 * k) == pytest.approx(float(wanted), rel=1e-9, abs=1e-9)


def test_the_compiled_metrics_are_those_of_a_log(pair):
    run, one = pair[1].run, case()
    p = SimpleNamespace(
        **vars(HOIST.plant.values(one.machine, 4500.0)),
        **loop_values(SETTINGS, one.machine.drive, 597.0),
        **case_limits(one),
    )
    seen = {name: run[name] for name in run.signals}
    sums = observe(observer(), p, {**seen, "time_s": run.time_s}, 0.004)
    metrics = observer().finish(sums, p, 0.004 * len(run.time_s))
    short = Run("short", run.time_s[:400], {name: values[:400] for name, values in seen.items()}, 4500.0, 9.0)
    some = observe(observer(), p, {**dict(short.signals), "time_s": short.time_s}, 0.004)
    by_log = measure(short, p)
    for name, value in observer().finish(some, p, 0.004 * 400).items():
        assert value == pytest.approx(by_log[name], rel=1e-6, abs=1e-9), name
    assert metrics["energy_motoring_j"] > 0.0


def test_a_lagging_drive_with_a_counted_late_speed_is_the_same_drive_here():
    drive: dict[str, Any] = {
        "torque_lag_s": 0.012,
        "speed_delay_s": 0.004,
        "speed_filter_s": 0.003,
        "encoder_counts_per_turn": 8192,
    }
    (lumped,) = simulate_loop([case(**drive)])
    multibody = simulate_multibody_loop(case(**drive), step_s=0.004)
    for name in ("peak_torque_motor_nm", "speed_error_rms_rad_s"):
        assert multibody.metrics[name] == pytest.approx(lumped.metrics[name], rel=0.02)


def test_a_machine_that_cannot_hang_is_an_outcome_with_its_place_and_not_an_unstable_loop():
    soft = replace(case(), machine=with_values(MACHINE, {"arm.cylinder_stiffness_n_per_m": 1.0}))
    result = simulate_multibody_loop(soft)
    assert result.outcome is Outcome.NOT_SOLVED
    assert "does not hang still" in result.at and "at height 9.000 m with 4500 kg" in result.at


def test_an_engine_that_gives_up_says_when_and_in_what_state(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(motion, "TOLERANCE", 1e-300)  # which no iteration reaches once anything moves
    result = simulate_multibody_loop(case(), step_s=0.004)
    assert result.outcome is Outcome.NOT_SOLVED
    assert "did not converge, at 0." in result.at
    assert "height 9.000 m" in result.at and "torque 597" in result.at


def test_an_effect_that_it_does_not_know_is_said_before_anything_runs():
    with pytest.raises(InputError, match="has no effect 'backlash'"):
        check_multibody(MACHINE.model_copy(update={"effects": {"backlash": {"play_rad": 0.01}}}))
