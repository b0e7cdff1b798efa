"""Each fault of a log: refused by file, run, column and time, or repaired and said so."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.attack.edits import EDITS, edited
from tests.support.log_campaign import AXIS, RUNS, Array, axis_columns, csv_text, hoist_columns, write_campaign
from workbench.cli.measured import load_campaign
from workbench.core.errors import InputError
from workbench.core.run import Run, integrated
from workbench.logs import read_campaign
from workbench.logs.campaign import RunsError
from workbench.logs.doubts import dead_band, doubts_of
from workbench.logs.samples import clipped, find_spikes
from workbench.machines import KINDS, default_hoist, kind_of, save_machine, with_values

AXIS_RUNS = "runs:\n- {name: lift, file: runs/lift.csv}\n"


def read(folder: Path, columns: dict[str, Array] | str, runs: str = RUNS) -> Run:
    return read_campaign(write_campaign(folder, columns, runs=runs)).runs[0]


def refusal(folder: Path, columns: dict[str, Array] | str) -> str:
    with pytest.raises(InputError) as caught:
        read(folder, columns)
    text = str(caught.value)
    assert "lift.csv" in text
    assert ": lift: " in text, "the run is named"
    assert "\n" not in text
    return text


# The text of a CSV file


TEXT = csv_text(hoist_columns())
LINES = TEXT.splitlines()


def with_line(number: int, text: str) -> str:
    """The log with line `number` (from 1) replaced."""
    return "\n".join([*LINES[: number - 1], text, *LINES[number:]]) + "\n"


CSV_FAULTS = {
    "": "is empty",
    LINES[0]: "holds only the header; expected at least 10 samples",
    "\n".join(LINES[1:]): "has no header: the first row is numbers (0.0, …)",
    TEXT.replace(",", ";"): "columns are separated by semicolons; expected commas",
    TEXT.replace(",", ";").replace(".", ","): "expected commas and decimal points",
    TEXT.replace("torque_motor2_nm", "torque_motor1_nm"): "column 'torque_motor1_nm' is doubled",
    TEXT.replace(
        "speed_motor_rad_s", "speed_motor_rads"
    ): "no column speed_motor_rad_s; did you mean 'speed_motor_rads'?",
    TEXT.replace("time_s", "zeit"): "no column time_s; the file has: zeit, torque_motor1_nm",
    with_line(100, "0.98,1,2,3"): "lift.csv:100: lift: row has 4 fields, the header 5 columns; is the file cut off?",
    with_line(100, "0,98,296,4,301,2,0,31,0,31"): "row has 10 fields, the header 5 columns; are there decimal commas?",
    with_line(100, "0.98,1,fault,3,4"): "lift.csv:100: lift: torque_motor2_nm: 'fault' is not a number",
    with_line(
        100, "0.98,1,296 Nm,3,4"
    ): "torque_motor2_nm: '296 Nm' is not a number; put the unit into the column's name",
    with_line(2, "s,Nm,Nm,rad/s,rad/s"): "lift.csv:2: lift: time_s: 's' is not a number",
    TEXT + "\0\0": "holds binary data",
}


@pytest.mark.parametrize("text", CSV_FAULTS, ids=list(CSV_FAULTS.values()))
def test_fault_of_csv_text_is_named_by_line_and_column(tmp_path, text):
    assert CSV_FAULTS[text] in refusal(tmp_path, text)


def test_byte_order_mark_windows_line_ends_and_spaces_in_the_header_do_no_harm(tmp_path):
    plain = read(tmp_path, TEXT)
    odd = "\ufeff" + TEXT.replace(",", " , ", 4).replace("\n", "\r\n")
    run = read(tmp_path, odd)
    assert run.notes == ()
    assert np.array_equal(run["speed_motor_rad_s"], plain["speed_motor_rad_s"])


def test_compressed_or_latin1_file_is_refused(tmp_path):
    write_campaign(tmp_path, TEXT)
    file = tmp_path / "runs" / "lift.csv"
    file.write_bytes(b"\xe9" + TEXT.encode())
    with pytest.raises(InputError, match=r"lift.csv:1: lift: header is not UTF-8"):
        read_campaign(tmp_path)
    file.write_bytes(b"\x1f\x8b\x08\x00\x00\x00")
    with pytest.raises(InputError, match=r"lift.csv: lift: holds binary data"):
        read_campaign(tmp_path)


# Parquet and MAT


def other_format(folder: Path, suffix: str) -> Path:
    write_campaign(folder, TEXT, runs=RUNS.replace("lift.csv", f"lift.{suffix}"))
    return folder / "runs" / f"lift.{suffix}"


def test_parquet_text_column_is_refused_by_name_and_null_is_a_missing_sample(tmp_path):
    file = other_format(tmp_path, "parquet")
    columns: dict[str, object] = dict(hoist_columns())
    pa.parquet.write_table(pa.table(columns | {"speed_motor_rad_s": ["fast"] * 500}), file)
    with pytest.raises(InputError, match=r"lift.parquet: lift: speed_motor_rad_s: holds string, expected numbers"):
        read_campaign(tmp_path)
    speed: list[float | None] = list(hoist_columns()["speed_motor_rad_s"])
    speed[40] = None
    pa.parquet.write_table(pa.table(columns | {"speed_motor_rad_s": speed}), file)
    assert "1 missing sample in 1 gap bridged" in read_campaign(tmp_path).runs[0].notes[0]


MATLAB_FAULTS: dict[str, dict[str, Any]] = {
    r"columns differ in length: time_s 500, .*speed_motor_rad_s 499": {"speed_motor_rad_s": np.ones(499)},
    r"no column time_s; the file has: torque_motor1_nm": {"time_s": np.ones((4, 500)), "note": "a log"},
    r"speed_motor_rad_s: holds complex128, expected real numbers": {"speed_motor_rad_s": np.ones(500) * 1j},
}


@pytest.mark.parametrize("said", MATLAB_FAULTS)
def test_what_is_no_real_vector_of_a_matlab_file_is_refused(tmp_path, said):
    scipy.io.savemat(other_format(tmp_path, "mat"), hoist_columns() | MATLAB_FAULTS[said])
    with pytest.raises(InputError, match=said):
        read_campaign(tmp_path)


# What is wrong with one signal of a log: `signal[rows] = value`, and what is said of it.

SPEED, REFERENCE, SECOND = "speed_motor_rad_s", "speed_reference_rad_s", "torque_motor2_nm"
REFUSED = [
    ("time_s", 200, 1.5, "time_s goes backwards from 1.99 s to 1.5 s at line 202"),
    ("time_s", 200, np.nan, "time_s is missing at line 202, after 1.99 s"),
    ("time_s", slice(None), 3.0, "time_s stands still at 3 s"),
    ("time_s", slice(None), 10.0 * np.arange(500), "expected at most 0.5 s; if it is in milliseconds, give the column"),
    ("time_s", slice(None), 1e-7 * np.arange(500), "is it in days or hours?"),
    ("time_s", slice(None), 2e-4 * np.arange(500), "time_s spans 0.0998 s, expected at least 0.2 s"),
    ("time_s", slice(None), (0.01 * np.arange(500)).round(1), "other values, first at 0 s; are the stamps rounded"),
    (SECOND, slice(100, 460), np.nan, "torque_motor2_nm: 360 samples in a row are missing from 1 s to 4.59 s"),
    (SPEED, slice(200, None), np.nan, "speed_motor_rad_s ends at 1.99 s, the run at 4.99 s"),
    (SPEED, slice(None), np.nan, "speed_motor_rad_s holds no numbers at all"),
    (SPEED, slice(1, -1, 10), np.nan, "50 of 500 samples are missing, the first at 0.01 s"),
    (SPEED, 123, -np.inf, "speed_motor_rad_s is infinite at 1.23 s"),
    (SECOND, slice(None), 0.0, "torque_motor2_nm is zero throughout; a hoist's motors hold its load"),
    (SPEED, slice(None), 12.5, "speed_motor_rad_s is 12.5 throughout; is the channel frozen?"),
]
NOTED = [
    (SPEED, slice(300, 304), np.nan, "speed_motor_rad_s: 4 missing samples in 1 gap bridged by straight lines, first "),
    (SPEED, slice(450, None), np.nan, "speed_motor_rad_s ends at 4.49 s; the run's last 50 samples are cut off"),
    (REFERENCE, slice(300, 340), np.nan, "speed_reference_rad_s dropped: 40 samples in a row are missing from 3 s"),
    ("tension_dead_line_n", slice(None), 0.0, "tension_dead_line_n dropped: it is zero throughout"),
    ("time_s", 100, 0.99, "1 samples repeat a time stamp with other values, averaged, first at 0.99 s"),
    (SPEED, slice(77, 80), 900.0, "speed_motor_rad_s: 3 samples beyond twice the nominal speed, first at 0.77 s"),
]


def changed(signal: str, rows: int | slice, value: float | Array) -> dict[str, Array]:
    columns = hoist_columns()
    columns.setdefault(signal, np.ones(500))[rows] = value
    return columns


@pytest.mark.parametrize(("signal", "rows", "value", "said"), REFUSED, ids=[said for *_, said in REFUSED])
def test_a_log_that_tells_nothing_is_refused_by_signal_and_time(tmp_path, signal, rows, value, said):
    assert said in refusal(tmp_path, changed(signal, rows, value))


@pytest.mark.parametrize(("signal", "rows", "value", "said"), NOTED, ids=[said for *_, said in NOTED])
def test_a_fault_that_is_mended_or_kept_is_the_one_note(tmp_path, signal, rows, value, said):
    columns = changed(signal, rows, value)
    run = read(tmp_path, columns)
    assert next(note for note in run.notes if not note.startswith("time is irregular")).startswith(said)
    assert ("dropped" in said) != (signal in run or signal == "time_s")
    if "bridged" in said:
        before, after = columns[SPEED][[299, 304]]
        assert run[SPEED][299:305] == pytest.approx(np.linspace(before, after, 6), rel=1e-9)
    elif "averaged" in said:
        assert run[SPEED][99] == pytest.approx(columns[SPEED][99:101].mean(), rel=1e-15)
    elif "kept" not in said and "cut off" not in said and signal in run:
        assert np.array_equal(run[signal], columns[signal])


def test_irregular_time_and_gaps_are_kept_and_said(tmp_path):
    columns = {name: np.delete(column, slice(200, 230)) for name, column in hoist_columns().items()}
    run = read(tmp_path, columns)
    assert np.array_equal(run.time_s, columns["time_s"])
    assert run.notes == (
        "time is irregular: steps from 0.01 to 0.31 s, median 0.01 s; kept as is",
        "1 gap in time, the longest from 1.99 s to 2.3 s; signals count as straight lines there",
    )


def test_a_pause_of_the_recorder_is_a_hole_too(tmp_path):
    """It was bridged by straight lines with a note, and the noise of the log was that of a line over an hour."""
    kept = {name: np.delete(column, slice(300, 450)) for name, column in hoist_columns().items()}
    first, second = read_campaign(write_campaign(tmp_path, kept)).runs
    assert np.array_equal(np.concatenate([first.time_s, second.time_s]), kept["time_s"]) and len(first.time_s) == 300
    said = "samples are missing from 2.99 s to 4.5 s; the stretches before and behind are used, each as a run"
    assert first.notes[0] == second.notes[0] == said
    way_m = kind_of(default_hoist()).transmission_of(default_hoist()) * np.trapezoid(
        kept[SPEED][:301], kept["time_s"][:301]
    )
    assert second.start_position_m == pytest.approx(first.start_position_m + way_m, abs=1e-6)


def test_the_stretches_before_and_behind_a_hole_are_used_each_as_a_run(tmp_path):
    columns = changed(SECOND, slice(300, 400), np.nan)
    first, second = read_campaign(write_campaign(tmp_path, columns)).runs
    assert (first.name, second.name) == ("lift", "lift_2")
    assert np.array_equal(first.time_s, columns["time_s"][:300])
    assert np.array_equal(second[SPEED], columns[SPEED][400:])
    said = "samples are missing from 3 s to 3.99 s; the stretches before and behind are used, each as a run"
    assert first.notes[0] == second.notes[0] == said
    machine = default_hoist()
    way_m = kind_of(machine).transmission_of(machine) * np.trapezoid(columns[SPEED][:401], dx=0.01)
    assert second.start_position_m == pytest.approx(first.start_position_m + way_m, abs=1e-6)
    assert second.start_time_s == pytest.approx(first.start_time_s + 4.0)


def test_all_faults_of_all_runs_are_told_at_once_with_what_goes_on(tmp_path):
    runs = "".join(
        f"- {{name: {name}, file: runs/{name}.csv, payload_kg: 0.0, start_position_m: 9.0}}\n" for name in "abc"
    )
    write_campaign(tmp_path, hoist_columns(), runs=f"runs:\n{runs}")
    (tmp_path / "runs" / "lift.csv").rename(tmp_path / "runs" / "b.csv")
    (tmp_path / "runs" / "a.csv").write_text("")
    with pytest.raises(RunsError) as caught:
        read_campaign(tmp_path)
    assert "a.csv: a: is empty; " in str(caught.value)
    assert "runs.yaml:4: c: runs/c.csv: no such file" in str(caught.value)
    assert caught.value.sound == ("b",)
    with pytest.raises(InputError, match=r"; without what is at fault: --runs b$"):
        load_campaign(tmp_path)
    assert [run.name for run in read_campaign(tmp_path, select="b").runs] == ["b"]


def test_a_fault_that_several_runs_have_is_told_once_with_their_names(tmp_path):
    runs = "".join(
        f"- {{name: {name}, file: runs/{name}.csv, payload_kg: 0.0, start_position_m: 9.0}}\n" for name in "abcdefgh"
    )
    write_campaign(tmp_path, hoist_columns(), runs=f"runs:\n{runs}")
    good = (tmp_path / "runs" / "lift.csv").read_text()
    for name in "abcdefgh":
        (tmp_path / "runs" / f"{name}.csv").write_text(good if name == "h" else good.replace(SPEED, "speed"))
    (tmp_path / "runs" / "c.csv").write_text("")
    with pytest.raises(RunsError) as caught:
        read_campaign(tmp_path)
    said = str(caught.value)
    assert "a.csv: a: no " in said and " (so in b, d, e, f, g); " in said and said.endswith("c.csv: c: is empty")
    assert said.count(SPEED) == 1
    for name in "abcdefg":
        factor = 60.0 / (2.0 * np.pi) * (1.0 + 0.01 * ord(name))
        columns = hoist_columns()
        (tmp_path / "runs" / f"{name}.csv").write_text(csv_text(columns | {SPEED: factor * columns[SPEED]}))
    with pytest.raises(RunsError, match=r"is it in rpm\? .* \(so in b, c, d, e, f, g\)$") as caught:
        read_campaign(tmp_path)
    assert str(caught.value).count("rpm") == 1


def test_hoist_that_holds_still_reads_with_a_note_and_keeps_its_reference(tmp_path):
    run = read(tmp_path, hoist_columns() | {SPEED: np.zeros(500), REFERENCE: np.zeros(500)})
    assert REFERENCE in run
    assert run.notes == ("the machine stands still throughout; this run says nothing of friction or inertia",)


def test_clipped_channel_is_pointed_out(tmp_path):
    columns = hoist_columns()
    level = np.percentile(columns["torque_motor1_nm"], 80)
    columns["torque_motor1_nm"] = np.minimum(columns["torque_motor1_nm"], level)
    (note,) = read(tmp_path, columns).notes
    assert note.startswith(f"torque_motor1_nm may be clipped: 100 samples at its largest value {level:g}")


def test_a_run_may_begin_after_many_turns(tmp_path):
    """Parts of a motor's log at 300 rad/s were refused, as millimetres."""
    runs = "runs:\n- {name: lift, file: runs/lift.csv, start_position_m: 13639.9}\n"
    (run,) = read_campaign(write_campaign(tmp_path, axis_columns(), runs=runs, machine=AXIS)).runs
    assert run.start_position_m == 13639.9


