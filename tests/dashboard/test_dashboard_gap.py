"""The page Gap: a campaign's diagnosis asked for, watched, cancelled, shown, kept, found again; its errors."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("streamlit")

from streamlit.testing.v1 import AppTest

from tests.support.dashboard_app import errors, figures, page
from tests.support.log_campaign import hoist_columns, write_campaign
from tests.support.made_diagnosis import made_diagnosis
from tests.support.simulated_campaign import simulated_campaign
from workbench.core.errors import InputError
from workbench.dashboard import chosen as campaigns
from workbench.dashboard import jobs, session
from workbench.dashboard.jobs import VIEW, Job, Teller, new_id, read_view, write_record, write_view
from workbench.dashboard.pages import gap
from workbench.dashboard.pages.gap import TAB, View
from workbench.dashboard.server import SCRIPT
from workbench.diagnose import diagnose as orchestration
from workbench.diagnose.diagnose import Diagnosis
from workbench.effects import check
from workbench.machines import load_machine

BOX = "gap campaign"
TABS = ["Verdict", "Where it lies", "Before and after", "Told apart, next run", "Control study", "Gap and logs"]


@pytest.fixture(scope="module")
def spring(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated_campaign(tmp_path_factory.mktemp("owner") / "spring")


@pytest.fixture(autouse=True)
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spring: Path) -> Iterator[Path]:
    """The server's own folder, empty; it offers the campaign `spring`; what runs in it ends with the test."""
    folder = tmp_path / "server"
    folder.mkdir()
    monkeypatch.setattr(session, "app_folder", lambda: folder)
    monkeypatch.setattr(campaigns, "SHIPPED", ())
    monkeypatch.setenv(campaigns.VARIABLE, str(spring.parent))
    yield folder
    for work in folder.glob("work-*"):
        for job in jobs.jobs_of(work):
            jobs.stop(job, grace_s=0.1)
            while not jobs.poll(job).ended:
                time.sleep(0.02)


def finished(
    server: Path, monkeypatch: pytest.MonkeyPatch, spring: Path, kind: str, title: str = "spring", work: str = ""
) -> tuple[str, jobs.Job]:
    """A job whose worker has found `made_diagnosis(kind)`: its workspace's id, and itself."""
    number = work or new_id()
    workspace = server / f"work-{number}"
    workspace.mkdir(mode=0o700, exist_ok=True)
    asked: dict[str, Any] = {"folder": str(spring), "name": title, "most_effects": 2, "candidates": None}
    job = Job(new_id(), gap.KIND, title, Path(), "", asked, time.time())
    job = replace(job, folder=workspace / "jobs" / job.id)
    job.folder.mkdir(parents=True)
    write_record(job)
    with monkeypatch.context() as patch:
        patch.setattr(orchestration, "diagnose", lambda campaign, **_: made_diagnosis_of(kind))
        tell = Teller(job.file("said.jsonl"))
        gap.work(job.file("result"), tell, **asked)
        tell.write(ended=0, at_s=time.time())
    return number, job


def made_diagnosis_of(kind: str) -> Diagnosis:
    return made_diagnosis(kind, kind in ("named", "pair"))


def shown(number: str) -> AppTest:
    app = page("Gap")
    app.query_params["work"] = number
    app.run()
    assert not app.exception
    return app


def turned(app: AppTest, job: jobs.Job, tab: str) -> AppTest:
    app.session_state[f"{TAB} {job.id}"] = tab
    app.run()
    assert not app.exception and errors(app) == []
    return app


def titles(app: AppTest) -> list[str]:
    return [figure["layout"]["title"].get("text", "") for figure in figures(app)]


def words(app: AppTest) -> str:
    return " ".join(element.value for element in [*app.markdown, *app.caption, *app.info]).replace("\\", "")


def the_job(server: Path) -> jobs.Job:
    (work,) = server.glob("work-*")
    return jobs.jobs_of(work)[0]


def until(app: AppTest, fact: Callable[[], bool]) -> AppTest:
    end = time.monotonic() + 240.0
    while not fact():
        assert time.monotonic() < end
        time.sleep(0.05)
    app.run()
    assert not app.exception
    return app


