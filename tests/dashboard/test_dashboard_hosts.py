"""What the server answers and what its answers may do: hosts, security headers, no metrics, two sessions at once."""

from __future__ import annotations

import base64
import gzip
import os
import re
import socket
import urllib.error
import urllib.request
from collections.abc import Iterator
from typing import Any

import pytest

from tests.support import browser
from workbench.dashboard.server import HERE, OPTIONS, PLOTLY, hosts_allowed, is_allowed


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a server that a proxy calls workbench.example."""
    words = ["-m", "workbench", "app", "--no-browser", "--host", "workbench.example", "--port"]
    with browser.dashboard(tmp_path_factory.mktemp("hosts") / "server", words) as address:
        yield address


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
def test_this_computers_names_and_the_proxys_are_taken(server: str, host: str):
    assert websocket_status(server, host) == 101
    assert answer(server, host)[0] == 200


@pytest.mark.parametrize("host", ["elsewhere.example:8501", "localhost.elsewhere.example", "192.0.2.1", "[::1", "a b"])
def test_another_name_is_refused_for_pages_files_and_the_websocket(server: str, host: str):
    assert websocket_status(server, host) in (400, 403)
    for path in ("/", "/Loop", "/_stcore/health", "/static/js/index.js"):
        assert answer(server + path, host)[0] == 400


def test_who_listens_to_others_without_a_name_is_reached_by_any():
    assert OPTIONS["server.allowedHosts"] == HERE
    assert hosts_allowed("127.0.0.1", ()) == HERE
    assert hosts_allowed("0.0.0.0", ()) == [*HERE, "*"]
    assert hosts_allowed("0.0.0.0", ("lifts.example",)) == [*HERE, "lifts.example"]
    assert is_allowed("a.lifts.example:80", ["*.lifts.example"]) and not is_allowed(
        "lifts.example", ["*.lifts.example"]
    )


@pytest.mark.parametrize("path", ["/", "/Loop", "/_stcore/health", "/nothing.js"])
def test_every_answer_forbids_frames_and_what_comes_from_elsewhere(server: str, path: str):
    _, headers = answer(server + path)
    assert (headers["X-Frame-Options"], headers["X-Content-Type-Options"]) == ("DENY", "nosniff")
    assert headers["Referrer-Policy"] == "same-origin"
    policy = dict(part.split(maxsplit=1) for part in headers["Content-Security-Policy"].split("; "))
    assert (policy["default-src"], policy["frame-ancestors"]) == ("'self'", "'none'")
    assert "unsafe" not in policy["script-src"] and "http" not in " ".join(policy.values())


def test_nobody_reads_the_metrics(server: str):
    assert answer(f"{server}/_stcore/metrics")[0] == 404


def test_the_library_of_figures_is_of_the_packages_version_draws_every_trace_and_is_packed_once(server: str):
    from plotly.offline import get_plotlyjs, get_plotlyjs_version

    with urllib.request.urlopen(f"{server}/{PLOTLY}", timeout=10.0) as said:
        assert said.headers["content-encoding"] == "gzip"  # whatever the browser says it takes
        assert int(said.headers["content-length"]) < 600_000
        library = gzip.decompress(said.read()).decode()
    assert f" v{get_plotlyjs_version()}\n" in library[:100]
    mine, every = (set(re.findall(r'moduleType:"trace",name:"(\w+)"', text)) for text in (library, get_plotlyjs()))
    files = [file for part in ("view", "dashboard") for file in (browser.ROOT / "workbench" / part).rglob("*.py")]
    drawn = {kind for file in files for kind in re.findall(r'"type": "(\w+)"', file.read_text("utf-8"))} & every
    assert {"scatter", "bar", "heatmap"} <= drawn <= mine
    assert not re.search(r"\bgo\.(?!Figure\b)[A-Z]", "".join(file.read_text("utf-8") for file in files))
