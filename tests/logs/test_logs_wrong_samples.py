"""Samples that are no measurement: dropouts, spikes, absurd sizes, optional signals in another unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.log_campaign import AXIS, RUNS, Array, axis_columns, hoist_columns, write_campaign
from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.logs import read_campaign
from workbench.logs.samples import find_spikes
from workbench.machines import default_hoist

AXIS_RUNS = "runs:\n- {name: lift, file: runs/lift.csv}\n"
MOTORS = ("torque_motor1_nm", "torque_motor2_nm")


def read(folder: Path, columns: dict[str, Array], runs: str = RUNS) -> Run:
    return read_campaign(write_campaign(folder, columns, runs=runs)).runs[0]


def read_axis(folder: Path, columns: dict[str, Array]) -> Run:
    return read_campaign(write_campaign(folder, columns, runs=AXIS_RUNS, machine=AXIS)).runs[0]


def height(columns: dict[str, Array]) -> Array:
    """What the drum's rotation makes of the start at 9 m."""
    time, speed = columns["time_s"], columns["speed_motor_rad_s"]
    travel = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))))
    return 9.0 + default_hoist().lift_m_per_rad * travel


# Dropouts


SPEED, SECOND = "speed_motor_rad_s", "torque_motor2_nm"


@pytest.mark.parametrize(
    ("signals", "rows", "frozen", "said"),
    [
        (MOTORS, slice(1300, 1500), 0.0, "torque_motor1_nm is exactly 0 from 13 s to 14.99 s while the machine moves; "
         "the run is kept from 0 s to 12.99 s, 700 samples are left out"),
        (MOTORS, slice(1500, 1512), 0.0, "torque_motor1_nm is exactly 0 from 15 s to 15.11 s while the machine moves"),
        (SECOND, slice(1500, 1700), None, "torque_motor2_nm is exactly "),
        (SPEED, slice(1480, 1492), 0.0, "speed_motor_rad_s is exactly 0 from 14.8 s to 14.91 s"),
        (SPEED, slice(1600, 1700), 0.0, "speed_motor_rad_s is exactly 0 from 16 s to 16.99 s"),
    ],
    ids=["torque, long", "torque, brief", "one motor frozen", "speed, brief", "speed, long"],
)  # fmt: skip
def test_a_dropout_late_in_a_run_is_cut_off_and_said(tmp_path, signals, rows, frozen, said):
    columns = hoist_columns(2000)
    for name in [signals] if isinstance(signals, str) else signals:
        columns[name][rows] = columns[name][rows.start] if frozen is None else frozen
    run = read(tmp_path, columns)
    assert np.array_equal(run.time_s, columns["time_s"][: rows.start])
    assert (run.start_position_m, run.start_time_s) == (9.0, 0.0)
    assert len(run.notes) == 1 and run.notes[0].startswith(said)


def test_what_follows_an_early_dropout_starts_later_and_where_the_carriage_then_is(tmp_path):
    columns = hoist_columns(2000)
    for name in MOTORS:
        columns[name][200:400] = 0.0
    run = read(tmp_path, columns, RUNS.replace("start_time_s: 0.0", "start_time_s: 100.0"))
    assert run.time_s[0] == columns["time_s"][400]
    assert run.start_time_s == pytest.approx(104.0)
    assert run.start_position_m == pytest.approx(height(columns)[400], abs=1e-9)


def test_dropouts_that_leave_no_third_of_a_run_whole_are_refused_by_time(tmp_path):
    columns = hoist_columns(2000)
    for name in MOTORS:
        for start in (300, 900, 1500):
            columns[name][start : start + 60] = 0.0
    with pytest.raises(InputError, match=r"torque_motor1_nm is exactly 0 from 3 s to 3.59 s while the machine moves"):
        read(tmp_path, columns)


def test_a_hoist_on_its_brake_has_no_torque_and_keeps_its_run(tmp_path):
    columns = {name: np.concatenate((np.zeros(300), column)) for name, column in hoist_columns(1000).items()}
    columns["time_s"] = 0.01 * np.arange(1300, dtype=np.float64)
    run = read(tmp_path, columns)
    assert len(run.time_s) == 1300
    assert run.notes == ()


def test_one_motor_that_fails_while_the_other_carries_on_is_said_and_kept(tmp_path):
    columns = hoist_columns(2000)
    columns["torque_motor1_nm"][1400:1600] += columns["torque_motor2_nm"][1400:1600]
    columns["torque_motor2_nm"][1400:1600] = 0.0
    run = read(tmp_path, columns)
    assert len(run.time_s) == 2000
    assert run.notes[0] == "torque_motor2_nm is exactly 0 from 14 s to 15.99 s while the machine moves; kept"


