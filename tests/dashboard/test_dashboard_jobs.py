"""Long work outside the page, and the pages Batches and Gap that start it."""

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
from streamlit.testing.v1 import AppTest

from tests.support.batches import ROOT, SCENARIO, environment
from tests.support.dashboard_app import (
    after,
    downloads,
    end_all,
    ended,
    errors,
    figures,
    good,
    metrics,
    page,
    sent,
    the_job,
    until,
    words,
)
from tests.support.log_campaign import hoist_columns, write_campaign
from tests.support.scenario_text import GOOD
from tests.support.simulated_campaign import simulated_campaign
from workbench.core.errors import InputError
from workbench.dashboard import chosen, jobs, session
from workbench.dashboard.desk import shipped_scenarios
from workbench.dashboard.jobs import INPUTS, Job, poll, start, stop
from workbench.dashboard.pages import batches, gap
from workbench.diagnose import diagnose as orchestration
from workbench.machines import load_machine

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
def test_what_went_wrong_is_one_line_without_the_servers_folders(workspace, name, arguments, sentence, logged):
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


def test_two_at_a_time_and_no_more_and_all_sessions_together_are_bounded(workspace, tmp_path, monkeypatch):
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


# The page of batches: chosen, started, watched, stopped, resumed, opened, found again after a reload.


def picked(scenario: str) -> AppTest:
    return page("Batches").run().selectbox(key="batches scenario").select(scenario).run()


def begun(app: AppTest) -> AppTest:
    app.button(key="batches start").click().run()
    assert not app.exception
    return app


def uploaded(text: str) -> AppTest:
    app = sent(picked(batches.UPLOAD), text, "batches upload")
    assert not app.exception
    return app


def units(app: AppTest) -> dict[str, str]:
    return {label: value.split()[-1] for label, (value, _) in metrics(app).items()}


def test_a_scenario_says_what_it_would_run_before_it_runs():
    app = page("Batches").run()
    assert app.selectbox(key="batches scenario").value == "payloads"
    assert "**9 runs** of 47 s each: 3 payloads" in words(app) and "No batch yet" in words(app)
    assert "work" not in app.query_params
    assert len(shipped_scenarios()) >= 9
    for name in shipped_scenarios():
        good(app.selectbox(key="batches scenario").select(name).run())


def test_a_batch_is_started_watched_opened_found_after_a_reload_and_removed(server: Path):
    app = begun(picked("jog"))
    job = the_job(server)
    after(app, job)
    assert "jog" in words(app) and "4 runs" in words(app) and app.subheader[0].value == "jog · 4 runs"
    assert units(app) == {
        "Torque peak per motor": "m", "Largest speed error": "rad/s", "Smallest wire tension": "kN", "Move time": "s",
    }  # fmt: skip
    assert [tab.label for tab in app.tabs] == ["Conclusions", "Figures", "Runs", "What was run"]
    assert len(figures(app)) >= 3
    assert downloads(app) == ["Report", "Index (CSV)", "Index (Parquet)", "Scenario"]
    index = app.dataframe[-2].value
    assert len(index) == 4 and "peak_torque_motor_nm" in index.columns
    number = "".join(app.query_params["work"])  # only who knows it finds the batch
    assert job.folder.parents[1].name == f"work-{number}"
    for guess in (number, "../" + number, "x" * 22, ""):
        other = page("Batches")
        other.query_params["work"] = guess
        other.run()
        assert not other.exception and ("No batch yet" in words(other)) == (guess != number)
    app.button(key=f"remove {job.id}").click().run()
    assert "No batch yet" in words(app) and not job.folder.exists() and not app.metric


