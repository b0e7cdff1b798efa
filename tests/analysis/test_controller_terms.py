"""Terms beside the PI: the linear loop says of them what the compiled loop does, and they do what they are for."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import detrend

import workbench as wb
from tests.support.ideal import ideal_hoist
from workbench.analysis.linearise import OperatingPoint
from workbench.analysis.loop import linear_loop
from workbench.analysis.margins import margins
from workbench.analysis.tune import Goal, tune, usual_trial
from workbench.control import PiSettings
from workbench.core.errors import InputError
from workbench.machines import Hoist, with_values
from workbench.references import Limits, Step, motor_speed_rad_s, plan_motion
from workbench.simulate.loop import LoopCase, simulate_loop

DRIVE = {"drive.torque_lag_s": 0.004, "drive.speed_filter_s": 0.003, "drive.speed_delay_s": 0.0025}
MACHINE = with_values(ideal_hoist(), DRIVE)
RINGING = with_values(MACHINE, {"wire.damping_time_s": 0.002})
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
    loop = linear_loop(RINGING, settings, OperatingPoint(9000.0, HEIGHT))
    assert loop.stable
    linear = complex(loop.responses(np.array([frequency_hz])).R[0])
    assert abs(simulated_response(RINGING, settings, 9000.0, frequency_hz) / linear - 1.0) < 0.01


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
    assert swing_left(RINGING, damped) < 0.5 * swing_left(RINGING, plain)


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
    heavier = MACHINE.model_copy(update={"effects": {"carriage_mass_error": {"mass_kg": 900.0}}})
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
    runs = simulate_loop([LoopCase("a", MACHINE, 4000.0, HEIGHT, s, reference) for s in (scheduled, plain)])
    assert runs[0].metrics == runs[1].metrics
    point = OperatingPoint(4000.0, HEIGHT)
    assert margins(linear_loop(MACHINE, scheduled, point)) == margins(linear_loop(MACHINE, plain, point))
    assert scheduled.at(9000.0).kp == 50.0  # beyond the last row nothing is extrapolated
    with pytest.raises(InputError, match="payload"):
        scheduled.at(None)


def test_tuning_chooses_no_notch_shaper_or_schedule_that_is_worse_than_none():
    points = [OperatingPoint(load, HEIGHT) for load in (0.0, 9000.0)]
    base = PiSettings.model_validate(GAINS)
    trial = usual_trial(RINGING, (0.0, 9000.0), base.sample_time_s)
    plain = tune(RINGING, base, points, trial, Goal())
    also = tune(RINGING, base, points, trial, Goal(), also=("notch", "shaper"))
    for term, better in (("notch", max), ("shaper", min)):
        results = {one.value: one.result for one in also.compared if one.term == term}
        chosen = getattr(also.winner.settings, "notch" if term == "notch" else "input_shaper")
        assert results[chosen] == better(results.values())
        assert len(results) > 3
    assert all(member.margins.ms <= 1.4 for member in also.members)
    assert also.winner.cost <= plain.winner.cost * 1.001
    scheduled = tune(RINGING, base, points, trial, Goal(), also=("schedule",))
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
