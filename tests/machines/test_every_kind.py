"""Every kind of machine goes through the commands, or says in one line what it lacks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.commands import Commands
from tests.support.driven_campaign import driven, planned, write
from workbench.analysis.usual import usual_settings
from workbench.control import form_of
from workbench.core.yaml_strict import dumps
from workbench.identify.identify import identify
from workbench.logs import read_campaign
from workbench.machines import KINDS, get_value, save_machine, with_values

AXES = [name for name, kind in KINDS.items() if kind.looped.position_loop]


def reach(machine: Any, kind: Any) -> tuple[float, float]:
    """A speed and a way that suit the example."""
    top = kind.looped.top_speed(machine).speed
    speed = 0.7 * top if np.isfinite(top) else {"m": 0.3, "rad": 6.0}[kind.moved.unit]
    strongest = machine.drive.limit / (2.2 * kind.looped.total_inertia(machine, 0.0))  # `planned` takes 8 / s of speed
    speed = min(speed, strongest / 8.0)
    return speed, 4.0 * speed if np.isfinite(top) else speed


@pytest.fixture(scope="module", params=AXES)
def heavier(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str, float, Path]:
    """(kind, key of its inertia, the true one, a campaign whose machine.yaml has a tenth less)."""
    kind = KINDS[request.param]
    nominal = kind.example()
    key = nominal.value_of["inertia"]
    true = 1.1 * get_value(nominal, key)
    speed, way = reach(nominal, kind)
    motions = [planned(nominal, "slow", way / 4.0, speed / 5.0), planned(nominal, "fast", way, speed)]
    machine = with_values(nominal, {key: true})
    clean = driven(machine, motions, {})
    noise = {
        kind.plant.input: 1e-3 * max(float(np.max(np.abs(run[kind.plant.input]))) for run in clean),
        kind.plant.speeds[0]: 1e-5 * speed,
    }
    folder = write(tmp_path_factory.mktemp("every") / request.param, nominal, driven(machine, motions, noise))
    return request.param, key, true, folder


def test_identification_finds_the_inertia(heavier: tuple[str, str, float, Path]):
    name, key, true, folder = heavier
    identified = identify(read_campaign(folder))
    number = [free.key for free in identified.fit.free].index(key)
    # Of two inertias the runs show the sum: the motor's stays within its tolerance, and the load's takes the rest.
    if name == "two_inertia":
        number_l = [free.key for free in identified.fit.free].index("load.inertia_kg_m2")
        nominal = KINDS[name].example()
        total = identified.fit.value[number] + identified.fit.value[number_l]
        assert total == pytest.approx(true + nominal.load.inertia_kg_m2, rel=0.01)
    else:
        assert identified.fit.value[number] == pytest.approx(true, rel=0.01)


def test_replay_reports_it(heavier: tuple[str, str, float, Path], capsys: pytest.CaptureFixture[str], tmp_path: Path):
    name, _, _, folder = heavier
    done = Commands(capsys)("replay", folder, "--out", tmp_path / "replay")
    assert done.status == 0, done.err
    overall = json.loads((tmp_path / "replay" / "replay.json").read_text())["overall"]
    assert overall[f"{KINDS[name].drive.quantity}_residual_rms_{KINDS[name].drive.suffix}"] > 0.0


@pytest.mark.parametrize(
    "name", [name if name == "slew_boom" else pytest.param(name, marks=pytest.mark.proof) for name in AXES]
)
def test_study_loop_and_tune_take_its_example(name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path):
    kind = KINDS[name]
    machine = kind.example()
    save_machine(machine, tmp_path / "machine.yaml")
    (speed, way), unit = reach(machine, kind), kind.moved.unit
    controller = usual_settings(machine)[0]
    assert form_of(controller) in ("linear", "rotary")
    scenario = {
        "format": 1,
        "name": "example",
        "machine": "machine.yaml",
        f"start_position_{unit}": 0.0,
        "moves": [{f"by_{unit}": way}, {"dwell_s": 0.2}, {f"by_{unit}": -way}],
        "limits": {f"speed_{unit}_s": speed, f"acceleration_{unit}_s2": speed, f"jerk_{unit}_s3": 10.0 * speed},
        "references": ["ruckig"],
        "controller": controller.model_dump(exclude_none=True),
    }
    (tmp_path / "scenario.yaml").write_text(dumps(scenario), encoding="utf-8")
    run = Commands(capsys)
    for words in (("study", tmp_path / "scenario.yaml"), ("loop", "--scenario", tmp_path / "scenario.yaml"),
                  ("tune", "--scenario", tmp_path / "scenario.yaml")):  # fmt: skip
        done = run(*words, "--out", tmp_path / words[0])
        assert done.status == 0, f"{words[0]}: {done.err}"


def test_what_is_for_hoists_only_is_refused_in_one_line(
    heavier: tuple[str, str, float, Path], capsys: pytest.CaptureFixture[str], tmp_path: Path
):
    name, _, _, folder = heavier
    done = Commands(capsys)("compare-models", folder, "--out", tmp_path / "models")
    assert done.status == 2
    assert len(done.err.strip().splitlines()) == 1 and f"kind '{KINDS[name].example().kind}'" in done.err
