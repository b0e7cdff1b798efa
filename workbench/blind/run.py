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
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from workbench import __version__
from workbench.blind.make import validation
from workbench.blind.seal import (
    CAMPAIGNS,
    Entry,
    append,
    check_campaign,
    compare,
    entries,
    head_of,
    manifest_hash,
    read_manifest,
    sha256,
)
from workbench.core.errors import InputError
from workbench.core.input_file import read_input
from workbench.diagnose.diagnose import Diagnosis, diagnose
from workbench.diagnose.hypotheses.settings import MOST_EFFECTS
from workbench.logs import read_campaign
from workbench.machines import plant_of


@dataclass(frozen=True)
class Answer:
    """The diagnosis' answer beside what it weighed; nothing here knows the label.

    word: the verdict; "refused" where it took the runs for unfit, "failed" where it broke down: `warnings` says why.
    weighed: a row for each hypothesis: names, merit, and how it fits. counted: names and merit of those that took part
    in the ranking, no names for what speaks for an unknown cause. twins: groups of hypotheses that differ in name only:
    the ranking has the first of each. evidence: what speaks for an unknown cause besides. estimates:
    effect -> name -> (value, standard error). held_out: names and held-out rms, N m (N), of the best fits, and of none.
    places: subsystem and probability. explained: share of the gap's energy. events: run, from_s, to_s of each that the
    answer says. none: chi2 and prior without any effect, samples. sparse: what sparse regression of the residual
    names, None where pysindy is not installed.
    """

    folder: str
    word: str
    names: tuple[str, ...] = ()
    alike: tuple[str, ...] = ()
    ranking: list[tuple[str, list[str], float]] = field(default_factory=list)
    twins: list[list[list[str]]] = field(default_factory=list)
    weighed: list[dict[str, Any]] = field(default_factory=list)
    counted: list[tuple[list[str], float]] = field(default_factory=list)
    evidence: Mapping[str, float] = field(default_factory=dict)
    estimates: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    held_out: list[tuple[list[str], float]] = field(default_factory=list)
    before: float = 0.0
    after: float = 0.0
    noise: float = 0.0
    subsystem: str = ""
    regime: str = ""
    windows: list[tuple[str, float, float]] = field(default_factory=list)
    cpu_s: float = 0.0
    wall_s: float = 0.0
    kind: str = ""
    places: list[tuple[str, float]] = field(default_factory=list)
    events: list[tuple[str, float, float]] = field(default_factory=list)
    explained: float | None = None
    none: Mapping[str, float] = field(default_factory=dict)
    next_run: Mapping[str, Any] | None = None
    sparse: tuple[str, ...] | None = None
    warnings: tuple[str, ...] = ()


def answer(folder: Path, most_effects: int = MOST_EFFECTS) -> Answer:
    """Diagnose one campaign."""
    cpu, wall = time.process_time(), time.monotonic()

    def spent() -> dict[str, Any]:
        return {"cpu_s": time.process_time() - cpu, "wall_s": time.monotonic() - wall}

    try:
        diagnosis = diagnose(read_campaign(folder), most_effects=most_effects, study=False)
        return _kept(diagnosis, folder, spent())
    except InputError as error:
        word, why = "refused", str(error)
    except Exception:  # a defect is an answer that counts as wrong, and no reason to lose the others
        word, why = "failed", traceback.format_exc(limit=-3)
    return Answer(folder.name, word, ranking=[(word, [], 1.0)], warnings=(why,), **spent())


def _kept(d: Diagnosis, folder: Path, spent: Mapping[str, Any]) -> Answer:
    base = d.search.base
    return Answer(
        folder=folder.name,
        word=d.verdict.word,
        names=d.verdict.effects,
        alike=d.verdict.alike,
        ranking=[(row.verdict, list(row.effects), row.probability) for row in d.verdict.ranking[:8]],
        twins=[[list(names) for names in group] for group in d.judged.groups],
        weighed=[_weighed(w, len(base.z)) for w in d.judged.weighed],
        counted=[(list(names), merit) for names, merit in d.judged.counted],
        evidence=dict(d.judged.signs),
        estimates={
            name: {e.name: (e.value, e.std_error) for e in rows}
            for name, rows in (d.candidates[0].parameters if d.candidates else {}).items()
        },
        held_out=[
            ([], d.shrink.before),
            *((list(row.effects), row.held_out_rms) for row in d.candidates if row.held_out_rms is not None),
        ],
        before=d.shrink.before,
        after=d.shrink.after,
        noise=d.shrink.noise,
        subsystem=d.where.subsystem if d.where else "",
        regime=d.where.regime if d.where else "",
        windows=[(w.run, w.from_s, w.to_s) for w in d.where.windows] if d.where else [],
        kind=plant_of(d.campaign.machine).kind.partition("-")[0],
        places=[(place.subsystem, place.probability) for place in (d.where.places if d.where else ())],
        events=[(event.run, event.from_s, event.to_s) for event in (d.where.events if d.where else ())],
        explained=d.verdict.explained,
        none={"chi2": base.chi2, "prior": base.prior, "samples": d.search.problem.samples},
        next_run=d.next_run.record if d.next_run else None,
        sparse=_sparse(d),
        warnings=tuple(map(str, d.warnings)),
        **spent,
    )


def _sparse(d: Diagnosis) -> tuple[str, ...] | None:
    """In a checkout with pysindy."""
    try:
        named: tuple[str, ...] | None = validation("baselines").sparse_regression(d.search)
    except InputError:
        return None
    return named