def begun(app: AppTest) -> AppTest:
    app.button(key="gap start").click().run()
    assert not app.exception
    return app


def one_candidate(app: AppTest) -> AppTest:
    """The quickest question."""
    app.selectbox(key="gap candidates").set_value(gap.OWN).run()
    return app


def test_a_campaign_is_shown_before_it_is_diagnosed(server):
    app = page("Gap").run()
    assert not app.exception and errors(app) == []
    assert "Campaign spring" in words(app) and "which effect the model lacks" in words(app)
    assert app.dataframe[0].value["run"].tolist() == ["empty", "half", "full"]
    assert not list(server.glob("work-*"))
    assert [button.proto.label for button in app.get("download_button")] == []


def test_a_diagnosis_is_run_in_a_process_of_its_own_and_its_answer_shown(server, spring):
    app = one_candidate(page("Gap").run())
    effect = app.multiselect[0].value[0]
    app.segmented_control(key="gap most effects").set_value(1).run()
    begun(app)
    job = the_job(server)
    assert job.arguments == {
        "folder": str(spring), "name": "spring", "most_effects": 1, "candidates": [effect],
    }  # fmt: skip
    assert app.button(key=f"stop {job.id}")
    until(app, lambda: jobs.poll(job).ended)
    assert errors(app) == [] and jobs.poll(job).state == "done"
    said = json.loads((job.file("result") / "diagnosis.json").read_text())
    assert f"#### {said['sentence']}" in words(app).replace("\u00a0", " ")
    assert "one effect at most · 1 candidate" in words(app)
    ranked = figures(app)[0]["data"][0]
    assert set(ranked["y"]) >= {"no gap", "unknown cause"}


def test_a_diagnosis_is_cancelled_tried_again_and_removed(server):
    app = begun(one_candidate(page("Gap").run()))
    job = the_job(server)
    until(app, lambda: jobs.poll(job).total > 0)
    assert "Search the effects" in words(app) and "Write the report" in words(app)
    app.button(key=f"stop {job.id}").click().run()
    until(app, lambda: jobs.poll(job).ended)
    assert ":gray-badge[stopped]" in words(app)
    assert not job.file("result").exists()
    app.button(key=f"resume {job.id}").click().run()
    assert not jobs.poll(job).ended
    app.button(key=f"stop {job.id}").click().run()
    until(app, lambda: jobs.poll(job).ended)
    app.button(key=f"remove {job.id}").click().run()
    assert not job.folder.exists()
    assert "which effect the model lacks" in words(app)


def test_the_answer_stands_first_and_each_tab_draws_its_own_figures_only(server, monkeypatch, spring):
    number, job = finished(server, monkeypatch, spring, "named")
    app = shown(number)
    assert "#### The machine lacks friction_viscous." in words(app)
    assert "That probability means: of a hundred campaigns judged like this one" in words(app)
    assert [metric.label for metric in app.metric] == ["Torque residual", "Noise floor", "Shrinks by", "Speed error"]
    assert all(metric.delta.startswith("-") for metric in app.metric if metric.delta)
    assert [tab.label for tab in app.tabs] == TABS
    assert titles(app) == ["Probability", "How the gap shows"]
    drawn = {
        "Where it lies": ["Measured and predicted torque", "Mean residual (N m) over what may explain it"],
        "Before and after": [
            "Residual on held-out runs, rms (N m)",
            "Torque residual (dashed: ± 2 × noise of 0.49 N m; grey: at rest or at an end, left out)",
            "Speed replayed open loop, in % of nominal motor speed",
        ],
        "Told apart, next run": ["Angle between the marks that two effects leave in these runs"],
        "Control study": ["Control study before and after: friction_viscous"],
        "Gap and logs": [],
    }  # fmt: skip
    for tab, expected in drawn.items():
        assert titles(turned(app, job, tab)) == expected
    assert "torque peak" in words(turned(app, job, "Control study")).lower()


def test_the_figures_are_the_reports(server, monkeypatch, spring):
    from workbench.view.diagnosis import sections_of

    _, job = finished(server, monkeypatch, spring, "named")
    view, sections = read_view(View, job), sections_of(made_diagnosis_of("named"))
    assert list(view.sections) == list(sections)
    for name in set(sections) - {"answer", "verdict"}:
        kept = list(map(tuple, view.sections[name].figures))
        assert kept == [(json.loads(figure.to_json()), note) for figure, note in sections[name].figures]
    assert job.file(VIEW).stat().st_size < 1_000_000


