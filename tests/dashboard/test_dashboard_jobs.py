"""Long work outside the page: it is watched, stopped, found again, and goes when it is old."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support.batches import ROOT, environment
from tests.support.dashboard_app import end_all, ended, until
from workbench.core.errors import InputError
from workbench.dashboard import jobs, session
from workbench.dashboard.jobs import INPUTS, Job, poll, start, stop

LONG: dict[str, Any] = {"to": 10_000, "each_s": 0.01}


@pytest.fixture
def workspace(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / "work"
    folder.mkdir()
    yield folder
    end_all(folder)


def begin(workspace: Path, name: str, **arguments: object) -> Job:
    return start("test", f"tests.support.job_calls:{name}", arguments, workspace)


def said(job: Job) -> str:
    return job.file("result/said.txt").read_text()


def test_a_stopped_call_goes_on_from_what_it_kept(workspace: Path):
    job = begin(workspace, "counted", **LONG)
    until(job, lambda progress: progress.done > 5)
    stop(job)
    assert ended(job).state == "stopped" and not job.file("result").exists()
    assert int(job.file("kept.txt").read_text()) > 5
    job.file("kept.txt").write_text("9990")
    jobs.restart(job)
    assert ended(job).state == "done" and said(job) == "9990 to 10000"


def test_work_sees_its_own_copy_of_the_inputs_and_gives_way_to_the_page(workspace: Path, tmp_path: Path):
    file = tmp_path / "upload.txt"
    file.write_text("as it was")
    call = "tests.support.job_calls:what_it_sees"
    job = start("test", call, {"file": f"{INPUTS}/a.txt"}, workspace, inputs={"a.txt": file, "b.txt": "a text"})
    file.unlink()
    ended(job)
    assert said(job) == f"as it was|{job.id}|{min(os.nice(0) + 10, 19)}"
    assert job.file("inputs/b.txt").read_text() == "a text"


def test_a_file_in_the_jobs_folder_is_never_imported(workspace: Path):
    job = begin(workspace, "counted", to=1)
    ended(job)
    for name in ("json.py", "workbench.py"):
        job.file(name).write_text("raise SystemExit(7)")
    job.file("kept.txt").unlink()
    job.file("result/said.txt").unlink()
    job.file("result").rmdir()
    jobs.restart(job)
    assert ended(job).state == "done"


@pytest.mark.parametrize(
    ("name", "arguments", "sentence", "logged"),
    [
        ("refused", {"file": f"{INPUTS}/m.yaml"}, "m.yaml:3: unknown key 'mas'", ""),
        ("refused", {"file": "/srv/own/lifts/m.yaml", "folder": "/srv/own/lifts"}, "m.yaml:3: unknown key 'mas'", ""),
        ("refused", {"file": "/srv/own/lifts", "folder": "/srv/own/lifts"}, "lifts:3: unknown key 'mas'", ""),
        ("defective", {}, "ZeroDivisionError: a defect", "Traceback"),
        ("shot", {}, jobs.KILLED, ""),
    ],
    ids=["bad input", "bad file of the server", "bad folder of the server", "defect", "killed"],
)
def test_what_went_wrong_is_one_line_without_the_servers_folders(
    workspace: Path, name: str, arguments: dict[str, Any], sentence: str, logged: str
):
    job = begin(workspace, name, **arguments)
    progress = ended(job)
    assert (progress.state, progress.sentence) == ("failed", sentence)
    assert logged in job.file("stderr.txt").read_text()


def test_a_worker_that_does_not_hear_ctrl_c_is_ended_by_a_second_stop_with_its_children(workspace: Path):
    job = begin(workspace, "stubborn")
    child = int(until(job, lambda progress: progress.stage.startswith("child")).stage.split()[1])
    stop(job)
    time.sleep(0.3)
    assert poll(job).state == "stopping"
    stop(job)
    assert ended(job).state == "stopped"
    for _ in range(200):
        try:
            os.kill(child, 0)
        except ProcessLookupError:
            return
        time.sleep(0.02)
    # A zombie that nobody waits for is dead too.
    assert Path(f"/proc/{child}/stat").read_text().split(")")[1].split()[0] == "Z"


def test_a_stop_is_heard_when_the_server_was_put_into_the_background(workspace: Path):
    """Such a server ignores Ctrl-C, and what it starts inherits that."""
    old = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        job = begin(workspace, "counted", **LONG)
    finally:
        signal.signal(signal.SIGINT, old)
    until(job, lambda progress: progress.done > 0)
    stop(job)
    assert ended(job).state == "stopped"


@pytest.mark.parametrize("wait_s", [0.0, 0.02, 0.1])
def test_a_stop_before_the_worker_can_hear_of_it_is_not_lost(workspace: Path, wait_s: float):
    job = begin(workspace, "counted", to=40, each_s=0.1)
    time.sleep(wait_s)
    stop(job)
    assert ended(job).state == "stopped" and not job.file("result").exists()


@pytest.mark.parametrize("number", ["", "..", "../../etc", "a" * 15, "a" * 65, "aaaaaaaaaaaaaaaa/b", "\0" * 20, None])
def test_an_id_that_is_none_is_no_path(number: str | None):
    assert not jobs.is_id(number)
    assert jobs.is_id(jobs.new_id())


def test_two_at_a_time_and_no_more_and_all_sessions_together_are_bounded(
    workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(jobs, "_running", [])  # what other tests started may still be ending
    for _ in range(2):
        running = begin(workspace, "counted", **LONG)
    with pytest.raises(InputError, match="2 jobs are running already"):
        begin(workspace, "counted", to=1)
    other = tmp_path / "other"
    other.mkdir()
    assert ended(begin(other, "counted", to=1)).state == "done"
    monkeypatch.setattr(jobs, "MOST_RUNNING_IN_ALL", 2)
    with pytest.raises(InputError, match="busy with the work of others"):
        begin(other, "counted", to=1)
    for refused in (jobs.remove, jobs.restart):
        with pytest.raises(InputError, match="still running"):
            refused(running)
    assert jobs.clean(workspace, older_than_s=-1.0) == 0


def test_old_jobs_and_old_workspaces_without_one_go_and_the_young_stay(workspace: Path, tmp_path: Path):
    old, young = begin(workspace, "counted", to=1), begin(workspace, "counted", to=1)
    ended(old), ended(young)
    past = time.time() - 8 * 24 * 3600
    for path in (*old.folder.iterdir(), old.folder):
        os.utime(path, (past, past))
    assert jobs.clean(workspace) == 1 and jobs.jobs_of(workspace) == [young]
    root = tmp_path / "root"
    for name, when in (("work-old", past), ("work-young", time.time())):
        (root / name).mkdir(parents=True)
        os.utime(root / name, (when, when))
    session.sweep(root)
    assert [path.name for path in root.iterdir()] == ["work-young"]


def test_a_server_that_ends_takes_its_workers_along(workspace: Path):
    code = (
        "import sys, time; from pathlib import Path; from workbench.dashboard.jobs import start\n"
        "counted = 'tests.support.job_calls:counted', {'to': 10**6, 'each_s': 0.01}\n"
        "job = start('test', *counted, Path(sys.argv[1]))\n"
        "while not job.file('kept.txt').exists(): time.sleep(0.02)\n"
    )
    subprocess.run([sys.executable, "-c", code, str(workspace)], cwd=ROOT, env=environment(), check=True, timeout=60)
    (job,) = jobs.jobs_of(workspace)
    assert ended(job).state == "stopped"
