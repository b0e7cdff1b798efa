"""Public recordings as campaigns, of logs of their form."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import recordings
from workbench.logs import read_campaign
from workbench.machines import get_value


def test_what_is_not_cloned_is_left_out_and_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """One of them ended the command in a traceback."""
    monkeypatch.setattr(sys, "argv", ["recordings", str(tmp_path / "clones"), str(tmp_path / "out")])
    recordings.main()
    said = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in said] == list(recordings.FAMILIES)
    assert all(": left out, " in line for line in said)


def test_a_joint_of_a_robot_begins_with_its_gravity(tmp_path: Path):
    time = np.arange(0.0, 40.0, 0.0107)
    time = np.round(time / 0.002) * 0.002  # as it is stamped
    angle, speed = -1.0 + 1.5 * np.sin(0.6 * time), 0.9 * np.cos(0.6 * time)
    torque = -4.0 * 0.54 * np.sin(0.6 * time) + 8.0 * speed + 5.0 * np.sign(speed) - 37.0 * np.sin(angle)
    columns = np.zeros((len(time), 31))
    columns[:, 0], columns[:, 3], columns[:, 9] = time + 1297.5, angle, speed
    columns[:, 15] = torque / recordings.ROBOT_NM_PER_A[2]
    folder = tmp_path / "dynamic_calibration/dataset_ur10e/jointwise_motion"
    folder.mkdir(parents=True)
    np.savetxt(folder / "ur-20_01_22-joint_3.csv", columns, delimiter=",", fmt="%.4f")
    recordings.campaign(tmp_path / "robot_elbow", dict(recordings.robot(3)(tmp_path)))
    read = read_campaign(tmp_path / "robot_elbow")
    assert get_value(read.machine, "gravity.sine_nm") == pytest.approx(-37.0, rel=0.01)
    assert get_value(read.machine, "inertia_kg_m2") == pytest.approx(4.0, rel=0.05)
    assert read.runs[0].time_s[0] == 0.0 and math.isclose(read.runs[0].duration_s, 40.0, abs_tol=0.02)


def test_what_a_drive_notes_before_its_loop_runs_is_left_out(tmp_path: Path):
    time = np.concatenate([[0.1, 0.2], 0.9 + 0.002 * np.arange(500)])
    columns = np.column_stack([time, np.sin(time), np.cos(time), 0.5 * time])
    np.savetxt(
        tmp_path / "step.csv", columns, delimiter=",", header="# of one drive\ntime,angle,speed,current", comments=""
    )
    ((name, read),) = recordings.drive("{}.csv", (0, 1, 2, 3), {"first": "step"}, 2.0)(tmp_path)
    assert name == "first" and np.array_equal(read["time_s"], time[2:])
    assert read["torque_nm"] == pytest.approx(time[2:])
