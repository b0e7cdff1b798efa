"""Sealed campaigns diagnosed: each in a process and a folder that hold its own files and nothing else."""

from __future__ import annotations

import itertools
import json
import multiprocessing
import os
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from filelock import FileLock, Timeout

from workbench import __version__
from workbench.blind.answer import answer, save, text_of
from workbench.blind.seal import CAMPAIGNS, MANIFEST, Manifest, check_campaign, read_manifest, sha256
from workbench.errors import InputError

ANSWERS, LEDGER, LOCK = "answers", "answers.jsonl", ".run.lock"
Tell = Callable[[str], None]
Diagnose = Callable[[Path], str]  # a campaign's folder -> its answer, as JSON


@dataclass(frozen=True)
class Ran:
    """How many of the campaigns have an answer: of all, before this call and after it."""

    cases: int
    kept: int
    done: int


@dataclass(frozen=True)
class Entry:
    """A line of the ledger: the hash of an answer as it was written, when, by which version, of which manifest."""

    case: str
    sha256: str
    at: str
    version: str
    manifest: str


def run(
    folder: Path,
    *,
    processes: int = 2,
    count: int | None = None,
    most_effects: int = 2,
    tell: Tell = lambda line: None,
    diagnose: Diagnose | None = None,
) -> Ran:
    """Diagnose what has no answer yet; each answer is kept as soon as it is there, so a stop loses those in work.

    count: of campaigns, the first ones. diagnose: what stands in for the diagnosis, in tests.
    InputError where a campaign was changed since sealing, and while another process runs this folder.
    """
    manifest = read_manifest(folder)
    wanted = sorted(manifest.cases)[:count]
    with _alone(folder):
        kept = [name for name in wanted if answer_file(folder, name).exists()]
        todo = [name for name in wanted if name not in kept]
        for name in todo:
            check_campaign(folder, name, manifest.cases[name])
        begun, done = time.monotonic(), 0
        if kept and todo:
            tell(f"goes on after {len(kept)} of {len(wanted)}")
        for name, text in _answers(folder, todo, processes, diagnose or partial(answered, most_effects=most_effects)):
            _keep(folder, manifest, name, text)
            done += 1
            each_s = (time.monotonic() - begun) / done
            left = each_s * (len(todo) - done)
            tell(f"{len(kept) + done}/{len(wanted)} campaign {name}: {_said(text)}; {left / 60.0:.0f} min left")
        return Ran(len(manifest.cases), len(kept), len(kept) + done)


def answered(folder: Path, most_effects: int = 2) -> str:
    """The answer to one campaign, as JSON."""
    return text_of(answer(folder, most_effects=most_effects))


def answer_file(folder: Path, name: str) -> Path:
    return folder / ANSWERS / f"{name}.json"


def ledger(folder: Path) -> dict[str, Entry]:
    """case -> its last line. InputError where the file is damaged."""
    path = folder / LEDGER
    try:
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        return {entry.case: entry for entry in (Entry(**json.loads(line)) for line in lines if line.strip())}
    except (ValueError, TypeError) as error:
        raise InputError("is damaged, expected what `workbench blind run` wrote", file=path) from error


def _keep(folder: Path, manifest: Manifest, name: str, text: str) -> None:
    """The ledger first: an answer without its line would count as changed."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    entry = Entry(name, sha256(text.encode()), now, __version__, sha256((folder / MANIFEST).read_bytes()))
    with (folder / LEDGER).open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(vars(entry)) + "\n")
    save(text, answer_file(folder, name))


def _said(text: str) -> str:
    row = json.loads(text)
    names = "+".join(row["names"]) or row["word"].replace("_", " ")
    probability = row["ranking"][0][2] if row["ranking"] else 0.0
    return f"{names} ({probability:.2f}), {row['cpu_s']:.0f} s"


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    lock = FileLock(folder / LOCK)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise InputError("another `workbench blind run` works in this folder", file=folder) from None
    try:
        yield
    finally:
        lock.release()


def _answers(folder: Path, names: Sequence[str], processes: int, diagnose: Diagnose) -> Iterator[tuple[str, str]]:
    """Each as soon as it is there. A campaign is copied to a folder of its own, which is all that its process knows."""
    if not names:
        return
    with tempfile.TemporaryDirectory(prefix="workbench-blind-") as temporary:
        if processes > 1 and len(names) > 1:
            yield from _in_processes(folder, names, temporary, min(processes, len(names)), diagnose)
            return
        for name in names:
            room = _room(folder, temporary, name)
            yield name, diagnose(room)
            shutil.rmtree(room)


def _room(folder: Path, temporary: str, name: str) -> Path:
    room = Path(temporary) / name
    shutil.copytree(folder / CAMPAIGNS / name, room)
    return room


def _in_processes(
    folder: Path, names: Sequence[str], temporary: str, processes: int, diagnose: Diagnose
) -> Iterator[tuple[str, str]]:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read by the processes as they start
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _settle, (temporary,))
    waiting, running = iter(names), dict[Future[str], Path]()
    try:
        while True:
            for name in itertools.islice(waiting, 2 * processes - len(running)):
                room = _room(folder, temporary, name)
                running[pool.submit(diagnose, room)] = room
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                room = running.pop(future)
                yield room.name, future.result()
                shutil.rmtree(room)
    except BrokenProcessPool as error:
        raise InputError(
            "a process ended in the middle of a diagnosis, perhaps for want of memory; what was answered is kept, the "
            "same command goes on, with one process in less memory"
        ) from error
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()


def _settle(temporary: str) -> None:
    """A process of the pool: it stands in the temporary folder; Ctrl-C is the parent's to hear."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.chdir(temporary)