def test_a_command_in_steps_is_not_clipped():
    """A motor's voltage, stepped from 0 to 1.5 V and back, was said to be clipped where it stays."""
    t = 0.01 * np.arange(1000, dtype=np.float64)
    noise = np.random.default_rng(1).normal(size=1000)
    steps = np.where((t > 1.0) & (t < 8.0), 1.5, np.where(t >= 8.0, 0.5, 0.0))
    assert clipped(t, steps) is None
    assert clipped(t, np.minimum(steps + 0.01 * noise, 1.5)) is not None


# Units and sizes


def test_speed_in_rpm_is_named_with_its_scale(tmp_path):
    columns = hoist_columns()
    columns["speed_motor_rad_s"] *= 60 / (2 * np.pi)
    text = refusal(tmp_path, columns)
    assert "reaches 573 rad/s, the machine's nominal speed is 157.1 rad/s; is it in rpm?" in text
    assert "scale of 0.10472" in text


def test_spikes_too_many_to_be_bridged_are_not_said_to_be_a_unit_alone(tmp_path):
    """Ten samples of 1e6 N m in a run were "a mass in tonnes"."""
    columns = hoist_columns(2000)
    columns["torque_motor1_nm"][50::200] = 1e6
    assert "are its 10 samples beyond 4 times the motors' nominal torque spikes, is it in" in refusal(tmp_path, columns)


