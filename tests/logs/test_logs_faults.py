"""Each fault of a log: refused by file, run, column and time, or repaired and said so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io

from tests.support.log_campaign import AXIS, RUNS, Array, axis_columns, csv_text, hoist_columns, write_campaign
from workbench.cli.campaign import load_campaign
from workbench.core.errors import InputError
from workbench.core.run import Run
from workbench.logs import read_campaign
from workbench.logs.campaign import RunsError
from workbench.machines import default_hoist, kind_of

AXIS_RUNS = "runs:\n- {name: lift, file: runs/lift.csv}\n"


def read(folder: Path, columns: dict[str, Array] | str) -> Run:
    return read_campaign(write_campaign(folder, columns)).runs[0]


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
    "\n\n": "is empty",
    LINES[0]: "holds only the header; expected at least 10 samples",
    "\n".join(LINES[:2]): "holds 1 row; expected at least 10 samples",
    "\n".join(LINES[1:]): "has no header: the first row is numbers (0.0, …)",
    TEXT.replace(",", ";"): "columns are separated by semicolons; expected commas",
    TEXT.replace(",", ";").replace(".", ","): "expected commas and decimal points",
    TEXT.replace(",", "\t"): "columns are separated by tabs",
    TEXT.replace("torque_motor2_nm", "torque_motor1_nm"): "column 'torque_motor1_nm' is doubled",
    TEXT.replace(
        "speed_motor_rad_s", "speed_motor_rads"
    ): "no column speed_motor_rad_s; did you mean 'speed_motor_rads'?",
    TEXT.replace("time_s", "zeit"): "no column time_s; the file has: zeit, torque_motor1_nm",
    with_line(100, "0.98,1,2,3"): "lift.csv:100: lift: row has 4 fields, the header 5 columns; is the file cut off?",
    with_line(100, "0.98,1,2,3,4,5"): "lift.csv:100: lift: row has 6 fields, the header 5 columns",
    with_line(100, "0,98,296,4,301,2,0,31,0,31"): "row has 10 fields, the header 5 columns; are there decimal commas?",
    with_line(100, "0.98,1,fault,3,4"): "lift.csv:100: lift: torque_motor2_nm: 'fault' is not a number",
    with_line(
        100, '0.98,1,"296,4",3,4'
    ): "lift.csv:100: lift: torque_motor2_nm: '296,4' is not a number; write decimal",
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


def test_damaged_parquet_and_mat_files_are_refused(tmp_path):
    for suffix, words in (("parquet", "is not a readable Parquet file"), ("mat", "is not a readable MAT file")):
        file = other_format(tmp_path, suffix)
        file.write_bytes(b"PAR1 nothing of the kind" * 20)
        with pytest.raises(InputError, match=f"lift.{suffix}: lift: {words}"):
            read_campaign(tmp_path)
        file.write_bytes(b"")
        with pytest.raises(InputError, match=f"lift.{suffix}: lift: "):
            read_campaign(tmp_path)


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


def test_a_damaged_file_of_the_newest_matlab_format_is_one_line(tmp_path):
    file = other_format(tmp_path, "mat")
    file.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n")
    with pytest.raises(InputError, match="is not a readable MAT file"):
        read_campaign(tmp_path)


def test_matlab_vectors_of_unequal_length_are_refused(tmp_path):
    file = other_format(tmp_path, "mat")
    scipy.io.savemat(file, hoist_columns() | {"speed_motor_rad_s": np.ones(499)})
    with pytest.raises(InputError, match=r"columns differ in length: time_s 500, .*speed_motor_rad_s 499"):
        read_campaign(tmp_path)


def test_matlab_matrix_and_text_are_no_columns(tmp_path):
    file = other_format(tmp_path, "mat")
    scipy.io.savemat(file, hoist_columns() | {"time_s": np.ones((4, 500)), "note": "a log"})
    with pytest.raises(InputError, match=r"no column time_s; the file has: torque_motor1_nm"):
        read_campaign(tmp_path)


def test_complex_matlab_vector_is_refused(tmp_path):
    file = other_format(tmp_path, "mat")
    scipy.io.savemat(file, hoist_columns() | {"speed_motor_rad_s": np.ones(500) * 1j})
    with pytest.raises(InputError, match=r"speed_motor_rad_s: holds complex128, expected real numbers"):
        read_campaign(tmp_path)


# Time


def test_time_going_backwards_is_named_by_row(tmp_path):
    columns = hoist_columns()
    columns["time_s"][200] = 1.5
    assert "time_s goes backwards from 1.99 s to 1.5 s at line 202" in refusal(tmp_path, columns)


def test_line_of_a_fault_counts_blank_lines(tmp_path):
    columns = hoist_columns()
    columns["time_s"][200] = 1.5
    text = csv_text(columns).replace("\n0.0,", "\n\n\n0.0,", 1)
    assert "at line 204" in refusal(tmp_path, text)


def test_missing_and_infinite_time_are_named_by_row(tmp_path):
    columns = hoist_columns()
    columns["time_s"][200] = np.nan
    assert "time_s is missing at line 202, after 1.99 s" in refusal(tmp_path, columns)
    columns["time_s"][200] = np.inf
    assert "time_s is infinite at line 202" in refusal(tmp_path, columns)


def test_time_that_stands_still_is_refused(tmp_path):
    columns = hoist_columns()
    columns["time_s"][:] = 3.0
    assert "time_s stands still at 3 s" in refusal(tmp_path, columns)


def test_time_in_milliseconds_is_suspected(tmp_path):
    columns = hoist_columns()
    columns["time_s"] *= 1000.0
    assert (
        "step of 10 s, expected at most 0.5 s; if it is in milliseconds, give the column a scale of 0.001"
        in refusal(tmp_path, columns)
    )


def test_time_in_days_is_suspected(tmp_path):
    columns = hoist_columns()
    columns["time_s"] /= 86400.0
    assert "is it in days or hours?" in refusal(tmp_path, columns)


def test_log_of_a_tenth_of_a_second_is_refused(tmp_path):
    assert "time_s spans 0.0998 s, expected at least 0.2 s" in refusal(tmp_path, hoist_columns(500, 0.0002))


def test_repeated_samples_are_dropped_and_said(tmp_path):
    text = "\n".join([*LINES[:100], LINES[99], LINES[99], *LINES[100:]])
    run = read(tmp_path, text)
    assert np.array_equal(run.time_s, hoist_columns()["time_s"])
    assert run.notes == ("2 repeated samples (same time, same values) dropped, first at 0.98 s",)


def test_few_repeated_stamps_with_other_values_are_averaged_and_said(tmp_path):
    columns = hoist_columns()
    columns["time_s"][100] = columns["time_s"][99]
    run = read(tmp_path, columns)
    assert len(run.time_s) == 499
    assert run["speed_motor_rad_s"][99] == pytest.approx(columns["speed_motor_rad_s"][99:101].mean(), rel=1e-15)
    assert run.notes[0] == "1 samples repeat a time stamp with other values, averaged, first at 0.99 s"


def test_stamps_rounded_too_coarsely_are_refused(tmp_path):
    columns = hoist_columns()
    columns["time_s"] = columns["time_s"].round(1)
    assert "samples repeat a time stamp with other values, first at 0 s; are the stamps rounded" in refusal(
        tmp_path, columns
    )


def test_irregular_time_and_gaps_are_kept_and_said(tmp_path):
    columns = {name: np.delete(column, slice(200, 230)) for name, column in hoist_columns().items()}
    run = read(tmp_path, columns)
    assert np.array_equal(run.time_s, columns["time_s"])
    assert run.notes == (
        "time is irregular: steps from 0.01 to 0.31 s, median 0.01 s; kept as is",
        "1 gap in time, the longest from 1.99 s to 2.3 s; signals count as straight lines there",
    )


# Missing samples and dead channels


def test_short_gap_is_bridged_by_a_straight_line_and_said(tmp_path):
    columns = hoist_columns()
    columns["speed_motor_rad_s"][300:304] = np.nan
    run = read(tmp_path, columns)
    before, after = columns["speed_motor_rad_s"][299], columns["speed_motor_rad_s"][304]
    assert run["speed_motor_rad_s"][299:305] == pytest.approx(np.linspace(before, after, 6), rel=1e-9)
    assert run.notes == ("speed_motor_rad_s: 4 missing samples in 1 gap bridged by straight lines, first at 3 s",)


def test_the_stretches_before_and_behind_a_hole_are_used_each_as_a_run(tmp_path):
    columns = hoist_columns()
    columns["torque_motor2_nm"][300:400] = np.nan
    write_campaign(tmp_path, columns)
    first, second = read_campaign(tmp_path).runs
    assert (first.name, second.name) == ("lift", "lift_2")
    assert np.array_equal(first.time_s, columns["time_s"][:300])
    assert np.array_equal(second["speed_motor_rad_s"], columns["speed_motor_rad_s"][400:])
    said = "samples are missing from 3 s to 3.99 s; the stretches before and behind are used, each as a run"
    assert first.notes[0] == second.notes[0] == said
    way_m = kind_of(default_hoist()).transmission_of(default_hoist()) * np.trapezoid(
        columns["speed_motor_rad_s"][:401], dx=0.01
    )
    assert second.start_position_m == pytest.approx(first.start_position_m + way_m, abs=1e-6)
    assert second.start_time_s == pytest.approx(first.start_time_s + 4.0)


def test_a_hole_that_leaves_less_than_half_is_refused_by_time(tmp_path):
    columns = hoist_columns()
    columns["torque_motor2_nm"][100:460] = np.nan
    assert "torque_motor2_nm: 360 samples in a row are missing from 1 s to 4.59 s" in refusal(tmp_path, columns)


def test_all_faults_of_all_runs_are_told_at_once_with_what_goes_on(tmp_path):
    runs = "".join(
        f"- {{name: {name}, file: runs/{name}.csv, payload_kg: 0.0, start_position_m: 9.0}}\n" for name in "abc"
    )
    columns = hoist_columns()
    write_campaign(tmp_path, columns, runs=f"runs:\n{runs}")
    (tmp_path / "runs" / "lift.csv").rename(tmp_path / "runs" / "b.csv")
    (tmp_path / "runs" / "a.csv").write_text("")
    with pytest.raises(InputError) as caught:
        read_campaign(tmp_path)
    said = str(caught.value)
    assert "a.csv: a: is empty; " in said
    assert "runs.yaml:4: c: runs/c.csv: no such file" in said
    assert isinstance(caught.value, RunsError)
    assert caught.value.sound == ("b",)
    with pytest.raises(InputError, match=r"; leave it out: --runs b$"):
        load_campaign(tmp_path)
    assert [run.name for run in read_campaign(tmp_path, select="b").runs] == ["b"]


def test_long_gap_in_an_optional_signal_drops_it_and_says_so(tmp_path):
    columns = hoist_columns()
    columns["speed_reference_rad_s"][300:340] = np.nan
    run = read(tmp_path, columns)
    assert "speed_reference_rad_s" not in run
    assert run.notes[0].startswith("speed_reference_rad_s dropped: 40 samples in a row are missing from 3 s")


def test_signal_that_ends_early_shortens_the_run_and_says_so(tmp_path):
    columns = hoist_columns()
    columns["speed_motor_rad_s"][450:] = np.nan
    run = read(tmp_path, columns)
    assert run.time_s[-1] == 4.49
    assert run.notes == ("speed_motor_rad_s ends at 4.49 s; the run's last 50 samples are cut off",)


def test_signal_that_ends_in_the_first_half_is_refused(tmp_path):
    columns = hoist_columns()
    columns["speed_motor_rad_s"][200:] = np.nan
    assert "speed_motor_rad_s ends at 1.99 s, the run at 4.99 s" in refusal(tmp_path, columns)


def test_signal_without_any_number_is_refused(tmp_path):
    columns = hoist_columns()
    columns["speed_motor_rad_s"][:] = np.nan
    assert "speed_motor_rad_s holds no numbers at all" in refusal(tmp_path, columns)


def test_many_scattered_missing_samples_are_refused(tmp_path):
    columns = hoist_columns()
    columns["speed_motor_rad_s"][1:-1:10] = np.nan
    assert "50 of 500 samples are missing, the first at 0.01 s" in refusal(tmp_path, columns)


def test_infinite_sample_is_refused_by_column_and_time(tmp_path):
    columns = hoist_columns()
    columns["speed_motor_rad_s"][123] = -np.inf
    assert "speed_motor_rad_s is infinite at 1.23 s" in refusal(tmp_path, columns)


def test_mapped_column_is_named_beside_its_signal(tmp_path):
    columns = hoist_columns()
    columns["n"] = columns.pop("speed_motor_rad_s")
    columns["n"][123] = np.inf
    write_campaign(tmp_path, columns, runs="columns: {speed_motor_rad_s: n}\n" + RUNS)
    with pytest.raises(InputError, match=r"speed_motor_rad_s \(column 'n'\) is infinite at 1.23 s"):
        read_campaign(tmp_path)


def test_all_zeros_are_refused(tmp_path):
    columns = {name: column if name == "time_s" else 0.0 * column for name, column in hoist_columns().items()}
    assert "torque_motor1_nm is zero throughout; a hoist's motors hold its load" in refusal(tmp_path, columns)


def test_dead_channel_of_one_motor_is_refused(tmp_path):
    columns = hoist_columns()
    columns["torque_motor2_nm"][:] = 0.0
    assert "torque_motor2_nm is zero throughout" in refusal(tmp_path, columns)


def test_frozen_channel_is_refused(tmp_path):
    columns = hoist_columns()
    columns["speed_motor_rad_s"][:] = 12.5
    assert "speed_motor_rad_s is 12.5 throughout; is the channel frozen?" in refusal(tmp_path, columns)


def test_hoist_that_holds_still_reads_with_a_note_and_keeps_its_reference(tmp_path):
    columns = hoist_columns()
    columns["speed_motor_rad_s"][:] = 0.0
    columns["speed_reference_rad_s"][:] = 0.0
    run = read(tmp_path, columns)
    assert "speed_reference_rad_s" in run
    assert run.notes == ("the machine stands still throughout; this run says nothing of friction or inertia",)


def test_optional_column_of_zeros_is_dropped_and_said(tmp_path):
    run = read(tmp_path, hoist_columns() | {"tension_dead_line_n": np.zeros(500)})
    assert "tension_dead_line_n" not in run
    assert run.notes == ("tension_dead_line_n dropped: it is zero throughout",)


def test_clipped_channel_is_pointed_out(tmp_path):
    columns = hoist_columns()
    level = np.percentile(columns["torque_motor1_nm"], 80)
    columns["torque_motor1_nm"] = np.minimum(columns["torque_motor1_nm"], level)
    notes = read(tmp_path, columns).notes
    assert len(notes) == 1
    assert notes[0].startswith(f"torque_motor1_nm may be clipped: 100 samples at its largest value {level:g}")


# Units and sizes


def test_speed_in_rpm_is_named_with_its_scale(tmp_path):
    columns = hoist_columns()
    columns["speed_motor_rad_s"] *= 60 / (2 * np.pi)
    text = refusal(tmp_path, columns)
    assert "reaches 573 rad/s, the machine's nominal speed is 157.1 rad/s; is it in rpm?" in text
    assert "scale of 0.10472" in text


def test_slow_run_in_rpm_is_found_by_where_it_would_take_the_carriage(tmp_path):
    columns = hoist_columns(12000)
    for name in ("speed_motor_rad_s", "speed_reference_rad_s"):
        columns[name] *= 0.3 * 60 / (2 * np.pi)
    assert "the rail goes from 0 to 25 m; is the speed in rpm" in refusal(tmp_path, columns)


def test_samples_of_too_much_speed_are_pointed_out_and_kept(tmp_path):
    columns = hoist_columns()
    columns["speed_motor_rad_s"][77:80] = 900.0  # too long for a spike
    run = read(tmp_path, columns)
    assert run["speed_motor_rad_s"][77] == 900.0
    assert "speed_motor_rad_s: 3 samples beyond twice the nominal speed, first at 0.77 s" in run.notes


def test_torque_in_kilonewton_metres_or_of_the_drum_is_refused(tmp_path):
    columns = hoist_columns()
    for factor, words in ((1e-3, "is it in kN m or per cent"), (31.0, "is it the drum's torque")):
        scaled = columns | {name: columns[name] * factor for name in ("torque_motor1_nm", "torque_motor2_nm")}
        assert words in refusal(tmp_path, scaled)


def test_flipped_torque_and_one_motors_torque_for_the_sum_are_pointed_out(tmp_path):
    columns = hoist_columns()
    one, _ = columns.pop("torque_motor1_nm"), columns.pop("torque_motor2_nm")
    assert "is it one motor's only?" in read(tmp_path, columns | {"torque_motor_nm": one}).notes[0]
    assert "is its sign flipped?" in read(tmp_path, columns | {"torque_motor_nm": -2 * one}).notes[0]


def test_payload_in_newtons_is_pointed_out(tmp_path):
    columns = hoist_columns()
    for name in ("torque_motor1_nm", "torque_motor2_nm"):
        columns[name] *= 1.6
    folder = write_campaign(tmp_path, columns, runs=RUNS.replace("4500.0", "170000.0"))
    with pytest.raises(InputError, match="or is the payload wrong"):
        read_campaign(folder)
    columns["speed_motor_rad_s"][:] = 0.0
    folder = write_campaign(tmp_path, columns, runs=RUNS.replace("4500.0", "170000.0"))
    assert read_campaign(folder).runs[0].notes[0].startswith("payload 170000 kg is more than 20 times the carriage's")


def test_axis_without_force_is_refused_and_one_at_rest_said(tmp_path):
    columns = axis_columns()
    write_campaign(tmp_path, columns | {"force_n": 0.0 * columns["force_n"]}, runs=AXIS_RUNS, machine=AXIS)
    with pytest.raises(InputError, match=r"lift.csv: lift: force_n is zero throughout"):
        read_campaign(tmp_path)
    still = np.full(500, 0.25)
    write_campaign(
        tmp_path, columns | {"position_m": still, "position_reference_m": still}, runs=AXIS_RUNS, machine=AXIS
    )
    run = read_campaign(tmp_path).runs[0]
    assert run.start_position_m == 0.25
    assert run.notes == ("the machine stands still throughout; this run says nothing of friction or inertia",)


def test_dead_velocity_beside_a_position_is_dropped_and_said(tmp_path):
    columns = axis_columns() | {"velocity_m_s": np.zeros(500)}
    run = read_campaign(write_campaign(tmp_path, columns, runs=AXIS_RUNS, machine=AXIS)).runs[0]
    assert "velocity_m_s" not in run
    assert run.notes == ("velocity_m_s dropped: it is zero throughout",)
