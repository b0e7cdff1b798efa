"""Studies run, and their results: right rows, whole folders, the same bytes each time."""

from __future__ import annotations

import errno
import json
import os
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from tests.support.scenario_text import GOOD
from workbench.cli.study import study as command
from workbench.core.errors import InputError
from workbench.metrics import fixed_columns
from workbench.study.conclude import sentences
from workbench.study.load import Study, load_study
from workbench.study.rows import read_rows
from workbench.study.run import StudyResult, run_study
from workbench.study.store import Chunk, SavedRuns, place_for, run_batch
from workbench.view.study import run_table, save_study_page

SCENARIO = GOOD.replace("references: [trapezoid, ruckig]\n", "") + "settle_s: 3.0\n"


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scenario") / "small.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def study(scenario: Path) -> Study:
    return load_study(scenario)


@pytest.fixture(scope="module")
def result(study: Study) -> StudyResult:
    return run_study(study)


def test_rows_agree_with_the_signals_of_their_runs(result: StudyResult) -> None:
    for row in result.rows:
        run = result.runs[row.run_id]
        error = run["speed_reference_rad_s"] - run["speed_motor_rad_s"]
        # The signals hold every tenth sample of those the metrics are taken at.
        assert np.abs(run["torque_motor1_nm"]).max() == pytest.approx(row["peak_torque_motor_nm"], rel=5e-3)
        assert np.sqrt(np.mean(error**2)) == pytest.approx(row["speed_error_rms_rad_s"], rel=2e-2)
        assert np.abs(error).max() == pytest.approx(row["speed_error_max_rad_s"], rel=2e-2)
        above = run["torque_motor_nm"].max() - run["torque_motor_nm"][0]
        assert above == pytest.approx(row["peak_torque_above_static_nm"], rel=1e-2)
        assert row["peak_torque_percent"] == pytest.approx(100.0 * row["peak_torque_motor_nm"] / 480.0)


def test_torque_above_static_is_inertia_times_acceleration_and_friction(result: StudyResult) -> None:
    for row in result.rows:
        mass = 8000.0 + row.payload_kg
        inertia = 2 * 0.8 + 55.0 / 31.0**2 + mass * (0.15 / 31.0) ** 2
        wanted = inertia * row["acceleration_limit_m_s2"] * 31.0 / 0.15 + 6000.0 * 0.15 / 31.0
        # Above it: pin friction and the loop's overshoot. Ruckig may stay below its acceleration limit.
        low = 0.75 if row.reference != "trapezoid" else 1.0
        assert low * wanted < row["peak_torque_above_static_nm"] < 1.35 * wanted


def written(study: Study, folder: Path) -> Path:
    run_batch(study, place_for(study, folder), extras={"study.html": save_study_page})
    return folder


def test_folder_holds_index_signals_scenario_machine_manifest_and_page(
    result: StudyResult, study: Study, tmp_path: Path
) -> None:
    folder = written(study, tmp_path / "deep" / "small")
    index = pq.read_table(folder / "index.parquet")
    assert index.column_names[:6] == ["run_id", "scenario", "status", "reason", "payload_kg", "reference"]
    assert index.column_names[6 : 6 + len(fixed_columns())] == list(fixed_columns())
    assert index.num_rows == 6
    for run_id in index["run_id"].to_pylist():
        signals = pq.read_table(folder / "runs" / run_id / "signals.parquet")
        np.testing.assert_array_equal(signals["time_s"].to_numpy(), result.runs[run_id].time_s)
        np.testing.assert_array_equal(signals["tension_drum_n"].to_numpy(), result.runs[run_id]["tension_drum_n"])
    said = json.loads((folder / "manifest.json").read_text())
    assert said["fingerprint"] == result.study.fingerprint
    assert said["versions"]["workbench"]
    assert said["runs"] == {"all": 6, "ok": 6, "failed": 0}
    assert "Plotly.newPlot" in (folder / "study.html").read_text(encoding="utf-8")
    assert [p.name for p in folder.parent.iterdir()] == ["small"]
    assert folder.stat().st_mode & 0o777 == 0o755


def test_signals_read_back_are_those_of_the_runs(result: StudyResult, study: Study, tmp_path: Path) -> None:
    folder = written(study, tmp_path / "small")
    saved = SavedRuns(folder, read_rows(folder))
    assert list(saved) == [row.run_id for row in result.rows]
    for run_id, run in saved.items():
        assert run.signals.keys() == result.runs[run_id].signals.keys()
        for name, values in run.signals.items():
            np.testing.assert_array_equal(values, result.runs[run_id][name])
        assert run.payload_kg == result.runs[run_id].payload_kg


def test_a_full_disk_is_one_sentence_and_leaves_no_result(study: Study, tmp_path: Path) -> None:
    def full(_: StudyResult, path: Path) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(InputError, match="small: no results written: No space left on device"):
        run_batch(study, place_for(study, tmp_path / "small"), extras={"study.html": full})
    assert not (tmp_path / "small").exists()


