"""No warning of a library reaches the terminal: the commands run with warnings as errors, at zero damping.

`tune` finds no gains there that keep a wire without damping stable behind a drive that lags, and says so in a line.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from workbench.machines import default_hoist, save_machine, with_values

STUDY = """
name: undamped
machine: undamped.yaml
payloads_kg: [9000]
moves: [{by_m: 3.0}]
start_position_m: 4.0
limits: {speed_m_s: 0.7, acceleration_m_s2: 0.6, jerk_m_s3: 0.8}
references: [trapezoid, ruckig, ruckig_equal_time, ruckig_least_peak, optimal, zv, zvd, ei, seventh_order]
controller: {kp_nm_s_per_rad: 31.0, ki_nm_per_rad: 122.0}
"""
AT = ["--machine", "undamped.yaml", "--payloads", "9000", "--heights", "5"]


@pytest.mark.parametrize(
    ("command", "status"), [(["loop", *AT], 0), (["tune", *AT], 2), (["study", "study.yaml"], 0)],
    ids=["loop", "tune", "study"],
)  # fmt: skip
def test_at_zero_damping_no_library_warns(command: list[str], status: int, tmp_path: Path):
    save_machine(with_values(default_hoist(), {"wire.damping_time_s": 0.0}), tmp_path / "undamped.yaml")
    (tmp_path / "study.yaml").write_text(STUDY, encoding="utf-8")
    words = [sys.executable, "-W", "error", "-m", "workbench", *command, "--out", str(tmp_path / "out.yaml")]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == status, done.stderr
    assert "Warning" not in done.stderr
