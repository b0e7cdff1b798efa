"""Fixtures that all tests share, and the rule that nothing is skipped unseen.

With WORKBENCH_REQUIRE_DATA=1, as in CI, a test whose outside data are missing fails, and so
does a session in which anything was skipped for a reason that does not begin with "allowed:".
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import hypothesis
import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser

    from tests.support.commands import Commands

ROOT = Path(__file__).resolve().parents[1]

# A shell that runs the tests in the background (nohup, some CI) has them ignore Ctrl-C, and every child inherits that;
# the tests that interrupt a child would wait for ever.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Matrices here are small, and the workers are what the cores are for: threads of BLAS would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

REQUIRE_ALL = os.environ.get("WORKBENCH_REQUIRE_DATA") == "1"

# Many containers set PYTHONDONTWRITEBYTECODE. pytest then rewrites 3,600 asserts at each collection, which takes 5 s.
sys.dont_write_bytecode = False

# A first call compiles for seconds, so no example has a deadline. CI draws the same few examples each time; a proof
# draws many, other ones each time.
hypothesis.settings.register_profile("local", deadline=None)
hypothesis.settings.register_profile("ci", deadline=None, derandomize=True, print_blob=True, max_examples=40)
hypothesis.settings.register_profile("proof", deadline=None, print_blob=True, max_examples=500)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "local")


def not_here(what: str) -> NoReturn:
    """Skip the test for want of `what`; fail it where everything has to be there."""
    if REQUIRE_ALL:
        pytest.fail(f"{what} (WORKBENCH_REQUIRE_DATA=1 forbids skipping)", pytrace=False)
    pytest.skip(what)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recorded data beside the checkout."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        not_here("no recorded data at ../shared/data")
    return folder


@pytest.fixture(scope="session")
def campaigns(shared_data: Path) -> Path:
    """The folder of recorded hoist campaigns, one sub-folder each: 01, 02, …"""
    folder = shared_data / "campaigns"
    if not folder.is_dir():
        not_here("no recorded campaigns at ../shared/data/campaigns")
    return folder


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """A browser for the tests of a module."""
    from tests.support import browser

    if missing := browser.what_is_missing():
        not_here(missing)
    with browser.browser() as started:
        yield started


MAIN = sys.modules["__main__"]


@pytest.fixture(autouse=True)
def main_module_kept() -> Iterator[None]:
    """A page's test leaves its script as the main module, which a Dask worker started later would import."""
    sys.modules["__main__"] = MAIN
    yield
    sys.modules["__main__"] = MAIN


@pytest.fixture
def commands(capsys: pytest.CaptureFixture[str]) -> Commands:
    """Runs commands in this process."""
    from tests.support.commands import Commands

    return Commands(capsys)


@pytest.fixture
def kernel_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty kernel cache of this test's own, for tests of compiling and of stale code."""
    folder = tmp_path / "kernel_cache"
    monkeypatch.setenv("WORKBENCH_CACHE", str(folder))
    return folder


def _unexplained_skips(config: pytest.Config) -> list[str]:
    reporter = config.pluginmanager.getplugin("terminalreporter")
    if not REQUIRE_ALL or reporter is None or hasattr(config, "workerinput"):
        return []
    skipped = []
    for report in reporter.stats.get("skipped", []):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        reason = reason.removeprefix("Skipped: ")
        if not reason.startswith("allowed:"):
            skipped.append(f"{report.nodeid}: {reason}")
    return skipped


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_sessionfinish(session: pytest.Session) -> Iterator[None]:
    if _unexplained_skips(session.config) and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
    yield


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    if skipped := _unexplained_skips(config):
        terminalreporter.section("skipped although WORKBENCH_REQUIRE_DATA=1", red=True)
        for line in skipped:
            terminalreporter.line(line)
