"""Studies and batches run: right rows, whole folders, killed and resumed, the same bytes each time."""

from __future__ import annotations

import errno
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from tests.support.batches import RUNS, SCENARIO, SHORT, chunks_of, environment, part_of, wait_for_chunks, workbench
from tests.support.scenario_text import GOOD
from workbench.cli.study import study as command
from workbench.core.errors import InputError
from workbench.metrics import fixed_columns
from workbench.study.conclude import sentences
from workbench.study.load import Study, load_study
from workbench.study.rows import read_rows
from workbench.study.run import StudyResult, run_study
from workbench.study.store import LOCK, Chunk, Progress, SavedRuns, on_this_computer, place_for, run_batch
from workbench.view.study import run_table, save_study_page

SETTLED = GOOD.replace("references: [trapezoid, ruckig]\n", "") + "settle_s: 3.0\n"


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scenario") / "small.yaml"
    path.write_text(SETTLED, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def study(scenario: Path) -> Study:
    return load_study(scenario)


@pytest.fixture(scope="module")
def result(study: Study) -> StudyResult:
    return run_study(study)


def test_rows_agree_with_the_signals_of_their_runs(result: StudyResult) -> None:
    for row in result.rows:  # the signals hold every tenth sample of those the metrics are taken at
        run = result.runs[row.run_id]
        error = run["speed_reference_rad_s"] - run["speed_motor_rad_s"]
        assert np.abs(run["torque_motor1_nm"]).max() == pytest.approx(row["peak_torque_motor_nm"], rel=5e-3)
        assert np.abs(error).max() == pytest.approx(row["speed_error_max_rad_s"], rel=2e-2)


def written(study: Study, folder: Path) -> Path:
    run_batch(study, place_for(study, folder), extras={"study.html": save_study_page})
    return folder


def test_folder_holds_index_signals_scenario_machine_manifest_and_page(result, study, tmp_path):
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
    path.write_text(SETTLED.replace("[0, 9000]", "[0, 60000]"), encoding="utf-8")
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


def test_command_says_that_this_very_study_is_there_and_runs_nothing(scenario, tmp_path, monkeypatch):
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


# Batches: killed, interrupted, resumed, doubled, half-broken; the result is the same to the byte, or none.


SMALL = SHORT.replace(f"steps: {RUNS // 4}", "steps: 75").replace("name: batch", "name: three")


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("batch") / "batch.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def index(file: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The batch run at once."""
    out = tmp_path_factory.mktemp("at_once") / "out"
    study = load_study(file)
    run_batch(study, place_for(study, out))
    return (out / "index.parquet").read_bytes()


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """300 runs in three chunks."""
    path = tmp_path_factory.mktemp("small") / "three.yaml"
    path.write_text(SMALL, encoding="utf-8")
    return load_study(path)


@pytest.fixture(scope="module")
def whole(small: Study, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The three chunks run at once."""
    out = tmp_path_factory.mktemp("whole") / "out"
    run_batch(small, place_for(small, out))
    return (out / "index.parquet").read_bytes()


def stopping_after(chunks: int, study: Study, numbers: Sequence[int]) -> Iterator[tuple[int, Chunk]]:
    """Runs some chunks, then is stopped as by Ctrl-C."""
    yield from on_this_computer(study, numbers[:chunks])
    raise KeyboardInterrupt


def never(study: Study, numbers: Sequence[int]) -> Iterator[tuple[int, Chunk]]:
    assert not numbers, "was run"
    return iter(())


def resumed(file: Path, out: Path, index: bytes, kept: int) -> None:
    """A second call goes on after what is kept and ends with the bytes of a batch run at once."""
    again = workbench("study", file, "--out", out)
    _, said = again.communicate(timeout=120)
    assert again.returncode == 0
    assert f"batch: goes on after {kept} of {RUNS} runs" in said
    assert (out / "index.parquet").read_bytes() == index
    assert part_of(out) is None
    assert json.loads((out / "manifest.json").read_text())["runs"] == {"all": RUNS, "ok": RUNS, "failed": 0}


def test_kill_9_in_the_middle_keeps_what_is_done_and_a_second_call_does_the_rest(file, index, tmp_path):
    out = tmp_path / "out"
    process = workbench("study", file, "--out", out)
    wait_for_chunks(out, 2, process)
    process.kill()
    process.communicate()
    assert not out.exists()
    assert 2 <= len(chunks_of(out)) < 10
    part = part_of(out)
    assert part and (part / LOCK).is_file(), "killed, it leaves its lock file"
    resumed(file, out, index, 128 * len(chunks_of(out)))


def test_while_one_process_runs_a_study_another_says_so_and_ctrl_c_says_what_is_kept(file, index, tmp_path):
    out = tmp_path / "out"
    process = workbench("study", file, "--out", out)
    wait_for_chunks(out, 2, process)
    process.send_signal(signal.SIGSTOP)
    try:
        second = workbench("study", file, "--out", out)
        _, said = second.communicate(timeout=60)
    finally:
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGCONT)
    assert second.returncode == 2
    assert f"is being written by process {process.pid} on " in said
    assert len(said.splitlines()) == 1
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    kept = 128 * len(chunks_of(out))
    assert f"batch: {kept} of {RUNS} runs done and kept; the same command goes on from there." in said
    assert "Traceback" not in said
    assert not out.exists()
    resumed(file, out, index, kept)


def test_a_batch_on_one_core_or_several_stopped_or_not_gives_the_same_bytes(small, whole, tmp_path):
    for name, cores in (("one", 1), ("two", 2)):
        run_batch(small, place_for(small, tmp_path / name), spread=partial(on_this_computer, cores=cores))
    stopped = place_for(small, tmp_path / "stopped")
    for done in (1, 1):
        with pytest.raises(KeyboardInterrupt):
            run_batch(small, stopped, spread=partial(stopping_after, done))
        assert not stopped.folder.exists()
    run_batch(small, stopped)
    assert [path.read_bytes() for path in tmp_path.glob("*/index.parquet")] == 3 * [whole]


def test_a_kept_chunk_that_is_damaged_is_run_again(small: Study, whole: bytes, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        run_batch(small, place_for(small, out), spread=partial(stopping_after, 2))
    first, second = chunks_of(out)
    first.write_bytes(first.read_bytes()[:1000])
    second.write_bytes(b"")
    told: list[Progress] = []
    run_batch(small, place_for(small, out), tell=told.append)
    assert told[0].kept == 0
    assert (out / "index.parquet").read_bytes() == whole


def test_a_result_that_another_process_finished_meanwhile_is_left_alone(small: Study, tmp_path: Path) -> None:
    place = place_for(small, tmp_path / "out")  # found unfinished ...
    run_batch(small, place)

    def written() -> tuple[int, int, int]:  # not when it was read
        now = (place.folder / "manifest.json").stat()
        return now.st_ino, now.st_size, now.st_mtime_ns

    before = written()
    run_batch(small, place, spread=never)
    assert written() == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_another_study_does_not_go_on_with_the_chunks_of_this_one(small: Study, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        run_batch(small, place_for(small, tmp_path / "out"), spread=partial(stopping_after, 1))
    other = replace(small, scenario=small.scenario.model_copy(update={"settle_s": 9.0}))
    told: list[Progress] = []
    with pytest.raises(KeyboardInterrupt):
        run_batch(other, place_for(other, tmp_path / "out"), spread=partial(stopping_after, 1), tell=told.append)
    assert told[0].kept == 0


PEAK = """
import resource, sys
from workbench.cli import main
try:
    main(["study", *sys.argv[1:]])
finally:
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def peak_mb(file: Path, out: Path) -> float:
    words = [sys.executable, "-c", PEAK, str(file), "--out", str(out)]
    done = subprocess.run(words, env=environment(), capture_output=True, text=True, check=True)
    return float(done.stdout.splitlines()[-1]) / 1024.0


def test_memory_is_the_same_for_ten_times_the_runs(tmp_path: Path) -> None:
    # The signals alone are 0.2 MB a run: 400 of them held in memory would show.
    taken = {}
    for runs in (40, 400):
        text = SCENARIO.replace(f"steps: {RUNS // 4}", f"steps: {runs // 4}").replace("none", "thinned, every_s: 0.02")
        path = tmp_path / f"{runs}.yaml"
        path.write_text(text, encoding="utf-8")
        taken[runs] = peak_mb(path, tmp_path / f"out{runs}")
    assert taken[400] < taken[40] + 60.0, taken


def test_several_files_go_into_folders_of_their_names(tmp_path: Path) -> None:
    files = []
    for name in ("one", "two"):
        files.append(tmp_path / f"{name}.yaml")
        text = SCENARIO.replace("name: batch", f"name: {name}").replace(f"steps: {RUNS // 4}", "steps: 2")
        files[-1].write_text(text, encoding="utf-8")
    done = CliRunner().invoke(command, [*map(str, files), "--out", str(tmp_path / "all")], catch_exceptions=False)
    assert done.exit_code == 0
    assert sorted(path.name for path in (tmp_path / "all").iterdir()) == ["one", "two"]
    twice = CliRunner().invoke(command, [str(files[0]), str(files[0]), "--out", str(tmp_path / "again")])
    assert isinstance(twice.exception, InputError)
    assert "is study 'one', like" in str(twice.exception)
    assert not (tmp_path / "again").exists()
