"""The dashboard in a real browser: a server of its own, Debian's Chromium, what its console says, how long things take.

`dashboard()` starts the server, `visit()` is a visitor. What the server's security policy forbids is an error in the
console. Times are measured inside the browser.
"""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from playwright.sync_api import Browser, ConsoleMessage, Locator, Page, Request

ROOT = Path(__file__).resolve().parents[2]
WIDTH, HEIGHT = 1280, 800
Scheme = Literal["light", "dark"]
STARTS_WITHIN_S = 60.0
DRAWN_WITHIN_MS = 240_000.0  # a first page may compile kernels, on a computer that does other work too

QUIET_MS = 400

# Runs in the page: the title of each button of its figures.
BUTTONS = "() => [...document.querySelectorAll('.modebar-btn')].map(b => b.getAttribute('data-title') || b.title)"

# Runs in the page: when a pointer was let go, when anything last changed, whether the script has ended.
_INSTRUMENTS = r"""
window.bench = {released: 0, changed: 0};
addEventListener("pointerup", () => { window.bench.released = performance.now(); }, true);
new MutationObserver(() => { window.bench.changed = performance.now(); }).observe(
  document, {subtree: true, childList: true, attributes: true, characterData: true});
window.bench.ended = () => {
  const app = document.querySelector('[data-testid="stApp"]');
  return !!app && app.getAttribute("data-test-script-state") === "notRunning"
    && !document.querySelector('[data-stale="true"]') && !document.querySelector('[data-testid="stSkeleton"]')
    && !document.querySelector("[data-drawing]");
};
window.bench.still = quiet => window.bench.ended() && performance.now() - window.bench.changed > quiet;
window.bench.figures = () => [...document.querySelectorAll(".js-plotly-plot")].filter(f => f.data && f.calcdata);
window.bench.xRange = () => {
  const layout = window.bench.figures()[0]._fullLayout;
  return layout[Object.keys(layout).find(name => /^xaxis\d*$/.test(name))].range;
};
window.bench.said = () => window.bench.figures().map(f => JSON.stringify(f.data)).join("|");
"""


def chromium() -> str | None:
    """Where the browser is; None where there is none."""
    return shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


def what_is_missing() -> str | None:
    """What these tests want and this computer has not."""
    import importlib.util

    if importlib.util.find_spec("playwright") is None:
        return "playwright is not installed"
    return None if chromium() else "no Chromium on the PATH (Debian's package is called chromium)"


APP = ["-m", "workbench", "app", "--no-browser", "--port"]
SCRIPT = ["-m", "streamlit", "run", "app.py", "--server.port"]


@contextmanager
def dashboard(home: Path, words: Sequence[str] = APP) -> Iterator[str]:
    """The address of a fresh server that knows nothing of this user but the cache of compiled kernels.

    words: how Python is to start it, up to the port.
    """
    from workbench.engine.native import cache_folder

    for folder in (home, home / "tmp"):
        folder.mkdir(parents=True, exist_ok=True)
    own = {"HOME": str(home), "TMPDIR": str(home / "tmp"), "WORKBENCH_CACHE": str(cache_folder())}
    port = _free_port()
    log = home / "server.log"
    with log.open("wb") as out:
        process = subprocess.Popen(
            [sys.executable, *words, str(port)],
            cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)} | own, stdout=out, stderr=out,
        )  # fmt: skip
    address = f"http://localhost:{port}"
    try:
        _wait_until_healthy(f"{address}/_stcore/health", process, log)
        yield address
    finally:
        process.terminate()
        process.wait(30)
        said = log.read_text()
    assert "Traceback" not in said and "Warning" not in said and "warning" not in said, said


def _free_port() -> int:
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        port: int = sock.getsockname()[1]
    return port


def _wait_until_healthy(address: str, process: subprocess.Popen[bytes], log: Path) -> None:
    end = time.monotonic() + STARTS_WITHIN_S
    while time.monotonic() < end:
        assert process.poll() is None, log.read_text()
        try:
            with urllib.request.urlopen(address, timeout=1.0) as answer:
                if answer.status == 200:
                    return
        except OSError:
            time.sleep(0.05)
    raise AssertionError(f"no server within {STARTS_WITHIN_S} s: {log.read_text()}")


@contextmanager
def browser() -> Iterator[Browser]:
    from playwright.sync_api import sync_playwright

    # Root has no sandbox to give; elsewhere it stays.
    words = ["--no-sandbox"] if os.getuid() == 0 else []
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(
            executable_path=chromium(), args=["--disable-gpu", "--disable-dev-shm-usage", *words]
        )
        yield started
        started.close()


# A page that is opened by its own address looks for the server below that address first, and finds it above.
_LOOKED_FOR_ELSEWHERE = re.compile(r"/\w+/_stcore/(health|host-config)$")


