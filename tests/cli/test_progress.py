"""Progress: a line from time to time for who redirects, a bar that leaves nothing behind on a terminal."""

from __future__ import annotations

import sys

import pytest

from workbench.cli import progress
from workbench.study.store import Progress


def test_lines_say_where_a_study_goes_on_and_how_fast_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    clock = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])

    def stopped() -> None:
        with progress.shown(["a"]) as tell:
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


def test_a_bar_on_a_terminal_is_gone_at_the_end(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with progress.shown(["a", "b"]) as tell:
        tell(Progress("a", done=1, runs=2, kept=0, failed=0))
        tell(Progress("b", done=1, runs=2, kept=1, failed=0))
    said = capsys.readouterr()
    assert said.out == "" and "goes on" not in said.err
