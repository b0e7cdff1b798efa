"""How far a job is: what its worker wrote, or else what its command line says on stderr."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from workbench.dashboard.jobs.record import Job, is_alive, read, write

State = Literal["running", "stopping", "done", "stopped", "failed"]
INTERRUPTED = 130  # exit status of a command line after Ctrl-C
READ_AT_MOST = 20_000
_COUNT = re.compile(r"(\d+) ?(?:of|/) ?(\d+)")


@dataclass(frozen=True)
class Progress:
    """stage, done of total: as the worker counts; total 0 where it does not. failed: of those done.

    sentence: the latest line, or why it ended. rate_per_s: 0 where it is not known. running_s: since it was started.
    """

    state: State
    stage: str = ""
    done: int = 0
    total: int = 0
    failed: int = 0
    sentence: str = ""
    rate_per_s: float = 0.0
    running_s: float = 0.0

    @property
    def ended(self) -> bool:
        return self.state in ("done", "stopped", "failed")

    @property
    def share(self) -> float:
        """0 to 1; 0 where nothing is counted."""
        return min(max(self.done / self.total, 0.0), 1.0) if self.total > 0 else 0.0


class Teller:
    """The worker's side: writes progress to a file, at most a few times a second."""

    EVERY_S = 0.2

    def __init__(self, path: Path) -> None:
        self.path = path
        self.stage = ""
        self.next = 0.0

    def __call__(self, stage: str, done: int = 0, total: int = 0, failed: int = 0, rate_per_s: float = 0.0) -> None:
        """A new stage and a stage's end are always written."""
        now = time.monotonic()
        if stage != self.stage or done >= total or now >= self.next:
            self.stage, self.next = stage, now + self.EVERY_S
            said = {"stage": stage, "done": done, "total": total, "failed": failed, "rate_per_s": rate_per_s}
            write(self.path, said)


def progress_of(job: Job) -> Progress:
    """Read from the job's folder, whoever started it."""
    alive = is_alive(job.folder)  # asked first: `ended.json` is the last that a living worker writes
    ended = read(job.file("ended.json"))
    lines = _lines(job.file("stderr.txt"))
    # Where the server keeps a job is its own affair.
    last = lines[-1].replace(f"{job.folder / 'inputs'}/", "").replace(f"{job.folder}/", "") if lines else ""
    said = read(job.file("progress.json"))
    stage, done, total, failed, rate = "", 0, 0, 0, 0.0
    if said is not None:
        stage, done, total = str(said["stage"]), int(said["done"]), int(said["total"])
        failed, rate = int(said["failed"]), float(said["rate_per_s"])
    elif last:
        stage, (done, total) = last.partition(":")[0], _count(last)
    state: State
    if alive:
        state = "stopping" if job.file("stopping").exists() else "running"
        running_s = time.time() - _started(job)
        return Progress(state, stage, done, total, failed, last or stage, rate, running_s)
    state, sentence = _end(job, ended, last)
    running_s = max(float(ended["at_s"]) - _started(job), 0.0) if ended else 0.0
    return Progress(state, stage, done, total, failed, sentence, rate, running_s)


def _end(job: Job, ended: dict[str, object] | None, last: str) -> tuple[State, str]:
    asked = job.file("stopping").exists()
    if ended is None:
        if asked:
            return "stopped", "Stopped."
        return "failed", "The worker ended without a word: it was killed, or the computer ran out of memory."
    status = ended["status"]
    if status == 0:
        return "done", "Done."
    if status == INTERRUPTED or asked:
        return "stopped", "Stopped."
    return "failed", last.removeprefix("error: ") or f"It ended with exit status {status}."


def _started(job: Job) -> float:
    """When the worker was last started: its file of the process is written anew each time."""
    try:
        return job.file("pid").stat().st_mtime
    except OSError:
        return job.begun_s


def _lines(path: Path) -> list[str]:
    """The lines at the end of a log that may be long."""
    try:
        with path.open("rb") as stream:
            stream.seek(0, 2)
            stream.seek(max(stream.tell() - READ_AT_MOST, 0))
            text = stream.read().decode("utf-8", errors="replace")
    except OSError:
        return []
    return [line.strip() for line in text.splitlines() if line.strip()]


def _count(line: str) -> tuple[int, int]:
    """`3 of 12` and `3/12` in a line; 0 of 0 where it counts nothing."""
    counted = _COUNT.search(line)
    if counted is None or int(counted[1]) > int(counted[2]):
        return 0, 0
    return int(counted[1]), int(counted[2])
