"""A real ball-screw axis: the published values are found again, and its force residual is reproduced.

A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS", Workshop on Nonlinear
System Identification Benchmarks, Eindhoven, 2019. The records lie beside the checkout.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.support.commands import Commands
from tests.support.emps_campaign import PUBLISHED, emps_in
from workbench.machines import LinearAxis, load_machine


@pytest.fixture(scope="module")
def campaign(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The knowledge taken out: a rough mass and viscous friction, nothing else."""
    folder = tmp_path_factory.mktemp("emps") / "emps"
    return emps_in(folder, shared_data, mass=50.0, coulomb=0.0, viscous=50.0, offset=0.0)


def overall(folder: Path) -> Any:
    return json.loads((folder / "replay.json").read_text())["overall"]


def test_the_published_values_and_residuals_come_out(commands: Commands, campaign: Path, tmp_path: Path):
    done = commands("identify", campaign, "--runs", "train", "--out", tmp_path / "found")
    assert done.status == 0, done.err
    machine = load_machine(tmp_path / "found" / "machine.yaml")
    assert isinstance(machine, LinearAxis)
    assert machine.mass_kg == pytest.approx(PUBLISHED["mass"], rel=0.01)
    assert machine.friction.viscous_n_s_per_m == pytest.approx(PUBLISHED["viscous"], rel=0.01)
    assert machine.friction.coulomb_forward_n == pytest.approx(PUBLISHED["coulomb"], rel=0.01)
    assert machine.friction.coulomb_backward_n == pytest.approx(PUBLISHED["coulomb"], rel=0.01)
    assert machine.gravity.constant_n == pytest.approx(PUBLISHED["offset"], rel=0.01)
    assert overall(tmp_path / "found")["force_residual_percent"] <= 4.43

    words = ("--runs", "pulses", "--machine", tmp_path / "found" / "machine.yaml", "--out", tmp_path / "test")
    assert commands("replay", campaign, *words).status == 0
    assert overall(tmp_path / "test")["force_residual_percent"] <= 7.50


def test_the_published_values_lie_within_the_error_bars(commands: Commands, campaign: Path, tmp_path: Path):
    commands("identify", campaign, "--runs", "train", "--out", tmp_path / "found")
    said = json.loads((tmp_path / "found" / "identify.json").read_text())["parameters"]
    published = [PUBLISHED[name] for name in ("mass", "viscous", "coulomb", "coulomb", "offset")]
    for key, value in zip(said, published, strict=True):
        assert abs(said[key]["value"] - value) < 3.0 * said[key]["std_error"], key
        assert said[key]["std_error"] < 0.03 * abs(value), key
