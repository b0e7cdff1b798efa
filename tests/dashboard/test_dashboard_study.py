"""The pages Study and Compare, the frame around them, and the command that serves them."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
import tomllib
import urllib.request
from pathlib import Path
from typing import Any

import pytest
from streamlit.testing.v1 import AppTest

from tests.support.dashboard_app import errors, figures, good, metrics, page, sent
from workbench.cli import cli
from workbench.core.errors import InputError
from workbench.dashboard import session, widgets
from workbench.dashboard.desk import edited, usual_desk
from workbench.dashboard.server import OPTIONS
from workbench.machines import default_hoist, with_values
from workbench.study.load import load_study, plan_study, standalone_text
from workbench.study.run import run_study
from workbench.study.scenario import Scenario

KP, KI = "loop kp", "loop ki"
ROOT = Path(__file__).resolve().parents[2]
SCENARIO = """\
format: 1
name: heavy
payloads_kg: [8000]
start_position_m: 3.0
moves: [{by_m: 10.0}, {dwell_s: 1.5}, {by_m: -10.0}]
limits: {speed_m_s: 0.5, acceleration_m_s2: 0.4, jerk_m_s3: 1.2}
references: [trapezoid, ruckig]
controller: {kp_nm_s_per_rad: 25.0, ki_nm_per_rad: 90.0}
"""


def usual_scenario(**values: Any) -> Scenario:
    """What the page begins with, with other values of controls."""
    return edited(usual_desk(default_hoist()).scenario, default_hoist(), values)


@pytest.fixture(scope="module")
def drawn() -> Any:
    """The Study page, run once, Ruckig against the trapezoid; tests that change it take a page of their own."""
    return against_ruckig().run()


def against_ruckig() -> Any:
    app = page("Study")
    app.session_state["study against"] = "ruckig"
    return app


def test_the_page_leads_with_the_librarys_numbers_green_where_better_and_red_where_worse(drawn):
    good(drawn)
    assert list(metrics(drawn)) == [
        "Torque peak per motor", "Largest speed error", "Smallest wire tension", "Move time",
    ]  # fmt: skip
    assert len(figures(drawn)) == 2
    result = run_study(plan_study(usual_scenario(), default_hoist()))
    worst = {
        kind: max(row["peak_torque_motor_nm"] for row in result.rows if row.reference == kind)
        for kind in ("ruckig", "trapezoid")
    }
    value, delta = metrics(drawn)["Torque peak per motor"]
    assert value == f"{widgets.text(worst['ruckig'])} N m"
    assert delta == f"{worst['ruckig'] - worst['trapezoid']:+.0f} N m"
    by_label = {metric.label: metric.proto for metric in drawn.metric}
    green, red = (type(by_label["Move time"]).MetricColor.Value(colour) for colour in ("GREEN", "RED"))
    assert by_label["Torque peak per motor"].color == green and by_label["Move time"].color == red
    assert by_label["Smallest wire tension"].color == green  # Ruckig leaves more tension, and more is better
    spec = figures(drawn)[0]
    assert spec["layout"]["hoversubplots"] == "axis"  # one cursor
    assert {trace["xaxis"] for trace in spec["data"]} == {"x10", "x11", "x12"}  # three columns of four rows


@pytest.mark.parametrize(
    ("widget", "key", "value", "said"),
    [
        ("multiselect", "study.payloads", [0.0, "heavy"], "Payloads (kg): 'heavy', expected a number in kg"),
        ("multiselect", "study.payloads", [], "Payloads (kg): choose at least one payload"),
        ("text_input", "study.name", "a/b",
         "Name of the study: 'a/b', expected up to 64 letters, digits, '.', '_' or '-'"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_one_error_under_its_controls_name_above_the_last_study(widget, key, value, said):
    app = page("Study").run()
    good(app.multiselect(key="study.payloads").set_value([0.0, "5200"]).run())  # another payload may be typed
    getattr(app, widget)(key=key).set_value(value).run()
    assert errors(app) == [said] and not app.exception and len(figures(app)) == 2


def test_a_loaded_scenario_sets_the_controls_and_stays_under_the_sliders_that_move_on_from_it():
    app = good(sent(page("Study").run(), SCENARIO, "study upload"))
    assert app.multiselect(key="study.payloads").value == [8000.0]
    assert app.slider(key="study.jerk").value == 1.2 and app.slider(key="study.way").value == 10.0
    assert app.text_input(key="study.name").value == "heavy"
    before = metrics(app)
    app.slider(key="study.jerk").set_value(0.4).run()
    assert app.slider(key="study.kp").value == 25.0 and metrics(app) != before
    good(app.selectbox(key="study ships").set_value("payloads").run())
    assert app.text_input(key="study.name").value == "payloads"


def test_a_session_has_a_private_folder_that_goes_with_it_or_with_its_server(tmp_path: Path):
    script = (
        "import streamlit as st\nfrom workbench.dashboard.session import workspace\nst.text(str(workspace()))\n"
        "(workspace() / 'x').write_text('1')\n"
    )
    one, two = AppTest.from_string(script).run(), AppTest.from_string(script).run()
    a, b = Path(one.text[0].value), Path(two.text[0].value)
    assert a != b and a.stat().st_mode & 0o777 == 0o700 and a.parent.stat().st_mode & 0o777 == 0o700
    one.session_state["workbench workspace"].cleanup()
    assert not a.exists() and b.is_dir()
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    left, ours = tmp_path / f"session-{gone.pid}-abc", tmp_path / f"session-{os.getpid()}-abc"
    left.mkdir()
    ours.mkdir()
    session.sweep(tmp_path)
    assert ours.is_dir() and not left.exists()


def test_a_link_shows_the_study_that_it_was_copied_from():
    app = page("Study").run()
    assert "study" not in app.query_params  # what everybody begins with needs no words
    app.number_input(key="study.jerk typed").set_value(7.5).run()
    link = app.query_params["study"]
    link = link if isinstance(link, str) else link[0]
    other = page("Study")
    other.query_params["study"] = link
    other.run()
    assert other.slider(key="study.jerk").value == 7.5 and errors(other) == []
    assert metrics(other) == metrics(app)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (SCENARIO.replace("[8000]", "[heavy]"), "scenario.yaml:3: payloads_kg[0]: 'heavy', expected a number"),
        ("name: [", "scenario.yaml:1: is not YAML"),
        (SCENARIO + "extends: /etc/passwd\n", "scenario.yaml:9: extends: another file, which is not here"),
        (SCENARIO + "machine: ../../secret.yaml\n", "scenario.yaml:9: machine: '../../secret.yaml' is another file"),
        (SCENARIO + "sweep: {limits.jerk_m_s3: [1, 2]}\n", "sweep: is a batch of runs"),
    ],
)
def test_a_bad_scenario_is_one_clear_error_and_leaves_the_controls(text: str, said: str):
    app = sent(page("Study").run(), text, "study upload")
    assert not app.exception
    (shown,) = errors(app)
    assert shown.startswith(said)
    assert "/tmp" not in shown and len(app.metric) == 4
    assert app.slider(key="study.jerk").value == 0.8


def test_a_saved_scenario_is_read_by_the_study_command(tmp_path: Path):
    machine = with_values(default_hoist(), {"carriage.mass_kg": 9500.0, "drive.torque_lag_s": 0.002})
    down = {"down speed": 0.5, "down acceleration": 0.4, "down jerk": 0.6}
    scenario = edited(usual_desk(machine).scenario, machine, {"payloads_kg": (0.0, 7000.0), **down})
    file = tmp_path / "saved.yaml"
    file.write_text(standalone_text(scenario, machine), encoding="utf-8")
    study = load_study(file)
    assert study.machine == machine
    assert study.specs[0].limits == plan_study(scenario, machine).specs[0].limits
    rows, own = run_study(study).rows, run_study(plan_study(scenario, machine)).rows
    assert [row.metrics for row in rows] == [row.metrics for row in own]


def test_an_error_shows_the_files_name_and_no_markdown():
    app = AppTest.from_string(
        "from workbench.dashboard.widgets import guarded\nfrom workbench.core.errors import InputError\n"
        "import streamlit as st\nwith guarded():\n"
        "    raise InputError('**bold** $x$ [a](b)', file='/private/folder/machine.yaml', line=3)\n"
        "st.write('not reached')\n"
    ).run()
    assert not app.exception and not app.markdown
    assert errors(app) == ["machine.yaml:3: **bold** $x$ [a](b)"]
    assert "\\*\\*bold" in app.error[0].value


def test_streamlit_run_and_the_command_set_the_server_up_alike():
    file = tomllib.loads((ROOT / ".streamlit" / "config.toml").read_text(encoding="utf-8"))

    def flat(block: dict[str, Any], prefix: str = "") -> dict[str, Any]:
        options: dict[str, Any] = {}
        for key, value in block.items():
            options |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
        return options

    assert flat(file) == OPTIONS


def test_a_taken_port_is_said_before_anything_starts():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"--port: port {port} of 127.0.0.1 is taken"):
            cli.main(["app", "--no-browser", "--port", str(port)], standalone_mode=False)


@pytest.mark.parametrize(("stop", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 0)])
def test_the_command_serves_on_localhost_from_any_folder_and_ends_its_server(tmp_path: Path, stop: int, status: int):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    # A browser that is missing has nothing to say: sh stands in for xdg-open.
    opener = tmp_path / "xdg-open"
    opener.write_text("#!/bin/sh\necho $0: firefox: not found >&2\necho $1 > opened\n", encoding="utf-8")
    opener.chmod(0o755)
    environment = os.environ | {
        "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1", "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}",
    }  # fmt: skip
    words = [sys.executable, "-m", "workbench", "app", "--port", str(port)]
    command = subprocess.Popen(
        words, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        assert command.stdout is not None
        assert f"http://127.0.0.1:{port}" in command.stdout.readline()  # the first line of all
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/_stcore/health", timeout=5.0) as answer:
            assert answer.status == 200
        opened, until = tmp_path / "opened", time.monotonic() + 20.0
        while sys.platform == "linux" and not opened.is_file() and time.monotonic() < until:
            time.sleep(0.05)
    finally:
        command.send_signal(stop)
        assert command.wait(60.0) == status
    rest = command.stdout.read()
    assert ("The dashboard has ended." in rest) == (status == 0)
    assert not {"Uvicorn", "firefox"} & set(rest.replace(":", " ").split())
    if sys.platform == "linux":
        assert opened.read_text(encoding="utf-8").strip() == f"http://127.0.0.1:{port}"
    with socket.socket() as after:
        assert after.connect_ex(("127.0.0.1", port)) != 0


# Drawn in a process of its own, as a first visit does; what pandas costs is a third of the imports before it.
_DRAWN = """
import sys
from tests.support.dashboard_app import figures, page
app = page("Study").run()
assert not app.exception and len(figures(app)) == 2
heavy = ("pandas", "matplotlib", "control", "exudyn", "pymodbus", "asyncua", "scipy.stats", "scipy.signal")
print([name for name in heavy if name in sys.modules])
"""


def test_the_first_page_imports_nothing_heavy_that_it_does_not_show():
    done = subprocess.run([sys.executable, "-c", _DRAWN], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
