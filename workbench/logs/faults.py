"""The wording of the reader's messages: times, and errors of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from workbench.core.errors import InputError


class Fault(Protocol):
    """Makes the InputError of one run, so that each check need not know file and name."""

    def __call__(self, problem: str) -> InputError: ...


def fault_of(file: Path, run: str) -> Fault:
    def fault(problem: str) -> InputError:
        return InputError(problem, file=file, place=run)

    return fault


def seconds(time_s: float) -> str:
    """3.21 s, without the tail of digits of a binary fraction."""
    return f"{float(time_s):.9g} s"
