"""Runs the real command line inside the test's process."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from workbench.cli import main


@dataclass(frozen=True)
class Ended:
    status: int
    out: str
    err: str


class Commands:
    """Calls `workbench` with words, and gives back how it ended. An exception that escapes fails the test."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self.capsys = capsys

    def __call__(self, *words: object) -> Ended:
        self.capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main([str(word) for word in words])
        said = self.capsys.readouterr()
        return Ended(int(ended.value.code or 0), said.out, said.err)
