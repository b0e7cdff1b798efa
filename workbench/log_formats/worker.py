"""The process that parses logs which may be damaged. It loads a format's parser and nothing else of this package.

Where the system can fork, this process never touches a file: each log is parsed by a child of its own, with limits on
processor time and memory, so that nothing of one log outlives it and the parsers are loaded once. A child that dies
takes this process with it, by exit status 128 + signal. Elsewhere (Windows) this process parses, one log after the
other, and only the one who asked watches the time.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import select
import signal
import sys
from pathlib import Path
from typing import IO, Any

from workbench.errors import InputError
from workbench.log_formats import channel
from workbench.log_formats.declared import Limits
from workbench.log_formats.parsing import plain_errors

IDLE_S = 30.0  # without a question for so long, it ends
_CAN_FORK = hasattr(os, "fork") and sys.platform != "win32"


def main() -> None:
    """Answers what comes on standard input until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # a shell in the background has its children ignore it
    requests = os.fdopen(0, "rb", buffering=0, closefd=False)
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what a library prints is no answer
    with contextlib.suppress(EOFError, BrokenPipeError):
        while _asked_in_time():
            kind, _, length = channel.head(requests)
            asked = channel.text(requests, length)
            if kind == channel.IMPORT or kind == channel.OPEN:
                for name in asked["imports"]:
                    importlib.import_module(name)
            if kind == channel.OPEN:
                _apart(asked, requests, answers) if _CAN_FORK else _serve(asked, requests, answers)


def _asked_in_time() -> bool:
    return not _CAN_FORK or bool(select.select([0], [], [], IDLE_S)[0])


def _apart(asked: dict[str, Any], requests: IO[bytes], answers: IO[bytes]) -> None:
    child = os.fork()
    if child == 0:
        status = 1
        try:
            _limit(Limits(**asked["limits"]))
            _serve(asked, requests, answers)
            status = 0
        finally:
            os._exit(status)
    _, how = os.waitpid(child, 0)
    if (status := os.waitstatus_to_exitcode(how)) != 0:
        os._exit(128 - status if status < 0 else status)


def _limit(limits: Limits) -> None:
    """Processor time, memory beyond what is held already, no core file, no file written."""
    import resource

    def bound(which: int, most: int, beyond: int = 0) -> None:
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(which, (most, most + beyond))

    bound(resource.RLIMIT_CPU, max(1, round(limits.seconds)), beyond=2)  # at the second one comes SIGKILL
    bound(resource.RLIMIT_CORE, 0)
    bound(resource.RLIMIT_FSIZE, 0)
    with contextlib.suppress(OSError):  # only Linux has this file; macOS does not keep to this limit anyway
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        bound(resource.RLIMIT_AS, pages * resource.getpagesize() + limits.memory_bytes)


def _serve(asked: dict[str, Any], requests: IO[bytes], answers: IO[bytes]) -> None:
    """One log: its names; then, when they are asked for, its columns."""
    from workbench.log_formats.table import Meter

    limits = Limits(**asked["limits"])
    try:
        with plain_errors(asked["name"], limits):
            module, function = asked["open"]
            opened = getattr(importlib.import_module(module), function)(Path(asked["file"]))
        channel.send_text(answers, channel.NAMES, list(opened.names))
        kind, _, length = channel.head(requests)
        wanted = channel.text(requests, length)
        if kind == channel.READ:
            meter = Meter(len(wanted), limits)
            with plain_errors(asked["name"], limits):
                for column, piece in opened.pieces(wanted, limits):
                    meter.add(column, len(piece))
                    channel.send(answers, channel.PIECE, piece, column)
        channel.send(answers, channel.DONE)
    except InputError as error:
        message = {"problem": error.problem, "line": error.line, "place": error.place}
        channel.send_text(answers, channel.ERROR, message)
