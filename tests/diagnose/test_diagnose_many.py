"""Several campaigns in one command, runs kept for the end, and a diagnosis that is kept, opened, pickled."""

from __future__ import annotations

import json
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
import workbench.cli.diagnose as diagnose_module
from tests.support.commands import Commands
from tests.support.made_diagnosis import made_diagnosis
from tests.support.simulated_campaign import simulated_campaign
from workbench.core.errors import InputError
from workbench.diagnose.diagnose import Diagnosis, diagnose
from workbench.logs import read_campaign
from workbench.machines import default_hoist
from workbench.view.diagnosis_json import to_json

VISCOUS = {"friction_viscous": {"viscous_n_s_per_m": 4210.0}}
QUICK = ("--quick", "--candidates", "friction_viscous")


@pytest.fixture
def workbench(capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(capsys)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    machine = default_hoist().model_copy(update={"effects": VISCOUS})
    return simulated_campaign(tmp_path_factory.mktemp("many") / "lifts", machine)


@pytest.fixture(scope="module")
def broken(folder: Path) -> Path:
    bad = folder.parent / "broken"
    shutil.copytree(folder, bad)
    (bad / "machine.yaml").write_text("format: 1\nkind: hoist\n")
    return bad


@pytest.mark.parametrize("cluster", [(), ("--cluster", "local:2")])
def test_a_bad_campaign_among_good_ones_is_a_row_and_no_traceback(workbench, folder, broken, tmp_path, cluster):
    if cluster:
        pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    twin = folder.parent / "twin"
    if not twin.exists():
        shutil.copytree(folder, twin)
    done = workbench("diagnose", folder, broken, twin, *QUICK, "--out", tmp_path / "out", *cluster)
    assert done.status == 1
    assert "Traceback" not in done.out + done.err
    rows = {line.split()[0]: line for line in done.out.splitlines() if line.split()}
    assert "friction_viscous" in rows["lifts"] and "friction_viscous" in rows["twin"]
    assert "refused" in rows["broken"] and "- broken: " in done.out
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["lifts", "twin"]
    for name in ("lifts", "twin"):
        said = json.loads((tmp_path / "out" / name / "diagnosis.json").read_text())
        assert (said["campaign"], said["effects"]) == (name, ["friction_viscous"])
    assert "about" in done.err and "s left" in done.err


def test_several_campaigns_go_on_where_they_were_interrupted(workbench, folder, tmp_path, monkeypatch):
    """What is there of the same question is kept as it is; of another question, or damaged, it is refused untouched."""
    twin, out = tmp_path / "twin", tmp_path / "out"
    shutil.copytree(folder, twin)
    (tmp_path / "file").write_text("")
    refused = workbench("diagnose", folder, twin, *QUICK, "--out", tmp_path / "file")  # before any long work
    assert refused.status == 2 and "s left" not in refused.err
    asked = ("diagnose", folder, twin, *QUICK, "--out", out)
    first = diagnose_module.answered

    def stopped(name: str, *more: object) -> object:
        if name == "twin":
            raise KeyboardInterrupt
        return first(name, *more)  # type: ignore[arg-type]

    with monkeypatch.context() as m:
        m.setattr(diagnose_module, "answered", stopped)
        done = workbench(*asked)
    assert done.status == 130
    assert "1 of 2 are done and kept; the same command goes on" in done.err
    kept = {path: path.read_bytes() for path in (out / "lifts").iterdir()}
    other = workbench(*asked, "--seed", "1")
    assert other.status == 2 and "answer for other logs, options or another version" in other.err
    done = workbench(*asked)
    assert done.status == 0 and "lifts: friction_viscous; kept from before" in done.err
    assert {path: path.read_bytes() for path in (out / "lifts").iterdir()} == kept
    lines = [line.split() for line in done.out.splitlines()]
    rows = [line for line in lines if line[:1] in (["lifts"], ["twin"])]
    assert len(rows) == 2 and rows[0][1:] == rows[1][1:]
    answer = out / "lifts" / "answer.json"
    answer.write_text(answer.read_text()[:20])
    refused = workbench(*asked)
    assert refused.status == 2 and f"{answer}: is damaged" in refused.err


def test_each_campaign_is_read_when_its_turn_comes_and_a_missing_one_ends_it_at_once(
    workbench: Commands, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """All were read, and held, before the first one was diagnosed."""
    shutil.copytree(folder, tmp_path / "twin")
    done = workbench("diagnose", folder, tmp_path / "none", *QUICK)
    assert (done.status, done.out) == (2, "") and "none: is not there" in " ".join(done.err.split())
    order, load = list[str](), diagnose_module.load_campaign

    def loaded(path: Path, *more: object) -> object:
        order.append(f"read {path.name}")
        return load(path, *more)  # type: ignore[arg-type]

    def answered(name: str, *more: object) -> object:
        order.append(f"answer {name}")
        return diagnose_module.Answered(name, "friction_viscous")

    monkeypatch.setattr(diagnose_module, "load_campaign", loaded)
    monkeypatch.setattr(diagnose_module, "answered", answered)
    assert workbench("diagnose", folder, tmp_path / "twin", "--quick").status == 0
    assert order == ["read lifts", "answer lifts", "read twin", "answer twin"]


def test_two_campaigns_of_one_name_are_refused(workbench: Commands, folder: Path, tmp_path: Path):
    shutil.copytree(folder, tmp_path / "lifts")
    done = workbench("diagnose", folder, tmp_path / "lifts", *QUICK)
    assert (done.status, done.out) == (2, "")
    assert "two campaigns are called 'lifts'" in done.err


def kept_for_the_end(folder: Path, scale: float) -> Diagnosis:
    """`full` is kept; its torque is scaled."""
    campaign = read_campaign(folder)
    runs = []
    for run in campaign.runs:
        if run.name == "full":
            signals = {k: v * scale if k.startswith("torque") else v for k, v in run.signals.items()}
            run = wb.Run(run.name, run.time_s, signals, run.payload_kg, run.start_position_m, run.start_time_s)
        runs.append(run)
    campaign = type(campaign)(**{**vars(campaign), "runs": tuple(runs)})
    return diagnose(campaign, candidates=("friction_viscous",), quick=True, validate=("full",))


def test_nothing_is_fitted_to_a_run_that_is_kept_for_the_end(folder: Path):
    """Whatever that run holds, no number of the others changes; its own residual does."""
    sound, other = kept_for_the_end(folder, 1.0), kept_for_the_end(folder, 1.1)
    assert sound.delivered.runs == other.delivered.runs and sound.corrected == other.corrected
    assert [run.name for run in sound.delivered.validated] == ["full"]
    assert sound.delivered.validated[0].after < 1.3 * sound.delivered.validated[0].noise
    assert other.delivered.validated[0].after > 10.0 * sound.delivered.validated[0].after
    assert [row[0] for row in sound.table("runs").rows] == ["empty", "half", "full, not in the fit"]
    assert [run["name"] for run in to_json(sound)["delivered"]["validated"]] == ["full"]


def test_a_run_that_is_none_cannot_be_kept(folder: Path):
    with pytest.raises(InputError, match="no run 'ful'; did you mean 'full'"):
        diagnose(read_campaign(folder), validate=("ful",))
    with pytest.raises(InputError, match="no run is left"):
        diagnose(read_campaign(folder), validate=("empty", "half", "full"))


@pytest.mark.parametrize("kind", ["pair", "unknown", "axis"])
def test_a_diagnosis_is_kept_and_opened_with_every_number(kind: str, tmp_path: Path):
    made = made_diagnosis(kind)
    made.save(tmp_path / "kept")
    opened = wb.open_diagnosis(tmp_path / "kept")
    assert to_json(opened) == to_json(made) and repr(opened) == repr(made)
    assert to_json(pickle.loads(pickle.dumps(made))) == to_json(made)
    assert wb.open_diagnosis(tmp_path / "kept").plot("shrink").to_dict() == made.plot("shrink").to_dict()


class _Runs:
    def __reduce__(self) -> tuple[object, ...]:
        return exec, ("raise SystemExit('ran')",)


@pytest.mark.parametrize("what", [_Runs(), {"a": 1}, np.zeros(3)])
def test_a_file_that_is_no_diagnosis_is_refused_and_never_run(tmp_path: Path, what: object):
    (tmp_path / "diagnosis.pickle").write_bytes(pickle.dumps(what))
    with pytest.raises(InputError, match="diagnosis"):
        wb.open_diagnosis(tmp_path)
    (tmp_path / "diagnosis.pickle").write_bytes(pickle.dumps(made_diagnosis("axis"))[:5000])
    with pytest.raises(InputError, match="no saved diagnosis"):
        wb.open_diagnosis(tmp_path)


def test_a_doubtful_log_is_said_in_python_as_by_the_command(workbench: Commands, folder: Path, tmp_path: Path):
    """A second of one run's log is there twice."""
    twice = tmp_path / "twice"
    shutil.copytree(folder, twice)
    log = twice / "runs" / "half.csv"
    head, *rows = log.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    for k in range(900, 1100):
        cells[k][1:] = cells[k - 200][1:]
    log.write_text("\n".join([head, *(",".join(row) for row in cells)]) + "\n")
    said = " ".join(workbench("diagnose", twice, *QUICK).out.split())
    found = wb.diagnose(twice, candidates=("friction_viscous",), quick=True)
    assert found.campaign.doubts and "Notes on the logs:" in said
    assert all(f"note on the logs: {doubt}" in repr(found) for doubt in found.campaign.doubts)
