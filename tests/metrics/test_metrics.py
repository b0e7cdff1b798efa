"""Each metric against a trace made by hand; the compiled loop gives the very same numbers."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tests.support.ideal import ideal_hoist
from workbench.control import PiSettings
from workbench.core.run import Array, Run
from workbench.machines import KINDS, PLANTS, Drive, default_hoist, with_values
from workbench.metrics import LoopMetric, measure, metrics
from workbench.simulate import loop
from workbench.simulate.loop import LoopCase, simulate_loop

DT = 0.01
NEVER = 1e30
P = SimpleNamespace(
    n_m=2.0, T_nominal=480.0, T_hold=600.0, share=0.5, share_failed=1.0, t_fail=NEVER, before=1.0,
    x_low=0.0, x_high=25.0, w_nominal=157.1, W_break=0.0, D_w=0.6, ratio=31.0,
    **loop.overload_numbers(Drive(overload=1.6, overload_time_s=10.0, overload_period_s=300.0)),
)  # fmt: skip
CALM: dict[str, float] = {
    "torque_motor_nm": 600.0,
    "speed_motor_rad_s": 10.0,
    "speed_reference_rad_s": 10.0,
    "angle_motor_rad": 0.0,
    "position_carriage_m": 10.0,
    "speed_carriage_m_s": 0.05,
    "acceleration_carriage_m_s2": 0.0,
    "tension_drum_n": 6e4,
    "tension_dead_line_n": 6e4,
    "tension_min_n": 5.9e4,
}


def trace(n: int = 100, **signals: Array | list[float]) -> Run:
    """A run of n samples in calm motion, with some signals given."""
    calm = {name: np.full(n, value) for name, value in CALM.items()}
    return Run(
        "by hand",
        DT * np.arange(n, dtype=np.float64),
        {**calm, **{k: np.asarray(v, dtype=float) for k, v in signals.items()}},
    )


def metric(name: str, run: Run, **p: float) -> float:
    return measure(run, SimpleNamespace(**{**vars(P), **p}))[name]


def with_peak(value: float, at: int = 37, calm: float = 600.0) -> Array:
    signal = np.full(100, calm)
    signal[at] = value
    return signal


@pytest.mark.parametrize("peak", [1000.0, -1000.0])
def test_the_peak_torque_is_the_largest_of_one_motor_either_way(peak):
    assert metric("peak_torque_motor_nm", trace(torque_motor_nm=with_peak(peak))) == 500.0


def test_the_peak_torque_in_per_cent_is_of_one_motor_s_nominal_torque():
    assert metric("peak_torque_percent", trace(torque_motor_nm=with_peak(960.0))) == pytest.approx(100.0)


def test_the_harder_worked_motor_is_judged():
    run = trace(torque_motor_nm=with_peak(1000.0))
    assert metric("peak_torque_motor_nm", run, share=0.6) == pytest.approx(600.0)
    assert metric("rms_torque_motor_nm", trace(), share=0.6) == pytest.approx(360.0)


def test_after_a_failure_one_motor_gives_all():
    run = trace(torque_motor_nm=np.where(np.arange(100) < 60, 800.0, 700.0))
    assert metric("peak_torque_motor_nm", run, t_fail=0.599) == 700.0
    assert metric("peak_torque_motor_nm", run, t_fail=5.0) == 400.0


def test_the_peak_above_static_is_above_what_holds_the_load():
    assert metric("peak_torque_above_static_nm", trace(torque_motor_nm=with_peak(950.0))) == 350.0
    assert metric("peak_torque_above_static_nm", trace(torque_motor_nm=np.full(100, 400.0))) == -200.0


def test_the_rms_torque_of_a_sine_about_a_mean_is_its_closed_form():
    time = np.arange(1000) * DT
    run = trace(1000, torque_motor_nm=600.0 + 200.0 * np.sin(2.0 * math.pi * time))  # ten whole periods
    assert metric("rms_torque_motor_nm", run) == pytest.approx(0.5 * math.sqrt(600.0**2 + 200.0**2 / 2.0))


def test_speed_errors_are_those_of_reference_minus_speed():
    run = trace(speed_reference_rad_s=with_peak(7.0, calm=10.5))
    assert metric("speed_error_max_rad_s", run) == 3.0
    assert metric("speed_error_rms_rad_s", run) == pytest.approx(math.sqrt((99 * 0.25 + 9.0) / 100.0))


def test_the_wire_s_smallest_and_largest_tension_come_from_their_own_signals():
    run = trace(
        tension_min_n=with_peak(1e4, calm=5e4),
        tension_drum_n=with_peak(7e4, calm=6e4),
        tension_dead_line_n=with_peak(8e4, at=3, calm=6e4),
    )
    assert metric("min_wire_tension_n", run) == 1e4
    assert metric("max_wire_tension_n", run) == 8e4


def test_slack_is_timed_and_each_time_it_begins_counted():
    tension = np.full(100, 5e4)
    tension[10:15] = tension[50] = tension[99] = 0.0
    assert metric("slack_time_s", trace(tension_min_n=tension)) == pytest.approx(7 * DT)
    assert metric("slack_events", trace(tension_min_n=tension)) == 3.0


def test_a_run_that_begins_slack_counts_that_as_one():
    assert metric("slack_events", trace(tension_min_n=np.zeros(100))) == 1.0
    assert metric("slack_events", trace()) == metric("slack_time_s", trace()) == 0.0


def test_work_is_the_torque_held_times_the_angle_turned_by_sign():
    angle = np.concatenate([np.linspace(0.0, 5.0, 51), np.linspace(5.0, 3.0, 50)[1:]])  # 5 rad up, 2 rad down
    run = trace(angle_motor_rad=angle)
    assert metric("energy_motoring_j", run) == pytest.approx(600.0 * 5.0)
    assert metric("energy_regenerated_j", run) == pytest.approx(600.0 * 2.0)


def test_work_begins_with_the_first_sample_wherever_the_angle_stands():
    run = trace(angle_motor_rad=np.linspace(1900.0, 1909.9, 100))
    assert metric("energy_motoring_j", run) == pytest.approx(600.0 * 9.9)


def test_the_work_of_a_step_of_torque_is_that_of_the_torque_before_or_behind_a_lag_of_the_mean():
    run = trace(3, torque_motor_nm=np.array([100.0, 300.0, 300.0]), angle_motor_rad=np.array([0.0, 1.0, 1.0]))
    assert metric("energy_motoring_j", run) == pytest.approx(100.0)
    assert metric("energy_motoring_j", run, before=0.5) == pytest.approx(200.0)


@pytest.mark.parametrize("peak", [160.0, -160.0])
def test_the_largest_motor_speed_is_either_way_and_of_nominal(peak):
    run = trace(speed_motor_rad_s=with_peak(peak, calm=20.0))
    assert metric("peak_speed_percent", run) == pytest.approx(100.0 * 160.0 / P.w_nominal)


def test_the_overload_is_used_up_after_its_time_at_its_torque_and_back_after_the_rest_of_its_period():
    over = np.full(1000, 1.6 * 960.0)  # both motors: 160 % of nominal, for 10 s
    rest = np.full(29_000, 960.0)  # nominal torque for the 290 s that the drive's cycle leaves
    use = [
        metric("overload_use_percent", trace(len(torque), torque_motor_nm=torque))
        for torque in (over, over[:500], np.concatenate([over, rest, over]), np.concatenate([over, over[:500]]), rest)
    ]
    assert use == pytest.approx([100.0, 50.0, 100.0, 150.0, 0.0], rel=5e-3)


@pytest.mark.parametrize("peak", [1.5, -1.5])
def test_the_carriage_s_peak_acceleration_is_either_way(peak):
    run = trace(acceleration_carriage_m_s2=with_peak(peak, calm=0.2))
    assert metric("peak_carriage_acceleration_m_s2", run) == 1.5


@pytest.mark.parametrize(("height", "margin"), [(0.4, 0.4), (24.7, 0.3), (-0.2, -0.2), (25.5, -0.5)])
def test_the_rail_margin_is_the_least_distance_from_either_end(height, margin):
    run = trace(position_carriage_m=with_peak(height, calm=10.0))
    assert metric("rail_margin_m", run) == pytest.approx(margin)


def test_irregular_samples_count_each_until_the_next():
    run = Run(
        "by hand",
        np.array([0.0, 0.1, 0.4, 0.5]),
        {name: np.full(4, value) for name, value in CALM.items()} | {"tension_min_n": np.array([1.0, 0.0, 1.0, 1.0])},
    )
    assert metric("slack_time_s", run) == pytest.approx(0.3)


def test_every_metric_is_tested():
    here = Path(__file__)
    asserted = "".join(file.read_text(encoding="utf-8") for file in (here, here.with_name("test_metrics_more.py")))
    assert [m.name for m in metrics() if isinstance(m, LoopMetric) and f'metric("{m.name}", ' not in asserted] == []


def test_every_metric_has_a_unit_in_its_name_and_a_sentence():
    endings: dict[str, str | tuple[str, ...]] = {
        "N m": "_nm",
        "%": "_percent",
        "rad/s": "_rad_s",
        "N": "_n",
        "s": "_s",
        "J": "_j",
        "m/s²": "_m_s2",
        "m/s³": "_m_s3",
        "m": "_m",
        "rad": "_rad",
        "kW": "_kw",
        "N m/s": "_nm_per_s",
        "–": ("_events", "_factor", "_swings", "moves"),
    }
    for m in metrics():
        assert m.name.endswith(endings[m.unit])
        assert len(m.definition.split()) > 3


def record_the_angle(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs of hoists keep the motor's angle, too."""
    kind = KINDS["hoist"]
    more = replace(kind.looped, recorded=(*kind.looped.recorded, "angle_motor_rad"))
    monkeypatch.setitem(KINDS, "hoist", replace(kind, closed_loop=more))