def test_a_batch_is_stopped_kept_and_resumed(server: Path):
    app = begun(uploaded(SCENARIO))
    job = the_job(server)
    until(job, lambda progress: progress.done > 0)
    app.run()
    assert "of 1,280 runs" in words(app) and 0 < app.get("progress")[0].proto.value < 100
    app.button(key=f"stop {job.id}").click().run()
    assert "stopped" in words(after(app, job)) and 0 < jobs.poll(job).done < 1280
    app.button(key=f"resume {job.id}").click().run()
    assert after(app, job).subheader[0].value == "batch · 1,280 runs"


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("format: 1", "extends: ../../secret.yaml", "scenario.yaml:1: extends: another file, which is not here"),
        ("format: 1", "machine: ../../secret.yaml", "'../../secret.yaml' is another file, which is not here"),
        ("[trapezoid, ruckig]", "[{kind: recorded, campaign: /etc, run: a}]", "references[0]: a recorded campaign"),
        ("format: 1", "name: [", "scenario.yaml"),
        ("format: 1", "!!python/object/apply:os.system ['ls']", "scenario.yaml"),
        ("payloads_kg: [0, 9000]", "sweep: {payload_kg: {from: 0, to: 9000, steps: 60000}}\noutputs: {signals: none}",
         "120000 runs, expected at most 100000 here"),
        ("payloads_kg: [0, 9000]", "sweep: {payload_kg: {from: 0, to: 9000, steps: 2000}}",
         "4000 runs that keep their signals, expected at most 1000"),
    ],
)  # fmt: skip
def test_a_bad_upload_shows_its_one_error_and_no_start(old: str, new: str, sentence: str, server: Path):
    app = uploaded(GOOD.replace(old, new, 1))
    (shown,) = errors(app)
    assert sentence in shown and str(server) not in shown
    assert "batches start" not in [button.key for button in app.button]


# The page Gap: an upload is diagnosed from its copy, and a campaign that cannot be is one sentence.


BOX = "gap campaign"


@pytest.fixture(scope="module")
def spring(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated_campaign(tmp_path_factory.mktemp("owner") / "spring")


def shown(number: str) -> AppTest:
    app = page("Gap")
    app.query_params["work"] = number
    app.run()
    assert not app.exception
    return app


def diagnosing(app: AppTest) -> AppTest:
    app.button(key="gap start").click().run()
    assert not app.exception
    return app


def test_an_uploaded_campaign_is_copied_for_its_job(server, spring):
    app = page("Gap").run()
    assert app.button(key="gap start").disabled
    files = [path for path in sorted(spring.rglob("*")) if path.is_file()]
    app.file_uploader(key=f"{BOX} files 0").set_value([(f.name, f.read_bytes(), "text/plain") for f in files]).run()
    app.selectbox(key="gap candidates").set_value(gap.OWN).run()
    diagnosing(app)
    job = the_job(server)
    name = job.arguments["name"]
    assert job.title == f"{name} (uploaded)" and name == load_machine(spring / "machine.yaml").name
    again = shown(job.folder.parents[1].name.removeprefix("work-"))  # after a reload
    assert again.selectbox(key=BOX).value == job.title and again.session_state["campaign chosen"] == job.title
    assert job.file("inputs/campaign/runs.yaml").is_file()


def test_runs_that_cannot_be_diagnosed_are_one_clear_sentence_without_the_servers_folder(server, tmp_path, offer):
    folder = write_campaign(tmp_path / "standing", hoist_columns())
    offer(folder)
    app = diagnosing(page("Gap").run())
    (said,) = errors(after(app, the_job(server)))
    with pytest.raises(InputError) as refused:
        orchestration.diagnose(chosen.read_campaign(folder))
    assert said.endswith(refused.value.problem) and str(tmp_path) not in said
    assert ":red-badge[failed]" in words(app)


def test_every_file_of_a_diagnosis_that_its_sentences_name_can_be_downloaded(tmp_path: Path):
    for name in gap.FILES:
        (tmp_path / name).write_text(name)
    words = [words for words, *_ in gap.files_of(tmp_path)]
    assert words == ["Report", *list(gap.FILES)[1:]]
    assert {"next_run.csv", "law.py", "machine_law.yaml"} < set(words)
    (tmp_path / "law.py").unlink()
    assert "law.py" not in [words for words, *_ in gap.files_of(tmp_path)]
