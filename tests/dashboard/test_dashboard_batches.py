"""The page of batches: chosen, started, watched, stopped, resumed, opened, found again after a reload."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from tests.support.batches import SCENARIO
from tests.support.dashboard_app import errors, figures, page
from tests.support.scenario_text import GOOD
from workbench.dashboard import jobs, session
from workbench.dashboard.desk import shipped_scenarios
from workbench.dashboard.jobs import Progress, counts
from workbench.dashboard.pages import batches


@pytest.fixture(autouse=True)
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The server's own folder, empty; what runs in it ends with the test."""
    folder = tmp_path / "server"
    folder.mkdir()
    monkeypatch.setattr(session, "app_folder", lambda: folder)
    yield folder
    for work in folder.glob("work-*"):
        for job in jobs.jobs_of(work):
            jobs.stop(job, grace_s=0.1)
            while not jobs.poll(job).ended:
                time.sleep(0.02)


def the_job(server: Path) -> jobs.Job:
    (work,) = server.glob("work-*")
    return jobs.jobs_of(work)[0]


def until(app: AppTest, fact: Callable[[], bool]) -> AppTest:
    end = time.monotonic() + 300.0
    while not fact():
        assert time.monotonic() < end
        time.sleep(0.05)
    app.run()
    assert not app.exception
    return app


def begun(scenario: str = "jog") -> AppTest:
    app = page("Batches").run()
    app.selectbox(key="batches scenario").select(scenario).run()
    app.button(key="batches start").click().run()
    assert not app.exception
    return app


def uploaded(text: str) -> AppTest:
    app = page("Batches").run()
    app.selectbox(key="batches scenario").select(batches.UPLOAD).run()
    app.file_uploader(key="batches upload").set_value(("../../evil name.yaml", text.encode(), "application/yaml")).run()
    assert not app.exception
    return app


def address(app: AppTest) -> str:
    value = app.query_params["work"]
    return value if isinstance(value, str) else value[0]


def words(app: AppTest) -> str:
    return " ".join(element.value for element in [*app.markdown, *app.caption, *app.info]).replace("\\", "")


def test_a_scenario_says_what_it_would_run_before_it_runs():
    app = page("Batches").run()
    assert app.selectbox(key="batches scenario").value == "payloads"
    assert "**9 runs** of 47 s each: 3 payloads" in words(app)
    assert "No batch yet" in words(app)
    assert "work" not in app.query_params


def test_every_scenario_that_ships_can_be_chosen():
    assert len(shipped_scenarios()) >= 9
    for name in shipped_scenarios():
        app = page("Batches").run()
        app.selectbox(key="batches scenario").select(name).run()
        assert errors(app) == [], name
        assert not app.exception


def test_a_batch_of_an_axis_is_opened_with_its_own_numbers_and_figures(server: Path):
    app = begun("axis")
    job = the_job(server)
    until(app, lambda: jobs.poll(job).ended)
    assert not app.exception and errors(app) == []
    assert {element.label: element.value.split()[-1] for element in app.metric} == {
        "Largest force peak": "N",
        "Largest tracking error": "mm",
        "Shortest move time": "s",
    }
    assert figures(app)


def test_a_batch_is_started_watched_and_opened(server: Path):
    app = begun()
    job = the_job(server)
    until(app, lambda: jobs.poll(job).ended)
    assert "jog" in words(app)
    assert "4 runs" in words(app)
    assert app.subheader[0].value == "jog · 4 runs"
    assert {element.label: element.value.split()[-1] for element in app.metric} == {
        "Largest torque peak": "%",
        "Largest speed error": "rad/s",
        "Least wire tension": "kN",
        "Shortest move time": "s",
    }
    assert [tab.label for tab in app.tabs] == ["Conclusions", "Figures", "Runs", "What was run"]
    assert len(figures(app)) >= 3
    assert [element.proto.label for element in app.get("download_button")] == [
        "Report", "Index (CSV)", "Index (Parquet)", "Scenario",
    ]  # fmt: skip
    index = app.dataframe[-2].value
    assert len(index) == 4
    assert "peak_torque_motor_nm" in index.columns


def test_a_batch_is_stopped_kept_and_resumed(server: Path):
    app = uploaded(SCENARIO)
    app.button(key="batches start").click().run()
    job = the_job(server)
    until(app, lambda: jobs.poll(job).done > 0)
    assert "of 1,280 runs" in words(app)
    assert 0 < app.get("progress")[0].proto.value < 100
    app.button(key=f"stop {job.id}").click().run()
    until(app, lambda: jobs.poll(job).ended)
    assert "stopped" in words(app)
    halted = jobs.poll(job).done
    assert 0 < halted < 1280
    app.button(key=f"resume {job.id}").click().run()
    until(app, lambda: jobs.poll(job).ended)
    assert app.subheader[0].value == "batch · 1,280 runs"


