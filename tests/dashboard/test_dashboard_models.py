"""Both models on the page Validate: a comparison by a job, its report on the page, its errors."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("streamlit")

from tests.support.dashboard_app import errors, figures, page
from tests.support.log_campaign import AXIS, axis_columns, hoist_columns, write_campaign
from workbench.core.errors import InputError
from workbench.dashboard import chosen as campaigns
from workbench.dashboard import jobs, session
from workbench.dashboard.jobs import VIEW, Teller, read_view
from workbench.dashboard.pages import validate
from workbench.logs import read_campaign
from workbench.machines import Hoist
from workbench.machines.files import machine_text
from workbench.machines.multibody.exudyn_import import engine
from workbench.simulate.models import compare_models
from workbench.view.page import Section

NAME = "lift"


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The server's own folder; it offers one campaign of one short run. What a worker would do is done at once."""
    write_campaign(tmp_path / "owner" / NAME, hoist_columns())
    folder = tmp_path / "server"
    folder.mkdir()
    monkeypatch.setattr(session, "app_folder", lambda: folder)
    monkeypatch.setattr(campaigns, "SHIPPED", ())
    monkeypatch.setenv(campaigns.VARIABLE, str(tmp_path / "owner"))
    monkeypatch.setattr(validate, "start", at_once)
    return folder


def at_once(
    kind: str, call: str, arguments: Mapping[str, Any], workspace: Path, title: str, inputs: Mapping[str, Path]
) -> jobs.Job:
    """As `start`, in this process."""
    job = jobs.Job(jobs.new_id(), kind, title, Path(), call, arguments, time.time())
    job = replace(job, folder=workspace / "jobs" / job.id)
    job.folder.mkdir(parents=True)
    jobs.write_record(job)
    tell = Teller(job.file("said.jsonl"))
    tell.write(ended=jobs.work(job, tell), at_s=time.time())
    return job


def words(app: Any) -> str:
    return " ".join(element.value for element in [*app.markdown, *app.caption]).replace("\\", "").replace("\u00a0", " ")


def test_both_models_are_compared_by_a_job_and_shown(server, tmp_path):
    app = page("Validate").run()
    assert "rigid bodies, joints, rollers and wire" in words(app)
    app.button(key="validate models").click().run()
    assert not app.exception and errors(app) == []
    (work,) = server.glob("work-*")
    (job,) = jobs.jobs_of(work, "models")
    assert jobs.poll(job).state == "done", jobs.poll(job).sentence
    campaign = read_campaign(tmp_path / "owner" / NAME)
    assert isinstance(campaign.machine, Hoist)
    expected = compare_models(campaign.machine, campaign.runs)
    line = app.dataframe[-1].value.iloc[0]
    assert float(line.iloc[3]) == pytest.approx(expected.runs[0].apart_percent, abs=2e-3)
    titles = [figure["layout"]["title"].get("text", "") for figure in figures(app)]
    assert titles[-3:] == ["Motor speed of both models", "Difference of both models", "Forces of rollers and cylinders"]
    assert "The paper's models took 3.46 s and 91.53 s" in words(app)
    assert [button.proto.label for button in app.get("download_button")][-2:] == ["Report", "models.json"]
    app.run()
    assert len(jobs.jobs_of(work, "models")) == 1


def test_without_the_extra_the_button_says_how_to_get_it(server, monkeypatch):
    engine.cache_clear()
    monkeypatch.setitem(sys.modules, "exudyn", None)
    app = page("Validate").run()
    app.button(key="validate models").click().run()
    engine.cache_clear()
    (said,) = errors(app)
    assert "pip install '.[multibody]'" in said
    assert not list(server.glob("work-*"))


def test_an_axis_has_one_model_only(server, tmp_path):
    write_campaign(
        tmp_path / "owner" / "drive", axis_columns(), machine=AXIS, runs="runs:\n- {name: lift, file: runs/lift.csv}\n"
    )
    app = page("Validate").run()
    app.selectbox(key="validate campaign").set_value("drive").run()
    assert not app.exception and errors(app) == []
    assert "validate models" not in [button.key for button in app.button]


def test_what_cannot_be_compared_is_said_without_the_servers_folder(server, tmp_path):
    folder = tmp_path / "owner" / NAME
    campaign = read_campaign(folder)
    machine = campaign.machine.model_copy(update={"effects": {"backlash": {"play_rad": 0.01}}})
    out = tmp_path / "job" / "result"
    out.parent.mkdir()
    with pytest.raises(InputError, match="has no effect 'backlash'") as caught:
        validate.work(out, Teller(tmp_path / "job" / "said.jsonl"), folder=str(folder), name=NAME, runs=["lift"],
            machine=machine_text(machine))  # fmt: skip
    assert str(tmp_path) not in str(caught.value)
    assert not out.exists()


def test_a_damaged_result_is_one_clear_error(tmp_path):
    (tmp_path / VIEW).write_text('{"heading": 3}')
    job = jobs.Job(jobs.new_id(), validate.MODELS, "lift", tmp_path, "", {}, 0.0)
    with pytest.raises(InputError, match="damaged; compute it again"):
        read_view(Section, job)
