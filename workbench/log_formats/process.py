"""The worker process that parses logs, seen from the process that uses it."""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import InputError
from workbench.log_formats import channel
from workbench.log_formats.declared import Limits, LogFormat, Opened
from workbench.log_formats.kept_waiting import kept_waiting_s, this_thread
from workbench.log_formats.worker import IDLE_S
from workbench.run import Array

# The path is that of this process, so that both load the same files; nothing of the working folder comes first.
_CODE = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); import workbench.log_formats.worker as w; w.main()"
_CALM = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "ARROW_DEFAULT_MEMORY_POOL": "system"}
_MOST_IDLE = 2
_WALL = 4.0  # times the limit of processor time, less what a busy computer took: then it is ended whatever it does
_POSIX = os.name == "posix"

_idle: list[Worker] = []
_lock = threading.Lock()


@contextmanager
def opened(file: Path, log_format: LogFormat, limits: Limits) -> Iterator[Opened]:
    """Open a log in a worker. InputError, without the file's name, for whatever happens to the worker."""
    worker = _taken()
    try:
        names = worker.names(file, log_format, limits)
        yield Opened(names, worker.pieces)
    finally:
        worker.close()
        _given_back(worker)


def start_early(imports: tuple[str, ...]) -> None:
    """A worker that loads these modules while the caller goes on."""
    worker = _taken()
    worker.ask(channel.IMPORT, {"imports": imports})
    _given_back(worker)


class Worker:
    """One worker process; it has one log open at a time.

    `state`: "idle", "open" (the log's names are told, the worker waits), or "busy" (an answer is on its way).
    """

    def __init__(self) -> None:
        # A session of its own: Ctrl-C is for the process that asks, which ends its worker itself.
        apart: dict[str, Any] = {"start_new_session": True} if _POSIX else {"creationflags": 0x200}
        self.process = subprocess.Popen(
            [sys.executable, "-I", "-c", _CODE, json.dumps([path or os.getcwd() for path in sys.path])],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, bufsize=0,
            env={**os.environ, **_CALM}, **apart,
        )  # fmt: skip
        assert self.process.stdin is not None and self.process.stdout is not None
        self.requests: Any = self.process.stdin
        self.answers: Any = self.process.stdout
        self.state, self.late, self.used_s = "idle", False, time.monotonic()
        self.limits: Limits | None = None

    @property
    def usable(self) -> bool:
        """Whether the worker runs and will not end before the next request."""
        return self.state == "idle" and self.process.poll() is None and time.monotonic() - self.used_s < IDLE_S / 2

    def ask(self, kind: bytes, what: object) -> None:
        try:
            channel.send_text(self.requests, kind, what)
        except OSError:  # it is gone; the answer that does not come says so
            self.state = "busy"

    def names(self, file: Path, log_format: LogFormat, limits: Limits) -> list[str]:
        """What columns the log has, before its samples are read."""
        self.limits, self.state = limits, "busy"
        opener = (log_format.open.__module__, log_format.open.__qualname__)
        self.ask(channel.OPEN, {
            "file": os.path.abspath(file), "name": log_format.name, "open": opener, "imports": log_format.imports,
            "limits": asdict(limits),
        })  # fmt: skip
        with self._watched():
            _, _, length = self._head(channel.NAMES)
            listed = channel.text(self.answers, length)
        self.state = "open"
        return [str(name) for name in listed]

    def pieces(self, wanted: Sequence[str], limits: Limits) -> Iterator[tuple[int, Array]]:
        """The samples as they come."""
        self.state = "busy"
        self.ask(channel.READ, list(wanted))
        with self._watched():
            while True:
                kind, column, length = self._head(channel.PIECE, channel.DONE)
                if kind == channel.DONE:
                    self.state = "idle"
                    return
                if column >= len(wanted) or length % 8 or length > limits.bytes:
                    raise EOFError
                piece = np.empty(length // 8)
                channel.fill(self.answers, piece)
                yield column, piece

    def close(self) -> None:
        """Close the log. A worker that is still reading it is ended."""
        if self.state == "open":
            self.ask(channel.CLOSE, None)
            with contextlib.suppress(InputError), self._watched():
                self._head(channel.DONE)
                self.state = "idle"
        if self.state != "idle":
            self.end()

    def end(self) -> None:
        """Kill it, and what it has started."""
        self.state = "ended"
        self._kill()
        for stream in (self.requests, self.answers):
            with contextlib.suppress(OSError):
                stream.close()
        self.process.wait()

    def _kill(self) -> None:
        with contextlib.suppress(OSError):
            if _POSIX:
                os.killpg(self.process.pid, signal.SIGKILL)
            else:
                self.process.kill()

    def _head(self, *kinds: bytes) -> tuple[bytes, int, int]:
        kind, number, length = channel.head(self.answers)
        if kind == channel.ERROR:
            error = channel.text(self.answers, length)
            self.state = "idle"
            raise InputError(error["problem"], line=error["line"], place=error["place"])
        if kind not in kinds:
            raise EOFError
        return kind, number, length

    @contextmanager
    def _watched(self) -> Iterator[None]:
        """Ends the worker when it takes too long; an InputError when it dies."""
        assert self.limits is not None
        over = threading.Event()
        watch = threading.Thread(target=self._end_when_late, args=(over, self.limits, this_thread()), daemon=True)
        watch.start()
        try:
            yield
        except (EOFError, ValueError, KeyError) as error:  # nothing more comes, or nothing that makes sense
            raise InputError(self._obituary(self.limits)) from error
        finally:
            over.set()

    def _end_when_late(self, over: threading.Event, limits: Limits, reader: int) -> None:
        """Kill it, unless `over` comes first. What it and the thread that reads waited for a core does not count."""
        most, begun, waited = _WALL * limits.seconds, time.monotonic(), kept_waiting_s(self.process.pid, reader)
        left = most
        while not over.wait(max(left, 0.05)):
            lost = max(0.0, kept_waiting_s(self.process.pid, reader) - waited)
            left = most - (time.monotonic() - begun - lost)
            if left <= 0.0:
                self.late = True
                self._kill()
                return

    def _obituary(self, limits: Limits) -> str:
        """The cause of the worker's end, as a sentence."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(timeout=2.0)
        status, late = self.process.poll(), self.late
        self.end()
        number = -status if status is not None and status < 0 else (status or 0) - 128
        if late or (_POSIX and number == signal.SIGXCPU):
            return f"takes more than {limits.seconds:g} s to read; is it damaged?"
        if _POSIX and number == signal.SIGKILL:
            return "takes more memory than there is: its reader was killed"
        name = signal.Signals(number).name if number in {int(known) for known in signal.Signals} else f"status {status}"
        return f"is damaged: it crashes the reader of its format ({name})"


def _taken() -> Worker:
    with _lock:
        while _idle:
            worker = _idle.pop()
            if worker.usable:
                return worker
            worker.end()
    return Worker()


def _given_back(worker: Worker) -> None:
    """Keep the worker for the next log if it forks for each one; otherwise it has parsed a file and ends."""
    if worker.state == "idle" and hasattr(os, "fork"):
        worker.used_s = time.monotonic()
        with _lock:
            if len(_idle) < _MOST_IDLE:
                _idle.append(worker)
                return
    if worker.state != "ended":
        worker.end()


@atexit.register
def end_all() -> None:
    """Ends the workers that wait for the next log."""
    with _lock:
        while _idle:
            _idle.pop().end()


if hasattr(os, "register_at_fork"):  # a child has its parent's pipes, and must not talk through them
    os.register_at_fork(after_in_child=_idle.clear)
