"""Progress: a line from time to time for who redirects, a bar that leaves nothing behind on a terminal."""

from __future__ import annotations

import pytest

from workbench.cli import show
from workbench.study.store import Progress


def test_lines_say_where_a_study_goes_on_and_how_fast_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    clock = [100.0]
    monkeypatch.setattr(show.time, "monotonic", lambda: clock[0])

    def stopped() -> None:
        with show.shown(["a"]) as tell:
            for seconds, done, failed in ((0.0, 20, 0), (5.0, 40, 0), (6.0, 64, 1)):
                clock[0] += seconds
                tell(Progress("a", done=done, runs=100, kept=20, failed=failed))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert capsys.readouterr().err.splitlines() == [
        "a: goes on after 20 of 100 runs",
        "a: 64 of 100 runs (1 failed), 4 runs/s",
        "",
        "a: 64 of 100 runs (1 failed) done and kept; the same command goes on from there.",
    ]
