"""The pages Study and Compare, the frame around them, the command that serves them, what its server answers."""

from __future__ import annotations

import base64
import gzip
import os
import re
import signal
import socket
import subprocess
import sys
import time
import tomllib
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from streamlit.testing.v1 import AppTest

from tests.support import browser
from tests.support.dashboard_app import errors, figures, good, metrics, page, sent
from workbench.cli import cli
from workbench.core.errors import InputError
from workbench.dashboard import session, widgets
from workbench.dashboard.desk import edited, usual_desk
from workbench.dashboard.server import HERE, OPTIONS, PLOTLY, hosts_allowed, is_allowed
from workbench.machines import default_hoist, with_values
from workbench.study.load import load_study, plan_study, standalone_text
from workbench.study.run import run_study
from workbench.study.scenario import Scenario

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


# What the server answers and what its answers may do: hosts, security headers, no metrics, two sessions at once.


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a server that a proxy calls workbench.example."""
    words = ["-m", "workbench", "app", "--no-browser", "--host", "workbench.example", "--port"]
    with browser.dashboard(tmp_path_factory.mktemp("hosts") / "server", words) as at:
        yield at


def websocket_status(address: str, host: str) -> int:
    """Of the answer to a browser that opens the page's WebSocket under that name."""
    port = int(address.rpartition(":")[2])
    lines = [
        "GET /_stcore/stream HTTP/1.1", f"Host: {host}", f"Origin: http://{host}", "Upgrade: websocket",
        "Connection: Upgrade", f"Sec-WebSocket-Key: {base64.b64encode(os.urandom(16)).decode()}",
        "Sec-WebSocket-Version: 13", "", "",
    ]  # fmt: skip
    with socket.create_connection(("127.0.0.1", port), timeout=10.0) as line:
        line.sendall("\r\n".join(lines).encode())
        return int(line.recv(100).split()[1])


def answer(address: str, host: str = "localhost") -> tuple[int, Any]:
    """Status and headers of a plain request."""
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers={"Host": host}), timeout=10.0) as said:
            return said.status, said.headers
    except urllib.error.HTTPError as error:
        return error.code, error.headers


@pytest.mark.parametrize("host", ["localhost:8501", "127.0.0.1", "[::1]:8501", "workbench.example"])
def test_this_computers_names_and_the_proxys_are_taken(address: str, host: str):
    assert websocket_status(address, host) == 101
    assert answer(address, host)[0] == 200


@pytest.mark.parametrize("host", ["elsewhere.example:8501", "localhost.elsewhere.example", "192.0.2.1", "[::1", "a b"])
def test_another_name_is_refused_for_pages_files_and_the_websocket(address: str, host: str):
    assert websocket_status(address, host) in (400, 403)
    for path in ("/", "/Loop", "/_stcore/health", "/static/js/index.js"):
        assert answer(address + path, host)[0] == 400


def test_who_listens_to_others_without_a_name_is_reached_by_any():
    assert OPTIONS["server.allowedHosts"] == HERE
    assert hosts_allowed("127.0.0.1", ()) == HERE
    assert hosts_allowed("0.0.0.0", ()) == [*HERE, "*"]
    assert hosts_allowed("0.0.0.0", ("lifts.example",)) == [*HERE, "lifts.example"]
    assert is_allowed("a.lifts.example:80", ["*.lifts.example"]) and not is_allowed(
        "lifts.example", ["*.lifts.example"]
    )


@pytest.mark.parametrize("path", ["/", "/Loop", "/_stcore/health", "/nothing.js"])
def test_every_answer_forbids_frames_and_what_comes_from_elsewhere(address: str, path: str):
    _, headers = answer(address + path)
    assert (headers["X-Frame-Options"], headers["X-Content-Type-Options"]) == ("DENY", "nosniff")
    assert headers["Referrer-Policy"] == "same-origin"
    policy = dict(part.split(maxsplit=1) for part in headers["Content-Security-Policy"].split("; "))
    assert (policy["default-src"], policy["frame-ancestors"]) == ("'self'", "'none'")
    assert "unsafe" not in policy["script-src"] and "http" not in " ".join(policy.values())


def test_nobody_reads_the_metrics(address: str):
    assert answer(f"{address}/_stcore/metrics")[0] == 404


def test_the_library_of_figures_is_of_the_packages_version_draws_every_trace_and_is_packed_once(address: str):
    from plotly.offline import get_plotlyjs, get_plotlyjs_version

    with urllib.request.urlopen(f"{address}/{PLOTLY}", timeout=10.0) as said:
        assert said.headers["content-encoding"] == "gzip"  # whatever the browser says it takes
        assert int(said.headers["content-length"]) < 600_000
        library = gzip.decompress(said.read()).decode()
    assert f" v{get_plotlyjs_version()}\n" in library[:100]
    mine, every = (set(re.findall(r'moduleType:"trace",name:"(\w+)"', text)) for text in (library, get_plotlyjs()))
    files = [file for part in ("view", "dashboard") for file in (browser.ROOT / "workbench" / part).rglob("*.py")]
    drawn = {kind for file in files for kind in re.findall(r'"type": "(\w+)"', file.read_text("utf-8"))} & every
    assert {"scatter", "bar", "heatmap"} <= drawn <= mine
    assert not re.search(r"\bgo\.(?!Figure\b)[A-Z]", "".join(file.read_text("utf-8") for file in files))
