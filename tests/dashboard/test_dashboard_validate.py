"""The pages Validate and Signals: campaigns by name or upload, replay, identification, signals under one cursor."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.support.dashboard_app import errors, figures, metrics, page, titles, words
from tests.support.log_campaign import AXIS, axis_columns, hoist_columns, write_campaign
from tests.support.simulated_campaign import simulated_campaign
from workbench.core.errors import InputError
from workbench.core.run import Array, Run
from workbench.dashboard import chosen as campaigns
from workbench.dashboard.pages.signals import RAMP, part_of, with_computed
from workbench.logs import read_campaign
from workbench.logs.signal_files import Labelled, as_csv, as_mat, as_parquet
from workbench.simulate.replay import replay_runs
from workbench.view.logs import Stretch, browser

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


# The page Signals: peaks of long logs survive, rows share one cursor, the start of a move, what is taken away.


def run(n: int = 50_000, name: str = "long") -> Run:
    """At rest for 10 s, then at speed; a peak of one sample in the torque."""
    time: Array = np.arange(n) * np.float64(0.001)
    torque = np.sin(time)
    torque[12_345] = 77.0
    speed = np.where(time < 10.0, 0.001, 100.0)
    return Run(
        name, time, {"speed_motor_rad_s": speed, "torque_motor_nm": torque, "tension_dead_line_n": 5e4 + 0 * time}
    )


def test_a_peak_of_one_sample_is_drawn_whatever_is_left_out():
    figure = browser([Stretch.whole(run())], ["torque_motor_nm"])
    assert len(figure.data[0].x) < 5000
    assert max(figure.data[0].y) == 77.0
    assert figure.data[0].x[int(np.argmax(figure.data[0].y))] == pytest.approx(12.345)


def test_what_is_taken_away_is_every_sample_of_the_stretch(tmp_path: Path):
    from pyarrow import BufferReader
    from pyarrow.csv import read_csv
    from pyarrow.parquet import read_table
    from scipy.io import loadmat

    part = part_of(Stretch(run(), 12.0, 13.0), ["torque_motor_nm"])
    labelled = [Labelled("1 up & down", {"run": "1 up", "payload_kg": 2.5}, part)] * 2
    for back in (read_csv(BufferReader(as_csv(labelled))), read_table(BufferReader(as_parquet(labelled)))):
        assert back.column_names == ["run", "payload_kg", "time_s", "torque_motor_nm"]
        assert back["torque_motor_nm"].to_numpy()[:1001] == pytest.approx(part["torque_motor_nm"], rel=1e-12)
    (tmp_path / "signals.mat").write_bytes(as_mat(labelled))
    variables = loadmat(tmp_path / "signals.mat")
    assert (variables["run_1_up___down"]["time_s"][0, 0].ravel() == part.time_s).all()
    assert "run_1_up___down_2" in variables


def test_a_computed_signal_is_arithmetic_of_signals():
    one = run(20_000)
    power = with_computed("power_w = torque_motor_nm * speed_motor_rad_s / 2", one)["power_w"]
    assert power == pytest.approx(0.5 * one["torque_motor_nm"] * one["speed_motor_rad_s"])
    slope = with_computed("a_m_s2 = ddt(time_squared_m_s)", with_computed("time_squared_m_s = 3", one))["a_m_s2"]
    assert slope == pytest.approx(np.zeros(len(slope)), abs=1e-9)


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ("x_nm = torque_moter_nm", "did you mean 'torque_motor_nm'"),
        ("x = __import__('os').system('ls')", "is not arithmetic of signals"),
        ("x = (1).__class__", "is not arithmetic of signals"),
        ("x = 1 +", "is no expression"),
        ("torque_motor_nm", "expected name = expression"),
        ("torque_motor_nm = 1", "is a signal of the log"),
        ("x = " + "(" * 5000, "is no expression"),
    ],
)
def test_what_is_no_arithmetic_of_signals_is_one_clear_error(said: str, why: str):
    with pytest.raises(InputError, match="Computed signal") as caught:
        with_computed(said, run(20_000))
    assert why in str(caught.value)


@pytest.fixture
def logged(tmp_path: Path, offer: Any) -> Path:
    write_campaign(tmp_path / "owner" / "hoist", hoist_columns())
    write_campaign(tmp_path / "owner" / "axis", axis_columns(), machine=AXIS)
    offer(tmp_path / "owner")
    return tmp_path / "owner"


def field(app: Any, number: int) -> Any:
    return next(one for one in app.multiselect if one.label == f"Row {number + 1}")


@pytest.mark.parametrize("name", ["hoist", "axis"])
def test_runs_and_signals_of_a_campaign_are_chosen_and_drawn(logged, name):
    app = page("Signals").run()
    app.selectbox(key="signals campaign").set_value(name).run()
    assert not app.exception and errors(app) == []
    fields = [field for field in app.multiselect if field.label.startswith("Row")]
    first, last = fields[0].value, len(fields) - 1
    assert len(figures(app)[0]["data"]) == last > 0 and fields[-1].value == []
    # two signals in one row, and a computed one, which has a row of its own
    field(app, last).set_value(field(app, 1).options[:2] if last > 1 else first).run()
    app.text_area[0].set_value(f"twice = 2 * {first[0]}").run()
    assert not app.exception and errors(app) == [] and len(figures(app)[0]["data"]) >= last + 2
    assert "twice" in field(app, 0).options
    while field(app, 0).value:  # a row that is emptied is gone, and those below it move up
        field(app, 0).set_value([]).run()
    assert len(figures(app)[0]["data"]) == 1 and not app.exception
    app.segmented_control(key="signals stretch").set_value(RAMP).run()
    assert not app.exception
    app.text_area[0].set_value("").run()
    assert [info.value for info in app.info] == ["Choose at least one run and one signal."]