def test_the_compiled_loop_gives_the_metrics_of_its_own_recorded_signals(monkeypatch):
    """With slack, a limit and a reversal in it, at every sample."""
    record_the_angle(monkeypatch)
    machine = with_values(default_hoist(), {"drive.overload": 12.0})
    reference = np.interp(np.arange(1500) * 0.001, [0.1, 0.11, 0.3, 0.31, 0.8], [0.0, -400.0, -400.0, 60.0, 0.0])
    case = LoopCase("run", machine, 4500.0, 10.0, PiSettings(kp_nm_s_per_rad=200.0, ki_nm_per_rad=50.0), reference)
    result = simulate_loop([case], record_every=1)[0]
    p = vars(PLANTS["hoist"].values(machine, 4500.0)) | loop.case_limits(case) | {"T_hold": result.hold_torque_nm}
    measured = measure(result.run, SimpleNamespace(**p))
    assert measured.keys() == result.metrics.keys()
    for name, value in result.metrics.items():
        assert measured[name] == pytest.approx(value, rel=1e-9), name
    assert result.metrics["slack_events"] >= 1.0  # the case says something
    assert min(result.metrics["energy_motoring_j"], result.metrics["energy_regenerated_j"]) > 0.0


def test_work_from_the_metrics_is_the_integral_of_torque_over_angle(monkeypatch):
    record_the_angle(monkeypatch)
    reference = np.interp(np.arange(1500) * 0.001, [0.1, 0.5, 0.7, 1.2], [0.0, 40.0, 40.0, -40.0])
    settings = PiSettings(kp_nm_s_per_rad=31.0, ki_nm_per_rad=122.0)
    result = simulate_loop([LoopCase("run", ideal_hoist(), 4500.0, 10.0, settings, reference)], record_every=1)[0]
    net = result.metrics["energy_motoring_j"] - result.metrics["energy_regenerated_j"]
    torque, angle = result.run["torque_motor_nm"], result.run["angle_motor_rad"]
    assert net == pytest.approx(float(np.sum(torque[:-1] * np.diff(angle))), rel=1e-9)
