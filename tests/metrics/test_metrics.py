"""Each metric against a closed form and in the compiled loop; one that is declared is shown everywhere."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from tests.support.commands import Commands
from tests.support.dashboard_app import page
from tests.support.scenario_text import GOOD, write
from workbench.cli import cli
from workbench.control import PiSettings
from workbench.core.run import Array, Run
from workbench.machines import KINDS, PLANTS, Drive, default_hoist, with_values
from workbench.metrics import LoopMetric, RunMetric, add, columns, find, forget_added, metrics, observer
from workbench.simulate import loop
from workbench.simulate.loop import LoopCase, simulate_loop
from workbench.study.store import read_finished

DT = 0.01
NEVER = 1e30
P = SimpleNamespace(
    n_m=2.0, T_nominal=480.0, T_hold=600.0, share=0.5, share_failed=1.0, t_fail=NEVER, before=1.0,
    x_low=0.0, x_high=25.0, w_nominal=157.1, W_break=0.0, D_w=0.6, ratio=31.0,
    **loop.overload_numbers(Drive(overload=1.6, overload_time_s=2.0, overload_period_s=60.0)),
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


def measure(run: Run, p: Any) -> dict[str, float]:
    """A hoist's metrics of the compiled loop from a run's signals: a log, or a trace made by hand.

    p: the observer's parameters by symbol. Each sample counts until the next one.
    """
    accumulators: Sequence[float] = observer().start
    steps = [*(run.time_s[1:] - run.time_s[:-1]), run.sample_time_s]
    for k, dt in enumerate(steps):
        signals = {name: values[k] for name, values in run.signals.items()} | {"time_s": run.time_s[k]}
        accumulators = observer().update(accumulators, signals, p, dt)
    return observer().finish(accumulators, p, float(sum(steps)))


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


def steps(value: float, at: int, calm: float) -> Array:
    return np.where(np.arange(100) < at, value, calm)


def decaying(amplitude: float, time_constant_s: float) -> dict[str, Array]:
    """A reference that stops after 2 s, and a speed error that dies away from there."""
    time = np.arange(1000) * DT
    reference = np.where(time < 2.0, 50.0, 0.0)
    error = np.where(time < 2.0, 0.0, amplitude * np.exp(-(time - 2.0) / time_constant_s))
    return {"speed_reference_rad_s": reference, "speed_motor_rad_s": reference + error}


T10 = np.arange(1000) * DT  # ten whole periods of 1 Hz
SINE = np.sin(2.0 * math.pi * T10)
AT = np.arange(100)
SLACK = np.where(np.isin(AT, [10, 11, 12, 13, 14, 50, 99]), 0.0, 5e4)
TURN = np.where(AT < 50, 100.0, -80.0)
LIFT = 0.6 / (4 * 31)  # m of carriage per rad of motor
STOP = np.where(np.arange(300) * DT < 2.0, 10.0, 0.0)
# 1 s behind by 2 rad/s, then caught up by half before the stop and wholly after it.
BEHIND = STOP - np.where(np.arange(300) * DT < 1.0, 2.0, -1.0)
SAW = np.cumsum(np.where(np.arange(200) % 5 == 4, -150.0, 100.0))  # up to and down again, in saw teeth
OVER, REST = np.full(200, 1.6 * 960.0), np.full(5800, 960.0)  # 160 % of nominal for 2 s, then nominal for 58 s

# (metric, its closed form, signals, parameters that are other)
CASES: list[tuple[str, float, dict[str, Any], dict[str, float]]] = [
    *(("peak_torque_motor_nm", 500.0, {"torque_motor_nm": with_peak(peak)}, {}) for peak in (1000.0, -1000.0)),
    ("peak_torque_percent", 100.0, {"torque_motor_nm": with_peak(960.0)}, {}),
    ("peak_torque_motor_nm", 600.0, {"torque_motor_nm": with_peak(1000.0)}, {"share": 0.6}),  # the harder-worked motor
    ("rms_torque_motor_nm", 360.0, {}, {"share": 0.6}),
    ("peak_torque_motor_nm", 700.0, {"torque_motor_nm": steps(800.0, 60, 700.0)}, {"t_fail": 0.599}),  # one gives all
    ("peak_torque_motor_nm", 400.0, {"torque_motor_nm": steps(800.0, 60, 700.0)}, {"t_fail": 5.0}),
    ("peak_torque_above_static_nm", 350.0, {"torque_motor_nm": with_peak(950.0)}, {}),
    ("peak_torque_above_static_nm", -200.0, {"torque_motor_nm": np.full(100, 400.0)}, {}),
    ("rms_torque_motor_nm", 0.5 * math.sqrt(600.0**2 + 200.0**2 / 2.0), {"torque_motor_nm": 600.0 + 200.0 * SINE}, {}),
    ("speed_error_max_rad_s", 3.0, {"speed_reference_rad_s": with_peak(7.0, calm=10.5)}, {}),
    ("speed_error_rms_rad_s", math.sqrt((99 * 0.25 + 9.0) / 100.0),
     {"speed_reference_rad_s": with_peak(7.0, calm=10.5)}, {}),
    ("min_wire_tension_n", 1e4, {"tension_min_n": with_peak(1e4, calm=5e4)}, {}),
    ("max_wire_tension_n", 8e4, {"tension_drum_n": with_peak(7e4, calm=6e4),
                                 "tension_dead_line_n": with_peak(8e4, at=3, calm=6e4)}, {}),
    ("wire_tension_swing_n", 1.5e4, {"tension_drum_n": with_peak(7e4, calm=6e4),
                                     "tension_dead_line_n": with_peak(4.5e4, at=3, calm=6e4)}, {}),
    ("wire_tension_swing_n", 0.0, {}, {}),
    ("wire_safety_factor", 5.0, {"tension_dead_line_n": with_peak(1.2e5, calm=6e4)}, {"W_break": 6e5}),
    ("slack_time_s", 7 * DT, {"tension_min_n": SLACK}, {}),
    ("slack_events", 3.0, {"tension_min_n": SLACK}, {}),
    ("slack_events", 1.0, {"tension_min_n": np.zeros(100)}, {}),  # begins slack
    ("slack_events", 0.0, {}, {}),
    ("slack_time_s", 0.0, {}, {}),
    ("energy_motoring_j", 3000.0, {"angle_motor_rad": 5.0 * np.minimum(AT / 50.0, 2.0 - AT / 50.0)}, {}),
    ("energy_regenerated_j", 2940.0, {"angle_motor_rad": 5.0 * np.minimum(AT / 50.0, 2.0 - AT / 50.0)}, {}),
    ("energy_motoring_j", 600.0 * 9.9, {"angle_motor_rad": 1900.0 + 0.1 * AT}, {}),  # wherever the angle stands
    *(("energy_motoring_j", work, {"torque_motor_nm": [100.0, 300.0, 300.0], "angle_motor_rad": [0.0, 1.0, 1.0]},
       {"before": before}) for work, before in ((100.0, 1.0), (200.0, 0.5))),  # held, or the mean behind a lag
    *(("peak_speed_percent", 100.0 * 160.0 / P.w_nominal, {"speed_motor_rad_s": with_peak(peak, calm=20.0)}, {})
      for peak in (160.0, -160.0)),
    *(("overload_use_percent", use, {"torque_motor_nm": torque}, {})
      for use, torque in ((100.0, OVER), (50.0, OVER[:100]), (100.0, np.concatenate([OVER, REST, OVER])),
                          (150.0, np.concatenate([OVER, OVER[:100]])), (0.0, REST))),
    *(("peak_carriage_acceleration_m_s2", 1.5, {"acceleration_carriage_m_s2": with_peak(peak, calm=0.2)}, {})
      for peak in (1.5, -1.5)),
    *(("rail_margin_m", margin, {"position_carriage_m": with_peak(height, calm=10.0)}, {})
      for height, margin in ((0.4, 0.4), (24.7, 0.3), (-0.2, -0.2), (25.5, -0.5))),
    ("i2t_s", 1.0, {"torque_motor_nm": np.full(100, 960.0)}, {}),  # nominal torque for 1 s
    ("thermal_load_percent", 100.0, {"torque_motor_nm": np.full(100, 960.0)}, {}),
    ("i2t_s", 20.0, {"torque_motor_nm": 1920.0 * SINE}, {}),
    ("thermal_load_percent", 200.0, {"torque_motor_nm": 1920.0 * SINE}, {}),
    ("overload_time_s", 10 * DT,
     {"torque_motor_nm": np.select([(AT >= 10) & (AT < 17), (AT >= 50) & (AT < 53)], [960.1, -1000.0], 960.0)}, {}),
    ("overload_time_s", 0.0, {"torque_motor_nm": np.full(100, 600.0)}, {}),
    ("overload_time_s", 60 * DT, {"torque_motor_nm": np.full(100, 600.0)}, {"t_fail": 0.395}),
    ("torque_rate_max_nm_per_s", 25.0, {"torque_motor_nm": 600.0 - 50.0 * AT * DT}, {}),
    ("torque_rate_max_nm_per_s", 30.0 / DT, {"torque_motor_nm": with_peak(660.0)}, {}),
    ("torque_rate_max_nm_per_s", 0.0, {}, {}),  # not the change from nothing to the first sample
    ("peak_carriage_jerk_m_s3", 0.8, {"acceleration_carriage_m_s2": 5.0 - 0.8 * AT * DT}, {}),
    ("speed_error_iae_rad", 60.0 / math.pi, {"speed_reference_rad_s": 10.0 + 3.0 * SINE}, {}),
    *(("speed_overshoot_rad_s", beyond, {"speed_reference_rad_s": TURN, "speed_motor_rad_s": speed}, {})
      for beyond, speed in ((0.0, TURN), (4.0, TURN + 4.0 * (AT == 20)), (5.0, TURN - 5.0 * (AT == 70)),
                            (0.0, 0.5 * TURN))),
    # 1 % of 157.1 rad/s is 1.571 rad/s.
    *(("settling_time_s", math.log(10.0), decaying(amplitude, 1.0), {}) for amplitude in (15.71, -15.71)),
    ("settling_time_s", 0.0, decaying(1.5, 1.0), {}),
    ("settling_time_s", 8.0, decaying(20.0, 1e6), {}),
    ("position_error_max_m", 2.0 * LIFT, {"speed_reference_rad_s": STOP, "speed_motor_rad_s": BEHIND}, {}),
    ("position_error_stop_m", -LIFT, {"speed_reference_rad_s": STOP, "speed_motor_rad_s": BEHIND}, {}),
    ("position_error_stop_m", LIFT, {"speed_reference_rad_s": -STOP, "speed_motor_rad_s": -BEHIND}, {}),
    ("peak_power_motoring_kw", 90.0, {"speed_motor_rad_s": with_peak(150.0, calm=10.0)}, {}),
    ("peak_power_regenerating_kw", 72.0, {"speed_motor_rad_s": with_peak(-120.0, calm=10.0)}, {}),
    ("peak_power_regenerating_kw", 0.0, {}, {}),
    # Ten periods; the last way back, to zero, counts where it is long enough.
    *(("torque_swings", swings, {"torque_motor_nm": 300.0 + 960.0 * amplitude * SINE}, {})
      for amplitude, swings in ((0.51, 19.0), (3.0, 20.0), (0.49, 0.0))),
    ("torque_swings", 1.0, {"torque_motor_nm": [*SAW, *SAW[::-1]]}, {}),
]  # fmt: skip
ROUGH = {"overload_use_percent": 5e-3, "speed_error_iae_rad": 1e-3}  # sums in place of integrals


@pytest.mark.parametrize(("name", "value", "signals", "other"), CASES, ids=lambda x: x if isinstance(x, str) else "")
def test_a_metric_of_a_trace_is_its_closed_form(name, value, signals, other):
    n = max((len(signal) for signal in signals.values()), default=100)
    absolute = DT if name == "settling_time_s" else 1e-12
    assert metric(name, trace(n, **signals), **other) == pytest.approx(value, rel=ROUGH.get(name, 1e-6), abs=absolute)


def test_every_metric_of_the_loop_has_a_closed_form_here():
    assert {m.name for m in metrics() if isinstance(m, LoopMetric)} == {name for name, *_ in CASES}


def test_samples_count_each_until_the_next_and_changes_by_the_time_between():
    signals = {name: np.full(4, value) for name, value in CALM.items()} | {
        "tension_min_n": np.array([1.0, 0.0, 1.0, 1.0])
    }
    signals |= {"torque_motor_nm": np.array([600.0, 600.0, 700.0, 700.0])}
    signals |= {"acceleration_carriage_m_s2": np.array([0.0, 0.0, 0.6, 0.6])}
    run = Run("by hand", np.array([0.0, 0.1, 0.4, 0.5]), signals)
    assert metric("slack_time_s", run) == pytest.approx(0.3)
    assert metric("torque_rate_max_nm_per_s", run) == pytest.approx(50.0 / 0.3)
    assert metric("peak_carriage_jerk_m_s3", run) == pytest.approx(2.0)


def test_without_a_breaking_load_there_is_no_safety_factor():
    assert "wire_safety_factor" not in measure(trace(), P)
    assert {m.name for m in observer().metrics if m.optional} == {"wire_safety_factor"}


def test_every_metric_has_a_unit_in_its_name_and_a_sentence():
    endings: dict[str, str | tuple[str, ...]] = {
        "N m": "_nm", "%": "_percent", "rad/s": "_rad_s", "N": "_n", "s": "_s", "J": "_j", "m/s²": "_m_s2",
        "m/s³": "_m_s3", "m": "_m", "rad": "_rad", "kW": "_kw", "N m/s": "_nm_per_s",
        "–": ("_events", "_factor", "_swings", "moves"),
    }  # fmt: skip
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


# A metric that is declared is shown everywhere: one is added here, and looked for in every place.


# Numbers of its own, from accumulators that the compiled loop keeps already.
DRUM = LoopMetric(
    name="peak_drum_torque_nm", unit="N m", label="drum torque peak", better="lower", visible=10.0,
    definition="largest torque of the drum, one motor's torque times the ratio", shown_in="kN m", scale=1e-3,
    accumulators=find("peak_torque_motor_nm").accumulators,  # type: ignore[attr-defined]
    finish=lambda a, p, duration: a[0] * p.ratio,
)  # fmt: skip
LONGEST = RunMetric(
    name="longest_move_s", unit="s", label="longest move", better="lower", visible=1e-3,
    definition="time of the longest move of the reference", known_before=True,
    value=lambda run: max(end - start for start, end in run.move_windows),
)  # fmt: skip
RATIO = default_hoist().gearbox.ratio


@pytest.fixture(scope="module")
def declared() -> Iterator[None]:
    add(DRUM, LONGEST)
    yield
    forget_added()


@pytest.fixture(scope="module")
def folders(declared: None, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Results of a plain study and of one with a weaker controller."""
    folder = tmp_path_factory.mktemp("declared")
    texts = {"plain": GOOD, "weaker": GOOD.replace("kp_nm_s_per_rad: 31.0", "kp_nm_s_per_rad: 15.0")}
    for name, text in texts.items():
        file = write(folder, text, f"{name}.yaml")
        done = CliRunner().invoke(cli, ["study", str(file), "--out", str(folder / name)], catch_exceptions=False)
        assert done.exit_code == 0, done.output
    return {name: folder / name for name in texts}


