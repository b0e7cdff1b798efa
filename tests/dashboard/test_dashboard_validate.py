"""The page Validate: campaigns by name or upload, replay, identification, the machine that is kept; its errors."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.support.dashboard_app import errors, metrics, page, titles, words
from tests.support.log_campaign import hoist_columns, write_campaign
from tests.support.simulated_campaign import simulated_campaign
from workbench.dashboard import chosen as campaigns
from workbench.logs import read_campaign
from workbench.simulate.replay import replay_runs

BOX = "validate campaign"


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated_campaign(tmp_path_factory.mktemp("owner") / "spring")


@pytest.fixture
def offered(simulated: Path, offer: Any) -> Path:
    """The server's owner lets people see the folder that holds `spring`."""
    offer(simulated.parent)
    return simulated


def number(app: Any, label: str) -> float:
    return float(metrics(app)[label][0].split()[0])


def zipped(folder: Path) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for path in folder.rglob("*"):
            archive.write(path, path.relative_to(folder.parent))
    return stream.getvalue()


def test_the_owners_campaigns_are_offered_by_name_never_by_path(offered):
    app = page("Validate").run()
    assert app.selectbox(key=BOX).options == ["spring", campaigns.UPLOAD]
    assert not app.text_input and not app.text_area


def test_the_replay_is_the_librarys_own(offered):
    app = page("Validate").run()
    assert not app.exception and errors(app) == []
    campaign = read_campaign(offered)
    expected = replay_runs(campaign.machine, campaign.runs)
    assert number(app, "Speed error, open loop") == pytest.approx(expected.speed_rmse_percent, rel=1e-2)
    assert number(app, "Torque residual, moving") == pytest.approx(expected.residual_rms_moving, rel=1e-2)
    assert titles(app)[0] == "Measured and simulated speed" and titles(app)[1].startswith("Torque residual")
    assert app.dataframe[0].value["run"].tolist() == ["empty", "half", "full", "all runs"]
    assert "Identify fits the values. The page Gap names what the model lacks." in words(app)
    assert "workbench" not in words(app)


def test_the_servers_copy_of_an_upload_is_let_go(simulated, monkeypatch):
    let_go: list[tuple[str, str]] = []

    class Files:
        def remove_file(self, session_id: str, file_id: str) -> None:
            let_go.append((session_id, file_id))

    context = SimpleNamespace(uploaded_file_mgr=Files(), session_id="one")
    monkeypatch.setattr(campaigns, "get_script_run_ctx", lambda: context)
    app = page("Validate").run()
    app.file_uploader(key=f"{BOX} files 0").upload("mine.zip", zipped(simulated), "application/zip")
    app.run()
    assert [session_id for session_id, _ in let_go] == ["one"] and not app.exception


def test_two_sessions_do_not_see_each_others_uploads(simulated):
    one, other = page("Validate").run(), page("Validate").run()
    one.file_uploader(key=f"{BOX} files 0").upload("mine.zip", zipped(simulated), "application/zip")
    one.run()
    other.run()
    assert any("mine" in option for option in one.selectbox(key=BOX).options)
    assert not any("mine" in option for option in other.selectbox(key=BOX).options)
    folder = one.session_state["campaigns read"]["mine (uploaded)"].path.parent
    assert folder.stat().st_mode & 0o777 == 0o700


def test_a_log_outside_an_owners_campaign_is_not_read(offer, tmp_path):
    runs = "runs:\n- {name: lift, file: ../secret.csv, payload_kg: 0.0, start_position_m: 9.0}\n"
    folder = write_campaign(tmp_path / "broken", hoist_columns(), runs=runs)
    (tmp_path / "secret.csv").write_text("time_s,secret\n")
    offer(folder)
    (shown,) = errors(page("Validate").run())
    assert "lies outside the campaign's folder" in shown
