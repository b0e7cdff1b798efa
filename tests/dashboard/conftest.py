"""A server's own folder for every test; the campaigns that its owner offers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("streamlit")

from tests.support.dashboard_app import end_all
from workbench.dashboard import chosen, session


@pytest.fixture(autouse=True)
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The server's own folder, empty; it offers no campaign; what runs in it ends with the test."""
    folder = tmp_path / "server"
    folder.mkdir(mode=0o700)
    monkeypatch.setattr(session, "app_folder", lambda: folder)
    monkeypatch.setattr(chosen, "SHIPPED", ())
    monkeypatch.delenv(chosen.VARIABLE, raising=False)
    yield folder
    for work in folder.glob("work-*"):
        end_all(work)


@pytest.fixture
def offer(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """The server's owner lets people see these folders."""
    return lambda *folders: monkeypatch.setenv(chosen.VARIABLE, ":".join(map(str, folders)))