def test_a_place_that_cannot_be_written_is_known_before_anything_is_run(study: Study, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")

    def never(*_: object) -> Iterator[tuple[int, Chunk]]:
        raise AssertionError("was run")

    with pytest.raises(InputError, match="small: no results can be written there: a file stands where"):
        run_batch(study, place_for(study, tmp_path / "file" / "small"), spread=never)


def test_a_finished_result_is_never_overwritten(study: Study, tmp_path: Path) -> None:
    folder = written(study, tmp_path / "small")
    assert place_for(study, folder).finished
    other = replace(study, scenario=study.scenario.model_copy(update={"payloads_kg": (1.0,)}))
    with pytest.raises(InputError, match=r"holds another result \('small'.*choose another folder"):
        place_for(other, folder)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("keep")
    with pytest.raises(InputError, match="is not empty"):
        place_for(study, tmp_path / "mine")
    with pytest.raises(InputError, match="is a file, expected a folder"):
        place_for(study, tmp_path / "mine" / "notes.txt")
    (tmp_path / "empty").mkdir()
    assert not place_for(study, tmp_path / "empty").finished


def test_a_loop_that_runs_away_is_a_failed_row_and_the_rest_goes_on(tmp_path: Path) -> None:
    # Holding 68 t takes 3.2 kN m and the drive gives at most 1.5: the load runs off the rail. Without it all is well.
    path = tmp_path / "wild.yaml"
    path.write_text(SCENARIO.replace("[0, 9000]", "[0, 60000]"), encoding="utf-8")
    study = load_study(path)
    result = run_study(study)
    failed = [row for row in result.rows if not row.ok]
    assert {row.payload_kg for row in failed} == {60000.0}
    assert len(failed) == 3
    assert all("holding the load takes 3" in row.reason and "at most 1536 N m" in row.reason for row in failed)
    assert all(row.metrics["peak_torque_motor_nm"] is None and row.reason for row in failed)
    assert all(row.metrics["move_time_s"] is not None for row in failed)
    folder = written(study, tmp_path / "wild")
    statuses = pq.read_table(folder / "index.parquet")["status"].to_pylist()
    assert statuses.count("failed") == len(failed)
    assert any("failed" in line for line in run_table(result.rows).rows[-1])
    assert any(row.run_id in sentence for row in failed for sentence in sentences(result.rows, 768.0))


def test_command_says_that_this_very_study_is_there_and_runs_nothing(
    scenario: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    first = CliRunner().invoke(command, [str(scenario), "--out", str(out)], catch_exceptions=False)
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
    monkeypatch.setattr("workbench.study.run.simulate_loop", None)
    again = CliRunner().invoke(command, [str(scenario), "--out", str(out)], catch_exceptions=False)
    assert "holds this very study already; nothing was run" in again.output
    assert again.output.splitlines()[:11] == first.output.splitlines()[:11]
    assert before == {path: path.stat().st_mtime_ns for path in out.rglob("*")}


# The queries of docs/studies.md, run on a result.


ROOT = Path(__file__).resolve().parents[2]
DOCS = (ROOT / "docs" / "studies.md").read_text(encoding="utf-8")
SCENARIO_STUDY = """\
format: 1
name: gains
payloads_kg: [0, 60000]
start_position_m: 4.0
moves: [{by_m: 1.5}, {to_m: 4.0}]
limits: {speed_m_s: 0.7, acceleration_m_s2: 0.6, jerk_m_s3: 0.8}
references: [trapezoid, ruckig]
controller: {kp_nm_s_per_rad: 31.0, ki_nm_per_rad: 122.0}
sweep:
  controller.kp_nm_s_per_rad: [20.0, 40.0]
"""


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gains.yaml").write_text(SCENARIO_STUDY, encoding="utf-8")
    study = load_study("gains.yaml")
    run_batch(study, place_for(study))
    return tmp_path / "results" / "gains"


def test_duckdb_answers_the_query_of_the_docs(results: Path) -> None:
    duckdb = pytest.importorskip("duckdb", reason="duckdb is not installed")
    (query,) = re.findall(r"```sql\n(.*?)```", DOCS, re.DOTALL)
    lines = duckdb.sql(query).fetchall()
    rows = [row for row in read_rows(results) if row.ok]
    assert [line[:2] for line in lines] == [(0.0, 20.0), (0.0, 40.0)]  # the loads of 60 t ran off the rail
    for payload, kp, peak, error in lines:
        here = [
            row for row in rows if (row.payload_kg, row.assigned["sweep.controller.kp_nm_s_per_rad"]) == (payload, kp)
        ]
        assert len(here) == 2
        assert peak == max(row["peak_torque_percent"] for row in here)
        assert error == min(row["speed_error_max_rad_s"] for row in here)