def test_a_coarse_logger_and_a_quiet_signal_rest_without_a_word(tmp_path):
    columns = hoist_columns(2000)
    for name in MOTORS:
        columns[name] = (columns[name] / 20.0).round() * 20.0
    assert read(tmp_path, columns).notes == ()
    quiet = hoist_columns(2000)
    speed = np.clip(np.abs((quiet["time_s"] - 10.0) * 20.0) - 20.0, 0.0, 40.0) * np.sign(10.0 - quiet["time_s"])
    quiet |= {"speed_motor_rad_s": speed, "speed_reference_rad_s": speed}
    for name in MOTORS:
        quiet[name] = 297.0 + 0.15 * np.gradient(speed, quiet["time_s"]) + 20.0 * np.sign(speed)
    run = read(tmp_path, quiet)
    assert len(run.time_s) == 2000


def test_a_frozen_optional_signal_is_dropped(tmp_path):
    columns = hoist_columns(2000)
    position = height(columns)
    tension = 0.5 * (2600.0 + 4500.0) * 9.81 + np.random.default_rng(3).normal(scale=50.0, size=2000)
    columns |= {"position_carriage_m": position, "tension_dead_line_n": tension}
    assert read(tmp_path, columns).notes == ()
    columns["position_carriage_m"] = np.where(np.abs(np.arange(2000) - 700) < 200, position[500], position)
    columns["tension_dead_line_n"] = np.where(np.abs(np.arange(2000) - 700) < 200, tension[500], tension)
    run = read(tmp_path, columns)
    assert "position_carriage_m" not in run and "tension_dead_line_n" not in run
    assert [note.split(" dropped: ")[0] for note in run.notes] == ["position_carriage_m", "tension_dead_line_n"]


# Spikes


def test_spikes_are_bridged_and_said(tmp_path):
    columns = hoist_columns()
    before = {name: column.copy() for name, column in columns.items()}
    columns["torque_motor1_nm"][250] = 9999.9
    columns["speed_motor_rad_s"][77:79] = -900.0
    run = read(tmp_path, columns)
    assert run["torque_motor1_nm"][250] == pytest.approx(before["torque_motor1_nm"][[249, 251]].mean())
    assert run["speed_motor_rad_s"][77] == pytest.approx(before["speed_motor_rad_s"][77], abs=0.5)
    assert run.notes == (
        "torque_motor1_nm: 1 sample far off the neighbours on both sides bridged by straight lines, "
        "first 1e+04 at 2.5 s",
        "speed_motor_rad_s: 2 samples far off the neighbours on both sides bridged by straight lines, "
        "first -900 at 0.77 s",
    )


def test_steps_pulses_and_loud_signals_are_no_spikes():
    time = 0.001 * np.arange(1000, dtype=np.float64)
    noise = np.random.default_rng(1).normal(size=1000)
    step = np.where(time < 0.5, 0.0, 100.0) + 0.1 * noise
    pulse = np.where((time > 0.5) & (time < 0.51), 100.0, 0.0) + 0.1 * noise
    assert find_spikes(time, step) == find_spikes(time, pulse) == find_spikes(time, noise) == []
    assert find_spikes(time, np.where(np.arange(1000) % 10 == 0, 100.0, 0.1 * noise)) == []


# Sizes and scales


def test_a_position_of_1e308_is_refused(tmp_path):
    still = np.full(500, 1e308)
    with pytest.raises(InputError, match=r"lift: position_m reaches 1e\+308, expected at most 1e\+09 in SI units"):
        read_axis(tmp_path, axis_columns() | {"position_m": still, "position_reference_m": still})


@pytest.mark.parametrize("scale", [9.5493, -1.0, 0.01])
def test_optional_signals_in_another_unit_are_dropped_and_said(tmp_path, scale):
    columns = hoist_columns(2000)
    columns["speed_reference_rad_s"] *= scale
    columns["position_carriage_m"] = scale * height(columns)
    columns["tension_dead_line_n"] = np.full(2000, scale * 30e3) + np.arange(2000) % 7
    run = read(tmp_path, columns)
    assert not {"speed_reference_rad_s", "position_carriage_m", "tension_dead_line_n"} & run.signals.keys()
    assert all(note.endswith("is it in another unit?") for note in run.notes)
    assert len(run.notes) == 3