def test_torque_in_kilonewton_metres_or_of_the_drum_is_refused(tmp_path):
    columns = hoist_columns()
    hints = ((1e-3, "is it in kN m or per cent"), (5.3, "a mass in tonnes"), (31.0, "is it the drum's torque"))
    for factor, words in hints:
        scaled = columns | {name: columns[name] * factor for name in ("torque_motor1_nm", "torque_motor2_nm")}
        assert words in refusal(tmp_path, scaled)


def test_flipped_torque_and_one_motors_torque_for_the_sum_are_pointed_out(tmp_path):
    columns = hoist_columns()
    one, _ = columns.pop("torque_motor1_nm"), columns.pop("torque_motor2_nm")
    assert "is it one motor's only?" in read(tmp_path, columns | {"torque_motor_nm": one}).notes[0]
    assert "is its sign flipped?" in read(tmp_path, columns | {"torque_motor_nm": -2 * one}).notes[0]


def test_slow_run_in_rpm_is_found_by_where_it_would_take_the_carriage(tmp_path):
    columns = hoist_columns(12000)
    for name in ("speed_motor_rad_s", "speed_reference_rad_s"):
        columns[name] *= 0.3 * 60 / (2 * np.pi)
    assert "the rail goes from 0 to 25 m; is the speed in rpm" in refusal(tmp_path, columns)


