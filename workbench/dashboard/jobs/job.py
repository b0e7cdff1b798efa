"""Long work outside the page: a library call or a `workbench` command line in a process of its own.

    words = ["diagnose", f"{INPUTS}/campaign", "--out", RESULT]
    job = start("diagnose", words, workspace, title="campaign 01", inputs={"campaign": folder})
    poll(job).state         # running, stopping, done, stopped, failed
    stop(job)

All is kept in the workspace's folder (`jobs_place`), so a page that was reloaded, or another process, sees the same.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from workbench.dashboard.jobs.progress import Progress, progress_of
from workbench.dashboard.jobs.record import Job, clean, is_alive, jobs_of, make, read, read_job, remove, write
from workbench.errors import InputError

__all__ = [
    "INPUTS", "RESULT", "Call", "Job", "Progress", "clean", "jobs_of", "poll", "read_job", "remove", "restart",
    "result_folder", "start", "stop",
]  # fmt: skip

# In the words of a command line and in a call's arguments: the folder for results, and that of the inputs' copies.
RESULT, INPUTS = "{result}", "{inputs}"
GRACE_S = 10.0  # from Ctrl-C to the kill
ENDS_WITHIN_S = 3.0  # the same when the server itself ends
MOST_RUNNING = 2  # of one workspace at a time
MOST_RUNNING_IN_ALL = 8
PACKAGE_ROOT = Path(__file__).resolve().parents[3]

_running: dict[Path, subprocess.Popen[bytes]] = {}
_mutex = threading.Lock()


@dataclass(frozen=True)
class Call:
    """A function of the program, "workbench.module:name", called as name(result_folder, tell, **arguments).

    tell: see `jobs_progress.Teller`. arguments: what JSON can hold.
    """

    function: str
    arguments: Mapping[str, Any] = field(default_factory=dict)


def start(
    kind: str,
    what: Sequence[str] | Call,
    workspace: Path,
    title: str = "",
    inputs: Mapping[str, Path] | None = None,
) -> Job:
    """Start work in a process group of its own.

    kind: the page that it belongs to. what: the words of a `workbench` command line, `RESULT` among them for its
    --out; or a call. workspace: a private folder. inputs: the page's own name -> file or folder, of which the job
    gets a copy in `INPUTS`: it may outlive the session. InputError when too much is running already.
    """
    with _mutex:
        _check_room(workspace)
        clean(workspace)
        job = make(workspace, kind, title or kind, inputs or {}, lambda folder: _spec(what, folder))
        _launch(job)
    return job


def _spec(what: Sequence[str] | Call, folder: Path) -> dict[str, Any]:
    def placed(value: Any) -> Any:
        if not isinstance(value, str):
            return value
        return value.replace(RESULT, str(folder / "result")).replace(INPUTS, str(folder / "inputs"))

    if isinstance(what, Call):
        return {"call": what.function, "arguments": {name: placed(value) for name, value in what.arguments.items()}}
    return {"words": [placed(str(word)) for word in what]}


def restart(job: Job) -> None:
    """Start an ended job again, in its folder: work that keeps what it has done goes on from there."""
    with _mutex:
        if is_alive(job.folder):
            raise InputError("is still running", place=job.title)
        _check_room(job.folder.parents[1])
        for name in ("ended.json", "progress.json", "stopping", "pid"):
            job.file(name).unlink(missing_ok=True)
        _launch(job)


def poll(job: Job) -> Progress:
    """How far it is, or how it ended."""
    return progress_of(job)


def stop(job: Job, grace_s: float = GRACE_S) -> None:
    """Ask it to stop as Ctrl-C does, so that it keeps what can be resumed; end it when it does not."""
    if not is_alive(job.folder):
        return
    job.file("stopping").touch()
    group = _group(job)
    _send(job, signal.SIGINT, group)
    timer = threading.Timer(grace_s, _send, (job, signal.SIGKILL, group))
    timer.daemon = True
    timer.start()


def result_folder(job: Job) -> Path | None:
    """What the work made; None as long as it is not done."""
    folder = job.folder / "result"
    return folder if folder.is_dir() and progress_of(job).state == "done" else None


def _check_room(workspace: Path) -> None:
    mine = sum(is_alive(job.folder) for job in jobs_of(workspace))
    if mine >= MOST_RUNNING:
        raise InputError(f"{mine} jobs are running already; stop one or let it finish")
    if len(_running) >= MOST_RUNNING_IN_ALL:
        raise InputError("this computer is busy with the work of others; try again in a while")


def _launch(job: Job) -> None:
    """The worker inherits the lock that says that it lives, so it is alive from the first moment."""
    import fcntl

    lock = os.open(job.file("alive"), os.O_RDWR | os.O_CREAT, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with job.file("stdout.txt").open("wb") as out, job.file("stderr.txt").open("wb") as err:
            process = subprocess.Popen(
                # -P: what lies in the folder that it works in is data, and is never imported.
                [sys.executable, "-P", "-m", "workbench.dashboard.jobs.worker", str(job.folder)],
                cwd=job.folder, env=_environment(), stdin=subprocess.DEVNULL, stdout=out, stderr=err,
                start_new_session=True, pass_fds=(lock,),
            )  # fmt: skip
    finally:
        os.close(lock)
    write(job.file("pid"), {"group": process.pid, "at_s": time.time()})
    _running[job.folder] = process
    threading.Thread(target=_reap, args=(job.folder, process), name="reap", daemon=True).start()


def _environment() -> dict[str, str]:
    given = [str(Path(entry).resolve()) for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry]
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(PACKAGE_ROOT), *given]), "PYTHONUNBUFFERED": "1"}


def _reap(folder: Path, process: subprocess.Popen[bytes]) -> None:
    process.wait()
    if _running.get(folder) is process:
        del _running[folder]


def _group(job: Job) -> int | None:
    """The process group of its worker, as it was started last."""
    said = read(job.file("pid"))
    return None if said is None else int(said["group"])


def _send(job: Job, number: signal.Signals, group: int | None) -> None:
    """To that worker only: a job may have been started again meanwhile."""
    if group is not None and group == _group(job) and is_alive(job.folder):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(group, number)


@atexit.register
def _stop_all() -> None:
    """A server that ends takes its workers along; a batch keeps what it has done."""
    left = list(_running.values())
    for number, seconds in ((signal.SIGINT, ENDS_WITHIN_S), (signal.SIGKILL, 1.0)):
        left = [process for process in left if process.poll() is None]
        for process in left:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, number)
        end = time.monotonic() + seconds
        for process in left:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(end - time.monotonic(), 0.0))
