"""Long work outside the page: a function of the program in a process of its own, which outlives a reload; its card.

    job = start("gap", "workbench.dashboard.pages.gap:work", {"folder": f"{INPUTS}/campaign"}, workspace, "campaign 01",
                inputs={"campaign": folder})
    poll(job).state         # running, stopping, done, stopped, failed
    stop(job)
    cards([job])            # on a page: how far, stop, resume, open, remove

The function is called as name(result_folder, tell, **arguments). A job lies in <workspace>/jobs/<id>/, where a page
that was reloaded finds it:

  job.json      what to run; written once
  inputs/       copies of what it reads
  alive         locked by the worker as long as it lives; holds its process group
  said.jsonl    how far it is, a line each; the last one holds the exit status
  stderr.txt    messages and errors
  stopping      when it was asked to stop
  result/       what the work made; view.json beside it: what the page shows
"""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import importlib
import json
import logging
import os
import re
import secrets
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeGuard, TypeVar

import streamlit as st
from pydantic import TypeAdapter, ValidationError
from pydantic_core import from_json

from workbench.core.errors import InputError
from workbench.core.input_file import read_input
from workbench.dashboard.widgets import plain, problem

INPUTS = "{inputs}"  # in an argument: the folder of the inputs' copies
FOLDER, VIEW = "jobs", "view.json"
KEEP_S = 7 * 24 * 3600.0
GRACE_S = 10.0  # from Ctrl-C to the kill
ENDS_WITHIN_S = 3.0  # the same when the server itself ends
MOST_RUNNING, MOST_RUNNING_IN_ALL = 2, 8  # of one workspace at a time; of all
NICER = 10  # the page and its sliders go first
BAD_INPUT, INTERRUPTED = 2, 130
LAST_BYTES = 20_000  # of a file that is read for its last line
TOLD_EVERY_S, LOOKS_EVERY_S = 0.2, 0.5  # by the worker; by a page's card
COLOURS = {"running": "blue", "stopping": "orange", "done": "green", "stopped": "gray", "failed": "red"}
State = Literal["running", "stopping", "done", "stopped", "failed"]
T = TypeVar("T")

_ID = re.compile(r"[A-Za-z0-9_-]{16,64}")
_running: list[subprocess.Popen[bytes]] = []
_mutex = threading.Lock()


@dataclass(frozen=True)
class Job:
    """kind: the page that it belongs to. call: "module:function". begun_s: since the epoch."""

    id: str
    kind: str
    title: str
    folder: Path
    call: str
    arguments: Mapping[str, Any]
    begun_s: float

    def file(self, name: str) -> Path:
        return self.folder / name


@dataclass(frozen=True)
class Progress:
    """stage, done of total: as the worker counts; total 0 where it does not. failed: of those done.

    sentence: the latest line, or why it ended. rate_per_s: 0 where it is not known. running_s: since it was started.
    """

    state: State = "running"
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


@dataclass
class Teller:
    """The worker's side: writes progress a few times a second, and always a stage's beginning and end."""

    path: Path
    said: dict[str, Any] = field(default_factory=dict)
    next_s: float = 0.0

    def __call__(self, stage: str, done: int = 0, total: int = 0, failed: int = 0, rate_per_s: float = 0.0) -> None:
        now = time.monotonic()
        if stage != self.said.get("stage") or done >= total or now >= self.next_s:
            self.next_s = now + TOLD_EVERY_S
            self.said = {"stage": stage, "done": done, "total": total, "failed": failed, "rate_per_s": rate_per_s}
            self.write()

    def write(self, **more: Any) -> None:
        with self.path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(self.said | more) + "\n")


def new_id() -> str:
    """A name that nobody guesses: 128 bits."""
    return secrets.token_urlsafe(16)


def is_id(text: object) -> TypeGuard[str]:
    """Whether a text, such as one from a URL, has the form of an id; only then may it become a path."""
    return isinstance(text, str) and _ID.fullmatch(text) is not None


# ---- start, stop, find again --------------------------------------------------------------------------------------