def test_dead_velocity_beside_a_position_is_dropped_and_said(tmp_path):
    columns = axis_columns() | {"velocity_m_s": np.zeros(500)}
    run = read_campaign(write_campaign(tmp_path, columns, runs=AXIS_RUNS, machine=AXIS)).runs[0]
    assert "velocity_m_s" not in run
    assert run.notes == ("velocity_m_s dropped: it is zero throughout",)


# Samples that are no measurement: dropouts, spikes, absurd sizes, optional signals in another unit.


MOTORS = ("torque_motor1_nm", "torque_motor2_nm")


def read_axis(folder: Path, columns: dict[str, Array]) -> Run:
    return read_campaign(write_campaign(folder, columns, runs=AXIS_RUNS, machine=AXIS)).runs[0]


def height(columns: dict[str, Array]) -> Array:
    """What the drum's rotation makes of the start at 9 m."""
    time, speed = columns["time_s"], columns["speed_motor_rad_s"]
    travel = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))))
    return 9.0 + default_hoist().lift_m_per_rad * travel


# Dropouts


@pytest.mark.parametrize(
    ("signals", "rows", "frozen", "said"),
    [
        (MOTORS, slice(1300, 1500), 0.0, "torque_motor1_nm is exactly 0 from 13 s to 14.99 s while the machine moves; "
         "the run is kept from 0 s to 12.99 s, 700 samples are left out"),
        (MOTORS, slice(1500, 1512), 0.0, "torque_motor1_nm is exactly 0 from 15 s to 15.11 s while the machine moves"),
        (SECOND, slice(1500, 1700), None, "torque_motor2_nm is exactly "),
        (SPEED, slice(1480, 1492), 0.0, "speed_motor_rad_s is exactly 0 from 14.8 s to 14.91 s"),
        (SPEED, slice(1600, 1700), -0.0, "speed_motor_rad_s is exactly 0 from 16 s to 16.99 s"),
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


def test_a_part_of_a_log_in_which_an_axis_rests_to_a_count_is_kept(tmp_path):
    """The last part of a robot joint's log: what its speed shows there are single counts."""
    rest = axis_columns(2000) | {"position_m": np.zeros(2000), "velocity_m_s": np.full(2000, -0.0)}
    rest["velocity_m_s"][[200, 900, 1200]] = 1e-4, -1e-4, 2e-4
    assert len(read_axis(tmp_path, rest).time_s) == 2000


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


def test_a_position_of_1e308_is_refused(tmp_path):
    still = np.full(500, 1e308)
    with pytest.raises(InputError, match=r"lift: position_m reaches 1e\+308, expected at most 1e\+09 in SI units"):
        read_axis(tmp_path, axis_columns() | {"position_m": still, "position_reference_m": still})


# Sizes and scales


@pytest.mark.parametrize("noise_m", [0.0, 1e-5])
def test_an_axis_at_rest_is_no_axis_in_another_unit(tmp_path, noise_m):
    """Friction holds any force below its level; such a run was refused for a force 0.02 times what its motion takes."""
    position = -0.0997 + noise_m * np.random.default_rng(2).normal(size=500)
    at_rest = {"position_m": position, "force_n": 0.002 * axis_columns()["force_n"]}
    run = read_axis(tmp_path, {**axis_columns(), **at_rest, "position_reference_m": np.full(500, -0.0997)})
    assert np.array_equal(run["position_m"], position)
    assert any("stands still throughout" in note for note in run.notes) == (noise_m == 0.0)


@pytest.mark.parametrize(("factor", "refused"), [(5.0, None), (200.0, False), (1000.0, True)])
def test_an_input_far_beyond_what_the_motion_takes_is_pointed_out_and_refused_beyond_any_part_that_may_lack(
    tmp_path, factor: float, refused: bool | None
):
    """A motor's voltage is nearly all viscous friction: without that in machine.yaml its sound log was refused."""
    columns = axis_columns()
    more = {**columns, "force_n": factor * columns["force_n"]}
    if refused:
        with pytest.raises(InputError, match=r"225 times what this machine takes .* a scale of 0\.01 "):
            read_axis(tmp_path / "more", more)
        return
    notes = read_axis(tmp_path / "more", more).notes
    assert any("times what this machine takes" in note for note in notes) == (refused is not None)


def test_a_motor_that_goes_on_at_one_speed_has_no_position_in_another_unit(tmp_path):
    """Beside a straight line its position is noise, 2.4 times that of the integrated speed; the log was refused."""
    t, noise = 0.01 * np.arange(500, dtype=np.float64), np.random.default_rng(4)
    columns = {
        "time_s": t,
        "force_n": 20.4 + 0.2 * noise.normal(size=500),
        "velocity_m_s": 0.3 + 0.003 * np.cos(3.0 * t),
        "position_m": 0.3 * t + 0.003 * np.sin(3.0 * t),  # three times what the speed says, a thousandth of the way
    }
    assert "velocity_m_s" in read_axis(tmp_path / "even", columns)
    with pytest.raises(InputError, match=r"position_m changes 999.9 times as much as the integrated velocity_m_s"):
        read_axis(tmp_path / "in mm", {**columns, "position_m": 1000.0 * columns["position_m"]})


@pytest.mark.parametrize("scale", [9.5493, -1.0, 0.01])
def test_optional_signals_in_another_unit_are_dropped_and_said(tmp_path, scale):
    columns = hoist_columns(2000)
    columns["speed_reference_rad_s"] *= scale
    columns["position_carriage_m"] = scale * height(columns)
    columns["tension_dead_line_n"] = np.full(2000, scale * 30e3) + np.arange(2000) % 7
    run = read(tmp_path, columns)
    assert not {"speed_reference_rad_s", "position_carriage_m", "tension_dead_line_n"} & run.signals.keys()
    ends = [note.rpartition("is it ")[2] for note in run.notes]
    assert ends == [*2 * ["of another sign?" if scale < 0.0 else "in another unit?"], "in another unit?"]


# Wrong logs that can be read: each kind of edit of one run leaves a note that names it, and sound runs leave none.


recorded = cache(read_campaign)
HOISTS = ("17", "40")  # torque filtered, twice as large
AXES = ("09", "14")  # neither as rigid as the law that they are compared with

# What an axis' other runs, or the physics, cannot tell.
HIDDEN = {"start position 3 m off"}


@pytest.mark.parametrize("name", HOISTS)
def test_sound_runs_of_hoists_leave_no_note_whatever_effect_they_show(campaigns: Path, name: str):
    campaign = recorded(campaigns / name)
    assert doubts_of(campaign.machine, campaign.runs) == []


@pytest.mark.parametrize("name", AXES)
def test_sound_runs_of_axes_leave_no_note(shared_data: Path, name: str):
    campaign = recorded(shared_data / "axes" / name)
    assert doubts_of(campaign.machine, campaign.runs) == []


@pytest.mark.proof
def test_no_sound_run_of_all_recordings_leaves_a_note(shared_data: Path):
    runs = 0
    for runs_yaml in sorted(shared_data.glob("*/*/runs.yaml")):
        campaign = read_campaign(runs_yaml)
        runs += len(campaign.runs)
        assert doubts_of(campaign.machine, campaign.runs) == [], runs_yaml
    assert runs > 300


@pytest.mark.parametrize("edit", sorted(set(EDITS) - HIDDEN))
def test_an_edited_run_is_named_and_no_other(campaigns: Path, edit: str):
    campaign = recorded(campaigns / "01")
    for k in (1, 2):
        run = edited(campaign.machine, campaign.runs[k], edit, seed=k)
        if run is None:  # an empty run has no payload to lose
            continue
        notes = doubts_of(campaign.machine, [*campaign.runs[:k], run, *campaign.runs[k + 1 :]])
        assert notes
        assert all(note.startswith(f"{run.name}: ") and "check" in note for note in notes), notes


def test_a_start_position_is_held_against_the_logged_one(campaigns: Path):
    campaign = recorded(campaigns / "21")
    run = edited(campaign.machine, campaign.runs[2], "start position 3 m off", seed=0)
    assert run is not None
    (note,) = doubts_of(campaign.machine, [*campaign.runs[:2], run, *campaign.runs[3:]])
    assert note.startswith(f"{run.name}: position_carriage_m begins at ")
    assert note.endswith("check start_position_m")


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        ("force x 1.3", "times what the other runs' machine takes for this motion"),
        ("force with an offset", "off what its motion takes on average"),
        ("time x 1.2", "1.2 times as long"),
        ("noise x 10", "times as noisy as in the other runs"),
    ],
)
def test_an_edited_run_of_an_axis_is_named(shared_data: Path, edit: str, said: str):
    campaign = recorded(shared_data / "axes" / "01")

    def scaled(run: Run, change: Callable[[np.ndarray], np.ndarray]) -> Run:
        return replace(run, signals={**run.signals, "force_n": change(run["force_n"])})

    run = campaign.runs[1]
    if edit == "force x 1.3":
        run = scaled(run, lambda force: 1.3 * force)
    elif edit == "force with an offset":
        run = scaled(run, lambda force: force + 0.15 * np.ptp(force))
    else:
        run = edited(campaign.machine, run, edit, seed=1) or run
    notes = doubts_of(campaign.machine, [campaign.runs[0], run, *campaign.runs[2:]])
    assert any(note.startswith(f"{run.name}: ") and said in note for note in notes), notes


