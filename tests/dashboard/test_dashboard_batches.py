"""The page of batches: chosen, started, watched, stopped, resumed, opened, found again after a reload."""

from __future__ import annotations

from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from tests.support.batches import SCENARIO
from tests.support.dashboard_app import (
    after,
    downloads,
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
from tests.support.scenario_text import GOOD
from workbench.dashboard import jobs
from workbench.dashboard.desk import shipped_scenarios
from workbench.dashboard.pages import batches


def chosen(scenario: str) -> AppTest:
    return page("Batches").run().selectbox(key="batches scenario").select(scenario).run()


def begun(app: AppTest) -> AppTest:
    app.button(key="batches start").click().run()
    assert not app.exception
    return app


def uploaded(text: str) -> AppTest:
    app = sent(chosen(batches.UPLOAD), text, "batches upload")
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
    app = begun(chosen("jog"))
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
