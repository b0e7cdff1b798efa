"""A job on disk: what was asked for, how far it is, how it ended; what the page needs after a reload.

<workspace>/jobs/<id>/
  job.json            what to run; written once
  inputs/             copies of what it reads
  alive               locked by the worker for as long as it lives
  pid, stopping       the worker's process group; when it was asked to stop
  progress.json       how far the worker says it is
  stderr.txt, stdout.txt
  ended.json          the exit status, written last
  result/             what the work made
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import secrets
import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

from workbench.errors import InputError

FOLDER = "jobs"
KEEP_S = 7 * 24 * 3600.0
_ID = re.compile(r"[A-Za-z0-9_-]{16,64}")


@dataclass(frozen=True)
class Job:
    """Long work outside the page. spec: the words of a `workbench` command line, or a call (see `jobs.start`)."""

    id: str
    kind: str
    title: str
    folder: Path
    spec: Mapping[str, Any]
    begun_s: float  # since the epoch

    def file(self, name: str) -> Path:
        return self.folder / name


def new_id() -> str:
    """A name that nobody guesses: 128 bits."""
    return secrets.token_urlsafe(16)


def is_id(text: object) -> TypeGuard[str]:
    """Whether a text, such as one from a URL, has the form of an id; only then may it become a path."""
    return isinstance(text, str) and _ID.fullmatch(text) is not None


def make(
    workspace: Path,
    kind: str,
    title: str,
    inputs: Mapping[str, Path],
    spec_in: Callable[[Path], Mapping[str, Any]],
) -> Job:
    """The record of a new job in its own folder, which only this user can enter. spec_in: its spec, seen from there."""
    number = new_id()
    folder = workspace.resolve() / FOLDER / number
    job = Job(number, kind, title, folder, spec_in(folder), time.time())
    try:
        folder.mkdir(parents=True, mode=0o700)
        (folder / "inputs").mkdir()
        for name, source in inputs.items():
            copy = shutil.copytree if source.is_dir() else shutil.copyfile
            copy(source, folder / "inputs" / name)
        write(
            folder / "job.json", {"format": 1, "kind": kind, "title": title, "spec": job.spec, "begun_s": job.begun_s}
        )
    except OSError as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise InputError(f"no job can be started there: {error.strerror or error}", file=workspace) from error
    return job


def read_job(workspace: Path, job_id: str) -> Job | None:
    """The job of that id in a workspace; None where there is none, whatever the id holds."""
    if not is_id(job_id):
        return None
    folder = workspace.resolve() / FOLDER / job_id
    said = read(folder / "job.json")
    if said is None:
        return None
    return Job(job_id, str(said["kind"]), str(said["title"]), folder, said["spec"], float(said["begun_s"]))


def jobs_of(workspace: Path, kind: str | None = None) -> list[Job]:
    """The jobs of a workspace, the newest first."""
    with contextlib.suppress(OSError):
        names = [entry.name for entry in (workspace / FOLDER).iterdir()]
        jobs = [job for name in names if (job := read_job(workspace, name)) is not None]
        return sorted((job for job in jobs if kind in (None, job.kind)), key=lambda job: -job.begun_s)
    return []


def is_alive(folder: Path) -> bool:
    """Whether the worker lives: it holds a lock that the system lets go of when it dies, however it dies."""
    try:
        descriptor = os.open(folder / "alive", os.O_RDWR)
    except OSError:
        return False
    import fcntl

    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False


def remove(job: Job) -> None:
    """Forget an ended job, with its result. InputError while it runs."""
    if is_alive(job.folder):
        raise InputError("is still running; stop it first", place=job.title)
    shutil.rmtree(job.folder, ignore_errors=True)


def clean(workspace: Path, older_than_s: float = KEEP_S) -> int:
    """Remove ended jobs that nobody has touched for so long; returns how many."""
    removed = 0
    for job in jobs_of(workspace):
        if not is_alive(job.folder) and time.time() - _touched(job.folder) > older_than_s:
            remove(job)
            removed += 1
    return removed


def _touched(folder: Path) -> float:
    """When something was last written there."""
    times = [0.0]
    for name in (".", "job.json", "ended.json", "progress.json"):
        with contextlib.suppress(OSError):
            times.append((folder / name).stat().st_mtime)
    return max(times)


def write(path: Path, data: object) -> None:
    """JSON at one stroke: a reader sees the old or the new."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_text(json.dumps(data), encoding="utf-8")
    temporary.replace(path)


def read(path: Path) -> dict[str, Any] | None:
    """What `write` wrote; None where nothing is."""
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return said if isinstance(said, dict) else None