@pytest.mark.parametrize(("speed", "told"), [(0.1, False), (1.0, True)])
def test_a_run_that_goes_slower_may_be_quieter(speed: float, told: bool):
    """A wrist's run at 0.03 rad/s among runs at 0.05 to 1.5 was 0.29 times as noisy: "check its sensor, cable"."""
    time, random = 0.01 * np.arange(600.0), np.random.default_rng(2)

    def run(name: str, top: float, noise: float) -> Run:
        velocity = top * np.sin(time) + noise * random.normal(size=len(time))
        force = 95.0 * np.gradient(velocity, time) + random.normal(size=len(time))
        return Run(name, time, {"force_n": force, "velocity_m_s": velocity, "position_m": integrated(velocity, time)})

    runs = [*(run(f"run_{k}", 1.0, 0.01) for k in range(4)), run("odd", speed, 0.001)]
    notes = doubts_of(KINDS["axis-linear"].example(), runs)
    assert any("odd: velocity_m_s is" in note and "as noisy" in note for note in notes) == told


@pytest.mark.parametrize("gains", [False, True])
def test_a_run_without_input_coasts_and_one_that_gains_speed_has_a_dead_channel(tmp_path: Path, gains: bool):
    """A leg that was let go was refused, its torque zero throughout: a coast-down shows inertia and friction."""
    time = np.arange(0.0, 3.0, 0.002)
    speed = 0.8 * np.exp(-time) - 0.1
    speed = speed[::-1] if gains else np.maximum(speed, 0.0)
    (tmp_path / "runs").mkdir()
    for name, force in (("coast", 0.0 * time), ("driven", 95.0 * np.gradient(speed, time) + 20.0)):
        rows = np.column_stack([time, force, speed, integrated(speed, time)])
        header = "time_s,force_n,velocity_m_s,position_m"
        np.savetxt(tmp_path / "runs" / f"{name}.csv", rows, delimiter=",", header=header, comments="")
    runs = [f"- {{name: {name}, file: runs/{name}.csv, start_time_s: 0.0}}\n" for name in ("coast", "driven")]
    (tmp_path / "runs.yaml").write_text("runs:\n" + "".join(runs))
    save_machine(with_values(KINDS["axis-linear"].example(), {"gravity.constant_n": 0.0}), tmp_path / "machine.yaml")
    if gains:
        with pytest.raises(InputError, match="force_n is zero throughout, and the machine gains speed; is the channel"):
            read_campaign(tmp_path)
        return
    coasting, _ = read_campaign(tmp_path).runs
    assert "force_n is zero throughout: the machine coasts, or the channel is dead; check it" in coasting.notes
    with pytest.raises(InputError, match="force_n is zero throughout in every run; one at least has to be driven"):
        read_campaign(tmp_path, select="coast")