def test_an_unknown_cause_shows_its_curves(server, monkeypatch, spring):
    number, job = finished(server, monkeypatch, spring, "unknown")
    app = shown(number)
    assert [tab.label for tab in app.tabs] == [TABS[0], "Unknown cause", *TABS[1:]]
    assert "- An unlisted effect explains more: friction_step. Weigh it among the candidates." in words(app)
    assert titles(turned(app, job, "Unknown cause")) == ["The unknown cause: force against the motion"]
    assert "measured_correction" in words(app)


def test_what_is_alike_and_the_next_run_are_said(server, monkeypatch, spring):
    number, job = finished(server, monkeypatch, spring, "pair")
    app = turned(shown(number), job, "Told apart, next run")
    assert "These runs cannot tell it from carriage_mass_error" in words(app)
    assert "The next run.** A slow run tells friction_viscous from carriage_mass_error." in words(app)
    assert app.dataframe[0].value["signals to log too"].tolist() == ["tension_dead_line_n"]
    assert [warning.value for warning in app.warning] == ["No run logs the dead line's tension."]


def test_the_three_files_are_offered_and_the_corrected_machine_can_be_kept_for_study(server, monkeypatch, spring):
    number, job = finished(server, monkeypatch, spring, "named")
    app = shown(number)
    assert [element.proto.label for element in app.get("download_button")] == [
        "Report",
        "diagnosis.json",
        "machine.yaml",
    ]
    app.button(key="gap keep").click().run()
    assert [element.value for element in app.toast] == ["Kept as corrected by lifts"]
    corrected = load_machine(job.file("result") / "machine.yaml", check_effects=check)
    assert app.session_state["machines kept"] == {"corrected by lifts": corrected}
    study = page("Study")
    study.session_state["machines kept"] = app.session_state["machines kept"]
    study.run()
    study.selectbox(key="study machine").set_value("corrected by lifts").run()
    assert not study.exception and errors(study) == []


def test_a_kept_axis_is_offered_where_axes_are_studied_and_not_where_a_hoist_is_wanted(server, monkeypatch, spring):
    number, _ = finished(server, monkeypatch, spring, "axis")
    app = shown(number)
    app.button(key="gap keep").click().run()
    study = page("Study")
    study.session_state["machines kept"] = app.session_state["machines kept"]
    hoists = ["default hoist", "lightly damped hoist"]
    (kept,) = app.session_state["machines kept"]
    assert study.run().selectbox(key="study machine").options == [
        *hoists, "ball-screw axis", kept, "upload a machine.yaml",
    ]  # fmt: skip
    drawing = page("Machine")
    drawing.session_state["machines kept"] = app.session_state["machines kept"]
    assert drawing.run().selectbox(key="machine machine").options == [*hoists, "upload a machine.yaml"]


def test_after_a_reload_the_newest_is_shown_and_only_to_who_knows_the_address(server, monkeypatch, spring):
    number, _ = finished(server, monkeypatch, spring, "no_gap")
    finished(server, monkeypatch, spring, "named", work=number)
    assert "The machine lacks friction_viscous" in words(shown(number))
    assert "which effect the model lacks" in words(page("Gap").run())
    assert "which effect the model lacks" in words(shown(new_id()))


def test_an_earlier_diagnosis_can_be_shown_again(server, monkeypatch, spring):
    number, first = finished(server, monkeypatch, spring, "no_gap")
    finished(server, monkeypatch, spring, "named", work=number)
    app = shown(number)
    app.selectbox(key="gap shown").set_value(first.id).run()
    assert not app.exception and "No gap: what is left is noise" in words(app)


