"""The page Import: a drive's file becomes a campaign that the other pages work on, with the numbers of `import`."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from tests.support.dashboard_app import errors, figures, good, page
from tests.support.log_campaign import hoist_columns
from workbench.logs import read_campaign
from workbench.logs.formats.declared import Channel
from workbench.logs.importing import propose
from workbench.machines import default_hoist

RPM = 30.0 / np.pi


def drive_file(folder: Path, suffix: str) -> bytes:
    """As a drive writes it: own names, a speed without a unit that is in rpm, torques in per cent of nominal."""
    columns, nominal = hoist_columns(), default_hoist().motor.nominal_torque_nm
    time, file = columns["time_s"], folder / f"log{suffix}"
    signals = {"n_act": columns["speed_motor_rad_s"] * RPM}
    signals |= {f"torque motor {k}": 100.0 * columns[f"torque_motor{k}_nm"] / nominal for k in (1, 2)}
    if suffix == ".csv":
        lines = [",".join(f"{value:.6g}" for value in row) for row in np.column_stack([time, *signals.values()])]
        file.write_text("\n".join([",".join(["time [s]", *signals]), *lines]))
    elif suffix == ".mat":
        savemat(file, {"time_s": time} | {name.replace(" ", "_"): values for name, values in signals.items()})
    elif suffix == ".mf4":
        with MDF() as mdf:
            mdf.append([Signal(values, time, name=name) for name, values in signals.items()])
            mdf.save(file)
    else:
        with TdmsWriter(file) as writer:
            step = {"wf_increment": float(time[1] - time[0]), "wf_start_offset": float(time[0])}
            writer.write_segment([ChannelObject("drive", name, v, properties=step) for name, v in signals.items()])
    return file.read_bytes()


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
    app.selectbox(key="import speed_motor_rad_s unit").set_value("rpm")
    for motor in (1, 2):
        app.selectbox(key=f"import torque_motor{motor}_nm unit").set_value("%nominal")
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


@pytest.mark.parametrize(
    ("factor", "guessed"), [(1.0, ""), (RPM, "rpm"), (1e4, "")], ids=["rad/s", "rpm", "none that fits"]
)
def test_a_unit_that_the_file_does_not_say_is_proposed_by_size_only_where_si_is_not_plausible(
    factor: float, guessed: str
):
    machine, columns = default_hoist(), hoist_columns()
    speed = factor * 100.0 * np.sin(columns["time_s"])
    channels = [Channel("n_act", "", columns["time_s"], speed)]
    channels += [Channel(f"torque motor {k}", "Nm", columns["time_s"], columns[f"torque_motor{k}_nm"]) for k in (1, 2)]
    (proposal,) = (p for p in propose(machine, channels).proposals if p.signal == "speed_motor_rad_s")
    assert proposal.by_size == guessed
    assert proposal.factor * factor == pytest.approx(1.0 if guessed else factor)
