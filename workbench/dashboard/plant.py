"""A served plant of this session, as the page sees it: a process that is asked by lines and ends with the session."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import threading
import weakref
from collections.abc import Mapping
from typing import IO, Any

from workbench.core.errors import InputError
from workbench.dashboard.jobs import child_environment

MOST_IN_ALL = 8  # plants of all sessions
EVERY_S, KEPT_S = 0.04, 60.0  # between two rows of a plant's numbers; how much of them is kept
ANSWERS_WITHIN_S = 5.0

_running: weakref.WeakSet[PlantProcess] = weakref.WeakSet()


class PlantProcess:
    """Started at once; `greeting()` is None until the plant is there, for its step may have to be compiled.

    spec: `machine` (YAML) with either `wish`, the fields of `serve.Wish`, or `attach`, a port of this computer.
    InputError when too many are running.
    """

    def __init__(self, spec: Mapping[str, Any]) -> None:
        if sum(plant.alive for plant in _running) >= MOST_IN_ALL:
            raise InputError("this computer already serves the plants of others; try again in a while")
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "workbench.dashboard.plant_worker"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            env=child_environment(), start_new_session=True, bufsize=0,
        )  # fmt: skip
        assert self._process.stdin is not None and self._process.stdout is not None
        self._in: IO[bytes] = self._process.stdin
        self._out: IO[bytes] = self._process.stdout
        self._rest = b""
        self._one_at_a_time = threading.Lock()
        self._greeting: dict[str, Any] | None = None
        self._end = weakref.finalize(self, _ended, self._process)
        _running.add(self)
        self._write(spec)

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    def greeting(self, within_s: float = 0.0) -> dict[str, Any] | None:
        """Port, the machine's name, names of the points; None until it is there. InputError where it failed."""
        with self._one_at_a_time:
            if self._greeting is None:
                self._greeting = self._read(within_s)
            if self._greeting is None and not self.alive:
                raise InputError("the plant's process ended without a word")
            return self._greeting

    def ask(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """See `plant_worker.Desk.answer`. InputError for what is refused, and for a plant that has gone."""
        if self.greeting() is None:
            raise InputError("the plant is not there yet")
        with self._one_at_a_time:
            self._write(question)
            answer = self._read(ANSWERS_WITHIN_S)
        if answer is None:
            self.end()  # an answer that comes late would be taken for another question's
            raise InputError("the plant does not answer any more; start it again")
        return answer

    def end(self) -> None:
        self._end()

    def _write(self, words: Mapping[str, Any]) -> None:
        try:
            self._in.write(json.dumps(words).encode() + b"\n")
        except OSError as error:
            raise InputError("the plant has ended; start it again") from error

    def _read(self, within_s: float) -> dict[str, Any] | None:
        """One line; None where none comes in time. InputError where it is one."""
        while b"\n" not in self._rest:
            if not select.select([self._out], [], [], within_s)[0]:
                return None
            part = os.read(self._out.fileno(), 1 << 20)
            if not part:
                return None
            self._rest += part
        line, _, self._rest = self._rest.partition(b"\n")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise InputError(answer["error"]["problem"], place=answer["error"]["place"])
        return answer


def _ended(process: subprocess.Popen[bytes]) -> None:
    """Its sockets and files are the system's to close."""
    process.kill()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            stream.close()
    process.wait()