def test_a_stretch_that_rests_is_not_doubted_for_the_motion_that_it_has_not(campaigns: Path):
    """What is left behind a second without samples, of a run that had come to its end."""
    campaign = recorded(campaigns / "01")
    whole = campaign.runs[2]
    rows = whole.time_s > whole.time_s[-1] - 6.0
    still = replace(
        whole, name="rest", time_s=whole.time_s[rows], signals={k: v[rows] for k, v in whole.signals.items()}
    )
    speed = still.signals["speed_motor_rad_s"]
    assert np.max(np.abs(speed)) < 0.01 * np.max(np.abs(whole["speed_motor_rad_s"]))
    still = replace(still, signals={**still.signals, "torque_motor_nm": 0.9 * still["torque_motor_nm"]})
    assert doubts_of(campaign.machine, [*campaign.runs, still]) == []
    counted = replace(still, signals={**still.signals, "speed_motor_rad_s": 1e-3 * speed})
    assert doubts_of(campaign.machine, [*campaign.runs, counted]) == []


def test_a_run_that_stands_still_for_most_of_its_time_has_no_break_for_that(shared_data: Path):
    """Without a noise at rest its smallest step was 4e300 times as much; missing rows are told all the same."""
    campaign = recorded(shared_data / "axes" / "01")
    standing = []
    for run in (campaign.run("run1_fast"), campaign.run("run3_mid")):  # that come to rest
        n, still = len(run.time_s), 3 * len(run.time_s) // 2
        time = np.arange(n + still) * (run.time_s[1] - run.time_s[0])
        ends = {"velocity_m_s": 0.0, "position_m": run["position_m"][-1], "force_n": run["force_n"][-1]}
        signals = {k: np.append(run[k], np.full(still, v)) for k, v in ends.items() if k in run}
        standing.append(replace(run, time_s=time, signals=signals))
    assert not [note for note in doubts_of(campaign.machine, standing) if "breaks at" in note]
    whole = standing[0]
    speed = whole["velocity_m_s"]
    at = int(np.argmax(np.abs(speed[600:] - speed[:-600])))
    cut = {k: np.delete(v, slice(at, at + 600)) for k, v in whole.signals.items()}
    standing[0] = replace(whole, time_s=whole.time_s[:-600], signals=cut)
    (note,) = (note for note in doubts_of(campaign.machine, standing) if "breaks at" in note)
    assert note.startswith(f"{whole.name}: velocity_m_s breaks at") and "e+" not in note, note


