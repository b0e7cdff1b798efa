"""One campaign diagnosed and kept: what scoring, and weighing anew with other numbers, need of it."""

from __future__ import annotations

import json
import os
import time
import traceback
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from workbench.blind.make import validation
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
