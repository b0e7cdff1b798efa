"""`workbench compare-models` and `plant: multibody`; words of the command line; no warning of a library."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.support.commands import Commands
from tests.support.scenario_text import study_of, write
from workbench.cli.options import keyed_number
from workbench.cli.show import WIDTH, filled
from workbench.core.errors import InputError
from workbench.machines import Hoist, default_hoist, save_machine, with_values
from workbench.study.run import run_study

SHORT = """\
name: short
payloads_kg: [4500]
start_position_m: 8.0
moves: [{by_m: 0.3}]
limits: {speed_m_s: 0.4, acceleration_m_s2: 0.6, jerk_m_s3: 2.0}
references: [ruckig]
lead_s: 0.2
settle_s: 0.3
controller: {kp_nm_s_per_rad: 31.0, ki_nm_per_rad: 122.0, sample_time_s: 0.004}
solver: {step_s: 0.004}
"""


def campaign(folder: Path, machine: Hoist) -> Path:
    """A run of 4 s that hangs still under its holding torque, with a little noise to be logged by."""
    (folder / "runs").mkdir(parents=True)
    save_machine(machine, folder / "machine.yaml")
    rows = [
        f"{0.01 * k:.2f},{298.7 + 0.3 * (k % 3):.1f},{298.5 + 0.1 * (k % 5):.1f},{0.01 * (-1) ** k:.2f}"
        for k in range(400)
    ]
    head = "time_s,torque_motor1_nm,torque_motor2_nm,speed_motor_rad_s"
    (folder / "runs" / "hang.csv").write_text("\n".join([head, *rows, ""]), encoding="utf-8")
    run = {"name": "hang", "file": "runs/hang.csv", "payload_kg": 4500.0, "start_position_m": 9.0}
    (folder / "runs.yaml").write_text(yaml.safe_dump({"runs": [run]}), encoding="utf-8")
    return folder


def test_a_campaign_gives_both_models_errors_and_their_cost(commands: Commands, tmp_path: Path):
    ended = commands("compare-models", campaign(tmp_path / "c", default_hoist()), "--out", tmp_path / "out")
    assert ended.status == 0, ended.err
    said = json.loads((tmp_path / "out" / "models.json").read_text(encoding="utf-8"))
    assert said["runs"][0]["apart_percent"] < 0.05
    assert said["overall"]["ratio"] > 1.0 and said["paper"]["multibody_s"] == 91.53
    assert "multi-body" in ended.out and (tmp_path / "out" / "models.html").stat().st_size > 10_000


def test_a_scenario_is_run_in_both_closed_loops(commands: Commands, tmp_path: Path):
    ended = commands("compare-models", write(tmp_path, SHORT), "--out", tmp_path / "out")
    assert ended.status == 0, ended.err
    said = json.loads((tmp_path / "out" / "models.json").read_text(encoding="utf-8"))
    assert said["against"] == "its reference"
    assert said["overall"]["apart_percent"] < 0.1


def test_a_study_runs_on_the_plant_that_its_scenario_names(tmp_path: Path):
    lumped, multibody = (run_study(study_of_text(tmp_path, SHORT + more)) for more in ("", "plant: multibody\n"))
    ours, other = lumped.rows[0], multibody.rows[0]
    assert (ours.status, other.status) == ("ok", "ok")
    assert other["peak_torque_motor_nm"] == pytest.approx(ours["peak_torque_motor_nm"], rel=5e-3)
    assert other["peak_torque_motor_nm"] != ours["peak_torque_motor_nm"]
    assert "force_cylinder_n" in multibody.runs[other.run_id]


def study_of_text(folder: Path, text: str):
    from workbench.study.load import load_study

    return load_study(write(folder, text))


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("plant: multi_body\n", "multibody"),
        ("plant: multibody\neffects: {backlash: {play_rad: 0.01}}\n", "no effect 'backlash'"),
        ("plant: multibody\nmachine_overrides: {arm.reach_m: 3.5}\n", "longest_reach_m"),
    ],
)
def test_a_plant_that_cannot_be_is_said_with_its_line(tmp_path: Path, more: str, said: str):
    with pytest.raises(InputError, match=said) as caught:
        study_of(tmp_path, more)
    assert "scenario.yaml:" in str(caught.value)


# Words of the command line: sentences wrapped to the width, and numbers by key.


UNITS = ("N m", "N m s/rad", "m/s³", "m/s²", "rad/s", "kN", "kg", "s", "%", "Hz")


@pytest.mark.parametrize("unit", UNITS)
def test_a_number_keeps_its_unit_wherever_the_line_ends(unit: str) -> None:
    for length in range(60, 110):
        text = f"{'x' * (length - 20)} goes from -297.5 {unit} to 317 {unit} with more to say"
        shown = filled(text)
        assert " ".join(shown.split("\n")) == text
        assert shown.count(f" -297.5 {unit}") + shown.count(f"\n-297.5 {unit}") == 1
        assert max(map(len, shown.splitlines())) <= WIDTH


def test_a_word_of_key_and_number_is_read_and_any_other_is_one_line():
    assert keyed_number(" guide.coulomb_hoisting_n = 9e3", "limits") == ("guide.coulomb_hoisting_n", 9000.0)
    assert keyed_number("heave.amplitude_m=-0.2", "effect", "NAME.PARAMETER=VALUE", parts=2)[1] == -0.2
    for word, parts in [("heavy", 1), ("=3", 1), ("a=nan", 1), ("a=3", 2), ("a.=3", 2), (".b=3", 2), ("a.b=x", 2)]:
        with pytest.raises(InputError, match=f"^limits: '{word}', expected KEY=VALUE$"):
            keyed_number(word, "limits", parts=parts)


# No warning of a library reaches the terminal: the commands run with warnings as errors, at zero damping.
# `tune` finds no gains there that keep a wire without damping stable behind a drive that lags, and says so in a line.


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
