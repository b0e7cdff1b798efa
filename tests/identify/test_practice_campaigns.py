"""Recorded campaigns of machines whose source nobody here has: replay and identify tell sensible figures on each."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.support.commands import Commands
from workbench.machines import Hoist, load_machine

WITHOUT_A_GAP = ("01", "20", "25", "26", "27", "28")
# Of the two hoists: friction, a large load error, two effects at once, one that no effect explains.
DAILY = ("01", "20", "25", "05", "15", "24", "29", "33")
LEVELS = ("guide.coulomb_hoisting_n", "guide.coulomb_lowering_n")


def read_json(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def assert_finite(data: Any, place: str = "") -> None:
    for key, value in data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ():
        assert value is not None, f"{place}.{key}"
        assert not isinstance(value, float) or math.isfinite(value), f"{place}.{key}"
        assert_finite(value, f"{place}.{key}")


def daily(numbers: Sequence[str]) -> list[Any]:
    return [pytest.param(number, marks=[] if number in DAILY else [pytest.mark.proof]) for number in numbers]


@pytest.mark.parametrize("number", daily(WITHOUT_A_GAP))
def test_a_machine_without_a_gap_is_explained_down_to_the_noise(
    commands: Commands, campaigns: Path, tmp_path: Path, number: str
):
    out = tmp_path / "out"
    done = commands("identify", campaigns / number, "--out", out)
    assert done.status == 0, done.err
    said = read_json(out / "identify.json")
    assert_finite(said)
    assert commands("replay", campaigns / number, "--out", tmp_path / "replay").status == 0
    assert read_json(tmp_path / "replay" / "replay.json")["overall"] == said["before"]
    before, after = said["before"], said["after"]
    assert after["torque_residual_rms_moving_nm"] <= 1.3 * after["noise_rms_nm"]
    assert 0.5 < before["speed_rmse_percent"] < 20.0
    assert after["speed_rmse_percent"] < 1.0
    assert after["speed_rmse_percent"] < before["speed_rmse_percent"]
    machine = load_machine(campaigns / number / "machine.yaml")
    assert isinstance(machine, Hoist)
    for key in LEVELS:
        entry = said["parameters"][key]
        assert abs(entry["value"] - entry["nominal"]) < 4.0 * machine.tolerances.coulomb * entry["nominal"], key
        assert 0.0 < entry["std_error"] < entry["nominal"]