def test_after_a_reload_the_batches_are_there_again_and_only_for_the_one_who_knows_the_address(server: Path):
    app = begun()
    until(app, lambda: jobs.poll(the_job(server)).ended)
    number = address(app)
    assert the_job(server).folder.parents[1].name == f"work-{number}"
    reloaded = page("Batches")
    reloaded.query_params["work"] = number
    reloaded.run()
    assert "jog" in words(reloaded)
    assert reloaded.subheader[0].value == "jog · 4 runs"
    stranger = page("Batches").run()
    assert "No batch yet" in words(stranger)
    for guess in ("../" + number, "x" * 22, ""):
        guesser = page("Batches")
        guesser.query_params["work"] = guess
        guesser.run()
        assert "No batch yet" in words(guesser)
        assert not guesser.exception


def test_a_batch_that_is_removed_leaves_nothing(server: Path):
    app = begun()
    job = the_job(server)
    until(app, lambda: jobs.poll(job).ended)
    app.button(key=f"remove {job.id}").click().run()
    assert "No batch yet" in words(app)
    assert not job.folder.exists()
    assert not app.metric


def test_an_uploaded_scenario_is_run_from_its_copy_under_the_pages_own_name(server: Path):
    app = uploaded(GOOD)
    assert "**4 runs**" in words(app)
    app.button(key="batches start").click().run()
    job = the_job(server)
    until(app, lambda: jobs.poll(job).ended)
    assert [path.name for path in (job.folder / "inputs").iterdir()] == ["scenario.yaml"]
    assert app.subheader[0].value == "small · 4 runs"


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("ruckig", "rukig", "scenario.yaml:7: references[1]: unknown reference 'rukig'; did you mean 'ruckig'?"),
        ("by_m: 4.0", "by_m: 400.0", "scenario.yaml:5:"),
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
    assert sentence in shown
    assert str(server) not in shown
    assert "batches start" not in [button.key for button in app.button]


def test_an_uploaded_scenario_may_extend_one_that_ships(server: Path):
    app = uploaded("extends: references_at_their_best.yaml\nname: mine\npayloads_kg: [700]\n")
    assert errors(app) == [] and not app.exception
    assert "batches start" in [button.key for button in app.button]
    assert "24 runs" in words(app)  # eight references, three kinds of feed-forward


MACHINE = (Path(batches.__file__).parents[2] / "machines" / "default_hoist.yaml").read_text()


@pytest.mark.parametrize("scenario", ["jog", batches.UPLOAD])
def test_a_batch_can_run_on_another_machine_than_the_scenario_names(server: Path, scenario: str):
    app = uploaded(GOOD + "machine: mine.yaml\n") if scenario == batches.UPLOAD else page("Batches").run()
    if scenario == batches.UPLOAD:
        assert "choose that machine first" in errors(app)[0]
    app.selectbox(key="batches scenario").select(scenario).run()
    app.toggle(key="batches other machine").set_value(True).run()
    assert errors(app) == []
    app.selectbox(key="batches machine").select("upload a machine.yaml").run()
    assert "batches start" not in [button.key for button in app.button]
    named = MACHINE.replace("name:", "name: another, once", 1).encode()
    app.file_uploader(key="batches machine file").set_value(("m.yaml", named, "application/yaml")).run()
    assert "another, once" in words(app)
    app.button(key="batches start").click().run()
    job = the_job(server)
    until(app, lambda: jobs.poll(job).ended)
    folder = jobs.result_folder(job)
    assert folder is not None
    assert "another, once" in (folder / "machine.yaml").read_text()


@pytest.mark.parametrize(
    ("progress", "text"),
    [
        (Progress("running"), "getting ready"),
        (Progress("running", sentence="compiling the plant"), "compiling the plant"),
        (
            Progress("running", "runs", 256, 1280, 3, rate_per_s=512.0),
            "256 of 1,280 runs, 3 failed, 512 runs/s, 2 s to go",
        ),
        (Progress("running", "writing the report", 0, 1), "writing the report"),
        (Progress("stopped", "runs", 256, 1280, rate_per_s=512.0, running_s=4.2), "256 of 1,280 runs, 4 s"),
        (Progress("done", "runs", 1280, 1280, running_s=3.0), "1,280 runs, 3 s"),
    ],
)  # fmt: skip
def test_progress_is_one_line_of_plain_numbers(progress: Progress, text: str):
    assert counts(progress, "runs") == text
