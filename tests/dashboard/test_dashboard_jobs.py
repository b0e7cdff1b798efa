"""Long work outside the page: it is watched, stopped, found again, and goes when it is old."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.support.batches import ROOT, SCENARIO, environment
from tests.support.scenario_text import write
from workbench.core.errors import InputError
from workbench.dashboard import jobs, session
from workbench.dashboard.jobs import INPUTS, Job, Progress, Teller, poll, start, stop
from workbench.study.store import read_finished


@pytest.fixture
def workspace(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / "work"
    folder.mkdir()
    yield folder
    for job in jobs.jobs_of(folder):
        stop(job, grace_s=0.1)
        until(job, lambda progress: progress.ended)


def until(job: Job, fact: Callable[[Progress], bool], seconds: float = 300.0) -> Progress:
    end = time.monotonic() + seconds
    while not fact(progress := poll(job)):
        assert time.monotonic() < end, progress
        time.sleep(0.02)
    return progress


def begin(workspace: Path, name: str, **arguments: object) -> Job:
    return start("test", f"tests.support.job_calls:{name}", arguments, workspace)


def ended(job: Job) -> Progress:
    return until(job, lambda progress: progress.ended)


def said(job: Job) -> str:
    folder = jobs.result_folder(job)
    assert folder is not None
    return (folder / "said.txt").read_text()


def test_a_call_is_counted_while_it_runs_and_leaves_its_result(workspace: Path):
    job = begin(workspace, "counted", to=20, each_s=0.1)
    on_the_way = until(job, lambda progress: progress.done > 0)
    assert (on_the_way.state, on_the_way.stage, on_the_way.total, on_the_way.failed) == ("running", "counting", 20, 1)
    assert 0.0 < on_the_way.share < 1.0
    assert jobs.result_folder(job) is None
    assert ended(job).state == "done"
    assert poll(job).share == 1.0
    assert said(job) == "0 to 20"


def test_a_stopped_call_goes_on_from_what_it_kept(workspace: Path):
    job = begin(workspace, "counted", to=10_000, each_s=0.01)
    until(job, lambda progress: progress.done > 5)
    stop(job)
    assert ended(job).state == "stopped"
    assert jobs.result_folder(job) is None
    kept = int(job.file("kept.txt").read_text())
    job.file("kept.txt").write_text("9990")
    jobs.restart(job)
    assert ended(job).state == "done"
    assert said(job) == "9990 to 10000"
    assert kept > 5


def test_work_sees_its_own_copy_of_the_inputs_and_gives_way_to_the_page(workspace: Path, tmp_path: Path):
    file = tmp_path / "upload.txt"
    file.write_text("as it was")
    job = start(
        "test", "tests.support.job_calls:what_it_sees", {"file": f"{INPUTS}/a.txt"}, workspace, inputs={"a.txt": file}
    )
    file.unlink()
    ended(job)
    assert said(job) == f"as it was|{job.id}|{min(os.nice(0) + 10, 19)}"


def test_a_file_in_the_jobs_folder_is_never_imported(workspace: Path):
    job = begin(workspace, "counted", to=1)
    ended(job)
    for name in ("json.py", "workbench.py"):
        job.file(name).write_text("raise SystemExit(7)")
    job.file("kept.txt").unlink()
    (job.folder / "result" / "said.txt").unlink()
    (job.folder / "result").rmdir()
    jobs.restart(job)
    assert ended(job).state == "done"


def test_what_the_user_can_mend_is_said_in_one_line_without_the_servers_folders(workspace: Path):
    progress = ended(begin(workspace, "refused", file=f"{INPUTS}/m.yaml"))
    assert (progress.state, progress.sentence) == ("failed", "m.yaml:3: unknown key 'mas'")


def test_a_defect_ends_as_failed_with_its_last_line_and_keeps_its_traceback(workspace: Path):
    job = begin(workspace, "defective")
    assert ended(job).sentence == "ZeroDivisionError: a defect"
    assert poll(job).state == "failed"
    assert "Traceback" in job.file("stderr.txt").read_text()


def test_a_worker_that_was_killed_is_seen_to_have_failed(workspace: Path):
    progress = ended(begin(workspace, "shot"))
    assert progress.state == "failed"
    assert "killed" in progress.sentence


def test_a_worker_that_does_not_hear_ctrl_c_is_ended_with_its_children(workspace: Path):
    job = begin(workspace, "stubborn")
    child = int(until(job, lambda progress: progress.stage.startswith("child")).stage.split()[1])
    stop(job, grace_s=0.3)
    assert poll(job).state == "stopping"
    assert ended(job).state == "stopped"
    assert_gone(child)


def assert_gone(process: int) -> None:
    for _ in range(200):
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return
        time.sleep(0.02)
    # A zombie that nobody waits for is dead too.
    assert Path(f"/proc/{process}/stat").read_text().split(")")[1].split()[0] == "Z"


def test_a_stop_is_heard_when_the_server_was_put_into_the_background(workspace: Path):
    """Such a server ignores Ctrl-C, and what it starts inherits that."""
    old = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        job = begin(workspace, "counted", to=10_000, each_s=0.01)
    finally:
        signal.signal(signal.SIGINT, old)
    until(job, lambda progress: progress.done > 0)
    stop(job, grace_s=60.0)
    assert ended(job).state == "stopped"


@pytest.mark.parametrize("wait_s", [0.0, 0.02, 0.1])
def test_a_stop_before_the_worker_can_hear_of_it_is_not_lost(workspace: Path, wait_s: float):
    job = begin(workspace, "counted", to=40, each_s=0.1)
    time.sleep(wait_s)
    stop(job, grace_s=60.0)
    assert ended(job).state == "stopped"
    assert jobs.result_folder(job) is None


def test_the_end_of_an_earlier_stop_leaves_a_job_alone_that_was_started_again(workspace: Path):
    job = begin(workspace, "counted", to=15, each_s=0.1)
    until(job, lambda progress: progress.done > 1)
    stop(job, grace_s=0.6)
    assert ended(job).state == "stopped"
    jobs.restart(job)
    assert ended(job).state == "done"
    assert said(job).endswith("to 15")


def test_progress_is_written_a_few_times_a_second_and_always_at_a_stages_ends(tmp_path: Path):
    tell, said = Teller(tmp_path / "said.jsonl"), tmp_path / "said.jsonl"
    for number in range(1000):
        tell("quick", number, 1000)
    assert len(said.read_text().splitlines()) < 50
    tell("quick", 1000, 1000)
    assert json.loads(said.read_text().splitlines()[-1])["done"] == 1000
    tell("next", 0, 9)
    assert json.loads(said.read_text().splitlines()[-1])["stage"] == "next"


def test_jobs_are_found_again_by_the_workspace_alone(workspace: Path):
    first, second = begin(workspace, "counted", to=1), begin(workspace, "counted", to=2)
    ended(first), ended(second)
    assert jobs.jobs_of(workspace) == [second, first]
    assert jobs.read_job(workspace, first.id) == first
    assert jobs.jobs_of(workspace, "other") == []
    assert jobs.jobs_of(workspace / "nowhere") == []


@pytest.mark.parametrize("number", ["", "..", "../../etc", "a" * 15, "a" * 65, "aaaaaaaaaaaaaaaa/b", "\0" * 20, None])
def test_an_id_that_is_none_is_no_path(workspace: Path, number: str):
    assert jobs.read_job(workspace, number) is None


def test_two_at_a_time_and_no_more(workspace: Path, tmp_path: Path):
    for _ in range(2):
        begin(workspace, "counted", to=10_000, each_s=0.01)
    with pytest.raises(InputError, match="2 jobs are running already"):
        begin(workspace, "counted", to=1)
    other = tmp_path / "other"
    other.mkdir()
    assert ended(begin(other, "counted", to=1)).state == "done"


def test_all_sessions_together_are_bounded(workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(jobs, "MOST_RUNNING_IN_ALL", 1)
    monkeypatch.setattr(jobs, "_running", [])  # what other tests started may still be ending
    begin(workspace, "counted", to=10_000, each_s=0.01)
    other = tmp_path / "other"
    other.mkdir()
    with pytest.raises(InputError, match="busy with the work of others"):
        begin(other, "counted", to=1)


def test_a_running_job_is_neither_removed_nor_started_again(workspace: Path):
    job = begin(workspace, "counted", to=10_000, each_s=0.01)
    with pytest.raises(InputError, match="still running"):
        jobs.remove(job)
    with pytest.raises(InputError, match="still running"):
        jobs.restart(job)
    assert jobs.clean(workspace, older_than_s=-1.0) == 0


def test_old_jobs_go_and_the_young_stay(workspace: Path):
    old, young = begin(workspace, "counted", to=1), begin(workspace, "counted", to=1)
    ended(old), ended(young)
    past = time.time() - 8 * 24 * 3600
    for path in (*old.folder.iterdir(), old.folder):
        os.utime(path, (past, past))
    assert jobs.clean(workspace) == 1
    assert jobs.jobs_of(workspace) == [young]


def test_a_workspace_without_jobs_goes_when_it_is_old(tmp_path: Path):
    for name, age_s in (("work-old", 8 * 24 * 3600.0), ("work-young", 0.0)):
        (tmp_path / name).mkdir()
        os.utime(tmp_path / name, (time.time() - age_s,) * 2)
    session.sweep(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["work-young"]


def test_a_place_that_cannot_be_written_is_said(tmp_path: Path):
    (tmp_path / "jobs").write_text("a file where a folder must be")
    with pytest.raises(InputError, match="no job can be started there"):
        begin(tmp_path, "counted", to=1)


def test_a_server_that_ends_takes_its_workers_along(workspace: Path):
    code = (
        "import sys; from pathlib import Path; from workbench.dashboard.jobs import start\n"
        "counted = 'tests.support.job_calls:counted', {'to': 10**6, 'each_s': 0.01}\n"
        "job = start('test', *counted, Path(sys.argv[1]))\n"
        "import time\n"
        "while not job.file('kept.txt').exists(): time.sleep(0.02)\n"
    )
    subprocess.run([sys.executable, "-c", code, str(workspace)], cwd=ROOT, env=environment(), check=True, timeout=60)
    (job,) = jobs.jobs_of(workspace)
    assert poll(job).state == "stopped"


def test_a_batch_that_is_stopped_keeps_its_chunks_and_ends_as_if_it_had_never_stopped(workspace: Path, tmp_path: Path):
    scenario = write(tmp_path, SCENARIO)
    call = "workbench.dashboard.pages.batches:work"
    job = start("batch", call, {"scenario": f"{INPUTS}/s.yaml"}, workspace, inputs={"s.yaml": scenario})
    until(job, lambda progress: progress.done > 0)
    stop(job)
    halted = ended(job)
    assert halted.state == "stopped"
    assert 0 < halted.done < halted.total == 1280
    jobs.restart(job)
    going_on = until(job, lambda progress: progress.total > 0 or progress.ended)
    assert going_on.done >= halted.done
    finished = ended(job)
    assert (finished.state, finished.done, finished.failed) == ("done", 1280, 0)
    folder = jobs.result_folder(job)
    assert folder is not None
    assert len(read_finished(folder).rows) == 1280
    assert len((folder.parent / "index.csv").read_text().splitlines()) == 1281
    assert "<title>Study batch</title>" in (folder.parent / "report.html").read_text()