def start(
    kind: str,
    call: str,
    arguments: Mapping[str, Any],
    workspace: Path,
    title: str = "",
    inputs: Mapping[str, Path] | None = None,
) -> Job:
    """Starts work in a process group of its own. arguments: what JSON can hold. inputs: the page's own name -> file or
    folder, of which the job gets a copy: it may outlive the session. InputError when too much is running already."""
    with _mutex:
        _check_room(workspace)
        clean(workspace)
        number = new_id()
        folder = workspace.resolve() / FOLDER / number
        placed = {
            name: value.replace(INPUTS, str(folder / "inputs")) if isinstance(value, str) else value
            for name, value in arguments.items()
        }
        job = Job(number, kind, title or kind, folder, call, placed, time.time())
        try:
            (folder / "inputs").mkdir(parents=True, mode=0o700)
            for name, source in (inputs or {}).items():
                copy = shutil.copytree if source.is_dir() else shutil.copyfile
                copy(source, folder / "inputs" / name)
            write_record(job)
        except OSError as error:
            shutil.rmtree(folder, ignore_errors=True)
            raise InputError(f"no job can be started there: {error.strerror or error}", file=workspace) from error
        _launch(job)
    return job


def write_record(job: Job) -> None:
    text = json.dumps({key: value for key, value in asdict(job).items() if key not in ("id", "folder")})
    job.file("job.json").write_text(text, encoding="utf-8")


def read_job(workspace: Path, job_id: object) -> Job | None:
    """The job of that id in a workspace; None where there is none, whatever the id holds."""
    if is_id(job_id):
        folder = workspace.resolve() / FOLDER / job_id
        with contextlib.suppress(InputError, OSError, ValueError, TypeError):
            return Job(job_id, folder=folder, **json.loads(read_input(folder / "job.json", "json")))
    return None


def jobs_of(workspace: Path | None, kind: str | None = None) -> list[Job]:
    """The jobs of a workspace, the newest first."""
    paths = [] if workspace is None else workspace.glob(f"{FOLDER}/*")
    jobs = [job for path in paths if workspace and (job := read_job(workspace, path.name)) is not None]
    return sorted((job for job in jobs if kind in (None, job.kind)), key=lambda job: -job.begun_s)


def is_alive(job: Job) -> bool:
    """Whether the worker lives: it holds a lock that the system lets go of when it dies, however it dies."""
    with contextlib.suppress(FileNotFoundError), job.file("alive").open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def restart(job: Job) -> None:
    """Starts an ended job again, in its folder: work that keeps what it has done goes on from there."""
    with _mutex:
        if is_alive(job):
            raise InputError("is still running", place=job.title)
        _check_room(job.folder.parents[1])
        for name in ("said.jsonl", "stopping"):
            job.file(name).unlink(missing_ok=True)
        _launch(job)


def stop(job: Job, grace_s: float = GRACE_S) -> None:
    """Asks it to stop as Ctrl-C does, so that it keeps what can be resumed; ends it when it does not."""
    if not is_alive(job):
        return
    job.file("stopping").touch()
    group = job.file("alive").read_text()

    def send(number: signal.Signals) -> None:
        """To that worker only: a job may have been started again meanwhile."""
        with contextlib.suppress(OSError, ValueError):
            if job.file("alive").read_text() == group and is_alive(job):
                os.killpg(int(group), number)

    send(signal.SIGINT)
    timer = threading.Timer(grace_s, send, (signal.SIGKILL,))
    timer.daemon = True
    timer.start()


def remove(job: Job) -> None:
    """Forgets an ended job, with its result. InputError while it runs."""
    if is_alive(job):
        raise InputError("is still running; stop it first", place=job.title)
    shutil.rmtree(job.folder, ignore_errors=True)


def clean(workspace: Path, older_than_s: float = KEEP_S) -> int:
    """Removes ended jobs that nobody has touched for so long; how many."""
    gone = 0
    for job in jobs_of(workspace):
        touched = max(path.stat().st_mtime for path in (job.folder, *job.folder.glob("*.json*")))
        if not is_alive(job) and time.time() - touched > older_than_s:
            remove(job)
            gone += 1
    return gone


def result_folder(job: Job) -> Path | None:
    """What the work made; None as long as it is not done."""
    return job.file("result") if job.file("result").is_dir() and poll(job).state == "done" else None


def poll(job: Job) -> Progress:
    """How far it is, or how it ended."""
    alive = is_alive(job)  # asked first: the exit status is the last that a living worker writes
    said: dict[str, Any] = {}
    for line in _lines(job.file("said.jsonl")):
        with contextlib.suppress(ValueError):  # a line that is being written
            said = json.loads(line)
    # Where the server keeps a job is its own affair.
    errors = [line.replace(f"{job.file('inputs')}/", "").replace(f"{job.folder}/", "")
              for line in _lines(job.file("stderr.txt"))]  # fmt: skip
    last, asked, status = errors[-1] if errors else "", job.file("stopping").exists(), said.pop("ended", None)
    began_s = job.file("alive").stat().st_mtime if job.file("alive").exists() else job.begun_s
    now = Progress(**{"running_s": max(said.pop("at_s", time.time()) - began_s, 0.0)} | said)
    if alive:
        return replace(now, state="stopping" if asked else "running", sentence=last or now.stage)
    if status == 0:
        return replace(now, state="done", sentence="Done.")
    if asked or status == INTERRUPTED:
        return replace(now, state="stopped", sentence="Stopped.")
    killed = "The worker ended without a word: it was killed, or the computer ran out of memory."
    why = killed if status is None else last.removeprefix("error: ") or f"It ended with exit status {status}."
    return replace(now, state="failed", sentence=why)


