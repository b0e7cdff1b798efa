"""`workbench diagnose`: options reach the diagnosis, the answer comes first, nothing is left half-written."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.commands import Commands
from tests.support.made_diagnosis import KINDS, VISCOUS, made_diagnosis
from tests.support.simulated_campaign import simulated_campaign
from workbench.core.errors import InputError
from workbench.diagnose.progress import Progress, Remaining, Stage, Task, Tell
from workbench.effects import check
from workbench.machines import default_hoist, load_machine

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def workbench(capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(capsys)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated_campaign(tmp_path_factory.mktemp("diagnose") / "lifts")


class Called:
    """Stands in for the diagnosis itself: remembers how it was called, and gives a ready answer."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.how: dict[str, Any] = {}
        self.answer: Any = made_diagnosis("named")
        self.steps: list[Progress] = []
        monkeypatch.setattr("workbench.cli.diagnose.cause.diagnose", self)

    def __call__(self, campaign: Any, *, tell: Tell, **how: Any) -> Any:
        self.how = {"campaign": campaign, **how}
        for step in self.steps:
            tell(step)
        if isinstance(self.answer, BaseException):
            raise self.answer
        return self.answer


@pytest.fixture
def called(monkeypatch: pytest.MonkeyPatch) -> Called:
    return Called(monkeypatch)


def test_options_reach_the_diagnosis(workbench: Commands, folder: Path, called: Called):
    words = ["--baseline", "nominal", "--candidates", "heave,wire_mass", "--max-effects", 1, "--seed", 7]
    words += ["--quick", "--validate", "full"]
    assert workbench("diagnose", folder, *words, "--runs", "full,empty", "--band", 1.5).status == 0
    campaign = called.how.pop("campaign")
    assert [run.name for run in campaign.runs] == ["empty", "full"]
    assert called.how == {
        "baseline": "nominal", "candidates": ("heave", "wire_mass"), "most_effects": 1, "seed": 7, "band_hz": 1.5,
        "scenario": None, "quick": True, "validate": ["full"],
    }  # fmt: skip


def test_another_machine_is_what_is_diagnosed(workbench: Commands, folder: Path, called: Called, tmp_path: Path):
    text = (folder / "machine.yaml").read_text()
    other = tmp_path / "other.yaml"
    other.write_text(text.replace("name: ", "name: other "))
    assert workbench("diagnose", folder, "--machine", other).status == 0
    assert called.how["campaign"].machine.name.startswith("other ")


@pytest.mark.parametrize(
    ("more", "unused"), [(["--study", "lift.yaml"], "--study"), (["--max-effects", 3], "--max-effects")]
)
def test_quick_refuses_what_it_would_not_do(
    workbench: Commands, folder: Path, called: Called, more: list[Any], unused: str
):
    done = workbench("diagnose", folder, "--quick", *more)
    assert done.status == 2 and f"leave out {unused}, or --quick" in " ".join(done.err.split())
    assert called.how == {}


@pytest.mark.parametrize("kind", KINDS)
def test_the_status_is_zero_and_the_answer_first_whatever_the_verdict(workbench, folder, called, tmp_path, kind):
    called.answer = made_diagnosis(kind)
    done = workbench("diagnose", folder, "--out", tmp_path / "out")
    assert done.status == 0
    assert done.out.strip().splitlines()[0] == called.answer.verdict.sentence
    assert json.loads((tmp_path / "out" / "diagnosis.json").read_text())["verdict"] == called.answer.verdict.word
    for file in ("diagnose.html", "machine.yaml", "diagnosis.json"):
        assert (tmp_path / "out" / file).is_file()
    assert all(str(file) in done.out for file in (tmp_path / "out").iterdir())