@dataclass
class Visit:
    """One person's page.

    complaints: what the console and failed requests say. asked: the addresses, beside the server's, that the page
    has asked for something.
    """

    page: Page
    address: str
    shots: Path
    complaints: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def listen(self) -> None:
        self.page.on("console", self._console)
        self.page.on("pageerror", lambda error: self.complaints.append(f"{self.page.url}: {error}"))
        self.page.on("requestfailed", self._failed)
        self.page.on("request", self._request)

    def _console(self, message: ConsoleMessage) -> None:
        where = str(message.location.get("url", ""))
        if message.type == "error" and not _LOOKED_FOR_ELSEWHERE.search(where):
            self.complaints.append(f"{self.page.url}: {where}: {message.text}")

    def _failed(self, request: Request) -> None:
        # What was under way when the visitor left is no failure.
        if "ERR_ABORTED" not in str(request.failure):
            self.complaints.append(f"{self.page.url}: {request.url}: {request.failure}")

    def _request(self, request: Request) -> None:
        if not request.url.startswith((self.address, "data:", "blob:")):
            self.asked.append(request.url)

    def go(self, title: str = "") -> None:
        """To a page by its address, as a first visit or a reload does."""
        answer = self.page.goto(f"{self.address}/{title.lower()}", wait_until="commit")
        assert answer is not None and "frame-ancestors 'none'" in answer.headers["content-security-policy"]
        self.drawn()

    def turn_to(self, title: str) -> None:
        """To a page by its link, which keeps the session."""
        self.page.get_by_test_id("stTopNavLink").filter(has_text=title).click()
        self.page.wait_for_url(re.compile(rf"/({title.lower()})?(\?.*)?$"))
        self.drawn()

    def choose(self, label: str, option: str) -> None:
        """An option of a select box, where it is not chosen already."""
        box = self.page.get_by_test_id("stSelectbox").filter(has_text=label)
        if option not in box.inner_text():
            box.get_by_role("combobox").click()
            self.page.get_by_role("option", name=option, exact=True).click()
            self.drawn()

    def drawn(self, figures: int = 0) -> None:
        """Waits until the page has stood still for a moment and shows at least so many figures."""
        self.page.wait_for_function(
            "([quiet, figures]) => window.bench.still(quiet) && window.bench.figures().length >= figures",
            arg=[QUIET_MS, figures], timeout=DRAWN_WITHIN_MS,
        )  # fmt: skip

    def figures_drawn_s(self, figures: int) -> float:
        """From the address to so many figures drawn, whether the script has ended or not."""
        waited = self.page.wait_for_function(
            "n => document.querySelectorAll('.js-plotly-plot .main-svg').length && window.bench.figures().length >= n"
            " && performance.now()",
            arg=figures, polling="raf", timeout=DRAWN_WITHIN_MS,
        )  # fmt: skip
        return float(waited.json_value()) / 1000.0

    def first_drawn_s(self, figures: int) -> float:
        """From the address to so many figures drawn and the script ended, as the browser counts."""
        waited = self.page.wait_for_function(
            "n => window.bench.ended() && window.bench.figures().length >= n && performance.now()",
            arg=figures, polling="raf", timeout=DRAWN_WITHIN_MS,
        )  # fmt: skip
        return float(waited.json_value()) / 1000.0

    def shot(self, name: str, whole: bool = False) -> Path:
        path = self.shots / f"{name}.png"
        self.page.screenshot(path=path, full_page=whole)
        return path

    def x_range(self) -> list[float]:
        """What the first figure shows of its first axis."""
        shown: list[float] = self.page.evaluate("window.bench.xRange()")
        return shown

    def zoom(self, start: float, end: float) -> None:
        """Draws a box in the first figure from one share of its width to another."""
        drawing = self.page.locator(".nsewdrag").first
        drawing.scroll_into_view_if_needed()
        box = drawing.bounding_box()
        assert box
        y = box["y"] + 0.5 * box["height"]
        self.page.mouse.move(box["x"] + start * box["width"], y)
        self.page.mouse.down()
        self.page.mouse.move(box["x"] + end * box["width"], y, steps=4)
        self.page.mouse.up()
        self.drawn()

    def moved_ms(self, slider: Locator, by: float) -> float:
        """Drags a slider by a share of its width; from the release of the mouse to all figures new and drawn."""
        thumb = slider.get_by_test_id("stSliderThumbValue").locator("..")
        thumb.scroll_into_view_if_needed()
        where, track = thumb.bounding_box(), slider.bounding_box()
        assert where and track
        before = self.page.evaluate("window.bench.said()")
        x, y = where["x"] + where["width"] / 2.0, where["y"] + where["height"] / 2.0
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(x + by * track["width"], y, steps=4)
        self.page.mouse.up()
        waited = self.page.wait_for_function(
            """before => {
              if (!window.bench.ended() || window.bench.said() === before) return false;
              return performance.now() - window.bench.released;
            }""",
            arg=before, polling="raf", timeout=DRAWN_WITHIN_MS,
        )  # fmt: skip
        return float(waited.json_value())


@contextmanager
def visit(started: Browser, address: str, shots: Path, scheme: Scheme = "light") -> Iterator[Visit]:
    """A visitor with nothing from before: no cookies, no storage."""
    context = started.new_context(
        viewport={"width": WIDTH, "height": HEIGHT}, color_scheme=scheme, accept_downloads=True
    )
    context.set_default_timeout(DRAWN_WITHIN_MS)
    context.add_init_script(_INSTRUMENTS)
    context.grant_permissions(["local-network-access"])  # a page that is handed on has no address of its own
    page = context.new_page()
    shots.mkdir(parents=True, exist_ok=True)
    made = Visit(page, address, shots)
    made.listen()
    try:
        yield made
    finally:
        context.close()