def test_a_reload_brings_back_the_campaign_too_and_another_one_its_own_answer(server, monkeypatch, spring, tmp_path):
    autumn = write_campaign(tmp_path / "autumn", hoist_columns())
    monkeypatch.setenv(campaigns.VARIABLE, f"{autumn}:{spring.parent}")
    number, _ = finished(server, monkeypatch, spring, "named")
    app = shown(number)
    assert app.selectbox(key=BOX).options[:2] == ["autumn", "spring"]
    assert app.selectbox(key=BOX).value == "spring"
    app.selectbox(key=BOX).set_value("autumn").run()
    assert "Campaign autumn" in words(app) and "The machine lacks" not in words(app)
    app.selectbox(key=BOX).set_value("spring").run()
    assert "The machine lacks friction_viscous" in words(app)


def test_an_uploaded_campaign_is_copied_for_its_job(server, spring, monkeypatch):
    monkeypatch.delenv(campaigns.VARIABLE)
    app = page("Gap").run()
    assert app.button(key="gap start").disabled
    files = [path for path in sorted(spring.rglob("*")) if path.is_file()]
    app.file_uploader(key=f"{BOX} files 0").set_value([(f.name, f.read_bytes(), "text/plain") for f in files]).run()
    begun(one_candidate(app))
    job = the_job(server)
    name = job.arguments["name"]
    assert job.title == f"{name} (uploaded)" and name == load_machine(spring / "machine.yaml").name
    again = shown(job.folder.parents[1].name.removeprefix("work-"))  # after a reload
    assert again.selectbox(key=BOX).value == job.title and again.session_state["campaign chosen"] == job.title
    assert (job.file("inputs") / "campaign" / "runs.yaml").is_file()
    assert job.arguments["folder"] == str(job.file("inputs") / "campaign")


def test_a_bad_campaign_is_one_clear_sentence_and_cannot_be_diagnosed(monkeypatch, tmp_path):
    folder = write_campaign(tmp_path / "broken", hoist_columns(), runs="runs:\n- {name: lift, fiel: runs/lift.csv}\n")
    monkeypatch.setenv(campaigns.VARIABLE, str(folder))
    app = page("Gap").run()
    (said,) = errors(app)
    assert said.startswith("runs.yaml:2: runs[0].fiel: unknown key 'fiel'; did you mean 'file'?")
    assert app.button(key="gap start").disabled


def test_runs_that_cannot_be_diagnosed_are_one_clear_sentence_without_the_servers_folder(server, monkeypatch, tmp_path):
    folder = write_campaign(tmp_path / "standing", hoist_columns())
    monkeypatch.setenv(campaigns.VARIABLE, str(folder))
    app = begun(page("Gap").run())
    job = the_job(server)
    until(app, lambda: jobs.poll(job).ended)
    (said,) = errors(app)
    with pytest.raises(InputError) as refused:
        orchestration.diagnose(campaigns.read_campaign(folder))
    assert said.endswith(refused.value.problem) and str(tmp_path) not in said
    assert ":red-badge[failed]" in words(app)


def test_without_an_effect_to_weigh_nothing_starts(server):
    app = one_candidate(page("Gap").run())
    app.multiselect[0].set_value([]).run()
    begun(app)
    assert errors(app) == ["candidates: choose at least one effect to weigh"]
    assert not list(server.glob("work-*"))


def test_a_damaged_result_says_so(server, monkeypatch, spring):
    number, job = finished(server, monkeypatch, spring, "named")
    job.file(VIEW).write_text('{"campaign": "spring"}')
    assert errors(shown(number)) == [f"{VIEW}: this result is damaged; compute it again"]


def test_a_view_is_read_as_it_was_written(tmp_path):
    job = Job(new_id(), gap.KIND, "spring", tmp_path, "", {}, 0.0)
    view = gap.view_of(made_diagnosis_of("named"))
    write_view(view, job.file(VIEW))
    again = read_view(View, job)
    assert (again.sentence, again.numbers, list(again.sections)) == (view.sentence, view.numbers, list(view.sections))
    job.file(VIEW).unlink()
    with pytest.raises(InputError, match="damaged"):
        read_view(View, job)


def test_the_address_keeps_the_jobs_on_every_page(server, monkeypatch, spring):
    number, _ = finished(server, monkeypatch, spring, "named")
    app = AppTest.from_file(str(SCRIPT), default_timeout=60.0)
    app.query_params["work"] = number
    app.run()
    app.query_params.clear()  # as a link to another page does
    app.run()
    assert not app.exception and app.query_params["work"] in (number, [number])