def _lines(path: Path) -> list[str]:
    """The lines at the end of a file that may be long."""
    try:
        with path.open("rb") as stream:
            stream.seek(max(path.stat().st_size - LAST_BYTES, 0))
            text = stream.read().decode("utf-8", errors="replace")
    except OSError:
        return []
    return [line.strip() for line in text.splitlines() if line.strip()]


def _check_room(workspace: Path) -> None:
    mine = sum(is_alive(job) for job in jobs_of(workspace))
    if mine >= MOST_RUNNING:
        raise InputError(f"{mine} jobs are running already; stop one or let it finish")
    _running[:] = [process for process in _running if process.poll() is None]
    if len(_running) >= MOST_RUNNING_IN_ALL:
        raise InputError("this computer is busy with the work of others; try again in a while")


def _launch(job: Job) -> None:
    """The worker inherits the lock that says that it lives, so it is alive from the first moment."""
    with job.file("alive").open("wb") as lock, job.file("stderr.txt").open("wb") as errors:
        fcntl.flock(lock, fcntl.LOCK_EX)
        process = subprocess.Popen(
            # -P: what lies in the folder that it works in is data, and is never imported.
            [sys.executable, "-P", "-m", "workbench.dashboard.jobs", str(job.folder)],
            cwd=job.folder, env=child_environment(), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors,
            start_new_session=True, pass_fds=(lock.fileno(),),
        )  # fmt: skip
        lock.write(str(process.pid).encode())
    _running.append(process)


def child_environment() -> dict[str, str]:
    """This process' environment, in which Python finds the program from any folder."""
    given = [str(Path(entry).resolve()) for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry]
    root = str(Path(__file__).resolve().parents[2])
    return os.environ | {"PYTHONPATH": os.pathsep.join([root, *given]), "PYTHONUNBUFFERED": "1"}


@atexit.register
def _stop_all() -> None:
    """A server that ends takes its workers along; a batch keeps what it has done."""
    for number, seconds in ((signal.SIGINT, ENDS_WITHIN_S), (signal.SIGKILL, 1.0)):
        left = [process for process in _running if process.poll() is None]
        for process in left:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, number)
        end = time.monotonic() + seconds
        for process in left:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(end - time.monotonic(), 0.0))


# ---- in the worker's process --------------------------------------------------------------------------------------


def write_view(view: Any, path: Path) -> None:
    """A record of words, numbers, tables and figures as JSON: the page computes nothing again. A figure is plotly's own
    JSON."""
    path.write_bytes(TypeAdapter(type(view)).dump_json(view, fallback=lambda figure: from_json(figure.to_json())))


def read_view(kind: type[T], job: Job) -> T:
    """InputError for a file that is gone or damaged."""
    try:
        return TypeAdapter(kind).validate_json(job.file(VIEW).read_bytes())
    except (OSError, ValidationError) as error:
        raise InputError("this result is damaged; compute it again", file=job.file(VIEW)) from error


@contextmanager
def without_folder(folder: str) -> Iterator[None]:
    """An InputError inside comes out without the campaign's folder, which is the server's own."""
    try:
        yield
    except InputError as error:
        file = None if error.file is None else Path(error.file).name
        said = error.problem.replace(f"{folder}/", "")
        raise InputError(said, file=file, line=error.line, place=error.place) from error


def work(job: Job, tell: Teller) -> int:
    """Does what a job asks for; returns the exit status. What the user can mend is one line on stderr."""
    log = logging.getLogger("workbench")
    log.addHandler(logging.StreamHandler())
    log.setLevel(logging.INFO)
    try:
        module, _, name = job.call.partition(":")
        getattr(importlib.import_module(module), name)(job.file("result"), tell, **job.arguments)
    except KeyboardInterrupt:
        return INTERRUPTED
    except (InputError, MemoryError, OSError) as error:
        print(f"error: {str(error) or 'not enough memory for this input; try fewer or shorter runs'}", file=sys.stderr)
        return BAD_INPUT
    return 0


