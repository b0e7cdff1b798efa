"""`--effects FILE`: a user's effects in every command, on workers too; in one line what is no good."""

from __future__ import annotations

import json
import pickle
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.commands import Commands
from tests.support.scenario_text import GOOD, write
from tests.support.simulated_campaign import simulated_campaign
from workbench.effects import forget_users, load_effects, names
from workbench.effects.registry import UserFile, files_behind
from workbench.machines import default_hoist, load_machine, save_machine
from workbench.study.cluster import OtherProgram, run_remote_chunk, versions
from workbench.study.load import load_study
from workbench.study.rows import read_rows
from workbench.study.store import Chunk

WIND = '''
from workbench.effects import Parameter, effect
from workbench.symbolic.expr import absolute


@effect(
    place={"hoist": "guide_force_n"},
    subsystem="guide",
    regime="speed",
    parameters=[
        Parameter("c", "wind_n_s2_per_m2", "drag over speed squared", "force/speed*speed", 0.0, 1.0, 0.02, 0.03,
                  vanishes_at=0.0, domain="not_negative"),
    ],
    reads={"v": "carriage speed, m/s"},
    equation="F = −c v |v|",
    reference="drag in proportion to dynamic pressure",
    shows="a residual that grows with the square of the speed",
    dissipative=True,
)
def wind(s, e, p):
    """Drag of the air on the load."""
    return -(e.c * s.v * absolute(s.v))
'''
BLOWN = GOOD + "effects: {wind: {wind_n_s2_per_m2: 9000.0}}\n"


@pytest.fixture(autouse=True)
def nobody_s_effects_are_known() -> Iterator[None]:
    forget_users()
    yield
    forget_users()


@pytest.fixture
def wind(tmp_path: Path) -> Path:
    return write(tmp_path, WIND, "wind.py")


def torques(folder: Path) -> list[float]:
    return [row["rms_torque_motor_nm"] or 0.0 for row in read_rows(folder)]


def test_a_scenario_s_own_effect_is_at_work_and_travels_with_the_result(commands: Commands, tmp_path: Path, wind: Path):
    plain = commands("study", write(tmp_path, GOOD), "--out", tmp_path / "plain")
    blown = commands("study", write(tmp_path, BLOWN, "blown.yaml"), "--out", tmp_path / "blown", "--effects", wind)
    assert (plain.status, blown.status) == (0, 0), blown.err
    without, with_wind = torques(tmp_path / "plain"), torques(tmp_path / "blown")
    assert len(without) == 4 and min(without) > 100.0
    assert all(abs(b - a) > 0.01 for a, b in zip(without, with_wind, strict=True))
    assert (tmp_path / "blown" / "wind.py").read_text(encoding="utf-8") == WIND
    assert list(json.loads((tmp_path / "blown" / "manifest.json").read_text())["effects"]) == ["wind"]
    again = tmp_path / "blown"
    forget_users()
    words = ("study", again / "scenario.yaml", "--out", tmp_path / "again", "--effects", again / "wind.py")
    assert commands(*words).status == 0
    assert (tmp_path / "again" / "index.parquet").read_bytes() == (again / "index.parquet").read_bytes()


def test_without_the_option_the_scenario_is_refused_by_line(commands: Commands, tmp_path: Path):
    ended = commands("study", write(tmp_path, BLOWN), "--out", tmp_path / "out")
    assert ended.status == 2
    assert "scenario.yaml:9: effects.wind: unknown effect 'wind'" in ended.err


def test_another_text_of_the_file_is_another_study_and_an_unused_one_is_not(tmp_path: Path, wind: Path):
    load_effects(wind)
    blown, plain = write(tmp_path, BLOWN, "blown.yaml"), write(tmp_path, GOOD)
    before, before_plain = load_study(blown).fingerprint, load_study(plain).fingerprint
    assert load_study(blown).fingerprint == before
    write(tmp_path, WIND.replace("-(e.c", "-(2.0 * e.c"), "wind.py")
    load_effects(wind)
    assert load_study(blown).fingerprint != before
    assert load_study(plain).fingerprint == before_plain


