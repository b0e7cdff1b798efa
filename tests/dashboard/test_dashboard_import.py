"""The page Import: a drive's file becomes a campaign that the other pages work on, with the numbers of `import`."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import pytest

from tests.support.dashboard_app import errors, figures, good, page, words
from tests.support.drive_files import drive_file
from tests.support.log_campaign import hoist_columns
from workbench.logs import read_campaign


def dropped(content: bytes, suffix: str = ".csv") -> Any:
    app = page("Import").run()
    assert not app.exception and "One file a run" in app.get("file_uploader")[0].proto.label
    app.file_uploader(key="import files").upload(f"../lift one{suffix}", content, "application/octet-stream").run()
    assert not app.exception
    return app


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".mf4", ".tdms"])
def test_a_drives_file_becomes_a_campaign_with_its_own_numbers(server: Path, suffix: str):
    app = dropped(drive_file(server, suffix), suffix)
    assert app.selectbox(key="import speed_motor_rad_s").value == "n_act"
    assert "its unit is not said: by its size %nominal" in words(app)  # 60 to 70 % would not hold the carriage
    app.number_input(key="import start lift one").set_value(9.0)
    app.number_input(key="import payload lift one").set_value(4500.0).run()
    assert errors(app) == [] and len(figures(app)) == 1
    app.text_input(key="import name").set_value("../mine").run()
    good(app.button(key="import make").click().run())
    name, packed = app.session_state["import made"]
    assert "/" not in name
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        assert sorted(archive.namelist()) == ["machine.yaml", "runs.yaml", "runs/lift one.parquet"]
        archive.extractall(server / "out")
    (run,) = read_campaign(server / "out").runs
    expected = hoist_columns()
    for signal in ("speed_motor_rad_s", "torque_motor1_nm", "torque_motor2_nm"):
        assert run[signal] == pytest.approx(expected[signal], rel=1e-4, abs=1e-3)
    assert run.payload_kg == 4500.0 and app.session_state["campaign chosen"].startswith(name)


def test_what_is_no_log_and_a_missing_payload_are_one_sentence(server: Path):
    app = page("Import").run()
    app.file_uploader(key="import files").upload("a.csv", b"\x00\x01nothing", "text/csv").run()
    assert not app.exception and len(errors(app)) == 1
    app = dropped(drive_file(server, ".csv"))
    app.button(key="import make").click().run()
    assert not app.exception and len(errors(app)) == 1 and "/" not in errors(app)[0].partition(":")[0]
