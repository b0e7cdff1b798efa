"""The page Gap: an upload is diagnosed from its copy, and a campaign that cannot be is one sentence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from tests.support.dashboard_app import after, errors, page, the_job, words
from tests.support.log_campaign import hoist_columns, write_campaign
from tests.support.simulated_campaign import simulated_campaign
from workbench.core.errors import InputError
from workbench.dashboard import chosen
from workbench.dashboard.pages import gap
from workbench.diagnose import diagnose as orchestration
from workbench.machines import load_machine

BOX = "gap campaign"


@pytest.fixture(scope="module")
def spring(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated_campaign(tmp_path_factory.mktemp("owner") / "spring")


@pytest.fixture(autouse=True)
def offered(server: Path, spring: Path, offer: Callable[..., None]) -> None:
    offer(spring.parent)


def shown(number: str) -> AppTest:
    app = page("Gap")
    app.query_params["work"] = number
    app.run()
    assert not app.exception
    return app


def begun(app: AppTest) -> AppTest:
    app.button(key="gap start").click().run()
    assert not app.exception
    return app


def test_an_uploaded_campaign_is_copied_for_its_job(server, spring, monkeypatch):
    monkeypatch.delenv(chosen.VARIABLE)
    app = page("Gap").run()
    assert app.button(key="gap start").disabled
    files = [path for path in sorted(spring.rglob("*")) if path.is_file()]
    app.file_uploader(key=f"{BOX} files 0").set_value([(f.name, f.read_bytes(), "text/plain") for f in files]).run()
    app.selectbox(key="gap candidates").set_value(gap.OWN).run()
    begun(app)
    job = the_job(server)
    name = job.arguments["name"]
    assert job.title == f"{name} (uploaded)" and name == load_machine(spring / "machine.yaml").name
    again = shown(job.folder.parents[1].name.removeprefix("work-"))  # after a reload
    assert again.selectbox(key=BOX).value == job.title and again.session_state["campaign chosen"] == job.title
    assert job.file("inputs/campaign/runs.yaml").is_file()


def test_runs_that_cannot_be_diagnosed_are_one_clear_sentence_without_the_servers_folder(server, tmp_path, offer):
    folder = write_campaign(tmp_path / "standing", hoist_columns())
    offer(folder)
    app = begun(page("Gap").run())
    (said,) = errors(after(app, the_job(server)))
    with pytest.raises(InputError) as refused:
        orchestration.diagnose(chosen.read_campaign(folder))
    assert said.endswith(refused.value.problem) and str(tmp_path) not in said
    assert ":red-badge[failed]" in words(app)