def test_without_out_nothing_is_written(workbench, folder, called, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "Nothing is written without --out." in workbench("diagnose", folder).out
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--candidates", "friction_viscos"], "--candidates: unknown effect 'friction_viscos'; did you mean "),
        (["--candidates", "presliding"], "unknown effect 'presliding'"),
        (["--baseline", "refit"], "'refit' is not one of 'tolerances', 'nominal'"),
        (["--max-effects", "6"], "6 is not in the range 1<=x<=5"),
        (["--seed", "-1"], "-1 is not in the range x>=0"),
        (["--runs", "emty"], "no run 'emty'; did you mean 'empty'?"),
        (["--band", "0.01"], "--band: 0.01 Hz, expected at least"),
    ],
)
def test_a_wrong_word_is_said_before_any_work(workbench, folder, called, tmp_path, words, problem):
    done = workbench("diagnose", folder, "--out", tmp_path / "out", *words)
    assert done.status == 2
    assert problem in done.err
    assert called.how == {}
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("stop", "status", "said"),
    [
        (InputError("speed rises against the torque in 4 of 6 runs: is its sign flipped?"), 2, "is its sign flipped?"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_what_stops_it_leaves_nothing(workbench, folder, called, tmp_path, stop, status, said):
    called.answer = stop
    done = workbench("diagnose", folder, "--out", tmp_path / "out")
    assert (done.status, done.out) == (status, "")
    assert said in done.err
    assert list(tmp_path.iterdir()) == []


# CPU seconds from the base fit to each message and to the end, of 17 of the 34 practice campaigns.
MARKS = """\
campaigns/05: 1.5S 1.6S 2.3P 2.7S 2.8S 3.6P 5.0J 6.4L 6.8A 6.9H 7.2C 8.6W 9.4
campaigns/11: 1.9S 2.6P 3.3P 3.6J 4.0L 4.4A 4.4H 4.8C 6.3W 7.1
campaigns/17: 1.2S 1.4S 1.7P 2.1S 2.2S 2.8P 4.7J 5.7L 6.0A 6.0H 6.5C 8.0W 8.7
campaigns/23: 1.2S 1.3S 2.0P 2.2P 2.6S 2.8S 3.5P 3.7P 5.6P 5.7P 5.9P 8.2J 10.4L 10.8A 12.2H 12.5C 13.9W 14.7
campaigns/29: 1.8S 2.6P 3.7P 4.1J 4.6L 4.9A 5.0H 5.4C 6.9W 7.8
campaigns/33: 2.5S 2.7S 2.9S 3.9P 4.4S 5.5P 8.2J 9.7L 12.5A 12.6H 21.1C 22.8W 23.8
campaigns/38: 1.3S 1.5S 1.9P 2.3S 2.6S 3.3P 4.2J 5.7L 6.1A 6.2H 6.5C 8.1W 8.9
campaigns/44: 1.8S 2.3P 2.7P 4.5J 5.2L 5.6A 5.7H 6.1C 7.7W 8.5
campaigns/47: 1.0S 1.1S 1.3P 2.0P 2.3S 2.4S 2.7P 3.5P 3.7P 3.9P 5.5J 7.7L 8.0A 9.4H 9.7C 11.0W 11.7
axes/02: 5.2S 5.5S 5.8S 6.8S 7.1S 7.3S 7.5S 7.8S 12.9J 13.7L 14.3A 14.4H 15.5C 15.6W 15.9
axes/04: 2.0S 2.1S 2.4P 2.8P 3.2S 3.3S 3.5P 5.0J 7.1L 9.0A 9.1H 13.5C 14.2W 15.0
axes/06: 1.6S 1.7S 2.0P 3.5S 3.6S 3.7P 4.1P 6.7J 8.2L 8.9A 9.0H 11.0C 11.7W 12.3
axes/08: 9.5S 10.1S 10.4S 11.7P 13.8S 14.4S 14.9S 15.3S 17.4S 18.6P 22.1J 23.7L 24.9A 24.9H 28.8C 29.6W 30.4
axes/10: 4.7S 4.9S 5.1S 5.5P 7.6S 7.8S 8.0S 8.2S 8.3S 9.3S 9.5S 9.7S 10.0P 10.6P 11.2J 12.8L 13.4A 13.4H 14.6C
  15.3W 16.1
axes/12: 1.3S 1.4S 1.4P 1.7P 2.1S 2.2S 2.4P 2.7P 4.3J 5.2L 6.0A 6.2H 7.6C 8.4W 9.3
axes/17: 8.1S 8.9S 9.1S 17.9P 18.7S 18.8S 18.9P 29.4J 34.3L 35.3A 35.5H 38.0C 38.6W 39.3
axes/22: 1.7S 1.9P 2.6P 3.1P 3.4P 4.5P 4.7P 4.9P 7.1P 7.3P 7.5P 9.8P 10.1P 10.4P 27.2J 29.2L 43.0A 43.1H 50.5C
  60.1W 60.9
"""
MARKED = {"S": (Stage.SEARCH, Task.SINGLE), "P": (Stage.SEARCH, Task.PAIRS)} | {
    letter: (stage, Task.WHOLE) for letter, stage in zip("JLAHCW", list(Stage)[Stage.JUDGE.value :], strict=True)
}


def test_nine_of_ten_messages_are_followed_by_no_more_than_they_say():
    over = []
    for line in MARKS.replace("\n  ", " ").splitlines():
        *steps, end = line.partition(": ")[2].split()
        now = [0.0]
        remaining = Remaining(lambda now=now: now[0])  # type: ignore[misc]
        assert remaining(Progress(Stage.READ)) is remaining(Progress(Stage.SEARCH, Task.BASE)) is None
        for step in steps:
            now[0] = float(step[:-1])
            left = remaining(Progress(*MARKED[step[-1]]))
            assert left is not None
            over.append(left / (float(end) - now[0]))
    assert np.mean(np.array(over) >= 1.0) > 0.87
    assert np.median(over) < 4.0  # and says something
    assert Remaining(lambda: 0.0)(Progress(Stage.SEARCH, Task.SINGLE)) is None  # nothing was measured


def test_a_missing_effect_is_named_from_its_runs_and_twice_alike(workbench: Commands, tmp_path: Path):
    """The whole way, with nothing stood in for: a simulated machine with viscous friction that its file lacks."""
    truth = default_hoist().model_copy(update={"effects": dict(VISCOUS)})
    lifts = simulated_campaign(tmp_path / "lifts", truth)
    words = ["--max-effects", 1, "--candidates", "friction_viscous,gearbox_inertia,torque_offset"]
    for out in ("one", "two"):
        done = workbench("diagnose", lifts, "--out", tmp_path / out, *words)
        assert done.status == 0, done.err
    for file in ("diagnosis.json", "machine.yaml", "diagnose.html"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes(), file
    said = json.loads((tmp_path / "one" / "diagnosis.json").read_text(encoding="utf-8"))
    assert (said["verdict"], said["effects"]) == ("named", ["friction_viscous"])
    assert sum(row["probability"] for row in said["ranking"]) == pytest.approx(1.0, abs=1e-9)
    slope = said["parameters"]["friction_viscous"]["viscous_n_s_per_m"]["value"]
    assert slope == pytest.approx(4210.0, rel=0.1)
    assert said["shrink"]["after"] < 1.3 * said["shrink"]["noise"] < 0.5 * said["shrink"]["before"]
    machine = load_machine(tmp_path / "one" / "machine.yaml", check_effects=check)
    assert machine.effects["friction_viscous"]["viscous_n_s_per_m"] == pytest.approx(slope, rel=1e-4)
    again = workbench("replay", lifts, "--machine", tmp_path / "one" / "machine.yaml", "--out", tmp_path / "replay")
    assert again.status == 0
    replayed = json.loads((tmp_path / "replay" / "replay.json").read_text(encoding="utf-8"))["overall"]
    assert replayed["speed_rmse_percent"] < 0.5 * said["gap"]["speed_rmse_percent"]


def test_the_readme_shows_what_this_version_prints(workbench, tmp_path, monkeypatch):
    """Its command is run; each line of its block is the next line printed, but where … stands for some."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    section = text.partition("## Find the gap")[2].partition("## ")[0]
    (command,) = re.findall(r"^workbench (diagnose .*)$", section, re.MULTILINE)
    block = [line.strip() for line in section.splitlines() if line.startswith("    ") and line.strip()]
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("COLUMNS", "100")
    done = workbench(*command.replace("results/diagnosis", str(tmp_path / "out")).split())
    printed = [line.strip().replace(str(tmp_path / "out"), "results/diagnosis") for line in done.out.splitlines()]
    rest, skipping = [line for line in printed if line], False
    for line in block:
        if line == "…":
            skipping = True
            continue
        assert line in rest, line
        assert skipping or rest[0] == line, f"{line!r} is printed after {rest[0]!r}"
        rest, skipping = rest[rest.index(line) + 1 :], False
    assert skipping or not rest
