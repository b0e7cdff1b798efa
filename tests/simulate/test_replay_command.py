"""`workbench replay`: figures that are right, files as the format says, bad input in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.commands import Commands
from tests.support.log_campaign import AXIS, csv_text
from tests.support.simulated_campaign import TORQUE_NOISE_NM, simulated_campaign, true_machine
from workbench.logs import read_campaign
from workbench.machines import default_hoist, save_machine, with_values
from workbench.simulate.replay import replay_runs


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated_campaign(tmp_path_factory.mktemp("replay") / "lifts")


def read_json(path: Path) -> Any:
    def refuse(word: str) -> float:
        raise AssertionError(f"{word} is no JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


def test_the_true_machine_leaves_only_noise(commands: Commands, campaign: Path, tmp_path: Path):
    save_machine(true_machine(), tmp_path / "true.yaml")
    done = commands("replay", campaign, "--machine", tmp_path / "true.yaml", "--out", tmp_path / "out")
    assert done.status == 0, done.err
    overall = read_json(tmp_path / "out" / "replay.json")["overall"]
    # The sum of two channels' white noise, of which the band keeps band / Nyquist of the power.
    noise = TORQUE_NOISE_NM * np.sqrt(2.0 * overall["band_hz"] / 50.0)
    assert overall["noise_rms_nm"] == pytest.approx(noise, rel=0.1)
    assert overall["torque_residual_rms_moving_nm"] < 1.2 * noise
    assert overall["speed_rmse_percent"] < 0.5
    assert "the model explains these runs" in " ".join(done.out.split())


def test_a_lack_of_friction_shows_as_the_torque_it_takes(commands: Commands, campaign: Path, tmp_path: Path):
    assert commands("replay", campaign, "--out", tmp_path / "out").status == 0
    overall = read_json(tmp_path / "out" / "replay.json")["overall"]
    # 1200 N and 900 N missing, on the lever of 0.6 m drum, two falls, ratio 31.
    lever = 0.6 / 4.0 / 31.0
    assert 900.0 * lever < overall["torque_residual_rms_moving_nm"] < 1200.0 * lever
    assert 1.0 < overall["speed_rmse_percent"] < 20.0
    assert overall["speed_rmse_percent_restarted_2s"] < overall["speed_rmse_percent"]


def axis_campaign(folder: Path, *, speed_logged: bool) -> Path:
    """A linear axis of exactly AXIS' values, moved by a sine, with the force that it takes."""
    time = np.arange(4000) * 0.001
    w = 2 * np.pi * 0.5
    position, speed = 0.1 * np.sin(w * time), 0.1 * w * np.cos(w * time)
    force = -95.1089 * 0.1 * w**2 * np.sin(w * time) + 203.5 * speed + 20.39 * np.clip(speed / 1e-4, -1.0, 1.0)
    columns = {"time_s": time, "force_n": force, "position_m": position}
    if speed_logged:
        columns["velocity_m_s"] = speed
    (folder / "runs").mkdir(parents=True)
    (folder / "runs" / "sine.csv").write_text(csv_text(columns))
    (folder / "machine.yaml").write_text(AXIS)
    (folder / "runs.yaml").write_text("runs:\n- {name: sine, file: runs/sine.csv}\n")
    return folder


@pytest.mark.parametrize("speed_logged", [True, False])
def test_a_linear_axis_says_force_and_newton(commands: Commands, tmp_path: Path, speed_logged: bool):
    folder = axis_campaign(tmp_path / "axis", speed_logged=speed_logged)
    done = commands("replay", folder, "--out", tmp_path / "out")
    assert done.status == 0, done.err
    overall = read_json(tmp_path / "out" / "replay.json")["overall"]
    assert {"force_residual_rms_n", "force_residual_percent"} <= overall.keys()
    assert not any("torque" in key for key in overall)
    assert overall["force_residual_percent"] < 2.0  # the Coulomb force's edges, and nothing else
    assert "force" in done.out
    assert "torque" not in done.out


BAD: list[tuple[list[str], str]] = [
    (["NOWHERE"], "no such campaign"),
    (["MACHINE"], "is a machine; expected a campaign's folder"),
    (["CAMPAIGN", "--runs", "empty,fulll"], "no run 'fulll'; did you mean 'full'?"),
    (["CAMPAIGN", "--band", "0"], "--band: 0 Hz, expected at least 0.25 Hz"),
    (["CAMPAIGN", "--band", "50"], "less than 50 Hz (half the sampling rate)"),
    (["CAMPAIGN", "--band", "nan"], "--band: nan Hz"),
    (["CAMPAIGN", "--machine", "NOWHERE"], "no such file"),
    (["CAMPAIGN", "--machine", "AXIS"], "is another kind of machine than the campaign's"),
]


@pytest.mark.parametrize("name", ["replay", "identify"])
@pytest.mark.parametrize(("words", "problem"), BAD)
def test_bad_input_is_one_line_and_leaves_nothing(
    commands: Commands, campaign: Path, tmp_path: Path, name: str, words: list[str], problem: str
):
    (tmp_path / "axis.yaml").write_text(AXIS)
    places = {
        "CAMPAIGN": campaign,
        "NOWHERE": tmp_path / "nowhere",
        "MACHINE": campaign / "machine.yaml",
        "LOG": campaign / "runs" / "full.csv",
        "AXIS": tmp_path / "axis.yaml",
    }
    done = commands(name, *[places.get(word, word) for word in words], "--out", tmp_path / "out")
    assert done.status == 2
    assert problem in done.err
    assert "Traceback" not in done.err
    assert done.out == ""
    assert len([line for line in done.err.splitlines() if line.lower().startswith("error")]) == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["axis.yaml"]


def test_an_identified_machine_is_compared_in_its_own_band(campaign: Path):
    read = read_campaign(campaign)
    machine = with_values(default_hoist(), {"wire.youngs_modulus_pa": 8e10})
    known = machine.model_copy(update={"identified": {"band_hz": 1.25}})
    assert replay_runs(known, read.runs).band_hz == 1.25
    assert replay_runs(machine, read.runs).band_hz != 1.25
