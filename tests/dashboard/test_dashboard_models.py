"""Both models on the page Validate: a comparison by a job, its report on the page, its errors."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.support.dashboard_app import downloads, errors, good, made_job, page, the_job, titles, words
from tests.support.log_campaign import hoist_columns, write_campaign
from workbench.dashboard import jobs
from workbench.dashboard.pages import validate
from workbench.logs import read_campaign
from workbench.machines import Hoist
from workbench.machines.files import machine_text
from workbench.machines.multibody.exudyn_import import engine
from workbench.simulate.models import compare_models


@pytest.fixture
def lift(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, offer) -> Path:
    """A campaign of one short run that the server offers. What a worker would do is done at once."""

    def at_once(
        kind: str, call: str, asked: dict[str, Any], workspace: Path, title: str, inputs: Mapping[str, Path]
    ) -> jobs.Job:
        return made_job(workspace, kind, title, call, asked)

    offer(tmp_path / "owner")
    monkeypatch.setattr(jobs, "start", at_once)
    return write_campaign(tmp_path / "owner" / "lift", hoist_columns())


def compared() -> Any:
    return page("Validate").run().button(key="validate models").click().run()


def test_both_models_are_compared_by_a_job_and_shown(server: Path, lift: Path):
    app = good(compared())
    campaign = read_campaign(lift)
    assert isinstance(campaign.machine, Hoist)
    expected = compare_models(campaign.machine, campaign.runs)
    line = app.dataframe[-1].value.iloc[0]
    assert float(line.iloc[3]) == pytest.approx(expected.runs[0].apart_percent, abs=2e-3)
    assert titles(app)[-3:] == [
        "Motor speed of both models", "Difference of both models", "Forces of rollers and cylinders",
    ]  # fmt: skip
    assert "The paper's models took 3.46 s and 91.53 s" in words(app)
    assert downloads(app)[-2:] == ["Report", "models.json"]
    job = the_job(server, "models")
    app.run()
    assert jobs.jobs_of(job.folder.parents[1], "models") == [job]
    job.file(jobs.VIEW).write_text('{"heading": 3}')
    assert errors(app.run()) == [f"{jobs.VIEW}: this result is damaged; compute it again"]


def test_without_the_extra_the_button_says_how_to_get_it(server: Path, lift: Path, monkeypatch: pytest.MonkeyPatch):
    engine.cache_clear()
    monkeypatch.setitem(sys.modules, "exudyn", None)
    (said,) = errors(compared())
    engine.cache_clear()
    assert "pip install '.[multibody]'" in said and not list(server.glob("work-*"))


def test_what_cannot_be_compared_is_said_without_the_servers_folder(server: Path, lift: Path):
    machine = read_campaign(lift).machine.model_copy(update={"effects": {"backlash": {"play_rad": 0.01}}})
    asked = {"folder": str(lift), "name": "lift", "runs": ["lift"], "machine": machine_text(machine)}
    job = jobs.start(validate.MODELS, "workbench.dashboard.pages.validate:work", asked, server, "lift", {})
    assert jobs.poll(job).state == "failed" and not job.file("result").exists()