def test_a_torque_upside_down_is_no_payload(campaigns: Path):
    campaign = recorded(campaigns / "01")
    run = campaign.run("half_fast")
    flipped = replace(run, signals={**run.signals, "torque_motor_nm": -run["torque_motor_nm"]})
    notes = doubts_of(campaign.machine, [flipped if one is run else one for one in campaign.runs])
    (load,) = (note for note in notes if "than the other runs let expect" in note)
    assert re.search(r"holds \d{4} N m less than the other runs let expect, -1\.\d\d times", load), load
    assert "would fit" not in load


def test_a_wrong_payload_is_told_with_the_one_that_fits(campaigns: Path):
    campaign = recorded(campaigns / "01")
    wrong = replace(campaign.run("half_fast"), payload_kg=4.5)
    runs = [wrong if run.name == wrong.name else run for run in campaign.runs]
    (note,) = doubts_of(campaign.machine, runs)
    fits = float(note.split("payload_kg: ")[1].split(" kg would fit")[0])
    assert fits == pytest.approx(4500.0, rel=0.05)


@given(
    band=st.floats(0.1, 0.5), seed=st.integers(0, 999), step=st.sampled_from([0.001, 0.01]), every=st.integers(2, 20)
)
def test_a_log_by_exception_shows_its_dead_band_and_no_other_log_has_one(
    band: float, seed: int, step: float, every: int
):
    t = np.arange(0.0, 20.0, step)
    value = 3.0 * np.sin(t) + 0.2 * band * np.random.default_rng(seed).normal(size=len(t))
    kept = value.copy()
    for k in range(1, len(kept)):
        kept[k] = value[k] if abs(value[k] - kept[k - 1]) > band else kept[k - 1]
    assert band <= dead_band(kept) < 1.5 * band
    for other in (value, value.round(4), np.round(value / band) * band, value[np.arange(len(t)) // every * every]):
        assert dead_band(other) == 0.0


def test_a_log_by_exception_is_told(shared_data: Path):
    campaign = recorded(shared_data / "axes" / "01")
    run = campaign.runs[1]
    force, kept = run["force_n"], run["force_n"].copy()
    band = 6.0 * float(np.std(np.diff(force)))
    for k in range(1, len(kept)):
        kept[k] = force[k] if abs(force[k] - kept[k - 1]) > band else kept[k - 1]
    run = replace(run, signals={**run.signals, "force_n": kept})
    notes = doubts_of(campaign.machine, [campaign.runs[0], run, *campaign.runs[2:]])
    assert any(note.startswith(f"{run.name}: force_n keeps its value until") and " N;" in note for note in notes), notes