def test_a_worker_that_gets_another_text_of_the_effect_refuses(tmp_path: Path, wind: Path):
    load_effects(wind)
    study = load_study(write(tmp_path, BLOWN))
    asked, files, fingerprint = pickle.dumps(study), files_behind(study.machine.effects, "hoist"), study.fingerprint
    assert [file.path for file in files] == [str(wind.resolve())]
    forget_users()
    right = run_remote_chunk(asked, 0, fingerprint, versions(), files)
    assert isinstance(right, Chunk) and right.failed == 0
    changed = UserFile(files[0].path, files[0].text.replace(b"-(e.c", b"-(2.0 * e.c"))
    other = run_remote_chunk(asked, 0, fingerprint, versions(), (changed,))
    assert isinstance(other, OtherProgram) and "another version" in other.what
    forget_users()
    missing = run_remote_chunk(asked, 0, fingerprint, versions())
    assert isinstance(missing, OtherProgram) and "unknown effect 'wind'" in missing.what
    # The first text again: the worker may have met another study in between.
    assert run_remote_chunk(asked, 0, fingerprint, versions(), files) == right


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated_campaign(tmp_path_factory.mktemp("campaigns") / "made")


@pytest.fixture
def windy_machine(tmp_path: Path, wind: Path) -> Path:
    """A machine.yaml with the user's effect in it."""
    load_effects(wind)
    machine = default_hoist().model_copy(update={"effects": {"wind": {"wind_n_s2_per_m2": 30000.0}}})
    save_machine(machine, tmp_path / "windy.yaml")
    forget_users()
    return tmp_path / "windy.yaml"


def test_replay_and_identify_take_a_machine_with_the_user_s_effect(commands, tmp_path, wind, windy_machine, campaign):
    assert commands("replay", campaign, "--out", tmp_path / "plain").status == 0
    words = ("replay", campaign, "--machine", windy_machine, "--out", tmp_path / "windy")
    refused = commands(*words)
    assert refused.status == 2 and "effects.wind: unknown effect 'wind'" in refused.err
    assert commands(*words, "--effects", wind).status == 0
    plain, windy = (json.loads((tmp_path / name / "replay.json").read_text()) for name in ("plain", "windy"))
    rms = "torque_residual_rms_nm"
    assert abs(windy["overall"][rms] - plain["overall"][rms]) > 1.0
    ended = commands("identify", campaign, "--machine", windy_machine, "--effects", wind, "--out", tmp_path / "found")
    assert ended.status == 0, ended.err
    identified = load_machine(tmp_path / "found" / "machine.yaml")
    assert identified.effects == {"wind": {"wind_n_s2_per_m2": 30000.0}}


@pytest.mark.parametrize(
    "words", [("loop",), pytest.param(("tune", "--bandwidth", "1.0"), marks=pytest.mark.proof)], ids=["loop", "tune"]
)
def test_loop_and_tune_take_a_scenario_with_the_user_s_effect(commands, tmp_path, wind, words):
    file = write(tmp_path, BLOWN)
    refused = commands(*words, "--scenario", file)
    assert refused.status == 2 and "unknown effect 'wind'" in refused.err
    ended = commands(*words, "--scenario", file, "--effects", wind)
    assert ended.status == 0, ended.err


TWICE = WIND.replace("def wind", "def gale")
BAD = {
    "x = 1\n": ".py: declares no effect",
    "x = 1\nx = = 2\n": ".py:2: fails: SyntaxError: invalid syntax",
    "import sys\nsys.exit()\n": ".py:2: fails: SystemExit: without a word",
    WIND.replace("s.v", "s.vv"): ".py: effect wind: on kind hoist: reads 'vv', which is not there; "
    "at guide_force_n s has t, v, x,",
    WIND.replace("return -", "if s.v > 0: return 0.0\n    return -"): "physics cannot branch on a traced value",
    WIND.replace("return -(e.c", "return 5.0 - (e.c"): "wind: on kind hoist: gives 5 where its parameters vanish",
}


@pytest.mark.parametrize(("text", "said"), BAD.items(), ids=range(len(BAD)))
def test_a_file_that_is_no_good_is_one_line_before_anything_is_read(commands, tmp_path, text, said):
    file = write(tmp_path, text, "mine.py")
    ended = commands("study", tmp_path / "is_not_there.yaml", "--effects", file)
    assert ended.status == 2 and ended.out == ""
    assert said in ended.err and len(ended.err.splitlines()) == 1
    assert ended.err.startswith(f"error: {file}")
    assert "wind" not in names("hoist")


def test_the_option_may_be_repeated_and_one_name_in_two_files_is_refused(commands, tmp_path, wind):
    second, again = write(tmp_path, TWICE, "gale.py"), write(tmp_path, WIND, "again.py")
    assert commands("loop", "--effects", wind, "--effects", second).status == 0
    assert {"wind", "gale"} <= set(names("hoist"))
    ended = commands("loop", "--effects", wind, "--effects", again)
    assert ended.status == 2 and f"{again}: the effect name 'wind' is taken" in ended.err
    assert {"wind", "gale"} <= set(names("hoist"))
