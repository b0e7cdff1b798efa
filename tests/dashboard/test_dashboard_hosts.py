"""Which names a browser may call the server by: a page from elsewhere that names this computer is refused."""

from __future__ import annotations

import base64
import hashlib
import os
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("streamlit")

from tests.support import browser
from tests.support.proxy import documented_headers
from workbench.dashboard import first_study, warm
from workbench.dashboard.options import OPTIONS, flags, hosts_allowed

ROOT = Path(__file__).resolve().parents[2]
LOCAL = ["localhost", "127.0.0.1", "::1"]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a server that a proxy calls workbench.example."""
    words = ["-m", "workbench", "app", "--no-browser", "--host", "workbench.example", "--port"]
    with browser.dashboard(tmp_path_factory.mktemp("hosts") / "server", words) as address:
        yield address


def status(address: str, host: str) -> int:
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


@pytest.mark.parametrize("host", ["localhost:8501", "127.0.0.1", "[::1]:8501", "workbench.example"])
def test_this_computers_names_and_the_proxys_are_taken(server: str, host: str):
    assert status(server, host) == 101


@pytest.mark.parametrize("host", ["elsewhere.example:8501", "localhost.elsewhere.example", "192.0.2.1"])
def test_another_name_is_refused(server: str, host: str):
    assert status(server, host) == 403


def test_who_listens_to_others_without_a_name_is_reached_by_any():
    assert OPTIONS["server.allowedHosts"] == LOCAL
    assert hosts_allowed("127.0.0.1", ()) == LOCAL
    assert hosts_allowed("0.0.0.0", ()) == [*LOCAL, "*"]
    assert hosts_allowed("0.0.0.0", ("lifts.example",)) == [*LOCAL, "lifts.example"]
    assert [flag for flag in flags({}) if "allowedHosts" in flag] == [f"--server.allowedHosts={h}" for h in LOCAL]


def test_all_that_is_loaded_ahead_of_time_can_be(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setattr(first_study, "kept_file", lambda: tmp_path / "kept.study")
    warm._load(soon_s=0.0, later_s=0.0)
    assert (tmp_path / "kept.study").is_file()
    assert not [record for record in caplog.records if record.exc_info]


# Another thread is in the middle of importing pandas when the figures are made.
WHILE_PANDAS_IS_IMPORTED = """
import importlib.abc, sys, threading, time
import numpy, plotly.graph_objects
from workbench.dashboard import first_study, warm

begun = threading.Event()

class Slow(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "pandas.core.api":
            begun.set()
            time.sleep(0.3)

sys.meta_path.insert(0, Slow())
warm._study = warm._sliders = warm._loop = warm._others = lambda: plotly.graph_objects.Scatter(y=numpy.arange(3.0))
importing = threading.Thread(target=__import__, args=["pandas"])
importing.start()
begun.wait()
warm._load(soon_s=0.0, later_s=0.0)
importing.join()
"""


def test_loading_ahead_of_time_waits_for_pandas_that_another_thread_imports():
    done = subprocess.run(
        [sys.executable, "-c", WHILE_PANDAS_IS_IMPORTED], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stderr == ""


def test_the_documented_proxies_forbid_frames_and_foreign_scripts_and_know_streamlits_and_our_own():
    import streamlit

    headers = documented_headers()["nginx"]
    assert documented_headers()["Caddy"] == headers
    assert (headers["X-Frame-Options"], headers["X-Content-Type-Options"]) == ("DENY", "nosniff")
    assert headers["Referrer-Policy"] == "same-origin"  # an address ends in the id that finds a visitor's work
    policy = dict(part.split(maxsplit=1) for part in headers["Content-Security-Policy"].split("; "))
    assert (policy["default-src"], policy["frame-ancestors"]) == ("'self'", "'none'")
    page = (Path(streamlit.__file__).parent / "static" / "index.html").read_text(encoding="utf-8")
    page += (ROOT / "workbench" / "figures" / "film.html").read_text(encoding="utf-8")
    inline = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
              for script in re.findall(r"<script>(.*?)</script>", page, re.DOTALL)]  # fmt: skip
    assert policy["script-src"].split() == ["'self'", *(f"'sha256-{digest}'" for digest in inline)]