def test_it_is_a_column_of_the_index_with_its_own_numbers(folders: dict[str, Path]) -> None:
    for row in read_finished(folders["plain"]).rows:
        assert row["peak_drum_torque_nm"] == pytest.approx(RATIO * row["peak_torque_motor_nm"])
        assert row["longest_move_s"] == pytest.approx(row["move_time_s"] / 2.0)
    assert columns()[-1] == "longest_move_s" and "peak_drum_torque_nm" in columns()


def test_compare_shows_it_knows_which_way_is_worse_and_takes_limits(folders, tmp_path, capsys):
    words = ["compare", folders["plain"], folders["weaker"], "--json", tmp_path / "c.json"]
    done = Commands(capsys)(*words, "--max-regression", "peak_drum_torque=1")
    said = json.loads((tmp_path / "c.json").read_text())
    change = said["metrics"]["peak_drum_torque_nm"]
    assert change["max_delta"] == pytest.approx(RATIO * said["metrics"]["peak_torque_motor_nm"]["max_delta"])
    assert "peak_drum_torque_nm" in done.out
    assert said["regressions"] and all(run["b"] > run["a"] + 1.0 for run in said["regressions"])
    assert done.status == 1


def test_the_dashboard_shows_it_on_study_and_compare(declared: None) -> None:
    from streamlit.testing.v1 import AppTest

    app = page("Study").run()
    assert not app.exception
    # A heading holds the unit where the number would be cut beside it.
    assert {"Drum torque peak", "Longest move"} <= {number.label.split(" (")[0] for number in app.metric}
    source = (
        "import streamlit as st\nfrom workbench.dashboard.shell import run_page\n"
        "run_page(st.session_state.get('page', 'Study'))\n"
    )
    both = AppTest.from_string(source, default_timeout=60.0).run()
    both.button(key="study keep").click().run()
    both.session_state["page"] = "Compare"
    both.run()
    assert not both.exception
    words = {str(cell).replace("\\", "") for cell in both.table[0].value.iloc[:, 0]}
    assert {"Drum torque peak (kN m)", "Longest move (s)"} <= words