def main(folder: Path) -> int:
    """The worker's process."""
    # A server that a shell has put into the background ignores Ctrl-C, and its children inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.nice(NICER)
    job, tell, status = read_job(folder.parents[1], folder.name), Teller(folder / "said.jsonl"), 1
    assert job is not None
    try:
        # A Ctrl-C that came before the line above may have been lost.
        status = INTERRUPTED if job.file("stopping").exists() else work(job, tell)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second one must not take the last word away
        tell.write(ended=status, at_s=time.time())
    return status


# ---- on a page ----------------------------------------------------------------------------------------------------


def cards(jobs: Sequence[Job], open_key: str = "", unit: str = "", stages: Sequence[str] = ()) -> None:
    """A card each, drawn anew by itself while one runs.

    open_key: where the session keeps the id of the job that is open; none can be opened where it is empty.
    unit: what is counted. stages: their names, where the worker counts an equal share for each.
    """
    running = any(not poll(job).ended for job in jobs)

    def draw() -> None:
        states = [poll(job) for job in jobs]
        for job, progress in zip(jobs, states, strict=True):
            with st.container(border=True):
                _card(job, progress, open_key, unit, stages)
        if running and all(progress.ended for progress in states):
            st.rerun()  # the whole page: there is a result to show, or a reason

    st.fragment(draw, run_every=LOOKS_EVERY_S if running else None)()


def _card(job: Job, progress: Progress, open_key: str, unit: str, stages: Sequence[str]) -> None:
    begun = time.localtime(job.begun_s)
    today = time.strftime("%j %Y", begun) == time.strftime("%j %Y")
    said = f"started {time.strftime('%H:%M' if today else '%d %b %H:%M', begun)}"
    said += "" if progress.state == "failed" else f" · {counts(progress, unit)}"
    with st.container(horizontal=True, horizontal_alignment="distribute", vertical_alignment="center"):
        badge = f":{COLOURS[progress.state]}-badge[{progress.state}]"
        st.markdown(f"**{plain(job.title)}** {badge} :small[{plain(said)}]", width="content")
        with st.container(horizontal=True, width="content"):
            _buttons(job, progress, open_key)
    if not progress.ended or (progress.state == "stopped" and progress.total):
        st.progress(progress.share)
    if not progress.ended and stages:
        now = int(progress.share * len(stages))
        done, doing, to_come = ":green[:material/check_circle:] {}", ":blue[:material/pending: **{}**]", ":gray[{}]"
        lines = [(done if k < now else doing if k == now else to_come).format(stage) for k, stage in enumerate(stages)]
        st.markdown("  \n".join(lines))
    if progress.state == "failed":
        problem(InputError(progress.sentence))


def _buttons(job: Job, progress: Progress, open_key: str) -> None:
    def button(word: str, icon: str, action: Callable[[], object], disabled: bool = False, tip: str = "") -> None:
        if not st.button(word, key=f"{word.lower().replace('try again', 'resume')} {job.id}", disabled=disabled,
                         icon=f":material/{icon}:", help=tip or None):  # fmt: skip
            return
        try:
            action()
        except InputError as error:
            problem(error)
        else:
            st.rerun()

    if not progress.ended:
        button("Stop", "stop", lambda: stop(job), progress.state == "stopping", "What is done is kept.")
    if open_key and progress.state == "done":
        opened = st.session_state.get(open_key) == job.id
        button("Open", "bar_chart", lambda: st.session_state.update({open_key: job.id}), opened)
    if progress.state in ("stopped", "failed"):
        button("Resume" if progress.done else "Try again", "resume", lambda: restart(job))
    if progress.ended:
        button("Remove", "delete", lambda: remove(job))


def counts(progress: Progress, unit: str = "") -> str:
    """`1,024 of 1,280 runs, 3 failed, 410 runs/s, 2 s to go`; the stage where nothing is counted in a unit."""
    running_s = f"{progress.running_s:,.0f} s"
    if not unit or progress.total <= 1:
        said = progress.stage or (not progress.ended and progress.sentence) or "getting ready"
        return f"{said}, {running_s}" if progress.running_s and not progress.ended else said
    whole = progress.done == progress.total and progress.ended
    parts = [f"{progress.total:,} {unit}" if whole else f"{progress.done:,} of {progress.total:,} {unit}"]
    if progress.failed:
        parts.append(f"{progress.failed:,} failed")
    if progress.rate_per_s and not progress.ended:
        parts.append(f"{progress.rate_per_s:,.0f} {unit}/s")
        parts.append(f"{(progress.total - progress.done) / progress.rate_per_s:,.0f} s to go")
    elif progress.running_s:
        parts.append(running_s)
    return ", ".join(parts)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
