"""Sealed campaigns diagnosed: each in a process and a folder that hold its own files and nothing else."""

from __future__ import annotations

import json
import os
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from workbench import __version__
from workbench.blind import seal
from workbench.blind.make import Tell, mapped, validation
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
    weighed: a row for each hypothesis: names, merit, and how it fits. barred: names of those that
    may not be named; bars: why, by names joined with + (`judge.bar`). counted: names and merit of those that took part
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
    barred: list[list[str]] = field(default_factory=list)
    bars: Mapping[str, str] = field(default_factory=dict)
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
        barred=[list(w.names) for w in d.judged.barred],
        bars={"+".join(names): why for names, why in d.judged.bars.items()},
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
    manifest = seal.read_manifest(folder)
    wanted = sorted(manifest.cases)[:count]
    with _alone(folder):
        found = seal.entries(folder)
        if found and not found[0].chain:
            raise InputError("was begun by a version without a chain of hashes; go on with that one", file=folder)
        seal.compare(folder, found, None)
        kept = [name for name in wanted if answer_file(folder, name).exists()]
        todo = [name for name in wanted if name not in kept]
        for name in todo:
            seal.check_campaign(folder, name, manifest.cases[name])
        begun, done = time.monotonic(), 0
        if kept and todo:
            tell(f"goes on after {len(kept)} of {len(wanted)}")
        given = _answers(folder, todo, processes, cluster, diagnose or partial(answered, most_effects=most_effects))
        for name, text in given:
            now = datetime.now(UTC).isoformat(timespec="seconds")
            # The ledger first: an answer without its line would count as changed.
            entry = seal.Entry(name, seal.sha256(text.encode()), now, __version__, seal.manifest_hash(folder))
            seal.append(folder, found, entry)
            save(text, answer_file(folder, name))
            done += 1
            each_s = (time.monotonic() - begun) / done
            left = each_s * (len(todo) - done)
            tell(f"{len(kept) + done}/{len(wanted)} campaign {name}: {_said(text)}; {left / 60.0:.0f} min left")
        return Ran(len(manifest.cases), len(kept), len(kept) + done, seal.head_of(folder, found))


def answered(folder: Path, most_effects: int = MOST_EFFECTS) -> str:
    """The answer to one campaign, as JSON."""
    return text_of(answer(folder, most_effects=most_effects))


def answer_file(folder: Path, name: str) -> Path:
    return folder / ANSWERS / f"{name}.json"


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


def _answers(
    folder: Path, names: Sequence[str], processes: int, cluster: str | None, diagnose: Diagnose
) -> Iterator[tuple[str, str]]:
    """Each as soon as it is there. A campaign's files in a folder of their own are all that its process knows."""
    if not names:
        return
    task = partial(_answered_apart, __version__, diagnose)

    def sent(name: str) -> tuple[str, dict[str, bytes]]:
        campaign = folder / seal.CAMPAIGNS / name
        files = (path for path in campaign.rglob("*") if path.is_file())
        return name, {path.relative_to(campaign).as_posix(): read_input(path, "log") for path in files}

    if cluster is None:
        with (
            tempfile.TemporaryDirectory(prefix="workbench-blind-") as room,
            mapped(min(processes, len(names)), room) as over,
        ):
            yield from over(partial(task, room=room), map(sent, names))
        return
    from workbench.study.cluster import client_on, each_on

    with client_on(cluster) as client:
        yield from (answer for _, answer in each_on(client, cluster, names, lambda name: (task, sent(name))))


def _answered_apart(
    version: str, diagnose: Diagnose, sent: tuple[str, Mapping[str, bytes]], room: str | None = None
) -> tuple[str, str]:
    """A campaign's name and answer, from its files in a folder of their own. InputError for another version."""
    if version != __version__:
        raise InputError(f"a worker has workbench {__version__}, expected {version}")
    name, files = sent
    with tempfile.TemporaryDirectory(prefix="workbench-blind-", dir=room) as temporary:
        for path, data in files.items():
            file = Path(temporary) / name / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
        return name, diagnose(Path(temporary) / name)
