"""The process of a job: `python -m workbench.dashboard.jobs.worker FOLDER`. It outlives the page, not the server."""

from __future__ import annotations

import contextlib
import importlib
import logging
import os
import runpy
import signal
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from workbench.dashboard.jobs.progress import INTERRUPTED, Teller
from workbench.dashboard.jobs.record import read, write
from workbench.errors import InputError

NICER = 10  # the page and its sliders go first
BAD_INPUT = 2


def work(spec: Mapping[str, Any], folder: Path) -> int:
    """Do what a job asks for; returns the exit status. What the user can mend is one line on stderr."""
    try:
        if "words" in spec:
            return _command_line(spec["words"])
        _speak()
        module, _, name = str(spec["call"]).partition(":")
        call = getattr(importlib.import_module(module), name)
        call(folder / "result", Teller(folder / "progress.json"), **spec["arguments"])
    except KeyboardInterrupt:
        return INTERRUPTED
    except (InputError, MemoryError, OSError) as error:
        said = str(error) or "not enough memory for this input; try fewer or shorter runs"
        print(f"error: {said}", file=sys.stderr)
        return BAD_INPUT
    return 0


def _command_line(words: list[str]) -> int:
    """As `python -m workbench WORDS` in this process."""
    sys.argv = ["workbench", *words]
    try:
        runpy.run_module("workbench", run_name="__main__")
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    return 0


def _speak() -> None:
    """What the library has to say while it works, such as that it compiles: lines on stderr."""
    log = logging.getLogger("workbench")
    log.addHandler(logging.StreamHandler())
    log.setLevel(logging.INFO)


def main() -> int:
    # A server that a shell has put into the background ignores Ctrl-C, and its children inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.nice(NICER)
    folder = Path(sys.argv[1])
    job = read(folder / "job.json")
    assert job is not None
    status = 1
    try:
        # Stopped before it could hear of it: a Ctrl-C that came earlier may have been lost.
        status = INTERRUPTED if (folder / "stopping").exists() else work(job["spec"], folder)
    finally:
        # A second Ctrl-C must not take the last word away.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        with contextlib.suppress(ValueError):
            sys.stdout.flush()
        write(folder / "ended.json", {"status": status, "at_s": time.time()})
    return status


if __name__ == "__main__":
    sys.exit(main())