def _weighed(w: Any, base: int) -> dict[str, Any]:
    """base: number of the machine's own parameters in every fit."""
    return {
        "names": [] if w.rival else list(w.names),
        "merit": w.evidence,
        "fit": list(w.names),
        "chi2": w.fit.chi2,
        "prior": w.fit.prior,
        "parameters": len(w.fit.z) - base,
    }


def text_of(kept: Answer) -> str:
    return json.dumps(asdict(kept), default=float)


def save(text: str, file: Path) -> None:
    """Whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(".part")
    part.write_text(text, encoding="utf-8")
    os.replace(part, file)


def load(folder: Path) -> dict[str, dict[str, Any]]:
    """name -> all answers of a folder, in the order of their names."""
    return {file.stem: json.loads(read_input(file, "json")) for file in sorted(folder.glob("*.json"))}


# Sealed campaigns diagnosed: each in a process and a folder that hold its own files and nothing else.


ANSWERS, LOCK = "answers", ".run.lock"
Tell = Callable[[str], None]
Diagnose = Callable[[Path], str]  # a campaign's folder -> its answer, as JSON


@dataclass(frozen=True)
class Ran:
    """How many of the campaigns have an answer: of all, before this call and after it. head: of the ledger's chain."""

    cases: int
    kept: int
    done: int
    head: str = ""


def run(
    folder: Path,
    *,
    processes: int = 2,
    count: int | None = None,
    most_effects: int = MOST_EFFECTS,
    tell: Tell = lambda line: None,
    diagnose: Diagnose | None = None,
    cluster: str | None = None,
) -> Ran:
    """Diagnose what has no answer yet; each answer is kept as soon as it is there, so a stop loses those in work.

    count: of campaigns, the first ones. diagnose: what stands in for the diagnosis, in tests. cluster: Dask's address,
    or local:N; the workers get each campaign's files and nothing else.
    InputError where a campaign was changed since sealing, and while another process runs this folder.
    """
    manifest = read_manifest(folder)
    wanted = sorted(manifest.cases)[:count]
    with _alone(folder):
        found = entries(folder)
        if found and not found[0].chain:
            raise InputError("was begun by a version without a chain of hashes; go on with that one", file=folder)
        compare(folder, found, None)
        kept = [name for name in wanted if answer_file(folder, name).exists()]
        todo = [name for name in wanted if name not in kept]
        for name in todo:
            check_campaign(folder, name, manifest.cases[name])
        begun, done = time.monotonic(), 0
        if kept and todo:
            tell(f"goes on after {len(kept)} of {len(wanted)}")
        how = diagnose or partial(answered, most_effects=most_effects)
        given = _answers(folder, todo, processes, how) if cluster is None else _on_cluster(folder, todo, cluster, how)
        for name, text in given:
            _keep(folder, found, name, text)
            done += 1
            each_s = (time.monotonic() - begun) / done
            left = each_s * (len(todo) - done)
            tell(f"{len(kept) + done}/{len(wanted)} campaign {name}: {_said(text)}; {left / 60.0:.0f} min left")
        return Ran(len(manifest.cases), len(kept), len(kept) + done, head_of(folder, found))


def answered(folder: Path, most_effects: int = MOST_EFFECTS) -> str:
    """The answer to one campaign, as JSON."""
    return text_of(answer(folder, most_effects=most_effects))


def answer_file(folder: Path, name: str) -> Path:
    return folder / ANSWERS / f"{name}.json"


def _keep(folder: Path, found: list[Entry], name: str, text: str) -> None:
    """The ledger first: an answer without its line would count as changed."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    append(folder, found, Entry(name, sha256(text.encode()), now, __version__, manifest_hash(folder)))
    save(text, answer_file(folder, name))


def _said(text: str) -> str:
    row = json.loads(text)
    names = "+".join(row["names"]) or row["word"].replace("_", " ")
    probability = row["ranking"][0][2] if row["ranking"] else 0.0
    return f"{names} ({probability:.2f}), {row['cpu_s']:.0f} s"


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    try:
        lock = FileLock(folder / LOCK, timeout=0).acquire()
    except Timeout:
        raise InputError("another `workbench blind run` works in this folder", file=folder) from None
    with lock:
        yield


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


def _on_cluster(folder: Path, names: Sequence[str], cluster: str, diagnose: Diagnose) -> Iterator[tuple[str, str]]:
    if not names:
        return
    from workbench.study.cluster import client_on, each_on

    def files_of(name: str) -> dict[str, bytes]:
        campaign = folder / CAMPAIGNS / name
        return {p.relative_to(campaign).as_posix(): read_input(p, "log") for p in campaign.rglob("*") if p.is_file()}

    with client_on(cluster) as client:
        task = partial(_answered_elsewhere, __version__, diagnose)
        yield from each_on(client, cluster, names, lambda name: (task, name, files_of(name)))


def _answered_elsewhere(version: str, diagnose: Diagnose, name: str, files: Mapping[str, bytes]) -> str:
    """On a worker: the campaign's files in a folder of their own, diagnosed there. InputError for another version."""
    if version != __version__:
        raise InputError(f"a worker has workbench {__version__}, expected {version}")
    with tempfile.TemporaryDirectory(prefix="workbench-blind-") as temporary:
        for path, data in files.items():
            file = Path(temporary) / name / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
        return diagnose(Path(temporary) / name)
