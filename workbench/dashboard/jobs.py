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
  said.json     how far it is; the last word holds the exit status
  stderr.txt    messages and errors
  stopping      when it was asked to stop
  result/       what the work made; view.json beside it: what the page shows
"""

from __future__ import annotations

import atexit
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
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeGuard, TypeVar

import streamlit as st
from pydantic import TypeAdapter, ValidationError
from pydantic_core import from_json

from workbench.core.errors import InputError
from workbench.core.input_file import read_input
from workbench.dashboard.widgets import guarded, plain, problem

INPUTS = "inputs"  # the folder of the inputs' copies, as the worker, which stands beside it, finds it
FOLDER, VIEW, SAID = "jobs", "view.json", "said.json"
KEEP_S = 7 * 24 * 3600.0
MOST_RUNNING, MOST_RUNNING_IN_ALL = 2, 8  # of one workspace at a time; of all
NICER = 10  # the page and its sliders go first
BAD_INPUT, INTERRUPTED = 2, 130
TOLD_EVERY_S, LOOKS_EVERY_S = 0.2, 0.5  # by the worker; by a page's card
COLOURS = {"running": "blue", "stopping": "orange", "done": "green", "stopped": "gray", "failed": "red"}
KILLED = "The worker ended without a word: it was killed, or the computer ran out of memory."
T = TypeVar("T")

_ID = re.compile(r"[A-Za-z0-9_-]{16,64}")
_running: list[subprocess.Popen[bytes]] = []
_mutex = threading.Lock()


@dataclass(frozen=True)
class Job:
    """kind: the page that it belongs to. call: "module:function". begun_s: since the epoch."""

    folder: Path
    kind: str
    title: str
    call: str
    arguments: Mapping[str, Any]
    begun_s: float

    @property
    def id(self) -> str:
        return self.folder.name

    def file(self, name: str) -> Path:
        return self.folder / name

    def write(self) -> None:
        self.file(INPUTS).mkdir(parents=True, mode=0o700)
        record = {key: value for key, value in asdict(self).items() if key != "folder"}
        self.file("job.json").write_text(json.dumps(record), encoding="utf-8")


@dataclass(frozen=True)
class Progress:
    """stage, done of total: as the worker counts; total 0 where it does not. failed: of those done.

    sentence: the latest line, or why it ended. rate_per_s: 0 where it is not known. running_s: since it was started.
    """

    state: str = "running"
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
    """The worker's side: writes progress a few times a second, and always a stage's beginning and end."""

    def __init__(self, job: Job) -> None:
        self.path, self.next_s = job.file(SAID), 0.0
        self.said: dict[str, Any] = {}

    def __call__(self, stage: str, done: int = 0, total: int = 0, failed: int = 0, rate_per_s: float = 0.0) -> None:
        now = time.monotonic()
        if stage != self.said.get("stage") or done >= total or now >= self.next_s:
            self.next_s = now + TOLD_EVERY_S
            self.said = {"stage": stage, "done": done, "total": total, "failed": failed, "rate_per_s": rate_per_s}
            self.write()

    def write(self, **more: Any) -> None:
        part = self.path.with_suffix(".part")
        part.write_text(json.dumps(self.said | more), encoding="utf-8")
        part.replace(self.path)  # whole, whenever it is read


def new_id() -> str:
    """A name that nobody guesses: 128 bits."""
    return secrets.token_urlsafe(16)


def is_id(text: object) -> TypeGuard[str]:
    """Whether a text, such as one from a URL, has the form of an id; only then may it become a path."""
    return isinstance(text, str) and _ID.fullmatch(text) is not None


# ---- start, stop, find again --------------------------------------------------------------------------------------


def start(
    kind: str, call: str, arguments: Mapping[str, Any], workspace: Path, title: str = "",
    inputs: Mapping[str, Path | str] | None = None,
) -> Job:  # fmt: skip
    """Starts work in a process group of its own. arguments: what JSON can hold. inputs: the page's own name -> file or
    folder, of which the job gets a copy, for it may outlive the session; or a text. InputError when too much is running
    already."""
    with _mutex:
        _check_room(workspace)
        clean(workspace)
        job = Job(workspace.resolve() / FOLDER / new_id(), kind, title or kind, call, arguments, time.time())
        try:
            job.write()
            for name, source in (inputs or {}).items():
                copy = job.file(INPUTS) / name
                if isinstance(source, str):
                    copy.write_text(source, encoding="utf-8")
                else:
                    (shutil.copytree if source.is_dir() else shutil.copyfile)(source, copy)
        except OSError as error:
            shutil.rmtree(job.folder, ignore_errors=True)
            raise InputError(f"no job can be started there: {error.strerror or error}", file=workspace) from error
        _launch(job)
    return job


def jobs_of(workspace: Path | None, kind: str | None = None) -> list[Job]:
    """The jobs of a workspace, the newest first."""
    jobs = []
    for folder in [] if workspace is None else workspace.resolve().glob(f"{FOLDER}/*"):
        with suppress(InputError, OSError, ValueError, TypeError):
            jobs.append(Job(folder, **json.loads(read_input(folder / "job.json", "json"))))
    return sorted((job for job in jobs if kind in (None, job.kind)), key=lambda job: -job.begun_s)


def is_alive(job: Job) -> bool:
    """Whether the worker lives: it holds a lock that the system lets go of when it dies, however it dies."""
    with suppress(FileNotFoundError), job.file("alive").open("rb") as file:
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
        for name in (SAID, "stopping"):
            job.file(name).unlink(missing_ok=True)
        _launch(job)


def stop(job: Job) -> None:
    """Asks it to stop as Ctrl-C does, so that it keeps what can be resumed; asked again it is ended, with what it has
    started."""
    if is_alive(job):
        asked = job.file("stopping").exists()
        job.file("stopping").touch()
        with suppress(OSError, ValueError):
            os.killpg(int(job.file("alive").read_text()), signal.SIGKILL if asked else signal.SIGINT)


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


def poll(job: Job) -> Progress:
    """How far it is, or how it ended."""
    alive = is_alive(job)  # asked first: the exit status is the last that a living worker writes
    told, last = dict[str, Any](), ""
    with suppress(FileNotFoundError):
        told = json.loads(job.file(SAID).read_bytes())
    with suppress(FileNotFoundError):
        last = job.file("stderr.txt").read_text("utf-8", errors="replace").strip().rpartition("\n")[2].strip()
    # Where the server keeps a job is its own affair.
    for folder in (str(job.folder), INPUTS, str(job.arguments.get("folder", INPUTS))):
        last = last.replace(f"{folder}/", "").replace(folder, Path(folder).name)
    asked, status = job.file("stopping").exists(), told.pop("ended", None)
    began_s = job.file("alive").stat().st_mtime if job.file("alive").exists() else job.begun_s
    now = Progress(**{"running_s": max(told.pop("at_s", time.time()) - began_s, 0.0)} | told)
    if alive:
        return replace(now, state="stopping" if asked else "running", sentence=last or now.stage)
    if status == 0:
        return replace(now, state="done", sentence="Done.")
    if asked or status == INTERRUPTED:
        return replace(now, state="stopped", sentence="Stopped.")
    why = KILLED if status is None else last.removeprefix("error: ") or f"It ended with exit status {status}."
    return replace(now, state="failed", sentence=why)


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
    for process in _running:
        if process.poll() is None:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGINT)


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
    job, status = Job(folder, **json.loads((folder / "job.json").read_bytes())), 1
    tell = Teller(job)
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
    halted, opens = progress.state in ("stopped", "failed"), bool(open_key) and progress.state == "done"
    buttons: list[tuple[bool, str, str, str, Callable[[], Any]]] = [
        (not progress.ended, "End now" if progress.state == "stopping" else "Stop", "stop", "stop", lambda: stop(job)),
        (opens, "Open", "open", "bar_chart", lambda: st.session_state.update({open_key: job.id})),
        (halted, "Resume" if progress.done else "Try again", "resume", "resume", lambda: restart(job)),
        (progress.ended, "Remove", "remove", "delete", lambda: remove(job)),
    ]
    with st.container(horizontal=True, horizontal_alignment="distribute", vertical_alignment="center"):
        badge = f":{COLOURS[progress.state]}-badge[{progress.state}]"
        st.markdown(f"**{plain(job.title)}** {badge} :small[{plain(said)}]", width="content")
        with st.container(horizontal=True, width="content"):
            for there, word, key, icon, action in buttons:
                off = there and key == "open" and st.session_state.get(open_key) == job.id
                if there and st.button(word, key=f"{key} {job.id}", disabled=off, icon=f":material/{icon}:"):
                    with guarded(stop=False):
                        action()
                        st.rerun()
    if not progress.ended or (progress.state == "stopped" and progress.total):
        st.progress(progress.share)
    if not progress.ended and stages:
        now = int(progress.share * len(stages))
        done, doing, to_come = ":green[:material/check_circle:] {}", ":blue[:material/pending: **{}**]", ":gray[{}]"
        forms = [done] * now + [doing] + [to_come] * len(stages)
        st.markdown("  \n".join(form.format(stage) for form, stage in zip(forms, stages, strict=False)))
    if progress.state == "failed":
        problem(InputError(progress.sentence))


def counts(progress: Progress, unit: str = "") -> str:
    """`1,024 of 1,280 runs, 3 failed, 410 runs/s, 2 s to go`; the stage where nothing is counted in a unit."""
    running = f", {progress.running_s:,.0f} s" if progress.running_s else ""
    if not unit or progress.total <= 1:
        said = progress.stage or (not progress.ended and progress.sentence) or "getting ready"
        return said if progress.ended else f"{said}{running}"
    of = "" if progress.ended and progress.done == progress.total else f"{progress.done:,} of "
    said = f"{of}{progress.total:,} {unit}" + (f", {progress.failed:,} failed" if progress.failed else "")
    if progress.ended or not progress.rate_per_s:
        return said + running
    left_s = (progress.total - progress.done) / progress.rate_per_s
    return f"{said}, {progress.rate_per_s:,.0f} {unit}/s, {left_s:,.0f} s to go"


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
